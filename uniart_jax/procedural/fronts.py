"""Doors, flaps and drawers with their handles: what opens on furniture and appliances.

Fronts are slabs in a plane x = const that face -x. A door that turns about its *outer front* edge
never moves behind the plane of its rear face or past the hinge line while it is open by 90 degrees
or less: it cannot hit what it closes. Others turn about a line further back and inside
(``FrontStyle.axis_depth``, ``axis_inset``): they clear what they close, and hit a neighbour that is
near.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.procedural import hinges, shapes
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    slide,
    turn,
    union,
)

PANELS = ("slab", "shaker", "raised", "glass", "slats", "border")
HANDLES = ("bar", "round_bar", "arch", "knob", "lip", "recess", "latch", "none")


@dataclasses.dataclass(frozen=True)
class FrontStyle:
    """What the fronts of one object have in common.

    Attributes:
      panel: one of ``PANELS``.
      handle: one of ``HANDLES``; a 'latch' is a turning part of its own.
      face, accent, glass, hardware, inside: materials of the front, its inset, its window, its
        handle, a drawer's box.
      thickness: of a front, metres.
      unit: one percent of the object's longest side, metres; keeps details visible on large
        objects.
      handle_length: share of the edge that a bar takes.
      reach: height above the floor where handles of tall doors sit, metres.
      own_handle: handles are parts of their own, fixed to their front.
      stand: how far handles stand out, of what is usual.
      axis_depth: where in a door's thickness its axis lies: 0 its front face, 1 its rear face.
      axis_inset: how far inside the door's edge its axis lies, metres.
    """

    panel: str
    handle: str
    face: Material
    accent: Material
    glass: Material
    hardware: Material
    inside: Material
    thickness: float
    unit: float
    handle_length: float = 0.4
    reach: float = 0.9
    own_handle: bool = False
    stand: float = 1.0
    axis_depth: float = 0.0
    axis_inset: float = 0.0


def panel(
    lo, hi, style: FrontStyle, kind: str | None = None, holes: tuple[Manifold, ...] = ()
) -> Shape:
    """A front slab between two corners in a style's manner; ``holes`` are cut out of its face."""
    kind = style.panel if kind is None else kind
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    depth, size = hi[0] - lo[0], min(hi[1] - lo[1], hi[2] - lo[2])
    frame = min(max(0.05, 3.2 * style.unit), 0.24 * size)
    inner_lo, inner_hi = lo[1:] + frame, hi[1:] - frame
    slab, shape = box(lo, hi), Shape()
    if frame < 1.2 * style.unit or kind == "slab":
        return shape.add(cut(slab, holes), style.face)
    through = box([lo[0] - depth, *inner_lo], [hi[0] + depth, *inner_hi])
    if kind in ("shaker", "glass"):
        fill = (0.3, 1.0) if kind == "shaker" else (0.15, 0.9)
        shape.add(cut(slab, (through, *holes)), style.face)
        inset = box([lo[0] + fill[0] * depth, *inner_lo], [lo[0] + fill[1] * depth, *inner_hi])
        return shape.add(cut(inset, holes), style.accent if kind == "shaker" else style.glass)
    if kind == "raised":
        groove = cut(
            box([lo[0] - depth, *inner_lo], [lo[0] + 0.35 * depth, *inner_hi]),
            (box([lo[0] - depth, *(inner_lo + frame * 0.3)], [hi[0], *(inner_hi - frame * 0.3)]),),
        )
        return shape.add(cut(slab, (groove, *holes)), style.face)
    if kind == "border":
        shape.add(cut(slab, (through, *holes)), style.face)
        return shape.add(cut(box([lo[0], *inner_lo], [hi[0], *inner_hi]), holes), style.accent)
    pitch = max(2.6 * style.unit, 0.04)
    count = max(2, int((inner_hi[1] - inner_lo[1]) / pitch))
    edges = np.linspace(inner_lo[1], inner_hi[1], count + 1)
    grooves = [
        box([lo[0] - depth, inner_lo[0], a], [lo[0] + 0.4 * depth, inner_hi[0], a + 0.45 * (b - a)])
        for a, b in itertools.pairwise(edges)
    ]
    return shape.add(cut(slab, (*grooves, *holes)), style.face)


def handle(style: FrontStyle, face: float, at, along: str, length: float) -> Shape:
    """A handle on the plane x = ``face``, centred at ``at`` (y, z), its bar along 'y' or 'z'."""
    y, z = at
    width = max(0.012, (1.5 if style.own_handle else 1.0) * style.unit)
    reach = max(0.032, 2.2 * style.unit) * style.stand
    length = max(length, 4 * width)
    half = length / 2
    shape = Shape()
    if style.handle == "knob":
        radius = max(0.015, 1.15 * style.unit)
        stem = cylinder("x", [face - 0.6 * reach, y, z], 0.6 * reach, 0.55 * radius, segments=10)
        head = cylinder("x", [face - reach, y, z], 0.5 * reach, 0.8 * radius, radius, segments=14)
        return shape.add(union([stem, head]), style.hardware)
    if style.handle == "arch":
        outer = np.array([[-half, 0], [-half + width, -reach], [half - width, -reach], [half, 0]])
        inner = np.array(
            [
                [half - 1.4 * width, 0],
                [half - 2 * width, width - reach],
                [2 * width - half, width - reach],
            ]
        )
        outline = np.vstack([outer, inner, [[1.4 * width - half, 0]]])  # (along, x - face)
        if along == "z":
            solid = shapes.extrusion(outline, "y", [face, y - width / 2, z], width)
        else:
            solid = shapes.extrusion(outline[:, ::-1], "z", [face, y, z - width / 2], width)
        return shape.add(solid, style.hardware)
    post = 0.12 * length
    solids = []
    for sign in (-1, 1):
        o = sign * (half - post)
        py, pz = (y, z + o) if along == "z" else (y + o, z)
        w = 0.45 * width
        solids.append(box([face - reach + 0.5 * width, py - w, pz - w], [face, py + w, pz + w]))
    if style.handle == "round_bar":
        start = (
            [face - reach + width / 2, y, z - half]
            if along == "z"
            else [face - reach + width / 2, y - half, z]
        )
        solids.append(cylinder(along, start, length, width / 2, segments=12))
    else:
        ey, ez = (width / 2, half) if along == "z" else (half, width / 2)
        solids.append(box([face - reach, y - ey, z - ez], [face - reach + width, y + ey, z + ez]))
    return shape.add(union(solids), style.hardware)


def _lip(style: FrontStyle, lo, hi, edge: str) -> Shape:
    """A grip that runs along a whole edge of a front and stands out of its face."""
    width, reach = max(0.014, 1.1 * style.unit), max(0.02, 1.6 * style.unit)
    lo, hi = np.array(lo, dtype=np.float64), np.array(hi, dtype=np.float64)
    axis = "xyz".index(edge[1])
    if edge[0] == "+":
        lo[axis] = hi[axis] - width
    else:
        hi[axis] = lo[axis] + width
    hi[0] = lo[0]
    lo[0] -= reach
    return Shape().add(box(lo, hi), style.hardware)


def _front(
    asm: Assembly, parent: int, lo, hi, edge: str, joint, style: FrontStyle, name: str, **options
) -> int:
    """A front with its handle near ``edge``. ``extra``: a shape welded to it; ``center``: handle
    amid the slab; ``kind``: panel."""
    extra, center, kind = options.get("extra"), options.get("center", False), options.get("kind")
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    width, height = hi[1] - lo[1], hi[2] - lo[2]
    inset = min(max(0.04, 2.6 * style.unit), 0.3 * min(width, height))
    y, z = (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2
    along, room = ("z", height) if edge[1] == "y" else ("y", width)
    length = min(style.handle_length * room, 0.75 * room, max(0.9, 40 * style.unit))
    if edge[1] == "y":
        y = hi[1] - inset if edge[0] == "+" else lo[1] + inset
        margin = length / 2 + inset
        z = (
            float(np.clip(style.reach, lo[2] + margin, hi[2] - margin))
            if 2 * margin < height
            else z
        )
    elif not center:
        z = hi[2] - inset if edge[0] == "+" else lo[2] + inset
    holes, grip = (), None
    if style.handle == "recess":
        a, b = (0.45 * inset, length / 2) if edge[1] == "y" else (length / 2, 0.45 * inset)
        deep = lo[0] + 0.55 * (hi[0] - lo[0])
        holes = (box([lo[0] - 1, y - a, z - b], [deep, y + a, z + b]),)
        grip = Shape().add(
            box([deep - 0.2 * (hi[0] - lo[0]), y - a, z - b], [deep, y + a, z + b]),
            style.face.darker(0.35),
        )
    elif style.handle == "lip":
        grip = _lip(style, lo, hi, edge)
    elif style.handle not in ("none", "latch"):
        grip = handle(style, float(lo[0]), (y, z), along, length)
    shape = panel(lo, hi, style, kind, holes)
    if extra is not None:
        shape.join(extra)
    own = style.own_handle and style.handle not in ("lip", "recess")
    if grip is not None and not own:
        shape.join(grip)
    front = asm.add(name, shape, parent, joint)
    if grip is not None and own:
        asm.add(f"{name}_handle", grip, front, label="handle")
    if style.handle == "latch":
        _latch(asm, front, style, (float(lo[0]), y, z), along)
    return front


def _latch(asm: Assembly, front: int, style: FrontStyle, at, along: str) -> int:
    """A lever that turns by a right angle on the face of a front."""
    x, y, z = at
    radius, length = max(0.018, 1.4 * style.unit), max(0.11, 7 * style.unit)
    reach, width = max(0.034, 2.4 * style.unit), max(0.014, 1.1 * style.unit)
    boss = cylinder("x", [x - reach, y, z], reach - 0.001, radius, segments=14)
    w = width / 2
    if along == "z":
        lever = box(
            [x - reach, y - w, z - length * 0.8], [x - reach + width, y + w, z + length * 0.2]
        )
    else:
        lever = box(
            [x - reach, y - length * 0.5, z - w], [x - reach + width, y + length * 0.5, z + w]
        )
    joint = hinge(at, (1, 0, 0), np.pi / 2)
    return asm.add("latch", Shape().add(union([boss, lever]), style.hardware), front, joint)


def add_door(
    asm: Assembly,
    parent: int,
    lo,
    hi,
    hinge_edge: str,
    angle: float,
    style: FrontStyle,
    name: str = "door",
    **options,
) -> int:
    """A hinged front filling the box (lo, hi), its handle at the free edge.

    Args:
      hinge_edge: '+y' (left as seen from the front), '-y' (right), '-z' (bottom) or '+z' (top).
      angle: how far it opens, radians.
      options: ``extra`` shape welded to its rear, ``kind`` of panel, ``inset`` for a door that
        stands between walls: its axis is its outer front edge whatever the style says; ``beyond``:
        metres of what it closes that lie beyond its hinged edge.

    Returns:
      The part's index.
    """
    lo, hi = np.asarray(lo, dtype=np.float64), np.array(hi, dtype=np.float64)
    inset = bool(options.pop("inset", False))
    at = (lo + hi) / 2
    axis, sign = "xyz".index(hinge_edge[1]), 1 if hinge_edge[0] == "+" else -1
    thick, width = hi[0] - lo[0], hi[axis] - lo[axis]
    depth = 0.0 if inset else style.axis_depth
    behind, into = hinges.place(thick, width, depth, style.axis_inset)
    at[0] = lo[0] + behind
    at[axis] = (hi[axis] if sign > 0 else lo[axis]) - sign * into
    beyond = options.pop("beyond", 0.0)
    if behind > 0:
        angle = min(angle, hinges.clear_angle(thick, behind, into, beyond))
    free = ("-" if hinge_edge[0] == "+" else "+") + hinge_edge[1]
    joint = hinge(at, hinges.OPENING[hinge_edge], angle)
    return _front(asm, parent, lo, hi, free, joint, style, name, **options)


def add_drawer(
    asm: Assembly,
    parent: int,
    lo,
    hi,
    bay_lo,
    bay_hi,
    travel: float,
    style: FrontStyle,
    name: str = "drawer",
    **options,
) -> int:
    """A drawer: front slab (lo, hi) with a box of walls behind it that fills most of the bay.

    Args:
      bay_lo, bay_hi: the free room in the body behind the front.
      travel: share of the box's depth by which it pulls out.
      options: ``fill`` share of the bay's height that the box takes, ``depth`` share of its depth,
        ``clearance`` metres, ``center`` handle in the middle of the front, ``kind`` of panel.
    """
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    bay_lo, bay_hi = np.asarray(bay_lo, dtype=np.float64), np.asarray(bay_hi, dtype=np.float64)
    gap = options.get("clearance", 0.003)
    wall = max(0.012, 1.55 * style.unit)
    start = hi[0]
    length = (bay_hi[0] - gap - start) * options.get("depth", 0.95)
    tray_lo = np.array([start, max(bay_lo[1] + gap, lo[1]), max(bay_lo[2] + gap, lo[2])])
    tray_hi = np.array([start + length, min(bay_hi[1] - gap, hi[1]), min(bay_hi[2] - gap, hi[2])])
    tray_hi[2] = tray_lo[2] + (tray_hi[2] - tray_lo[2]) * options.get("fill", 0.75)
    extra = None  # a bay lower than its clearances takes a front alone
    if tray_lo[2] < tray_hi[2]:
        extra = Shape().add(shapes.tray(tray_lo, tray_hi, wall, open_front=True), style.inside)
    joint = slide((-1, 0, 0), travel * length)
    edge = "+z"
    return _front(
        asm,
        parent,
        lo,
        hi,
        edge,
        joint,
        style,
        name,
        extra=extra,
        center=options.get("center", True),
        kind=options.get("kind"),
    )


def add_knob(
    asm: Assembly,
    parent: int,
    at,
    radius: float,
    reach: float,
    material: Material,
    mark: Material,
    sweep: float | None = None,
    name: str = "knob",
    pointer: bool = True,
    skirt: bool = False,
    tilt: float = 0.0,
) -> int:
    """A turning knob on a plane x = at[0] (1 mm of air behind it), ``pointer``: with a ridge
    that points up at rest.

    ``sweep``: how far it turns, radians; None: without end. ``skirt``: a flat disc of the mark's
    colour at its foot, as knobs with a scale have; the body is then narrower. ``tilt``: by how much
    its panel leans back, radians.
    """
    x, y, z = (float(a) for a in at)
    wide = 0.7 * radius if skirt else radius
    foot = 0.3 * reach if skirt else 0.001
    body = cylinder("x", [x - reach, y, z], reach - foot, 0.85 * wide, wide, segments=18)
    shape = Shape().add(body, material)
    if skirt:
        disc = cylinder("x", [x - foot, y, z], foot - 0.001, radius, radius, segments=18)
        shape.add(disc, mark)
    if pointer:  # from the axis to the rim on one side only: a picture must show where it points
        w = 0.22 * radius
        rim = radius if skirt else 0.8 * radius
        ridge = box([x - 1.35 * reach, y - w, z - w], [x - reach, y + w, z + rim])
        shape.add(ridge, mark)
    axis = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    if tilt:
        lean = trimesh.transformations.rotation_matrix(tilt, (0, 1, 0), (x, y, z))
        shape = shape.moved(lean)
    joint = turn((x, y, z), axis) if sweep is None else hinge((x, y, z), axis, sweep)
    return asm.add(name, shape, parent, joint)
