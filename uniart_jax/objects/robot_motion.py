"""What a robot's joints do: the joints on one edge of the tree, each a screw.

An edge is a chain of joints through links without a mesh. Joints coupled by ``<mimic>`` add up, so
a revolute and a prismatic joint along one line are a screw (that is how ``write_urdf`` writes
them). Those that are independent stay so: the one with the largest motion is the part's ``joint``,
the others are its ``outer`` and ``inner`` ones.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.robot import RawJoint
from uniart_jax.objects.several_joints import PARALLEL, proportional


@dataclasses.dataclass
class Edge:
    """A moving joint at the shown state. Its coordinate is ``rate`` times that of ``driver``
    (mimic), itself otherwise."""

    raw: RawJoint
    origin: np.ndarray  # world
    direction: np.ndarray  # world, unit
    lo: float  # relative to the shown state; infinite if unbounded
    hi: float
    driver: str
    rate: float


@dataclasses.dataclass
class Motion:
    """One degree of freedom of an edge: per unit of its coordinate in [lo, hi], so much angle and
    travel along one direction."""

    names: list[str]
    origin: np.ndarray
    direction: np.ndarray
    angle: float
    travel: float
    lo: float
    hi: float

    @property
    def bounded(self) -> bool:
        return bool(np.isfinite(self.lo) and np.isfinite(self.hi))

    def spans(self) -> tuple[np.ndarray, np.ndarray]:
        """(angle, travel) at both ends; the rotation is positive along ``direction``, or the travel
        if it does not rotate."""
        ends = np.array([self.lo, self.hi])
        return ends * self.angle, ends * self.travel


@dataclasses.dataclass(frozen=True)
class Joints:
    """All joints between a part and its parent: ``Part.outer``, ``joint`` and ``inner``."""

    joint: Joint
    outer: tuple[Joint, ...] = ()
    inner: tuple[Joint, ...] = ()


def joints_of(
    name: str,
    chain: list[Edge | RawJoint],
    mesh: trimesh.Trimesh,
    dead_zone: float,
    notes: list[str],
) -> Joints:
    """The joints between a link and its parent, each motion that is independent a joint.

    Args:
      name: the link.
      chain: its joints, from the parent down.
      mesh: the link's own mesh in the world at the shown state; it tells which motion is largest.
      dead_zone: travel below which there is none.
      notes: takes up one line for everything that is not as written.

    Raises:
      ValueError: a planar, floating or spherical joint.
    """
    for entry in chain:
        if isinstance(entry, RawJoint):
            raise ValueError(
                f"joint '{entry.name}' is {entry.type}: one rotation and one travel about a line "
                "are all a joint can do"
            )
    edges = [e for e in chain if isinstance(e, Edge)]
    motions = _motions(name, edges, mesh, notes) if edges else []
    made = [(_joint(motion, mesh, dead_zone, notes), motion) for motion in motions]
    made = [(joint, motion) for joint, motion in made if joint.type != "fixed"]
    if not made:
        return Joints(Joint.fixed())
    first = max(range(len(made)), key=lambda i: _reach(made[i][1], mesh))
    joints = tuple(joint for joint, _ in made)
    if len(made) > 1:
        names = [n for _, motion in made for n in motion.names]
        notes.append(
            f"joints {_quoted(names)} of link '{name}' move it independently; all are kept, and "
            f"its state is that of {_quoted(made[first][1].names)}"
        )
    return Joints(joints[first], joints[:first], joints[first + 1 :])


def _joint(motion: Motion, mesh: trimesh.Trimesh, dead_zone: float, notes: list[str]) -> Joint:
    """A motion as a joint, with an end where it has none."""
    if not motion.bounded:
        if motion.angle and motion.travel:  # a screw without an end turns and travels for ever
            motion = dataclasses.replace(motion, travel=0.0)
            notes.append(
                f"joint {_quoted(motion.names)}: a screw without limits; its travel was dropped"
            )
        if motion.angle:
            motion = dataclasses.replace(motion, lo=-np.pi, hi=np.pi, angle=1.0)
        else:
            along = float(np.ptp(mesh.vertices @ motion.direction) / abs(motion.travel))
            lo, hi, how = _ended(motion.lo, motion.hi, along)
            motion = dataclasses.replace(motion, lo=lo, hi=hi)
            notes.append(f"joint {_quoted(motion.names)}: prismatic without {how}")
    angle, travel = motion.spans()
    direction = motion.direction
    if (angle if motion.angle else travel)[1] < 0 or (angle if motion.angle else travel)[0] > 0:
        direction, angle, travel = -direction, -angle, -travel
    joint = Joint(motion.origin, direction, tuple(angle), tuple(travel), dead_zone)
    if joint.type == "fixed" and motion.hi > motion.lo:
        notes.append(
            f"joint {_quoted(motion.names)}: it moves by less than .1 degree or "
            f"{1000 * dead_zone:.2g} mm; read as fixed"
        )
    return joint


def _ended(lo: float, hi: float, along: float) -> tuple[float, float, str]:
    """Both ends of a travel that lacks one or two, from its part's length; and how, for people."""
    if np.isfinite(lo):
        return lo, max(lo + along, 0.0), "an upper limit; its part's length from the lower one"
    if np.isfinite(hi):
        return min(hi - along, 0.0), hi, "a lower limit; its part's length from the upper one"
    return -along / 2, along / 2, "limits; half its part's length either way"


def _motions(name: str, edges: list[Edge], mesh: trimesh.Trimesh, notes: list[str]) -> list[Motion]:
    """What an edge can do, from the parent down; joints that one coordinate drives are one motion,
    none if mimics undo each other."""
    groups: dict[str, list[Edge]] = {}
    inside = {e.raw.name for e in edges}
    for edge in edges:
        if edge.driver not in inside:  # it mimics a joint of another edge
            if edge.driver != edge.raw.name:
                notes.append(
                    f"joint '{edge.raw.name}': it mimics '{edge.driver}' of another link; read as "
                    "independent"
                )
            edge = dataclasses.replace(edge, driver=edge.raw.name, rate=1.0)
        groups.setdefault(edge.driver, []).append(edge)
    motions = [_coupled(group, mesh, notes) for group in groups.values()]
    motions = _without_held(_added([m for m in motions if m.angle or m.travel]), notes)
    if len(motions) == 1 and len(edges) > 1 and len(motions[0].names) == len(edges):
        kind = "screw" if motions[0].angle and motions[0].travel else "joint"
        notes.append(f"joints {_quoted(motions[0].names)} of link '{name}' are one {kind}")
    screw = _screw(motions)
    if screw is None:
        return motions
    notes.append(
        f"joints {_quoted(screw.names)} of link '{name}' turn more than once and travel "
        "independently; lowered to one proportional screw"
    )
    return [screw]


def _without_held(motions: list[Motion], notes: list[str]) -> list[Motion]:
    """Of several motions those whose limits leave room to move; one at least."""
    if len(motions) < 2:
        return motions
    free = [m for m in motions if m.hi - m.lo > 1e-9] or motions[:1]
    for motion in motions:
        if not any(motion is f for f in free):
            notes.append(
                f"joint {_quoted(motion.names)}: its limits leave no room to move; held fixed"
            )
    return free


def _largest(motions: list[Motion], mesh: trimesh.Trimesh, notes: list[str]) -> Motion:
    kept = max(motions, key=lambda m: _reach(m, mesh))
    lost = [n for m in motions if m is not kept for n in m.names]
    notes.append(
        f"joint {_quoted(lost)}: dropped beside joint {_quoted(kept.names)}, whose motion is larger"
    )
    return kept


def _coupled(edges: list[Edge], mesh: trimesh.Trimesh, notes: list[str]) -> Motion:
    """Joints driven by one coordinate (mimic) as one motion: a sum of parallel rotations and of
    travels."""
    lo, hi = _range([e for e in edges if e.raw.name == e.driver] or edges)
    if not np.isfinite(hi - lo):  # a continuous driver: the followers' limits hold it
        lo, hi = _range(edges)
    turning = [e for e in edges if e.raw.type != "prismatic"]
    slide = np.sum(
        [e.rate * e.direction for e in edges if e.raw.type == "prismatic"], axis=0
    ) + np.zeros(3)
    axis = turning[0].direction if turning else slide / max(np.linalg.norm(slide), 1e-12)
    angle = float(sum(e.rate * (e.direction @ axis) for e in turning))
    travel = float(slide @ axis)
    names = [e.raw.name for e in edges]
    coaxial = all(_same_line(e.origin, e.direction, turning[0].origin, axis) for e in turning)
    if coaxial and np.linalg.norm(slide - travel * axis) <= 1e-6 * max(1.0, np.linalg.norm(slide)):
        return Motion(names, (turning or edges)[0].origin, axis, angle, travel, lo, hi)
    alone = [Motion([e.raw.name], e.origin, e.direction, *_rates(e), lo, hi) for e in edges]
    return _largest(alone, mesh, notes)


def _rates(edge: Edge) -> tuple[float, float]:
    return (0.0, edge.rate) if edge.raw.type == "prismatic" else (edge.rate, 0.0)


def _range(edges: list[Edge]) -> tuple[float, float]:
    """The coordinates of the common driver that all of them allow."""
    ends = [sorted((e.lo / e.rate, e.hi / e.rate)) for e in edges]
    return max(e[0] for e in ends), min(e[1] for e in ends)


def _quoted(names: list[str]) -> str:
    return " and ".join(f"'{n}'" for n in names)


def _parallel(a: np.ndarray, b: np.ndarray) -> bool:
    return float(np.linalg.norm(np.cross(a, b))) < PARALLEL


def _same_line(p: np.ndarray, d: np.ndarray, origin: np.ndarray, axis: np.ndarray) -> bool:
    between = p - origin
    return _parallel(d, axis) and float(np.linalg.norm(between - (between @ axis) * axis)) < 1e-5


def _added(motions: list[Motion]) -> list[Motion]:
    """Independent travels along one direction, or turns about one line, one after the other, added
    up: a drawer on telescopic rails."""
    kept: list[Motion] = []
    for motion in motions:
        if not kept or not _alike(motion, kept[-1]):
            kept.append(motion)
            continue
        other = kept[-1]
        sign = np.sign(motion.direction @ other.direction)
        rate = (motion.angle or motion.travel) / (other.angle or other.travel) * sign
        ends = sorted((motion.lo * rate, motion.hi * rate))
        kept[-1] = dataclasses.replace(
            other, names=other.names + motion.names, lo=other.lo + ends[0], hi=other.hi + ends[1]
        )
    return kept


def _alike(a: Motion, b: Motion) -> bool:
    """Whether both are turns about one line, or travels along one direction."""
    if a.angle and b.angle and not (a.travel or b.travel):
        return _same_line(a.origin, a.direction, b.origin, b.direction)
    return bool(
        a.travel and b.travel and not (a.angle or b.angle) and _parallel(a.direction, b.direction)
    )


def _screw(motions: list[Motion]) -> Motion | None:
    """One proportional screw from an independent turn of more than a full turn, which a ``Joint``
    holds in a screw alone, and a travel, both bounded, along parallel axes; else None."""
    if len(motions) != 2 or not all(m.bounded for m in motions):
        return None
    turn, slide = sorted(motions, key=lambda m: m.angle == 0)
    if turn.travel or slide.angle or not turn.angle or not slide.travel:
        return None
    angle, travel = turn.spans()[0], slide.spans()[1]
    if np.ptp(angle) < 2 * np.pi:
        return None
    found = proportional(turn.direction, tuple(angle), slide.direction, tuple(travel))
    if found is None:
        return None
    (a0, a1), ends = found
    rate, (lo, hi) = (a1 - a0) / (ends[1] - ends[0]), sorted(ends)
    return Motion(turn.names + slide.names, turn.origin, turn.direction, rate, 1.0, lo, hi)


def _reach(motion: Motion, mesh: trimesh.Trimesh) -> float:
    """How far the motion carries the farthest point of the mesh; endless turns count once."""
    between = mesh.vertices - motion.origin
    radius = np.linalg.norm(
        between - (between @ motion.direction)[:, None] * motion.direction, axis=1
    ).max()
    span = min(motion.hi - motion.lo, 1e9)
    return float(max(min(abs(motion.angle) * span, 2 * np.pi) * radius, abs(motion.travel) * span))
