"""Open vessels of any outline, and the parts of buckets, baskets and cooler boxes: rims, hoops,
bails, drop handles and lids. Lengths are in metres; ``unit`` is a hundredth of the object's
size."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials, shapes
from uniart_jax.procedural.materials import Material, hsv, plain
from uniart_jax.procedural.pieces import shape_of
from uniart_jax.procedural.shapes import (
    about_z,
    box,
    cylinder,
    hinge,
    loft,
    pipe,
    rotated,
    rounded,
    slide,
    union,
)

Pieces = list[tuple[Manifold, Material]]
Spec = tuple[str, Pieces, int, Joint | None]  # a part before the object is turned about z


def assembled(parts: list[Spec], yaw: float) -> ArticulatedObject:
    """The object made of ``parts``, in metres, turned about z by ``yaw`` radians."""
    made = [(name, shape_of(pieces), parent, joint) for name, pieces, parent, joint in parts]
    return shapes.assembled(made, about_z(yaw))


def all_move(parts: list[Spec]) -> bool:
    """Whether every part but the body moves. A bail may have found no way to swing."""
    return all(joint is not None and joint.type != "fixed" for *_, joint in parts[1:])


def filled(pieces: Pieces) -> Manifold:
    """The union of the solids of ``pieces``."""
    return union(solid for solid, _ in pieces)


@dataclasses.dataclass
class Vessel:
    """An open vessel on z = 0: its outlines [n, 2] at the floor and at the rim, height and wall
    (metres)."""

    low: np.ndarray
    top: np.ndarray
    height: float
    wall: float

    def outline(self, z: float, grow: float = 0.0) -> np.ndarray:
        """The outline [n, 2] at height ``z``, grown on all sides by about ``grow`` metres."""
        at = self.low + (self.top - self.low) * z / self.height
        return at * (1 + grow / np.abs(at).max(0))

    def half(self, axis: int, z: float) -> float:
        """How far the outline at height ``z`` reaches along ``axis`` (0: x, 1: y), metres."""
        return float(np.abs(self.outline(z)[:, axis]).max())

    def band(self, z0: float, z1: float, grow: float) -> Manifold:
        """The solid between two heights, walls and inside together, grown by ``grow`` metres."""
        return loft(self.outline(z0, grow), self.outline(z1, grow), z0, z1)

    @property
    def full(self) -> Manifold:
        """The vessel filled to its rim."""
        return self.band(0, self.height, 0)

    @property
    def skin(self) -> Manifold:
        """The vessel filled and a hair larger than ``full``; fittings on the walls are cut by
        it."""
        return self.band(-0.01, self.height + 0.01, 2e-4)

    def hollow(self) -> Manifold:
        """The vessel without its inside."""
        return self.full - self.band(self.wall, self.height + 0.01, -self.wall)


def draw_vessel(
    rng, size: tuple[float, float], height: float, flare: float, square: bool, wall: float
) -> Vessel:
    """A vessel in metres whose rim is ``size`` (x, y); its floor is ``flare`` times as large."""
    if square:
        top = rounded(size[0], size[1], float(rng.uniform(0.04, 0.25)) * min(size), 5)
    else:
        angle = np.linspace(0, 2 * np.pi, 30, endpoint=False)
        top = np.column_stack([np.cos(angle), np.sin(angle)]) * np.array(size) / 2
    return Vessel(top * flare, top, height, wall)


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a vessel: plastic of any colour, zinc, enamel, wood, white or black."""
    kind = rng.choice(5, p=[0.42, 0.2, 0.15, 0.1, 0.13])
    if kind == 0:
        return plain(hsv(rng, (0, 1), (0.35, 0.95), (0.3, 0.95)))
    if kind == 1:
        return materials.metal(rng)
    if kind == 2:
        return plain(hsv(rng, (0.08, 0.6), (0.02, 0.3), (0.75, 0.96)))
    return materials.wood(rng) if kind == 3 else materials.paint(rng)


def _free_angle(solid: Manifold, at: np.ndarray, sense: int, others: Manifold) -> float:
    """The degrees by which a bail can fall from upright about y before it touches something."""
    angles = (0, 40, 60, 75, 85, 92, 99, 106, 113, 120, 128, 136, 144)
    least, most = 0, len(angles)
    while most - least > 1:
        middle = (least + most) // 2
        if (rotated(solid, (0, sense * angles[middle], 0), at) ^ others).volume() > 0:
            most = middle
        else:
            least = middle
    return max(0.0, angles[least] - 5.0)


def add_bail(
    rng, body: Pieces, v: Vessel, others: Manifold, at, length, unit, ear, **options
) -> Spec:
    """A bail handle (metres) that turns about y through ``at`` (x, z) and rests upright or fallen.
    Its ears are added to ``body``; ``others`` is what it must not hit.

    Options: ``sense`` is -1 to fall to the front, 1 to the rear. ``both`` lets it fall to the other
    side too. ``upright`` is the probability that it rests upright. ``power`` is the exponent of its
    arch; a large one makes it square.
    """
    sense, both = options.get("sense", -1), options.get("both", True)
    x, z = at
    r = float(rng.uniform(0.9, 1.5)) * unit
    lip = max(v.half(1, z), others.bounding_box()[4])
    size = 2.0 * r
    wide = lip + r + 0.95 * unit
    power = float(rng.choice([2.0, 2.6, 4.0, 9.0], p=[0.4, 0.25, 0.2, 0.15]))
    power = options.get("power", power)
    angle = np.linspace(0, np.pi, 13)
    c, s = np.cos(angle), np.sin(angle)
    ys = wide * np.sign(c) * np.abs(c) ** (2 / power)
    zs = length * np.abs(s) ** (2 / power)
    zs, ys = np.append(np.insert(zs, 0, 0), 0), np.append(np.insert(ys, 0, wide), -wide)
    zs[1:-1] = np.maximum(zs[1:-1], 0) + 1.5 * size * (1 - zs[1:-1] / max(zs.max(), 1e-9))
    line = np.column_stack([np.full(len(ys), x), ys, z + zs])
    wire = pipe(line, r, 8)
    pivot = np.array([x, 0.0, z])
    grip = None
    metal = materials.hardware(rng) if rng.random() < 0.6 else ear
    if rng.random() < 0.6 and power < 5:
        g = float(rng.uniform(1.5, 2.0)) * r
        w = float(rng.uniform(0.16, 0.3)) * wide
        grip = cylinder("y", [x, -w, z + zs.max()], 2 * w, g, segments=12)
    whole = pipe(line[::2], r, 5)  # rougher, to try its ways
    whole = whole if grip is None else whole + grip
    others = others + box([-2, -2, -1], [2, 2, 0])  # nor below the floor
    fall = _free_angle(whole, pivot, sense, others)
    over = _free_angle(whole, pivot, -sense, others) if both else 0.0
    for side in (-1, 1):
        lo, hi = sorted((side * (wide - r - 0.5 * unit), side * 0.5 * v.half(1, z)))
        plate = box([x - size, lo, z - size], [x + size, hi, z + size])
        body.append((plate - v.skin, ear))
    if rng.random() < options.get("upright", 0.25):
        start, most = 0.0, sense * fall
    else:
        start = sense * fall
        most = -sense * (fall + (over if both and rng.random() < 0.6 else 0))
    shape = [(rotated(wire if grip is None else wire - grip, (0, start, 0), pivot), metal)]
    if grip is not None:
        grip_finish = materials.wood(rng, grain="y") if rng.random() < 0.5 else draw_finish(rng)
        shape.append((rotated(grip, (0, start, 0), pivot), grip_finish))
    return "handle", shape, 0, hinge(pivot, (0, 1, 0), float(np.deg2rad(most)))


def bail_options(v: Vessel, parts: list[Spec]) -> dict[str, float]:
    """Options for ``add_bail``: a bail that must clear the corners of a rectangular lid is
    square."""
    return {"power": 9.0} if len(parts) > 1 and len(v.top) == 20 else {}


def add_drop_handles(
    rng, body: Pieces, v: Vessel, z: float, unit: float, metal: Material
) -> list[Spec]:
    """Two handles (metres) that hang at the sides and swing up and out. Their lugs are added to
    ``body``."""
    r = float(rng.uniform(1.0, 1.5)) * unit
    span = float(rng.uniform(0.16, 0.3)) * v.half(0, z)
    span = max(span, 5 * unit)
    drop = min(float(rng.uniform(7, 12)) * unit, 0.75 * z)
    out = v.half(1, v.height) + r + 0.8 * unit
    bow = rng.random() < 0.5
    most = float(np.deg2rad(rng.uniform(80, 120)))
    made = []
    for side in (-1, 1):
        y = side * out
        foot = 0.65 * span if bow else span
        points = [(-span, 0), (-foot, -drop), (foot, -drop), (span, 0)]
        grip = pipe([[x, y, z + dz] for x, dz in points], r, 10)
        for a in (span + r + 0.3 * unit, -span - r - 0.3 * unit - 1.6 * unit):
            lo, hi = sorted((y + side * r, 0.5 * y))
            lug = box([a, lo, z - 1.3 * r], [a + 1.6 * unit, hi, z + 1.3 * r])
            body.append((lug - v.skin, metal))
        joint = hinge((0, y, z), (side, 0, 0), most)
        made.append(("side_handle", [(grip, metal)], 0, joint))
    return made


def draw_lid(rng, v: Vessel, unit: float, face: Material, *, hinged: bool, grow=0.0) -> Spec:
    """A flat, stepped or raised lid on the rim (metres). A lid that lifts off has a knob or a
    bar."""
    base = v.height + 0.35 * unit
    thick = float(rng.uniform(1.5, 4)) * unit
    shape: Pieces = []
    solid = loft(v.outline(v.height, grow), v.outline(v.height, grow), base, base + thick)
    high = base + thick
    if rng.random() < 0.5:
        rise, inset = float(rng.uniform(1, 7)) * unit, float(rng.uniform(0.55, 0.93))
        wide, small = v.outline(v.height) * 0.96, v.outline(v.height) * inset * 0.96
        solid += loft(wide, small, high - 1e-4, high + rise)
        high += rise
    shape.append((solid, face))
    if not hinged:
        knob = materials.hardware(rng) if rng.random() < 0.5 else draw_finish(rng)
        if rng.random() < 0.55:
            r = float(rng.uniform(2.2, 4)) * unit
            shape.append((cylinder("z", [0, 0, high], 1.5 * r, 0.7 * r, r, 16), knob))
        else:
            w, up, r = float(rng.uniform(6, 12)) * unit, 5 * unit, 1.1 * unit
            line = [[0, -w, high], [0, -0.8 * w, high + up], [0, 0.8 * w, high + up], [0, w, high]]
            shape.append((pipe(line, r, 8) ^ box([-1, -1, high], [1, 1, 2]), knob))
        return "lid", shape, 0, slide((0, 0, 1), float(rng.uniform(0.2, 0.5)) * v.height)
    w = float(rng.uniform(0.15, 0.5)) * v.half(1, v.height)
    x = -v.half(0, v.height) - grow
    if rng.random() < 0.7:  # a lip to lift it by
        tab = box([x - 2.2 * unit, -w, base], [0.7 * x, w, base + min(thick, 1.6 * unit)])
        shape.append((tab - solid, face if rng.random() < 0.5 else materials.hardware(rng)))
    swing = float(np.deg2rad(rng.uniform(75, 115)))
    return "lid", shape, 0, hinge((v.half(0, v.height) + grow, 0, base), (0, 1, 0), swing)


def add_trim(rng, body: Pieces, v: Vessel, unit: float, face: Material, accent: Material) -> float:
    """Add a rim and hoops to ``body``; returns how far the rim stands out, metres."""
    proud = float(rng.uniform(0.5, 1.3)) * unit
    if rng.random() < 0.75:
        deep = float(rng.uniform(1.2, 4)) * unit
        body.append((v.band(v.height - deep, v.height, proud) - v.skin, accent))
    else:
        proud = 0.0
    for share in rng.choice([0.12, 0.25, 0.45, 0.6, 0.72], int(rng.integers(0, 3)), False):
        z, h = float(share) * v.height, float(rng.uniform(0.8, 3)) * unit
        body.append((v.band(z, z + h, 0.6 * unit) - v.skin, accent if rng.random() < 0.6 else face))
    return proud


def with_rim(v: Vessel, proud: float) -> Manifold:
    """The filled vessel with its rim, which stands out by ``proud`` metres: what bails must
    clear."""
    return union([v.full, v.band(0.9 * v.height, v.height, proud)])


def openings(rng, v: Vessel) -> list[Manifold]:
    """Solids (metres) to cut out of the walls of a rectangular vessel: rows of holes or gaps
    between slats."""
    rows, columns = int(rng.integers(2, 5)), int(rng.choice([1, 2, 4, 6]))
    lo, hi = 0.12 * v.height, 0.82 * v.height
    pitch, holes = (hi - lo) / rows, []
    share = float(rng.uniform(0.3, 0.6))
    for axis in (0, 1):
        span = 1.6 * (v.half(axis, 0) - 2 * v.wall)
        for k in range(rows):
            z = lo + pitch * k
            for n in range(columns):
                a = span * ((n + 0.5) / columns - 0.5)
                w = 0.5 * span / columns * (0.7 if columns > 1 else 1.0)
                near, far = [a - w, -2.0], [a + w, 2.0]
                if axis:
                    near, far = near[::-1], far[::-1]
                holes.append(box([*near, z], [*far, z + share * pitch]))
    return holes
