"""An object as a physics engine sees it: what every format's writer takes.

Metres, kilograms, seconds, radians; the object frame at the shown state.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh

GRAVITY = 9.81  # m / s^2, along -z


@dataclasses.dataclass(frozen=True)
class Box:
    """A solid box.

    Attributes:
      center: [3] metres, object frame.
      size: [3] full side lengths, metres.
      rotation: [3, 3] whose columns are the box's own axes in the object frame (right-handed).
      stands_out: whether it is a leg or a handle, which is joined with no other shape while the
        budget allows it (``export.budget``).
      optional: whether it goes where it is in another part's way (``export.budget``).
    """

    center: np.ndarray
    size: np.ndarray
    rotation: np.ndarray
    stands_out: bool = False
    optional: bool = False


@dataclasses.dataclass(frozen=True)
class Hull:
    """A convex solid.

    Attributes:
      mesh: closed convex surface, metres, object frame.
      stands_out, optional: as of a ``Box``.
    """

    mesh: trimesh.Trimesh
    stands_out: bool = False
    optional: bool = False


Shape = Box | Hull


@dataclasses.dataclass(frozen=True)
class Dynamics:
    """How a joint resists. For a joint that rotates in N m (damping N m s / rad), else in N (N s /
    m).

    Attributes:
      damping: viscous.
      friction: dry, beside the spring.
      effort, velocity: what a drive may use at most (rad / s or m / s).
      stiffness, reference: of a spring that carries most of gravity's load: it pushes the
        coordinate towards ``reference`` (rad or m). 0: none.
      unsprung: dry friction where a format has no springs; None: the same as ``friction``.
      start: newtons at the handle that start the joint from rest, with the spring; None if nobody
        asked.
      falls: whether gravity moves the part, from some states, where there is no spring.
      lever: what newtons at the handle do to the coordinate: metres where it turns, else 1.
      load, left: the most that gravity does to the coordinate in any state, without and with the
        spring; 0 if nobody asked.
    """

    damping: float
    friction: float
    effort: float
    velocity: float
    stiffness: float = 0.0
    reference: float = 0.0
    unsprung: float | None = None
    start: float | None = None
    falls: bool = False
    lever: float = 1.0
    load: float = 0.0
    left: float = 0.0

    @property
    def alone(self) -> float:
        """Dry friction where there is no spring."""
        return self.friction if self.unsprung is None else self.unsprung


@dataclasses.dataclass(frozen=True)
class Body:
    """One part of an ``ArticulatedObject``, same order as its parts.

    Attributes:
      mass: kg.
      center: [3] centre of mass, metres, object frame.
      inertia: [3, 3] tensor about ``center``, kg m^2, object frame's axes.
      shapes: convex pieces that together stand for the part in collisions; at least one.
      dynamics: of the joint to its parent; None for the root and fixed parts.
      further: of the part's further joints, ``Part.outer`` and then ``Part.inner``.
      volume_error: what the shapes hold too much and too little, as a share of the part's convex
        hull (``export.budget``); None if nobody measured it.
    """

    mass: float
    center: np.ndarray
    inertia: np.ndarray
    shapes: tuple[Shape, ...]
    dynamics: Dynamics | None
    volume_error: float | None = None
    further: tuple[Dynamics, ...] = ()
