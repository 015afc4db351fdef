"""A ``Robot`` as an ``ArticulatedObject``: the last step of every reader."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from uniart_jax.objects.double_faces import single_sided
from uniart_jax.objects.kinematics import TRAVEL_DEAD_ZONE
from uniart_jax.objects.object import ArticulatedObject, Part, moved_mesh
from uniart_jax.objects.robot import Robot
from uniart_jax.objects.robot_mesh import AssetFiles, link_mesh
from uniart_jax.objects.robot_motion import lowered
from uniart_jax.objects.robot_tree import Tree

_LOST = re.compile(
    r"^(link|mesh|texture) .*(is missing|left out|not read|cannot be read|outside the asset|not an image)"
)


def make_object(robot: Robot, files: AssetFiles, name: str) -> ArticulatedObject:
    """The object that a robot's links and joints make, in the robot's world frame and units at the shown state.

    Args:
      files: where its meshes may be read.
      name: of the object, where the robot has none.

    Raises:
      ValueError: it is not one tree of parts; without the file's name.
    """
    meshes, removed = {}, {}
    for link in robot.links.values():
        mesh = link_mesh(link, files, robot.notes)
        if mesh is not None:
            meshes[link.name], removed[link.name] = single_sided(mesh)
    if doubled := [f"'{name}'" for name, count in removed.items() if count]:
        robot.notes.append(
            f"{sum(removed.values())} faces exist twice, back to back, in links {', '.join(doubled)}: the outer ones were kept"
        )
    tree = Tree(robot, {n: float(np.linalg.norm(m.extents)) for n, m in meshes.items()})
    moved = {n: moved_mesh(meshes[n], tree.placed[n]) for n in tree.names}
    corners = np.stack([m.bounds for m in moved.values()])
    side = float((corners[:, 1].max(0) - corners[:, 0].min(0)).max())
    if not side > 0:
        raise ValueError("the object has no extent")
    parts = []
    for link in tree.names:
        parent = tree.parents[link]
        joint = lowered(link, tree.chains[link], moved[link], TRAVEL_DEAD_ZONE * side, robot.notes)
        above = -1 if parent is None else tree.names.index(parent)
        parts.append(Part(link, moved[link], above, joint, robot.links[link].label))
    notes = tuple(one_line(n) for n in dict.fromkeys([*robot.notes, *files.notes]))
    return ArticulatedObject(
        tuple(parts), name=robot.name or name, category=robot.category, provenance=notes
    )


def one_line(text: str) -> str:
    """A message without line breaks, at most 500 characters."""
    text = " ".join(str(text).split())
    return text if len(text) <= 500 else text[:497] + "..."


def lost_pieces(provenance: Sequence[str]) -> list[str]:
    """Those repairs that tell of geometry or textures that are gone: such an object is incomplete."""
    return [line for line in provenance if _LOST.search(line)]
