"""A ``Robot`` as an ``ArticulatedObject``: the last step of every reader."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence

import numpy as np

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.double_faces import single_sided
from uniart_jax.objects.kinematics import LEAST_TRAVEL, TRAVEL_DEAD_ZONE
from uniart_jax.objects.names import MAX_NAME, Numbered, clean, one_line
from uniart_jax.objects.object import ArticulatedObject, Part, moved_mesh
from uniart_jax.objects.robot import MAX_PARTS, Robot
from uniart_jax.objects.robot_mesh import link_mesh
from uniart_jax.objects.robot_motion import joints_of
from uniart_jax.objects.robot_tree import Tree

_HEAD = re.compile(r"^(?:(?:link|mesh) '.*?'(?:: | (?=is missing|lies ))|texture ')")
_QUOTED = re.compile(r"(?<!\w)'[^']*'(?!\w)")
_LOST = re.compile(r"is missing|left out|not read|cannot be read|outside the asset|not an image")


def make_object(robot: Robot, files: AssetFiles, name: str) -> ArticulatedObject:
    """The object that a robot's links and joints make, in the robot's world frame and units at the
    shown state.

    Args:
      files: where its meshes may be read.
      name: of the object, where the robot has none.

    Raises:
      ValueError: it is not one tree of parts; without the file's name.
    """
    if len(robot.links) > MAX_PARTS:
        raise ValueError(f"it holds {len(robot.links):,} links, more than {MAX_PARTS:,}")
    meshes, removed = {}, {}
    for link in robot.links.values():
        mesh = link_mesh(link, files, robot.notes)
        if mesh is not None:
            meshes[link.name], removed[link.name] = single_sided(mesh)
    if doubled := [f"'{name}'" for name, count in removed.items() if count]:
        robot.notes.append(
            f"{sum(removed.values())} faces exist twice, back to back or repeated, in links "
            f"{', '.join(doubled)}: the outer ones were kept"
        )
    tree = Tree(robot, {n: float(np.linalg.norm(m.extents)) for n, m in meshes.items()})
    moved = {n: moved_mesh(meshes[n], tree.placed[n]) for n in tree.names}
    corners = np.stack([m.bounds for m in moved.values()])
    side = float((corners[:, 1].max(0) - corners[:, 0].min(0)).max())
    if not side > 0:
        raise ValueError("the object has no extent")
    least = min(LEAST_TRAVEL, TRAVEL_DEAD_ZONE * side)  # the latter of objects below 2 cm
    parts, index = [], {n: i for i, n in enumerate(tree.names)}
    for link in tree.names:
        parent = tree.parents[link]
        made = joints_of(link, tree.chains[link], moved[link], least, robot.notes)
        above, label = -1 if parent is None else index[parent], robot.links[link].label
        parts.append(Part(link, moved[link], above, made.joint, label, made.outer, made.inner))
    parts, name, category = _named(parts, robot.name or name, robot.category, robot.notes)
    notes = tuple(dict.fromkeys(one_line(n) for n in [*robot.notes, *files.notes]))
    return ArticulatedObject(tuple(parts), name=name, category=category, provenance=notes)


def _named(
    parts: list[Part], name: str, category: str, notes: list[str]
) -> tuple[list[Part], str, str]:
    """Parts, the object's name and its category with names that any file can hold; one note tells
    of all that were changed."""
    given = [p.name for p in parts]
    fresh = Numbered(n for n in given if clean(n) == n)
    names = [n if clean(n) == n else fresh(clean(n) or "part", MAX_NAME) for n in given]
    labels = [clean(p.label) for p in parts]
    before = [*given, *(p.label for p in parts), name, category]
    after = [*names, *labels, clean(name), clean(category)]
    changed = [f"'{new}'" for old, new in zip(before, after, strict=True) if old != new]
    if changed:
        notes.append(
            "names that were too long or held what cannot be printed were changed: "
            f"{', '.join(dict.fromkeys(changed))}"
        )
    renamed = [
        dataclasses.replace(p, name=n, label=label)
        for p, n, label in zip(parts, names, labels, strict=True)
    ]
    return renamed, clean(name), clean(category)


def lost_pieces(provenance: Sequence[str]) -> list[str]:
    """Those repairs that tell of geometry or textures that are gone: such an object is
    incomplete."""
    return [line for line in provenance if _tells_of_loss(line)]


def _tells_of_loss(line: str) -> bool:
    """Whether a repair says so in its own words, not in the names that it quotes."""
    head = _HEAD.match(line)
    if head is None:
        return False
    return line.startswith("texture") or bool(_LOST.search(_QUOTED.sub("", line[head.end() :])))
