"""Windows whose panes slide sideways on tracks of their own, with fixed panes, glazing bars and
latches."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, cylinder, hinge, slide, union


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A sliding window or patio door, metres, closed."""
    tall_one = rng.random() < 0.2
    height = float(rng.uniform(1.7, 2.1)) if tall_one else float(rng.uniform(0.6, 1.4))
    width = float(rng.uniform(1.2, 2.0)) if tall_one else float(rng.uniform(0.8, 2.0))
    unit = max(width, height) / 100
    count = int(rng.choice([2, 3, 4], p=[0.6, 0.22, 0.18]))
    tracks = 3 if count == 3 and rng.random() < 0.5 else 2
    thick, air = max(0.026, 1.8 * unit), max(0.004, 0.5 * unit)
    rail = max(0.035, float(rng.uniform(3.0, 5.0)) * unit)  # of the frame
    sash = max(0.03, float(rng.uniform(2.6, 4.2)) * unit)
    depth = tracks * (thick + air) + air
    face = materials.white_plastic(rng) if rng.random() < 0.45 else materials.furniture(rng)
    if rng.random() < 0.25:
        face = materials.metal(rng, brushed=False)
    glass, hardware = materials.glass(rng), materials.hardware(rng)
    bars = (int(rng.integers(0, 3)), int(rng.integers(0, 3))) if rng.random() < 0.4 else (0, 0)

    asm, frame = Assembly(), Shape()
    half = width / 2
    room_y, room_z = half - rail, (rail, height - rail)
    solid = box([0, -half, 0], [depth, half, height])
    solid -= box([-1, -room_y, room_z[0]], [2, room_y, room_z[1]])
    frame.add(solid, face)
    if not tall_one and rng.random() < 0.6:  # a sill
        out = float(rng.uniform(0.03, 0.09))
        frame.add(
            box([-out, -half - 0.02, -0.03], [depth, half + 0.02, 0]),
            face if rng.random() < 0.6 else materials.stone(rng),
        )
    root = asm.add("frame", frame)

    lap = sash  # neighbours overlap by one upright, so that closed panes shut the whole opening
    wide = (2 * room_y - 2 * air + (count - 1) * lap) / count
    order = list(range(count)) if tracks == 3 else [k % 2 for k in range(count)]
    if count == 4:
        order = [1, 0, 0, 1]
        wide = (2 * room_y - 2 * air + 2 * lap - air) / 4
    if rng.random() < 0.5:
        order = [tracks - 1 - t for t in order]
    starts = [-room_y + air + k * (wide - lap) for k in range(count)]
    if count == 4:  # the two in the middle meet edge to edge
        starts = [-room_y + air, -room_y + air + wide - lap, 0.5 * air, wide - lap + 0.5 * air]
    still = set()
    if rng.random() < 0.45:
        still = (
            {0: {1}, 1: {0}}[int(rng.integers(2))]
            if count == 2
            else ({0, 3} if count == 4 else {1})
        )
    share = float(rng.uniform(0.75, 0.98))
    latches = rng.random() < 0.5
    for k in range(count):
        x = air + order[k] * (thick + air)
        lo = np.array([x, starts[k], room_z[0] + air])
        hi = np.array([x + thick, starts[k] + wide, room_z[1] - air])
        pane = Shape()
        outline, view = _sash(lo, hi, sash, bars)
        pane.add(outline, face)
        pane.add(view, glass)
        # towards the nearest side on which another track's pane stands
        way = 1 if k < count / 2 else -1
        if count == 4:
            way = 1 if k in (0, 2) else -1
        elif count == 3 and k == 1:
            way = 1 if rng.random() < 0.5 else -1
        outer = -way  # the edge that leaves the frame carries the grip
        grip_y = lo[1] + sash / 2 if outer < 0 else hi[1] - sash / 2
        grip_z = (lo[2] + hi[2]) / 2
        front = order[k] == 0
        moves = k not in still
        reach = 1.0 if front else 0.0
        if moves and front and not latches:
            long = max(4 * unit, 0.06)
            pane.add(
                box(
                    [x - 1.8 * unit, grip_y - 0.8 * unit, grip_z - long],
                    [x, grip_y + 0.8 * unit, grip_z + long],
                ),
                hardware,
            )
        laps = 2 if count == 3 and tracks == 2 else 1  # two stop short of the next on their track
        room = wide - laps * lap
        joint = slide((0, way, 0), share * room) if moves else None
        part = asm.add("pane" if moves else "fixed_pane", pane, root, joint)
        if moves and latches and reach:
            _latch(asm, part, way, x, grip_y, grip_z, unit, hardware)
    return asm.object()


def _sash(lo, hi, wide: float, bars: tuple[int, int]) -> tuple[Manifold, Manifold]:
    """The frame of a pane with its glazing bars, and its glass."""
    depth = hi[0] - lo[0]
    a, b = lo[1:] + wide, hi[1:] - wide
    ring = box(lo, hi) - box([lo[0] - 1, *a], [hi[0] + 1, *b])
    sheet = box([lo[0] + 0.15 * depth, *a], [hi[0] - 0.15 * depth, *b])
    strips, w = [], 0.3 * wide
    for axis, count in enumerate(bars):
        for at in np.linspace(a[axis], b[axis], count + 2)[1:-1]:
            s_lo, s_hi = np.array([lo[0], *a]), np.array([hi[0], *b])
            s_lo[1 + axis], s_hi[1 + axis] = at - w, at + w
            strips.append(box(s_lo, s_hi))
    if not strips:
        return ring, sheet
    grid = union(strips)
    return union([ring, grid]), cut(sheet, (grid,))


def _latch(
    asm: Assembly, pane: int, way: int, x: float, y: float, z: float, unit: float, finish: Material
) -> None:
    """A lever on the upright of a pane; it turns towards the pane's middle, on the side ``way``."""
    reach, w = 2.2 * unit, 0.85 * unit
    long = max(5 * unit, 0.07)
    boss = cylinder("x", [x - reach, y, z], reach - 0.001, 1.5 * unit, segments=14)
    lever = box([x - reach, y - w, z - long], [x - reach + 1.7 * unit, y + w, z])
    joint = hinge((x, y, z), (1, 0, 0), way * np.pi / 2)
    asm.add("latch", Shape().add(union([boss, lever]), finish), pane, joint)
