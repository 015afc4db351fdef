"""An object as pieces that can be printed and put together. Millimetres, assembled, at rest.

Parts that do not move against each other are one piece. Every piece keeps its clearance from all
others at rest and from its parent along its whole range, and is held by what ``hinge``, ``axle``
and ``slide`` give it. A joint that cannot be printed is fixed, and said to be.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold

from uniart_jax.export.frames import moves, rigid_groups
from uniart_jax.export.part_kinds import is_knob
from uniart_jax.export.printing.axle import fit_axle
from uniart_jax.export.printing.clear import apart, cleared, is_crumb, losses
from uniart_jax.export.printing.hinge import Around, Fit, fit_hinge
from uniart_jax.export.printing.settings import PrintSettings, UnprintableError
from uniart_jax.export.printing.slide import fit_slide
from uniart_jax.export.printing.solids import (
    CRUMB,
    TRIFLE,
    box_of,
    one_piece,
    solid_of,
    strutted,
    union,
    welded,
    without_path,
)
from uniart_jax.export.words import counted
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject

SEEN = 0.1  # length of a strut that is told


@dataclasses.dataclass(frozen=True)
class Piece:
    """One thing that comes off the printer.

    Attributes:
      name: of its file, like no other piece's.
      solid: assembled at rest.
      parts: names of the object's parts that it holds; none of a pin.
      leader: index of the part that it moves with.
      hardware: what of it was made to hold; its walls are what they have to be.
      loose: it broke off the piece of its leader, and is glued to it.
    """

    name: str
    solid: Manifold
    parts: tuple[str, ...]
    leader: int
    hardware: Manifold
    loose: bool = False


@dataclasses.dataclass(frozen=True)
class PrintedJoint:
    """A moving joint as it is printed.

    Attributes:
      child, parent: indices of leading parts.
      fit: what holds it.
      pins: names of the pieces that are its pins, in the order of the fit's.
    """

    child: int
    parent: int
    fit: Fit
    pins: tuple[str, ...] = ()

    @property
    def joint(self) -> Joint:
        """As it is printed, mm, 0 at rest."""
        return self.fit.joint


@dataclasses.dataclass(frozen=True)
class Print:
    """A whole object to be printed.

    Attributes:
      pieces: parents before children, a joint's pins behind its child.
      joints: those that move, in the order of assembly.
      notes: what is other than it was, a line each.
      settings: that it was made with.
    """

    pieces: tuple[Piece, ...]
    joints: tuple[PrintedJoint, ...]
    notes: tuple[str, ...]
    settings: PrintSettings


def make_print(
    obj: ArticulatedObject,
    surfaces: Sequence[tuple[np.ndarray, np.ndarray]],
    names: Sequence[str],
    settings: PrintSettings,
) -> Print:
    """The object at rest (``placement.place``), made printable.

    Args:
      obj: closed, coordinates from 0 up.
      surfaces: [K] (vertices [v, 3], faces [f, 3]) of the parts, closed, object units.
      names: [K] of the pieces' files.

    Raises:
      ValueError: a part that bounds no volume and is not fixed to another.
    """
    corners = np.stack([[v.min(0), v.max(0)] for v, _ in surfaces])
    lo, hi = corners[:, 0].min(0), corners[:, 1].max(0)
    scale = settings.size / float((hi - lo).max())
    sized = np.diag([scale, scale, scale, 1.0])
    notes, solids = [], []
    for part, (vertices, faces) in zip(obj.parts, surfaces, strict=True):
        solid, hulls = solid_of(np.asarray(vertices) * scale, faces)
        if solid.volume() < CRUMB and part.parent >= 0 and not moves(part):
            notes.append(f"'{part.name}' has {solid.volume():.2g} mm^3 and is left out")
            solid = Manifold()
        elif solid.volume() < CRUMB:
            raise ValueError(
                f"print: '{part.name}' has {solid.volume():.2g} mm^3 at this size; "
                "choose a larger --print-size"
            )
        if hulls:
            notes.append(
                f"'{part.name}': {hulls} of its shells were no solids; hulls stand for them"
            )
        solids.append(solid)
    joints = [p.joint.transformed(sized) for p in obj.parts]
    for k, part in enumerate(obj.parts):
        if len(part.chain) > 1:
            notes.append(f"'{part.name}': of its {len(part.chain)} joints one is printed")
        if moves(part) and part.joint.type == "screw":
            notes.append(f"'{part.name}': it turns, but does not travel along its axis")
            joints[k] = dataclasses.replace(joints[k], travel=(0.0, 0.0))
    fixed: dict[int, str] = {}
    while True:
        made = _attempt(obj, solids, joints, names, fixed, settings)
        if isinstance(made, Print):
            said = [
                f"'{obj.parts[k].name}' cannot be printed as a joint and is fixed: {why}"
                for k, why in sorted(fixed.items())
            ]
            return dataclasses.replace(made, notes=(*notes, *said, *made.notes))
        fixed |= made


def _attempt(
    obj: ArticulatedObject,
    solids: Sequence[Manifold],
    joints: Sequence[Joint],
    names: Sequence[str],
    fixed: dict[int, str],
    settings: PrintSettings,
) -> Print | dict[int, str]:
    """The print, or the joints that cannot be printed and why."""
    parts = [
        dataclasses.replace(p, joint=Joint.fixed()) if k in fixed else p
        for k, p in enumerate(obj.parts)
    ]
    rigid = dataclasses.replace(obj, parts=tuple(parts))
    leaders, notes = rigid_groups(rigid), []
    bodies: dict[int, Manifold] = {}
    for k in sorted(set(leaders)):
        own = [solids[i] for i, leader in enumerate(leaders) if leader == k]
        bodies[k], struts, crumbs = strutted(welded(own))
        told = [x for x in struts if x > SEEN]
        if told:
            notes.append(
                f"'{parts[k].name}': {counted(len(told), 'piece')} hung in the air; "
                f"{counted(len(told), 'strut')} of up to {max(told):.1f} mm hold them"
            )
        if crumbs:
            notes.append(
                f"'{parts[k].name}': {counted(crumbs, 'crumb')} below {CRUMB:g} mm^3 left out"
            )
    order = [k for k in sorted(bodies) if parts[k].parent >= 0]
    above = {k: leaders[parts[k].parent] for k in order}
    whole, failed = dict(bodies), {}
    bodies, cuts = cleared(bodies, above, joints, parts, failed, settings)
    if failed:
        return failed
    taken, hardware, printed = Manifold(), {k: Manifold() for k in bodies}, []
    for k in order:
        up = above[k]
        around = Around(union(s for i, s in bodies.items() if i not in (k, up)), taken)
        ways = {i: (bodies[i], joints[i]) for i in order if i != k and above[i] == up}
        fit, why = _fitted(
            bodies[up], bodies[k], joints[k], is_knob(obj, k), around, ways, settings
        )
        if fit is None and parts[k].joint.type == "screw":
            note = f"it only lies there, nothing holds it: {why}"
            text, none = "set it down where it belongs", Manifold()
            fit = Fit("loose", bodies[up], bodies[k], (), none, none, {}, text, joints[k], note)
        if fit is None:
            failed[k] = why
            continue
        left = {i: s - fit.keep for i, s in bodies.items() if i not in (k, up)}
        gone = [i for i, s in left.items() if is_crumb(s)]
        if gone:
            failed[k] = f"nothing would be left of '{parts[gone[0]].name}'"
            continue
        left |= {up: fit.parent, k: fit.child}
        cuts += [(k, i) for i in left if (bodies[i] - left[i]).volume() > TRIFLE]
        bodies = {i: left[i] for i in bodies}
        taken = union([taken, fit.keep])
        for i in (k, up):
            hardware[i] = union([hardware[i], fit.keep])
        printed.append(PrintedJoint(k, up, fit))
        if fit.note:
            notes.append(f"'{parts[k].name}': {fit.note}")
    if failed:
        return failed
    bodies, more = apart(bodies, above, parts, failed, settings)
    if failed:
        return failed
    notes += losses(whole, bodies, [*cuts, *more], parts)
    pieces, called = _pieces(bodies, above, printed, hardware, leaders, parts, names, notes)
    return Print(pieces, called, tuple(notes), settings)


def _pieces(
    bodies: dict[int, Manifold],
    above: dict[int, int],
    printed: Sequence[PrintedJoint],
    hardware: dict[int, Manifold],
    leaders: Sequence[int],
    parts: Sequence,
    names: Sequence[str],
    notes: list[str],
) -> tuple[tuple[Piece, ...], tuple[PrintedJoint, ...]]:
    """The bodies and the joints' pins as pieces, and the joints with their pins' names."""
    pieces: list[Piece] = []
    joints = {joint.child: joint for joint in printed}
    used = {name.lower() for name in names}  # some disks do not tell capitals apart
    for k, solid in bodies.items():
        held = tuple(p.name for p, leader in zip(parts, leaders, strict=True) if leader == k)
        shells = sorted(solid.decompose(), key=lambda s: -s.volume())
        loose = [s for s in shells[1:] if s.volume() > CRUMB]
        pieces.append(Piece(names[k], shells[0], held, k, hardware[k]))
        for rest in loose:
            name = _new_name(f"{names[k]}_loose", used)
            pieces.append(Piece(name, rest, held, k, hardware[k], loose=True))
        if loose:
            notes.append(f"'{parts[k].name}' falls into {len(loose) + 1} pieces: glue them")
        if k in joints:
            solids = joints[k].fit.pins
            pins = tuple(_new_name(f"{names[k]}_pin", used) for _ in solids)
            joints[k] = dataclasses.replace(joints[k], pins=pins)
            pieces += [
                Piece(n, pin, (), above[k], pin) for n, pin in zip(pins, solids, strict=True)
            ]
    return tuple(pieces), tuple(joints.values())


def _new_name(stem: str, used: set[str]) -> str:
    """The first of ``<stem>_1``, ``<stem>_2``, ... that is not used; it is from now on."""
    number = 1
    while f"{stem}_{number}".lower() in used:
        number += 1
    name = f"{stem}_{number}"
    used.add(name.lower())
    return name


def _fitted(
    parent: Manifold,
    child: Manifold,
    joint: Joint,
    knob: bool,
    around: Around,
    ways: dict[int, tuple[Manifold, Joint]],
    settings: PrintSettings,
) -> tuple[Fit | None, str]:
    """The first kind of joint that can be printed here; or none, and why not.

    Args:
      ways: the parent's other children, whose ways are kept free.
    """
    kinds = [fit_slide]
    if joint.rotates:
        kinds = [fit_axle, fit_hinge] if knob else [fit_hinge, fit_axle]
    reasons = []
    for kind in kinds:
        try:
            fit = kind(parent, child, joint, around, settings)
        except UnprintableError as error:
            reasons.append(str(error))
            continue
        kept = fit.added
        for solid, motion in ways.values():
            kept = without_path(kept, solid, motion, settings.clearance)
        lost = fit.added - kept
        if lost.volume() < TRIFLE:
            return fit, ""
        whole = one_piece(fit.parent - lost)
        if whole is not None:
            return dataclasses.replace(fit, parent=whole), ""
        reasons.append("what would hold it stands in another part's way")
    return None, "; ".join(dict.fromkeys(reasons))


def at_rest_bounds(made: Print) -> np.ndarray:
    """[2, 3] box of the assembled print."""
    boxes = np.stack([box_of(piece.solid) for piece in made.pieces])
    return np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)])
