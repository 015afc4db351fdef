"""What every description of an articulated object comes down to: links with shapes, joints between
them; and the object they make.

A reader (``urdf_read``, ``partnet_mobility``, ``mjcf``, ``singapo``) fills a ``Robot`` and trusts
nothing; ``asset_files`` reads what it names without leaving the asset's folder, ``robot_mesh``
makes one mesh a link, ``robot_limits`` sane limits, ``robot_tree`` with ``robot_motion`` one tree
with one screw an edge, ``robot_object`` the object. Every repair is one line of ``Robot.notes``.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh

MOVING = ("revolute", "continuous", "prismatic")
MAX_NUMBER = 1e9  # beyond it squares and products overflow; no asset is a million kilometres wide
MAX_PARTS = 4096  # links or joints; the worst steps take seconds for so many
REFUSED = ("planar", "floating", "spherical")


@dataclasses.dataclass
class Geometry:
    """A visual or collision shape: a mesh file, a loaded mesh or a primitive in its link's
    frame."""

    kind: str  # mesh, box, cylinder, sphere or capsule
    size: np.ndarray  # box: 3 sides; cylinder, capsule: radius, length; sphere: radius; mesh: scale
    origin: np.ndarray  # [4, 4]
    filename: str = ""
    color: np.ndarray | None = None  # [4] sRGB and alpha in [0, 1]
    texture: str = ""
    mesh: trimesh.Trimesh | None = None  # kind mesh, already loaded and painted: no file is read


@dataclasses.dataclass
class Link:
    """A rigid body; one without a shape that can be loaded is collapsed."""

    name: str
    visuals: list[Geometry]
    collisions: list[Geometry]
    label: str = ""  # for people


@dataclasses.dataclass
class RawJoint:
    """One joint as written."""

    name: str
    type: str
    parent: str
    child: str
    origin: np.ndarray  # [4, 4]
    axis: np.ndarray  # [3] in the joint's frame
    limits: tuple[float, float] | None
    mimic: tuple[str, float, float] | None  # source joint, multiplier, offset


@dataclasses.dataclass
class Robot:
    """What a file says, before it is made one tree of parts."""

    name: str
    links: dict[str, Link]
    joints: list[RawJoint]
    notes: list[str]  # repairs
    radians: bool = False  # angles are radians for certain: large ones are not taken for degrees
    category: str = ""
