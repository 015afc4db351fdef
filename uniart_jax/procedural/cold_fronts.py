"""Doors of refrigerators and freezers: thick, flat or bulged, lined, with handles that are parts of
their own."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import finishes, hinges
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    union,
)


@dataclasses.dataclass(frozen=True)
class Look:
    """What the doors of one appliance have in common (lengths in metres).

    Attributes:
      face, body, lining, glass, trim, grip: materials of doors, case, inside, panes, seals and
        frames, handles.
      panel: 'slab', 'border', 'raised', 'glass' or 'clear' (a frame without a pane).
      form: 'flat', 'bulged' or 'soft' (its edges cut).
      thick: of doors. unit: one percent of the longest side. seam: air between doors.
      handle: 'bar', 'bow', 'block', 'strip' (along a whole edge), 'groove', 'none'.
      own: handles are parts of their own. length: of a handle, a share of its door. wide: its
        thickness. reach: how far it stands out.
      axis: where doors turn, 0 their front face and 1 their rear face. inset: how far inside their
        edge, a share of what the ``gap`` (air behind doors) permits.
      swing: how far, radians. outline: what the corners of front and case are rounded to, or None.
    """

    face: Material
    body: Material
    lining: Material
    glass: Material
    trim: Material
    grip: Material
    panel: str
    form: str
    thick: float
    unit: float
    seam: float
    handle: str
    own: bool
    length: float
    wide: float
    reach: float
    axis: float
    inset: float
    gap: float
    swing: float
    outline: Manifold | None = None


def _slab(lo, hi, look: Look) -> Manifold:
    """A door's solid in the look's form."""
    solid = box(lo, hi)
    thick, wide = hi[0] - lo[0], hi[1] - lo[1]
    if look.form == "bulged":
        t = np.linspace(-1, 1, 9)
        arc = np.column_stack([lo[0] + 0.55 * thick * t**2, lo[1] + wide * (t + 1) / 2])
        outline = np.vstack([arc, [[hi[0], hi[1]], [hi[0], lo[1]]]])
        solid = extrusion(outline, "z", [0, 0, lo[2]], hi[2] - lo[2])
    elif look.form == "soft":
        r = 0.35 * thick
        outline = [[lo[0], lo[1] + r], [lo[0] + 0.4 * r, lo[1] + 0.4 * r], [lo[0] + r, lo[1]],
                   [hi[0], lo[1]], [hi[0], hi[1]], [lo[0] + r, hi[1]],
                   [lo[0] + 0.4 * r, hi[1] - 0.4 * r], [lo[0], hi[1] - r]]  # fmt: skip
        solid = extrusion(np.array(outline), "z", [0, 0, lo[2]], hi[2] - lo[2])
    return solid if look.outline is None else solid ^ look.outline


def _panel(lo, hi, look: Look) -> Shape:
    """A door between two corners: its slab with a frame, a groove or a pane."""
    shape, size = Shape(), (hi - lo)[1:]
    solid = _slab(lo, hi, look)
    frame = max(0.05, 3.5 * look.unit)
    a, b = lo[1:] + frame, hi[1:] - frame
    bent = look.panel == "raised" and look.form != "flat"
    if look.panel == "slab" or bent or size.min() < 3.2 * frame:
        return shape.add(solid, look.face)
    x0 = lo[0] + (0.6 if look.form == "bulged" else 0.0) * (hi[0] - lo[0])
    through = box([lo[0] - 1, *a], [hi[0] + 1, *b])
    if look.panel == "raised":
        m = 0.3 * frame
        groove = cut(through, [box([lo[0] - 2, *(a + m)], [hi[0] + 2, *(b - m)])])
        keep = box([x0 + 0.3 * (hi[0] - lo[0]), *(a - 1)], [hi[0] + 2, *(b + 1)])
        return shape.add(cut(solid, [cut(groove, [keep])]), look.face)
    shape.add(cut(solid, [through]), look.trim if look.panel == "border" else look.face)
    if look.panel == "clear":
        return shape
    pane = box([x0 + 0.1 * (hi[0] - lo[0]), *a], [hi[0], *b])
    return shape.add(pane, look.face if look.panel == "border" else look.glass)


def _handle(lo, hi, edge: str, high: float, look: Look) -> Manifold | None:
    """The handle of a door near its free ``edge``; ``high``: where along a side, 0 to 1."""
    size, unit = (hi - lo)[1:], look.unit
    wide, reach = look.wide, look.reach
    inset = min(max(0.025, 2.2 * unit), 0.2 * float(size.min()))
    face = float(lo[0]) + (0.25 * (hi[0] - lo[0]) if look.form == "bulged" else 0.0)
    axis = 1 if edge[1] == "y" else 2
    across, run = (axis, 3 - axis)
    at = hi[axis] - inset if edge[0] == "+" else lo[axis] + inset
    room = float(hi[run] - lo[run]) - 2 * inset
    if look.handle == "none" or look.handle == "groove":
        return None
    if look.handle == "strip":
        a, b = lo.copy(), hi.copy()
        a[axis], b[axis] = (hi[axis] - 1.5 * wide, hi[axis]) if edge[0] == "+" else (
            lo[axis], lo[axis] + 1.5 * wide)  # fmt: skip
        a[0], b[0] = lo[0] - 0.7 * reach, face - 0.0005
        trim = 0.0 if edge[1] == "y" else min(1.3 * (reach + look.thick), 0.25 * room)
        a[run], b[run] = a[run] + trim + 0.002, b[run] - trim - 0.002
        return box(a, b)
    length = float(np.clip(look.length * room, min(0.08, 0.8 * room), room))
    mid = float(np.clip(lo[run] + high * (hi[run] - lo[run]), lo[run] + inset + length / 2,
                        hi[run] - inset - length / 2))  # fmt: skip

    def block(x0, x1, s0, s1, t):
        a, b = np.empty(3), np.empty(3)
        a[0], b[0] = x0, x1
        a[across], b[across] = at - t / 2, at + t / 2
        a[run], b[run] = mid + s0, mid + s1
        return box(a, b)

    end = face + (0.35 * (hi[0] - lo[0]) if look.form == "bulged" else 0.0)
    half = length / 2
    if look.handle == "block":
        return block(face - reach * 0.8, end, -half, half, wide * 1.3)
    foot = 0.16 * length
    posts = [block(face - reach + 0.3 * wide, end, s, s + foot * 0.6, 0.8 * wide)
             for s in (-half + 0.2 * foot, half - 0.8 * foot)]  # fmt: skip
    if look.handle == "bow":
        t = np.linspace(0, np.pi, 9)
        outer = np.column_stack([half * np.cos(t), -reach * np.sin(t)])
        inner = np.column_stack([(half - wide) * np.cos(t), -(reach - 0.8 * wide) * np.sin(t)])
        outline = np.vstack([outer, inner[::-1]])
        if run == 2:
            bow = extrusion(outline, "y", [face, at - wide / 2, mid], wide)
        else:
            bow = extrusion(outline[:, ::-1], "z", [face, mid, at - wide / 2], wide)
        if end == face:
            return bow
        starts = (-half + 0.11 * wide, half - 0.91 * wide)
        feet = [block(face - 0.23 * wide, end, s, s + 0.8 * wide, 0.83 * wide) for s in starts]
        return union([bow, *feet])
    if run == 2:
        bar = cylinder("z", [face - reach + wide / 2, at, mid - half], length, wide / 2)
    else:
        bar = cylinder("y", [face - reach + wide / 2, mid - half, at], length, wide / 2)
    return union([bar, *posts])


def _groove(lo, hi, edge: str, look: Look) -> Manifold:
    """A dark line on a door's face along its free ``edge``, where fingers go in."""
    axis = 1 if edge[1] == "y" else 2
    a, b = lo + 0.004, hi - 0.004
    if edge[0] == "+":
        a[axis] = b[axis] - look.wide
    else:
        b[axis] = a[axis] + look.wide
    rest = 0.5 * (1 - look.length) * (b - a)[3 - axis]
    a[3 - axis], b[3 - axis] = a[3 - axis] + rest, b[3 - axis] - rest
    a[0], b[0] = lo[0] - 0.0015, lo[0]
    return box(a, b)


def add_front(asm, root, lo, hi, edge, joint, look: Look, name: str, high: float, extra) -> int:
    """A door or drawer front with its handle; returns its part."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    rear = hi.copy()
    lined = look.panel not in ("glass", "clear")
    if lined:  # its rear is of another material
        rear[0] -= 0.12 * (hi[0] - lo[0])
    shape = _panel(lo, rear, look)
    if lined:
        back = box([rear[0], *(lo[1:] + 0.008)], [hi[0], *(hi[1:] - 0.008)])
        shape.add(back if look.outline is None else back ^ look.outline, look.lining)
    if extra is not None:
        shape.join(extra)
    grip = _handle(lo, rear, edge, high, look)
    if grip is not None:
        grip = grip - _slab(lo, rear, look)
        grip = None if grip.is_empty() else grip
    if look.handle == "groove" and look.form == "flat" and look.outline is None:
        shape.add(_groove(lo, hi, edge, look), look.trim.darker(0.4))
    own = look.own and grip is not None
    if grip is not None and not own:
        shape.add(grip, look.grip)
    part = asm.add(name, shape, root, joint)
    if own:
        asm.add(f"{name}_handle", Shape().add(grip, look.grip), part, label="handle")
    return part


def add_door(asm, root, lo, hi, edge: str, look: Look, beyond: float, high: float, extra) -> int:
    """A door that turns about its side ``edge``."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    thick, sign = hi[0] - lo[0], 1 if edge[0] == "+" else -1
    outer = beyond < 0.5
    behind = thick * (look.axis if outer else 0.0)
    into = look.inset * float(np.sqrt((thick - behind + look.gap) ** 2 - (thick - behind) ** 2))
    into = min(into, 0.5 * thick) if behind > 0 else 0.0
    at = (lo + hi) / 2
    at[0], at[1] = lo[0] + behind, (hi[1] if sign > 0 else lo[1]) - sign * into
    angle = look.swing if outer else min(look.swing, float(np.deg2rad(110)))
    if behind > 0:
        steps = np.arange(0.0, angle + 0.02, 0.03)
        air = look.gap - 2e-4
        free = hinges.clear_angle(thick, behind, into, beyond, air, steps, (9, 12))
        angle = min(angle, free)
    free = ("-" if sign > 0 else "+") + "y"
    if look.handle == "strip" and high in (0.0, 1.0):
        free = "+z" if high == 1.0 else "-z"
    joint = hinge(at, hinges.OPENING[edge], angle)
    return add_front(asm, root, lo, hi, free, joint, look, "door", high, extra)


def add_plate(rng, asm: Assembly, part: int, lo, hi, look: Look) -> None:
    """A dispenser or a plate that is a fixed part of its own, on a door's face."""
    size = (hi - lo)[1:]
    wide, tall = rng.uniform(0.3, 0.6) * size[0], rng.uniform(0.12, 0.3) * size[1]
    if look.form == "bulged" or look.panel != "slab" or wide < 0.04:
        return
    y, z = (lo[1] + hi[1]) / 2, lo[2] + size[1] * float(rng.uniform(0.55, 0.75))
    reach = max(0.008, 0.7 * look.unit)
    plate = box([lo[0] - reach, y - wide / 2, z - tall / 2], [lo[0], y + wide / 2, z + tall / 2])
    hole = box(
        [lo[0] - 1, y - wide * 0.35, z - tall * 0.4], [lo[0] - 0.3 * reach, y + wide * 0.35, z]
    )
    shape = Shape().add(cut(plate, [hole]), finishes.dark(rng) if rng.random() < 0.7 else look.trim)
    asm.add("dispenser", shape, part)
