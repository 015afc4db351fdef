"""Where bodies stand, what their joints are called and which of them never touch: the same in every
format.

A body's frame stands at the origin of its joint, the last where it has several, with the object
frame's axes. Metres and radians, object frame at the shown state.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from uniart_jax.export.physics import Body, Dynamics, Hull
from uniart_jax.objects.object import ArticulatedObject, Part


def joint_name(part: Part) -> str:
    """The joint that carries ``part``'s coordinate q (of a screw, the one that turns)."""
    return f"{part.name}_joint"


def joint_names(part: Part) -> list[str]:
    """Of the joints of a part that moves, from its parent down (none of one that does not): its own
    is ``joint_name``, those beside it are counted from 2."""
    if not moves(part):
        return []
    own = joint_name(part)
    beside = [f"{own}_{number}" for number in range(2, len(part.chain) + 1)]
    return [*beside[: len(part.outer)], own, *beside[len(part.outer) :]]


def travel_name(part: Part) -> str:
    """The joint along which a screw slides."""
    return f"{part.name}_travel"


@dataclasses.dataclass(frozen=True)
class ChainJoint:
    """One of the joints between a part and its parent.

    Attributes:
      name: of the joint.
      part: the part with this joint and no other.
      dynamics: of the joint.
      first: whether the part's own coordinate is this joint's.
    """

    name: str
    part: Part
    dynamics: Dynamics
    first: bool


def joint_chain(part: Part, body: Body) -> list[ChainJoint]:
    """The joints of a part that moves, from its parent down; those beside ``part.joint`` are called
    ``<part>_joint_2`` and so on."""
    assert body.dynamics is not None  # ``check_bodies``
    before = len(part.outer)
    dynamics = [*body.further[:before], body.dynamics, *body.further[before:]]
    found = []
    links = zip(joint_names(part), part.chain, dynamics, strict=True)
    for place, (name, joint, resistance) in enumerate(links):
        alone = dataclasses.replace(part, joint=joint, outer=(), inner=())
        found.append(ChainJoint(name, alone, resistance, place == before))
    return found


def body_frames(obj: ArticulatedObject) -> list[np.ndarray]:
    """[K] of [3], origin of every body's frame: a point of its (last) axis; a fixed part shares its
    parent's frame, the root's is 0."""
    frames: list[np.ndarray] = []
    for part in obj.parts:
        if part.parent < 0:
            frames.append(np.zeros(3))
        elif part.joint.type == "fixed":
            frames.append(frames[part.parent])
        else:
            frames.append(part.chain[-1].origin * obj.scale)
    return frames


def moves(part: Part) -> bool:
    """Whether the part has a joint that moves it."""
    return part.parent >= 0 and part.joint.type != "fixed"


def metric_travel(part: Part, scale: float) -> tuple[float, float]:
    """(lower, upper) end of the joint's travel in metres; of a left-handed screw the ends of q are
    swapped."""
    lo, hi = sorted(t * scale for t in part.joint.travel)
    return lo, hi


def metric_limits(part: Part, scale: float) -> tuple[float, float]:
    """Ends of the joint's coordinate, radians or metres."""
    unit = 1.0 if part.joint.rotates else scale
    return part.joint.limits[0] * unit, part.joint.limits[1] * unit


def metric(obj: ArticulatedObject, q: np.ndarray) -> np.ndarray:
    """[K] coordinates ``q`` (object units) in radians and metres."""
    return q * [1.0 if p.joint.rotates else obj.scale for p in obj.parts]


def rigid_groups(obj: ArticulatedObject) -> list[int]:
    """[K] the part that leads each part's group: a part and what is fixed to it move as one."""
    leaders: list[int] = []
    for k, part in enumerate(obj.parts):
        leaders.append(k if part.parent < 0 or moves(part) else leaders[part.parent])
    return leaders


def linked_pairs(obj: ArticulatedObject) -> list[tuple[int, int]]:
    """Pairs of parts of two rigid groups that one moving joint links: they touch at the joint, so
    contacts between them are left out."""
    leaders = rigid_groups(obj)
    members: dict[int, list[int]] = {}
    for k, leader in enumerate(leaders):
        members.setdefault(leader, []).append(k)
    return [
        (above, below)
        for leader, group in members.items()
        if obj.parts[leader].parent >= 0
        for above in members[leaders[obj.parts[leader].parent]]
        for below in group
    ]


def check_lengths(writer: str, obj: ArticulatedObject, **given: Sequence) -> None:
    """One entry for every part.

    Raises:
      ValueError: a list of another length.
    """
    for name, values in given.items():
        if len(values) != len(obj.parts):
            raise ValueError(
                f"{writer}: {name} has {len(values)} entries for {len(obj.parts)} parts"
            )


def check_bodies(writer: str, obj: ArticulatedObject, bodies: Sequence[Body]) -> None:
    """One body for every part, with the dynamics of every joint that moves.

    Raises:
      ValueError: another number of bodies, or a joint that moves without dynamics.
    """
    check_lengths(writer, obj, bodies=bodies)
    for part, body in zip(obj.parts, bodies, strict=True):
        if moves(part) and body.dynamics is None:
            raise ValueError(
                f"{writer}: the body of part '{part.name}' has no dynamics, but its joint moves"
            )
        if len(body.further) != len(part.chain) - 1:
            raise ValueError(
                f"{writer}: the body of part '{part.name}' has the dynamics of {len(body.further)} "
                f"further joints, but there are {len(part.chain) - 1}"
            )


def hulls(body: Body) -> list[Hull]:
    """The body's shapes that need a mesh, in their order."""
    return [shape for shape in body.shapes if isinstance(shape, Hull)]


def number_text(value: float) -> str:
    """Short where it can be, and exact: limits and axes survive the round trip bit for bit."""
    return repr(float(value) + 0.0)


def vector_text(values: Iterable[float] | np.ndarray) -> str:
    return " ".join(number_text(v) for v in values)
