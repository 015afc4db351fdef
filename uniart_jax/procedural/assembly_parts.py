"""Parts of assemblies: what sits on a face of its parent and moves there by one kind of joint."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.procedural import materials
from uniart_jax.procedural.fitting import AIR, Candidate, Piece
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
    screw,
    slide,
    tray,
    turn,
    union,
)

CUES = 0.75  # share of the joints that show how they work


def random_material(rng: np.random.Generator) -> Material:
    """Any of the materials, or one plain colour."""
    if rng.random() < 0.25:
        return materials.plain(rng.uniform(0.1, 0.95, 3))
    kinds = (materials.paint, materials.wood, materials.metal, materials.dark)
    return kinds[rng.choice(4, p=[0.5, 0.22, 0.15, 0.13])](rng)


def random_finish(rng: np.random.Generator, palette: list[Material]) -> Material:
    """Mostly a material of the assembly's palette."""
    return palette[rng.integers(len(palette))] if rng.random() < 0.75 else random_material(rng)


def make_solid(rng: np.random.Generator, lo, hi, kind: str, axis: int) -> Manifold:
    """A solid that fills a box: 'box', 'round' or 'hex' about ``axis``, 'frame' open along its
    thinnest side, 'tray'."""
    size = hi - lo
    if kind == "round":
        u, v = (axis + 1) % 3, (axis + 2) % 3
        radius = 0.499 * min(size[u], size[v])
        if rng.random() < 0.3:
            radius *= float(rng.uniform(0.3, 0.9))
        outline = rounded(size[u], size[v], radius, 6)
        at = (lo + hi) / 2
        at[axis] = lo[axis]
        return extrusion(outline, "xyz"[axis], at, size[axis])
    if kind == "frame":
        thin = int(np.argmin(size))
        wall = float(rng.uniform(0.15, 0.3)) * np.partition(size, 1)[1]
        hole_lo, hole_hi = lo + wall, hi - wall
        hole_lo[thin], hole_hi[thin] = lo[thin] - 1, hi[thin] + 1
        return box(lo, hi) - box(hole_lo, hole_hi)
    if kind == "tray":
        wall = float(rng.uniform(0.08, 0.16)) * size.min()
        return tray(lo, hi, wall)
    return box(lo, hi)


def _span(s: int, start: float, h: float) -> tuple[float, float]:
    """Ends of a stretch of ``h`` that leaves the plane at ``start`` by direction s."""
    return (start, start + h) if s > 0 else (start - h, start)


def _box_on(seat: Piece, i: int, s: int, size: np.ndarray, place: np.ndarray):
    """Corners of a box of ``size`` that sits on face (i, s), its middle at ``place`` in the other
    axes."""
    lo, hi = place - size / 2, place + size / 2
    lo[i], hi[i] = _span(s, (seat.hi if s > 0 else seat.lo)[i] + s * AIR, size[i])
    return lo, hi


def _place(rng, seat: Piece, i: int, size: np.ndarray) -> np.ndarray:
    """A middle for a box of ``size`` on a face: in the centre, flush with an edge, or anywhere
    within."""
    place = (seat.lo + seat.hi) / 2
    for axis in range(3):
        if axis == i:
            continue
        slack = max((seat.hi - seat.lo)[axis] - size[axis], 0.0) / 2
        place[axis] += slack * float(rng.choice([0, 0, -1, 1, rng.uniform(-1, 1)]))
    return place


def _axis(i: int, s: float = 1.0) -> np.ndarray:
    out = np.zeros(3)
    out[i] = s
    return out


def _about_normal(rng, at, i: int) -> Joint:
    """A turn about the normal of a face: without end, or between stops."""
    if rng.random() < 0.5:
        return turn(at, _axis(i))
    angle = float(np.deg2rad(rng.uniform(40, 300)))
    return hinge(at, _axis(i, float(rng.choice([-1, 1]))), angle)


def turning(rng, seat: Piece, parent, i: int, s: int, palette, arm=False) -> Candidate | None:
    """A part that turns on a face: about its middle, or an arm about a pin near its end."""
    room = seat.hi - seat.lo
    j, k = [a for a in range(3) if a != i]
    size = np.zeros(3)
    size[i] = float(rng.uniform(0.04, 0.35)) if rng.random() < 0.7 else float(rng.uniform(0.3, 0.8))
    if arm:
        j, k = (j, k) if rng.random() < 0.5 else (k, j)
        size[j] = float(rng.uniform(0.3, 1.1)) * max(room[j], 0.4)
        size[k] = min(float(rng.uniform(0.15, 0.4)) * size[j], 0.9 * room[k])
        size[i] = min(size[i], 0.7 * size[k] + 0.03)
    else:
        size[j] = float(rng.uniform(0.25, 1.0)) * room[j]
        size[k] = size[j] if rng.random() < 0.6 else float(rng.uniform(0.25, 1.0)) * room[k]
        size[k] = min(size[k], room[k])
    if size[[j, k]].min() < 0.05:
        return None
    place = _place(rng, seat, i, size)
    shift = 0.0
    if arm:  # the pin near one end
        way = float(rng.choice([-1, 1]))
        pin = place[j]
        shift = way * (size[j] / 2 - 0.5 * size[k])
        lim = (seat.hi - seat.lo)[j] / 2 - 0.4 * min(size[k], room[j])
        middle = (seat.lo + seat.hi)[j] / 2
        pin = float(np.clip(pin, middle - lim, middle + lim))
        place[j] = pin + shift
    lo, hi = _box_on(seat, i, s, size, place)
    form = str(rng.choice(["box", "round", "frame"], p=[0.45, 0.45, 0.1]))
    if arm and form == "frame":
        form = "box"
    solids = [(make_solid(rng, lo, hi, form, i), random_finish(rng, palette))]
    at = (lo + hi) / 2
    at[j] -= shift
    if form != "frame" and rng.random() < CUES:  # the head of the pin
        r, tall = 0.28 * min(size[j], size[k]), max(0.25 * size[i], 0.02)
        start = at.copy()
        start[i] = min(_span(s, (hi if s > 0 else lo)[i], tall))
        solids.append((cylinder("xyz"[i], start, tall, r, segments=16), materials.hardware(rng)))
    return Candidate(Piece(lo, hi, solids, parent, _about_normal(rng, at, i)))


def flap(rng, seat: Piece, parent, i: int, s: int, palette) -> Candidate | None:
    """A plate or block on a face, hinged along one of the edges that it touches the face with."""
    room = seat.hi - seat.lo
    j, k = [a for a in range(3) if a != i]
    j, k = (j, k) if rng.random() < 0.5 else (k, j)  # hinged along k, opens about it
    size = np.zeros(3)
    whole = rng.random() < 0.4
    size[j] = room[j] * (1.0 if whole else float(rng.uniform(0.3, 1.0)))
    size[k] = room[k] * (1.0 if whole or rng.random() < 0.4 else float(rng.uniform(0.3, 1.0)))
    size[i] = (
        float(rng.uniform(0.03, 0.12)) if rng.random() < 0.75 else float(rng.uniform(0.1, 0.5))
    )
    if size[[j, k]].min() < 0.07:
        return None
    place = _place(rng, seat, i, size)
    way = 1 if rng.random() < 0.5 else -1
    flush = rng.random() < 0.7
    edge = (seat.hi if way > 0 else seat.lo)[j]
    if flush:
        place[j] = edge - way * size[j] / 2
    lo, hi = _box_on(seat, i, s, size, place)
    at = (lo + hi) / 2
    at[j] = (hi if way > 0 else lo)[j]
    at[i] = (lo if s > 0 else hi)[i]
    flush = abs(at[j] - edge) < 1e-9
    most = 175.0 if flush else 88.0
    angle = float(np.deg2rad(rng.uniform(35, most)))
    axis = np.cross(_axis(i, s), _axis(j, way))  # carries the normal towards the edge
    form = str(rng.choice(["box", "frame", "tray", "round"], p=[0.7, 0.12, 0.06, 0.12]))
    if form == "tray" and i != 2:
        form = "box"
    solids = [(make_solid(rng, lo, hi, form, i), random_finish(rng, palette))]
    r = min(0.6 * size[i], 0.03)
    if form != "round" and flush and rng.random() < CUES:  # barrels beside the edge, about the axis
        at[j] += way * (r + AIR)
        start, bars = at.copy(), []
        tall = float(rng.uniform(0.1, 0.25)) * size[k]
        for share in (0.12, 0.88) if rng.random() < 0.7 else (0.5,):
            start[k] = lo[k] + share * size[k] - tall / 2
            bars.append(cylinder("xyz"[k], start, tall, r, segments=12))
            a, b = start.copy(), start.copy()
            a[i], b[i] = _span(s, at[i] + s * 0.07 * r, 0.73 * r)
            a[j], b[j] = sorted((at[j] + way * 0.15 * r, at[j] - way * (r + AIR)))
            a[k], b[k] = start[k] + 0.08 * tall, start[k] + 0.92 * tall
            bars.append(box(a, b))
        solids.append((union(bars), materials.hardware(rng)))
    return Candidate(Piece(lo, hi, solids, parent, hinge(at, axis, angle)))


def sliding(rng, seat: Piece, parent, i: int, s: int, palette) -> Candidate | None:
    """A block that slides along a face, between rails on some."""
    room = seat.hi - seat.lo
    j, k = [a for a in range(3) if a != i]
    j, k = (j, k) if rng.random() < 0.5 else (k, j)  # slides along j
    size = np.zeros(3)
    size[j] = room[j] * float(
        rng.uniform(0.15, 0.6) if rng.random() < 0.75 else rng.uniform(0.6, 1)
    )
    size[k] = room[k] * float(rng.uniform(0.2, 0.85))
    size[i] = float(rng.uniform(0.04, 0.3))
    if size[[j, k]].min() < 0.05:
        return None
    way = 1 if rng.random() < 0.5 else -1
    place = _place(rng, seat, i, size)
    slack = room[j] - size[j]
    inset = float(rng.choice([0, rng.uniform(0, 0.3)])) * slack
    start = (seat.lo if way > 0 else seat.hi)[j]
    place[j] = start + way * (size[j] / 2 + inset)
    over = float(rng.choice([0, rng.uniform(0.2, 0.7)])) * size[j]
    travel = (slack - inset) * float(rng.uniform(0.6, 1)) + over
    if travel < 0.06:
        return None
    lo, hi = _box_on(seat, i, s, size, place)
    form = str(rng.choice(["box", "round", "frame"], p=[0.65, 0.25, 0.1]))
    finish = random_finish(rng, palette)
    solids = [(make_solid(rng, lo, hi, form, i), finish)]
    found = Candidate(Piece(lo, hi, solids, parent, slide(_axis(j, way), travel)))
    gap = min((lo - seat.lo)[k], (seat.hi - hi)[k])
    if rng.random() < CUES and gap > 0.03:
        rails = []
        wide, tall = min(0.04, gap - 2 * AIR), min(0.5 * size[i], 0.05)
        for side in (lo[k] - AIR - wide, hi[k] + AIR):
            a, b = seat.lo.copy(), seat.hi.copy()
            a[k], b[k] = side, side + wide
            a[i], b[i] = _span(s, (seat.hi if s > 0 else seat.lo)[i], tall)
            rails.append(box(a, b))
        found.add = union(rails)
    return found


def piston(rng, seat: Piece, parent, i: int, s: int, palette) -> Candidate | None:
    """A head on a rod in a bore: slides, turns, or winds."""
    room = seat.hi - seat.lo
    j, k = [a for a in range(3) if a != i]
    if room[i] < 0.12:
        return None
    radius = float(rng.uniform(0.06, 0.25)) * min(room[j], room[k])
    if radius < 0.022:
        return None
    deep = room[i] * float(rng.uniform(0.4, 0.85))
    out = float(rng.choice([0.0, rng.uniform(0.05, 0.5)]))  # of the rod, that shows at rest
    head = np.zeros(3)
    head[j] = radius * 2 * float(rng.uniform(1.3, 3.0))
    head[k] = head[j] if rng.random() < 0.7 else radius * 2 * float(rng.uniform(1.3, 3.0))
    head[i] = float(rng.uniform(0.03, 0.3))
    place = _place(rng, seat, i, np.where(np.arange(3) == i, 0, 2.6 * radius))
    plane = (seat.hi if s > 0 else seat.lo)[i]
    lo, hi = place - head / 2, place + head / 2
    lo[i], hi[i] = _span(s, plane + s * (AIR + out), head[i])
    square = rng.random() < 0.25
    start, bore = place.copy(), place.copy()
    start[i] = min(_span(s, plane - s * deep, deep + out + AIR))
    bore[i] = min(_span(s, plane - s * (deep + 0.02), deep + 0.02))
    long, hollow = deep + out + AIR, deep + 0.02
    if square:
        a, b = start - radius * 0.9, start + radius * 0.9
        a[i], b[i] = start[i], start[i] + long
        rod = box(a, b)
        c, d = bore - radius * 0.9 - AIR, bore + radius * 0.9 + AIR
        c[i], d[i] = bore[i] - (0.01 if s < 0 else 0), bore[i] + hollow + (0.01 if s > 0 else 0)
        hole = box(c, d)
    else:
        rod = cylinder("xyz"[i], start, long, radius, segments=20)
        bore[i] -= 0.01 if s < 0 else 0
        hole = cylinder("xyz"[i], bore, hollow + 0.01, radius + AIR, segments=20)
    form = str(rng.choice(["box", "round"], p=[0.4, 0.6]))
    finish = random_finish(rng, palette)
    body = make_solid(rng, lo, hi, form, i)
    steel = finish if rng.random() < 0.4 else materials.hardware(rng)
    solids = [(body + rod, finish)] if steel is finish else [(body, finish), (rod - body, steel)]
    travel = deep * float(rng.uniform(0.4, 0.85))
    kind = "slide" if square else str(rng.choice(["slide", "screw", "turn"], p=[0.42, 0.33, 0.25]))
    if kind == "slide":
        joint = slide(_axis(i, s), travel)
    elif kind == "screw":
        turns = float(rng.uniform(0.75, 5))
        joint = screw(place, _axis(i, s), turns, travel, left_handed=bool(rng.random() < 0.3))
    else:
        joint = _about_normal(rng, place, i)
    return Candidate(Piece(lo, hi, solids, parent, joint), cut=hole)


def drawer(rng, seat: Piece, parent, i: int, s: int, palette) -> Candidate | None:
    """A block in a pocket of its parent, that pulls out."""
    room = seat.hi - seat.lo
    j, k = [a for a in range(3) if a != i]
    if room[i] < 0.2 or min(room[j], room[k]) < 0.2:
        return None
    size = np.zeros(3)
    for axis in (j, k):
        size[axis] = room[axis] * float(rng.uniform(0.3, 0.85))
    size[i] = room[i] * float(rng.uniform(0.4, 0.85))
    proud = float(rng.choice([0.0, rng.uniform(0.01, 0.08), -0.01]))
    place = (seat.lo + seat.hi) / 2
    for axis in (j, k):
        slack = (room[axis] - size[axis]) / 2 - 0.03
        place[axis] += max(slack, 0) * float(rng.uniform(-1, 1))
    lo, hi = place - size / 2, place + size / 2
    plane = (seat.hi if s > 0 else seat.lo)[i]
    lo[i], hi[i] = _span(s, plane - s * size[i], size[i] + proud)
    c, d = lo - AIR, hi + AIR
    c[i], d[i] = _span(s, plane - s * (size[i] + AIR), size[i] + AIR + 0.01)
    finish = random_finish(rng, palette)
    solid = box(lo, hi)
    if i != 2 and rng.random() < 0.5 and size[i] > 0.15:  # hollow from above
        wall = 0.12 * min(size[j], size[k])
        a, b = lo + wall, hi - wall
        b[2] = hi[2] + 1
        if (a < b).all():
            solid -= box(a, b)
    solids = [(solid, finish)]
    if rng.random() < CUES:  # a knob or bar to pull
        reach = float(rng.uniform(0.03, 0.07))
        at = (lo + hi) / 2
        at[i] = (hi if s > 0 else lo)[i]
        if rng.random() < 0.5:
            start = at.copy()
            start[i] = min(_span(s, at[i], reach))
            grip = cylinder(
                "xyz"[i], start, reach, min(0.035, 0.2 * min(size[j], size[k])), segments=14
            )
        else:
            along = j if size[j] > size[k] else k
            half = np.full(3, 0.014)
            half[along] = 0.3 * size[along]
            a, b = at - half, at + half
            a[i], b[i] = _span(s, at[i], reach)
            grip = box(a, b)
        solids.append((grip, materials.hardware(rng)))
    travel = size[i] * float(rng.uniform(0.4, 0.9))
    return Candidate(Piece(lo, hi, solids, parent, slide(_axis(i, s), travel)), cut=box(c, d))
