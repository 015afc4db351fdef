"""One GLB with the kinematic tree as node hierarchy.

Every part is a node named after it, child of its parent's node and placed at its joint's origin, so that turning the node about
its own origin is what the joint does. glTF is y-up and faces +z: one node above the root turns our z-up frame, which faces -x, into it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject

Y_UP = np.array([[0.0, -1, 0, 0], [0, 0, 1, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])


def write_glb(obj: ArticulatedObject, meshes: Sequence[trimesh.Trimesh], path: Path) -> Path:
    """Write the object in metres at its shown state.

    Args:
      obj: tree, joints and scale.
      meshes: [K] textured meshes in the object frame, object units.
      path: the .glb file.

    A moving part's node has ``extras`` {"type", "axis" (node frame), "limits" (of q: radians, or metres for a prismatic joint),
    "pitch" (metres per radian, screws only)}.
    """
    names = {p.name for p in obj.parts}
    base, frame = _free_name("world", names), _free_name("z_up", names)
    scene = trimesh.Scene(base_frame=base)
    scene.graph.update(frame_to=frame, matrix=Y_UP)
    for part, mesh in zip(obj.parts, meshes, strict=True):
        origin = part.joint.origin * obj.scale
        parent = obj.parts[part.parent] if part.parent >= 0 else None
        local = mesh.copy()
        local.vertices = mesh.vertices * obj.scale - origin
        local.visual.material = mesh.visual.material  # the copy's own texture would be stored again
        scene.geometry[part.name] = local
        offset = origin - (parent.joint.origin * obj.scale if parent else 0.0)
        scene.graph.update(
            frame_to=part.name,
            frame_from=parent.name if parent else frame,
            matrix=trimesh.transformations.translation_matrix(offset),
            geometry=part.name,
            metadata=_extras(part.joint, obj.scale),
        )
    path.write_bytes(scene.export(file_type="glb", include_normals=True))
    return path


def _free_name(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    return name


def _extras(joint: Joint, scale: float) -> dict:
    """A joint as plain JSON values in metres and radians; empty if it does not move."""
    if joint.type == "fixed":
        return {}
    lo, hi = joint.limits
    unit = 1.0 if joint.rotates else scale
    extras = {
        "type": joint.type,
        "axis": [float(x) for x in joint.direction],
        "limits": [lo * unit, hi * unit],
    }
    if joint.type == "screw":
        extras["pitch"] = joint.pitch * scale
    return extras
