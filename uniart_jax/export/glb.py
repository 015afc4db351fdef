"""One GLB with the kinematic tree as node hierarchy.

Every part is a node named after it, child of its parent's node and placed at its joint's origin, so
that turning the node about its own origin is what the joint does. glTF is y-up and faces +z: one
node above the root turns our z-up frame, which faces -x, into it.

Every moving joint has an animation named after it: from rest to open over its whole range and back,
the other joints as shown. Players differ in how they interpolate rotations (glTF 2.0 says along the
arc, many take the chord), so these are sampled finely.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from uniart_jax.export.frames import check_lengths, joint_name, moves
from uniart_jax.export.texture_file import smaller
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

Y_UP = np.array([[0.0, -1, 0, 0], [0, 0, 1, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
CLIP_SECONDS = 4.0  # there and back
STEP = np.deg2rad(5)  # between two samples of a rotation: the normalised chord errs by < 1e-5 rad
FLOAT = 5126  # glTF's component type


def write_glb(obj: ArticulatedObject, meshes: Sequence[trimesh.Trimesh], path: Path) -> Path:
    """Write the object in metres at its shown state.

    Args:
      obj: tree, joints and scale.
      meshes: [K] textured meshes in the object frame, object units.
      path: the .glb file.

    Raises:
      ValueError: another number of meshes than parts.

    A moving part's node has ``extras`` {"type", "axis" (node frame), "limits" (of q: radians, or
    metres for a prismatic joint), "pitch" (metres per radian, screws only)}.
    """
    check_lengths("write_glb", obj, meshes=meshes)
    names = {p.name for p in obj.parts}
    base, frame = _free_name("world", names), _free_name("z_up", names)
    scene = trimesh.Scene(base_frame=base)
    scene.graph.update(frame_to=frame, matrix=Y_UP)
    for part, mesh in zip(obj.parts, meshes, strict=True):
        origin = part.joint.origin * obj.scale
        local = mesh.copy()
        local.vertices = mesh.vertices * obj.scale - origin
        local.visual.material = mesh.visual.material  # the copy's own texture would be stored again
        normals = np.array(local.vertex_normals)
        normals[np.linalg.norm(normals, axis=1) < 0.5] = [0, 0, 1]  # of faces without area
        local.vertex_normals = normals
        scene.geometry[part.name] = local
        scene.graph.update(
            frame_to=part.name,
            frame_from=obj.parts[part.parent].name if part.parent >= 0 else frame,
            matrix=trimesh.transformations.translation_matrix(_offset(obj, part)),
            geometry=part.name,
            metadata=_extras(part.joint, obj.scale) if moves(part) else {},
        )
    data = trimesh.exchange.gltf.export_glb(
        scene,
        include_normals=True,
        buffer_postprocessor=lambda items, tree: _finish(obj, items, tree),
    )
    path.write_bytes(data)
    return path


def clip(obj: ArticulatedObject, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Part ``k``'s animation: (times [n] in seconds, ascending from 0; q [n] at them), linear
    between, from rest to open and back.

    Open is the far end of the range; a continuous joint makes a full turn.
    """
    joint, start = obj.joints[k], float(obj.rest()[k])
    end = 2 * np.pi if joint.type == "continuous" else float(obj.open()[k])
    steps = max(1, int(np.ceil(abs(end - start) / STEP))) if joint.rotates else 1
    there = np.linspace(start, end, steps + 1)
    q = np.concatenate([there, there[-2::-1]])
    return np.linspace(0, CLIP_SECONDS, len(q)), q


def _finish(obj: ArticulatedObject, items: dict, tree: dict) -> None:
    """Store the texture smaller where that can be (``texture_file``), and add the clips; called
    before trimesh numbers the views."""
    keys = list(items)
    for image in tree.get("images", ()):
        key = keys[image["bufferView"]]
        packed = smaller(bytes(items[key]))
        if packed is not None:
            items[key] = packed + bytes(-len(packed) % 4)  # what follows stays aligned
            image["mimeType"] = "image/jpeg"
    _animate(obj, items, tree)


def _animate(obj: ArticulatedObject, items: dict, tree: dict) -> None:
    """Add the clips to a glTF tree and its buffer."""
    nodes = {node["name"]: i for i, node in enumerate(tree["nodes"])}
    animations = []
    for k, part in enumerate(obj.parts):
        if not moves(part):
            continue
        name, joint, offset = joint_name(part), part.joint, _offset(obj, part)
        node = tree["nodes"][nodes[part.name]]
        node.pop("matrix", None)  # glTF animates nodes that have none
        node["translation"] = offset.tolist()
        times, q = clip(obj, k)
        channels = {}
        if joint.rotates:
            axis = np.sin(q[:, None] / 2) * joint.direction
            channels["rotation"] = np.concatenate([axis, np.cos(q[:, None] / 2)], 1)
        if joint.travels:
            travel = (q * joint.pitch * obj.scale)[:, None]
            channels["translation"] = offset + travel * joint.direction
        clock = _accessor(items, tree, (name, "time"), times[:, None])
        samplers = [
            {"input": clock, "output": _accessor(items, tree, (name, path), values)}
            for path, values in channels.items()
        ]
        targets = [
            {"sampler": i, "target": {"node": nodes[part.name], "path": path}}
            for i, path in enumerate(channels)
        ]
        animations.append({"name": name, "channels": targets, "samplers": samplers})
    if animations:
        tree["animations"] = animations


def _accessor(items: dict, tree: dict, key: tuple[str, str], values: np.ndarray) -> int:
    """Store values [n, 1], [n, 3] or [n, 4] as floats; their index among the accessors."""
    values = np.ascontiguousarray(values, dtype="<f4")
    items[key] = values.tobytes()
    tree["accessors"][key] = {
        "bufferView": len(items) - 1,
        "componentType": FLOAT,
        "type": {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[values.shape[1]],
        "count": len(values),
        "min": values.min(0).tolist(),
        "max": values.max(0).tolist(),
    }
    return len(tree["accessors"]) - 1


def _offset(obj: ArticulatedObject, part: Part) -> np.ndarray:
    """[3] the part's node in its parent's, metres, as shown."""
    above = obj.parts[part.parent].joint.origin if part.parent >= 0 else np.zeros(3)
    return (part.joint.origin - above) * obj.scale


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
