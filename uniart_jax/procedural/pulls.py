"""Drawers as furniture has them: thin walls, fronts that sit flush, stand back or lie on, and pulls
of many kinds or none."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import shapes
from uniart_jax.procedural.fronts import FrontStyle, panel
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, cylinder, slide, union

PULLS = ("knob", "bar", "arch", "bail", "cup", "plate", "tab", "recess", "notch", "hole", "none")
GRIPS = PULLS[:7]  # those that stand out of the front


@dataclasses.dataclass(frozen=True)
class DrawerStyle:
    """What the drawers of one object have in common.

    Attributes:
      pull: one of ``PULLS``. size: of pulls, of what is usual. pairs: two pulls on wide fronts.
      own: pulls are parts of their own, fixed to their drawer.
      panel: of the front (``fronts.PANELS``). thick: of the front, metres. gap: air around it.
      mount: 'flush', 'back' (stands back in its opening), 'over' (lies on the frame).
      wall: of its box. fill: share of the height that the box takes. deep: share of the depth.
      travel: share of its depth by which it pulls out.
      inside: material of its box.
    """

    pull: str
    size: float
    pairs: bool
    own: bool
    panel: str
    thick: float
    gap: float
    mount: str
    wall: float
    fill: float
    deep: float
    travel: float
    hardware: Material
    inside: Material

    @classmethod
    def draw(cls, rng: np.random.Generator, unit: float, look: FrontStyle, inside: Material):
        """A plausible style; ``unit``: one percent of the object's longest side, metres."""
        shares = [0.34, 0.11, 0.08, 0.08, 0.05, 0.06, 0.03, 0.03, 0.04, 0.03, 0.15]
        kinds = ["slab", "shaker", "raised", "border"]
        return cls(
            pull=str(rng.choice(PULLS, p=shares)),
            size=float(rng.uniform(0.6, 1.5)),
            pairs=bool(rng.random() < 0.4),
            own=bool(rng.random() < 0.03),
            panel=str(rng.choice(kinds, p=[0.72, 0.1, 0.08, 0.1])),
            thick=max(float(rng.uniform(0.012, 0.024)), 0.9 * unit),
            gap=max(0.0012, unit * float(rng.choice(
                [rng.uniform(0.06, 0.2), rng.uniform(0.2, 0.5)], p=[0.65, 0.35]))),
            mount=str(rng.choice(["flush", "back", "over"], p=[0.5, 0.14, 0.36])),
            wall=max(0.006, float(rng.uniform(0.45, 0.9)) * unit),
            fill=float(rng.uniform(0.5, 0.95)),
            deep=float(rng.uniform(*((0.5, 0.85) if rng.random() < 0.25 else (0.82, 1.0)))),
            travel=float(rng.uniform(*((0.55, 0.85) if rng.random() < 0.2 else (0.85, 1.04)))),
            hardware=look.hardware,
            inside=inside,
        )  # fmt: skip


def pull_solid(
    style: DrawerStyle, face: float, y: float, z: float, room: tuple[float, float], unit: float
) -> Manifold:
    """A pull on the plane x = ``face`` at (y, z), within ``room`` (width, height) around it."""
    wide, tall = room
    size = style.size * unit
    reach = max(0.012, 1.5 * size)
    if style.pull == "knob":
        radius = min(max(0.007, 0.95 * size), 0.38 * tall)
        t = np.linspace(0, np.pi, 7) if size > unit else np.array([0.0, 1.1, 1.7, np.pi])
        head = np.column_stack([radius * np.sin(t), -reach - 0.8 * radius * np.cos(t)])
        head = head[head[:, 1] < -0.25 * reach]
        neck = [[0.45 * radius, -0.25 * reach], [0.55 * radius, 0.0], [0.0, 0.0]]
        rim = head[head[:, 0] > 0.5 * radius]
        profile = np.vstack([rim, neck, [[0.0, float(head[0, 1])]]])
        return shapes.revolution(profile, "x", [face, y, z], 12)
    half = min(max(0.03, 3.5 * size), 0.38 * wide)
    r = min(max(0.003, 0.4 * size), 0.2 * tall)
    if style.pull == "bar":
        posts = [
            box(
                [face - reach, y + s * 0.8 * half - r, z - r], [face, y + s * 0.8 * half + r, z + r]
            )
            for s in (-1, 1)
        ]
        return union(
            [box([face - reach - r, y - half, z - r], [face - reach + r, y + half, z + r]), *posts]
        )
    if style.pull == "arch":
        points = [[face + 0.3 * r, y - half, z], [face - reach, y - 0.7 * half, z]]
        points += [[face - reach, y + 0.7 * half, z], [face + 0.3 * r, y + half, z]]
        return shapes.pipe(points, r, 8) ^ box([-9, y - 2 * half, -9], [face, y + 2 * half, 9])
    if style.pull == "bail":
        drop = min(0.5 * half, 0.3 * tall)
        angle = np.linspace(0, np.pi, 6)
        points = np.column_stack(
            [np.full(6, face - 1.6 * r), y + half * np.cos(angle), z - drop * np.sin(angle)]
        )
        posts = [
            cylinder("x", [face - 2.2 * r, y + s * half, z], 2.2 * r, 1.4 * r, segments=10)
            for s in (-1, 1)
        ]
        return union([shapes.pipe(points, r, 8), *posts])
    if style.pull == "cup":
        radius = min(max(0.012, 1.3 * size), 0.3 * tall)
        body = cylinder(
            "y", [face, y - half * 0.7, z - 0.4 * radius], 1.4 * half, radius, segments=16
        )
        return body ^ box([face - radius, y - half, z - 0.4 * radius], [face, y + half, z + radius])
    if style.pull == "plate":
        h = min(max(0.012, 1.2 * size), 0.35 * tall)
        plate = box([face - 0.35 * r - 0.002, y - 0.5 * half, z - h], [face, y + 0.5 * half, z + h])
        key = cylinder("x", [face - 0.8 * reach, y, z], 0.8 * reach, 0.5 * h, segments=10)
        return union([plate, key])
    # a tab along the front's upper edge
    edge = z + 0.5 * tall
    return box([face - 0.8 * reach, y - half, edge - 2 * r], [face, y + half, edge])


def add_drawer(
    asm: Assembly,
    root: int,
    lo,
    hi,
    room_lo,
    room_hi,
    look: FrontStyle,
    style: DrawerStyle,
    front: Manifold | None = None,
    height: float = 0.5,
) -> int:
    """A drawer: front slab (lo, hi), and behind it a box in the free room (room_lo, room_hi).

    Args:
      front: the slab's solid, where it is not that box.
      height: of its pulls, as a share of the front's.
    """
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    size, start = hi - lo, float(hi[0])
    length = (room_hi[0] - start) * style.deep
    a = np.array([start, max(room_lo[1], lo[1] + 0.001), max(room_lo[2], lo[2] + 0.001)])
    b = np.array([start + length, min(room_hi[1], hi[1] - 0.001), min(room_hi[2], hi[2] - 0.001)])
    b[2] = a[2] + (b[2] - a[2]) * style.fill
    wall = min(style.wall, 0.3 * (b - a).min())
    count = 2 if style.pairs and size[1] > 22 * look.unit else 1
    share = 0.27 if count == 2 else 0.0
    spots = [((lo[1] + hi[1]) / 2 + s * share * size[1]) for s in (-1, 1)[2 - count :]]
    z = lo[2] + height * size[2]
    room = (size[1] / count, size[2] * 2 * min(height, 1 - height))
    holes: list[Manifold] = []
    grips: list[Manifold] = []
    shape = Shape()
    radius = min(max(0.01, 1.4 * style.size * look.unit), 0.3 * size[2], 0.2 * size[1])
    for y in spots:
        if style.pull == "notch":
            z0 = float(hi[2])
            holes.append(cylinder("x", [lo[0] - 0.01, y, z0], size[0] + 0.02, radius, segments=16))
        elif style.pull == "hole":
            holes.append(cylinder("x", [lo[0] - 0.01, y, z], size[0] + 0.02, radius, segments=16))
        elif style.pull == "recess":
            w, h = min(3 * radius, 0.3 * size[1]), 0.6 * radius
            deep = lo[0] + 0.6 * size[0]
            holes.append(box([lo[0] - 0.01, y - w, z - h], [deep, y + w, z + h]))
            dark = style.hardware if style.pairs else look.face.darker(0.35)
            w, h = w - 2e-4, h - 2e-4  # no vertex in common with the slab
            shape.add(box([deep - 0.2 * size[0], y - w, z - h], [deep, y + w, z + h]), dark)
        elif style.pull != "none":
            grips.append(pull_solid(style, float(lo[0]), y, z, room, look.unit))
    if front is None:
        kind = "slab" if holes else style.panel
        shape.join(panel(lo, hi, look, kind, tuple(holes)))
    else:
        shape.add(cut(front, holes), look.face)
    grip = None
    if grips:  # the front may be hollow or bowed where they stand
        grip = shapes.tidy(union(grips))
        grip = shapes.rooted(grip, float(lo[0]), 0.7 * float(size[0]), shape.solid())
    if (b > a)[1:].all():  # else no room is left for a tray: a front alone
        shape.add(shapes.tray(a, b, wall, open_front=True), style.inside)
    if grip is not None and not style.own:
        shape.add(grip, style.hardware)
    drawer = asm.add("drawer", shape, root, slide((-1, 0, 0), style.travel * length))
    if grip is not None and style.own:
        asm.add("pull", Shape().add(grip, style.hardware), drawer, label="handle")
    return drawer
