"""Fronts as joiners and kitchen makers build them: framed, raised, arched, louvred and glazed
panels, thin pulls, and doors, flaps and drawers with gaps of one to three millimetres."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import hinges, shapes
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    slide,
    tray,
    tube,
    union,
)

PANELS = (
    "slab", "shaker", "raised", "arched", "louvre", "planks", "glass", "muntins", "border", "split",
)  # fmt: skip
PULLS = ("bar", "square", "bow", "knob", "cup", "rail", "none")


@dataclasses.dataclass(frozen=True)
class Look:
    """What the fronts of one object have in common; lengths in metres.

    Attributes:
      panel: one of ``PANELS``. pull: one of ``PULLS``.
      face, accent, glass, hardware, inside: materials of fronts, their panels, panes (None: clear
        ones, left out), pulls, and of drawers' boxes.
      thick: of a front. unit: one percent of the object's longest side.
      frame: width of a front's frame.
      length: of a bar, a share of the edge it lies along. thin: a bar's diameter. stand: how far
        pulls stand out.
      turned: pulls of doors lie across, near the end that ``high`` says.
      high: where pulls of doors sit, 0 their foot and 1 their head.
      centred: pulls of drawers in the middle of their height.
      axis_depth, axis_inset: where doors turn (``hinges.place``).
      barrels: butt hinges show their barrels on the hinged edge.
    """

    panel: str
    pull: str
    face: Material
    accent: Material
    glass: Material | None
    hardware: Material
    inside: Material
    thick: float
    unit: float
    frame: float
    length: float
    thin: float
    stand: float
    turned: bool
    high: float
    centred: bool
    axis_depth: float
    axis_inset: float
    barrels: bool


def panel(lo, hi, look: Look, kind: str | None = None) -> Shape:
    """A front between two corners; too small ones are plain slabs."""
    kind = look.panel if kind is None else kind
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    depth = hi[0] - lo[0]
    size = hi[1:] - lo[1:]
    frame = min(look.frame, 0.27 * float(size.min()))
    slab, shape = box(lo, hi), Shape()
    if kind == "slab" or frame < 0.4 * look.unit:
        return shape.add(slab, look.face)
    a, b = lo[1:] + frame, hi[1:] - frame
    floor = lo[0] + 0.38 * depth
    if kind in ("glass", "muntins", "border"):
        pane = (lo[0] + (0.25 if kind != "border" else 0.0) * depth, hi[0])
        frames = [cut(slab, [box([lo[0] - 1, *a], [hi[0] + 1, *b])])]
        if kind == "muntins":
            frames += _muntins(lo[0], lo[0] + 0.25 * depth, a, b, look)
        shape.add(union(frames), look.face)
        fill = look.accent if kind == "border" else look.glass
        return shape if fill is None else shape.add(box([pane[0], *a], [pane[1], *b]), fill)
    if kind == "louvre":
        pitch = max(0.035, 2.4 * look.unit)
        edges = np.linspace(a[1], b[1], max(2, int((b[1] - a[1]) / pitch)) + 1)
        grooves = [
            box([lo[0] - 1, a[0], c], [floor, b[0], c + 0.42 * (d - c)])
            for c, d in itertools.pairwise(edges)
        ]
        return shape.add(cut(slab, grooves), look.face)
    if kind == "split":  # grooves as if it were several drawers
        w = max(0.0015, 0.2 * look.unit)
        heights = np.linspace(lo[2], hi[2], 2 + int(size[1] > 0.4) + 1)[1:-1]
        grooves = [box([lo[0] - 1, lo[1] - 1, z - w], [floor, hi[1] + 1, z + w]) for z in heights]
        return shape.add(cut(slab, grooves), look.face)
    if kind == "planks":
        pitch = max(0.06, 5 * look.unit)
        edges = np.linspace(lo[1], hi[1], max(2, int(size[0] / pitch)) + 1)[1:-1]
        w = 0.2 * look.unit
        grooves = [
            box([lo[0] - 1, y - w, lo[2] - 1], [lo[0] + 0.25 * depth, y + w, hi[2] + 1])
            for y in edges
        ]
        return shape.add(cut(slab, grooves), look.face)
    pocket = _field(lo[0] - 1, floor, a, b, kind == "arched")
    solids = [cut(slab, [pocket])]
    if kind == "raised":
        inner = frame * 0.35
        if (b - a).min() > 3 * inner:
            solids.append(box([lo[0] + 0.1 * depth, *(a + inner)], [hi[0], *(b - inner)]))
    shape.add(union(solids), look.face)
    if look.accent is not look.face:  # a panel of another finish, just above the pocket's floor
        shape.add(_field(floor - 0.08 * depth, floor, a, b, kind == "arched"), look.accent)
    return shape


def _field(x0: float, x1: float, a, b, arched: bool) -> Manifold:
    """The room inside a frame from x0 to x1, with a straight or an arched head."""
    if not arched:
        return box([x0, *a], [x1, *b])
    rise = min(0.35 * (b[0] - a[0]), 0.4 * (b[1] - a[1]))
    t = np.linspace(0, np.pi, 9)
    y = (a[0] + b[0]) / 2 + (b[0] - a[0]) / 2 * np.cos(t)
    head = np.column_stack([y, b[1] - rise + rise * np.sin(t)])
    outline = np.vstack([[a[0], a[1]], [b[0], a[1]], head])
    return extrusion(outline, "x", [x0, 0, 0], x1 - x0)


def _muntins(x0: float, x1: float, a, b, look: Look) -> list[Manifold]:
    """Bars that divide a pane: near its border, or into a grid."""
    w = max(0.008, 0.6 * look.unit)
    count = np.maximum(1, np.round((b - a) / max(0.22, 16 * look.unit)).astype(int))
    bars = []
    for y in np.linspace(a[0], b[0], count[0] + 1)[1:-1]:
        bars.append(box([x0, y - w / 2, a[1]], [x1, y + w / 2, b[1]]))
    for z in np.linspace(a[1], b[1], count[1] + 1)[1:-1]:
        bars.append(box([x0, a[0], z - w / 2], [x1, b[0], z + w / 2]))
    if not bars:  # a small pane has a bar near each side
        m = 0.12 * (b - a)
        for y in (a[0] + m[0], b[0] - m[0]):
            bars.append(box([x0, y - w / 2, a[1]], [x1, y + w / 2, b[1]]))
        for z in (a[1] + m[1], b[1] - m[1]):
            bars.append(box([x0, a[0], z - w / 2], [x1, b[0], z + w / 2]))
    return bars


def pull(look: Look, face: float, at, along: str, room: float) -> Manifold | None:
    """A pull on the plane x = ``face``, centred at ``at`` (y, z), along 'y' or 'z' of an edge that
    is ``room`` long."""
    y, z = at
    thin, stand = look.thin, look.stand
    length = float(np.clip(look.length * room, min(0.09, 0.6 * room), 0.92 * room))
    half = length / 2

    def block(x, s, t):  # s along the pull, t across it
        lo, hi = ([x[0], y + t[0], z + s[0]], [x[1], y + t[1], z + s[1]])
        if along == "y":
            lo, hi = ([x[0], y + s[0], z + t[0]], [x[1], y + s[1], z + t[1]])
        return box(lo, hi)

    if look.pull == "none":
        return None
    if look.pull == "knob":
        radius = max(0.013, 0.95 * look.unit)
        stem = cylinder("x", [face - 0.6 * stand, y, z], 0.6 * stand, 0.5 * radius, segments=10)
        head = cylinder("x", [face - stand, y, z], 0.5 * stand, 0.75 * radius, radius, 14)
        return union([stem, head])
    if look.pull == "cup":
        h, half = max(0.02, 1.4 * look.unit), max(0.04, 3 * look.unit)
        shell = tube("y", [face, y - half, z], 2 * half, h, 0.8 * h, 18)
        keep = box([face - h, y - half, z - 0.1 * h], [face, y + half, z + h])
        caps = [
            box([face - 0.9 * h, y + s - 0.1 * h, z], [face, y + s + 0.1 * h, z + 0.7 * h])
            for s in (-half + 0.1 * h, half - 0.1 * h)
        ]
        return union([shell ^ keep, *caps])
    if look.pull == "bow":
        t = np.linspace(0, np.pi, 9)
        outer = np.column_stack([half * np.cos(t), -stand * np.sin(t)])
        inner = np.column_stack([(half - thin) * np.cos(t), -(stand - thin) * np.sin(t)])[::-1]
        outline = np.vstack([outer, inner])  # (along, x)
        if along == "z":
            return extrusion(outline, "y", [face, y - thin / 2, z], thin)
        return extrusion(outline[:, ::-1], "z", [face, y, z - thin / 2], thin)
    foot = max(half - max(0.02, 0.1 * length), 0.3 * half)
    w = 0.4 * thin
    posts = [
        block((face - stand + 0.5 * thin, face), (s - w, s + w), (-w, w)) for s in (-foot, foot)
    ]
    if look.pull == "bar":
        start = [face - stand + thin / 2, y, z]
        start[1 if along == "y" else 2] -= half
        return union([*posts, cylinder(along, start, length, thin / 2, segments=10)])
    wide = thin if look.pull == "square" else 1.6 * thin
    bar = block((face - stand, face - stand + 0.7 * thin), (-half, half), (-wide / 2, wide / 2))
    return union([*posts, bar])


def _placed_pull(look: Look, lo, hi, edge: str) -> Manifold | None:
    """The pull of a front whose free edge is ``edge``."""
    size = hi[1:] - lo[1:]
    inset = min(max(0.03, 0.5 * look.frame, 2.0 * look.unit), 0.25 * float(size.min()))
    mid = (lo + hi)[1:] / 2
    small = look.pull in ("knob", "cup")
    if edge[1] == "y":
        y = hi[1] - inset if edge[0] == "+" else lo[1] + inset
        if look.turned or look.pull == "cup":
            room = 0.8 * size[0]
            length = min(look.length, 0.5) * room if not small else 2 * inset
            y = (
                y + (length / 2) * (-1 if edge[0] == "+" else 1)
                if length < 0.6 * size[0]
                else mid[0]
            )
            z = hi[2] - inset if look.high > 0.5 else lo[2] + inset
            short = dataclasses.replace(look, length=min(look.length, 0.5))
            return pull(short, float(lo[0]), (float(y), float(z)), "y", float(room))
        room = float(size[1]) - 2 * inset
        half = inset if small else max(look.length * room, 0.09) / 2 + 0.3 * inset
        z = float(np.clip(lo[2] + look.high * size[1], lo[2] + inset + half, hi[2] - inset - half))
        if lo[2] + inset + half > hi[2] - inset - half:
            z = float(mid[1])
        return pull(look, float(lo[0]), (float(y), z), "z", room)
    z = hi[2] - inset if edge[0] == "+" else lo[2] + inset
    if look.centred:
        z = mid[1]
    return pull(look, float(lo[0]), (float(mid[0]), float(z)), "y", float(size[0] - 2 * inset))


def front(lo, hi, look: Look, edge: str, kind: str | None = None, pulled: bool = True) -> Shape:
    """A front with the pull near its free ``edge``; drawers wide enough have two knobs."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    shape = panel(lo, hi, look, kind)
    if not pulled:
        return shape
    ground = shape.solid()
    shifts = [0.0]
    if edge[1] == "z" and look.pull in ("knob", "cup") and hi[1] - lo[1] > 0.62:
        shifts = [sign * 0.22 * (hi[1] - lo[1]) for sign in (-1, 1)]
    for shift in shifts:
        grip = _placed_pull(look, lo + [0, shift, 0], hi + [0, shift, 0], edge)
        if grip is None:
            break
        if edge[1] == "z" and look.centred:  # amid a field that may lie deeper than the frame
            grip = shapes.rooted(grip, float(lo[0]), 0.4 * (hi[0] - lo[0]), ground)
        shape.add(grip, look.hardware)
    return shape


def add_door(
    asm: Assembly, parent: int, lo, hi, edge: str, angle: float, look: Look, name: str = "door",
    **options,
) -> int:  # fmt: skip
    """A door or flap that turns about its edge ``edge`` ('+y' left as seen, '-y', '-z' foot, '+z'
    head).

    ``options``: ``kind`` of panel, ``pulled``, ``extra`` shape on its rear, ``tight``: it turns
    about its front edge since walls or neighbours are near, ``beyond``: metres of what it closes
    beyond its hinged edge.
    """
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    axis, sign = "xyz".index(edge[1]), 1 if edge[0] == "+" else -1
    if axis == 2:  # flaps are pulled at their free edge
        look = dataclasses.replace(look, centred=False)
    thick, width = hi[0] - lo[0], hi[axis] - lo[axis]
    depth = 0.0 if options.get("tight") else look.axis_depth
    behind, into = hinges.place(thick, width, depth, look.axis_inset)
    beyond = options.get("beyond", 0.0)
    if behind > 0 and angle > 2.0 and beyond < 0.1:  # turns right round: hinges beside its edge
        into = -(0.55 * beyond + 0.001 + 0.1 * look.unit)
    at = (lo + hi) / 2
    at[0] = lo[0] + behind
    at[axis] = (hi[axis] if sign > 0 else lo[axis]) - sign * into
    if behind > 0:
        angle = min(angle, hinges.clear_angle(thick, behind, into, beyond))
    free = ("-" if sign > 0 else "+") + edge[1]
    shape = front(lo, hi, look, free, options.get("kind"), options.get("pulled", True))
    if options.get("extra") is not None:
        shape.join(options["extra"])
    if look.barrels and depth == 0 and edge[1] == "y":
        radius, tall = max(0.006, 0.5 * look.unit), min(0.07, 0.1 * (hi[2] - lo[2]))
        for share in (0.12, 0.88):
            z = lo[2] + share * (hi[2] - lo[2]) - tall / 2
            place = [lo[0] - 0.3 * radius, at[1] - sign * 1.01 * radius, z]
            shape.add(cylinder("z", place, tall, radius, segments=10), look.hardware)
    return asm.add(name, shape, parent, hinge(at, hinges.OPENING[edge], angle))


def add_drawer(
    asm: Assembly, parent: int, lo, hi, bay_lo, bay_hi, look: Look, **options
) -> int:  # fmt: skip
    """A drawer whose front is the box (lo, hi) and whose box fills the bay behind it.

    ``options``: ``deep`` and ``fill``: shares of the bay's depth and height; ``travel``: share of
    its depth; ``kind`` of panel, ``pulled``.
    """
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    gap, wall = 0.004, max(0.012, 1.5 * look.unit)
    length = (bay_hi[0] - gap - hi[0]) * options.get("deep", 0.95)
    low = np.array([hi[0], max(bay_lo[1] + gap, lo[1]), max(bay_lo[2] + gap, lo[2])])
    high = np.array([hi[0] + length, min(bay_hi[1] - gap, hi[1]), min(bay_hi[2] - gap, hi[2])])
    high[2] = low[2] + (high[2] - low[2]) * options.get("fill", 0.75)
    shape = front(lo, hi, look, "+z", options.get("kind"), options.get("pulled", True))
    if (high - low)[1] > 2.5 * wall and (high - low)[2] > 1.3 * wall:
        shape.add(tray(low, high, wall, open_front=True), look.inside)
    joint = slide((-1, 0, 0), options.get("travel", 0.75) * length)
    return asm.add("drawer", shape, parent, joint)
