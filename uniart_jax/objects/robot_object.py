"""A ``Robot`` as an ``ArticulatedObject``: the last step of every reader."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.kinematics import TRAVEL_DEAD_ZONE
from uniart_jax.objects.object import ArticulatedObject, Part, moved_mesh
from uniart_jax.objects.robot import Robot
from uniart_jax.objects.robot_mesh import AssetFiles, link_mesh
from uniart_jax.objects.robot_motion import lowered
from uniart_jax.objects.robot_tree import Tree


def make_object(robot: Robot, files: AssetFiles, name: str) -> ArticulatedObject:
    """The object that a robot's links and joints make, in the robot's world frame and units at the shown state.

    Args:
      files: where its meshes may be read.
      name: of the object, where the robot has none.

    Raises:
      ValueError: it is not one tree of parts; without the file's name.
    """
    meshes = {}
    for link in robot.links.values():
        mesh = link_mesh(link, files, robot.notes)
        if mesh is not None:
            meshes[link.name] = mesh
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
        parts.append(
            Part(link, moved[link], -1 if parent is None else tree.names.index(parent), joint)
        )
    notes = tuple(one_line(n) for n in dict.fromkeys([*robot.notes, *files.notes]))
    return ArticulatedObject(tuple(parts), name=robot.name or name, provenance=notes)


def one_line(text: str) -> str:
    """A message without line breaks, at most 500 characters."""
    text = " ".join(str(text).split())
    return text if len(text) <= 500 else text[:497] + "..."
