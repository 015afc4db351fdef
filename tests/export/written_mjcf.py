"""An object as an MJCF: written, compiled by MuJoCo, held against the object."""

from __future__ import annotations

import dataclasses
import warnings

import mujoco
import numpy as np
import trimesh
from hand_bodies import Written, write_files

from uniart_jax.export.mjcf import write_mjcf
from uniart_jax.objects.kinematics import line_distance
from uniart_jax.objects.object import ArticulatedObject

STATES = 20


def written(obj: ArticulatedObject, folder) -> tuple[Written, tuple[str, ...]]:
    given = write_files(obj, folder)
    notes = write_mjcf(
        obj,
        folder / "object.xml",
        given.visual_files,
        given.bodies,
        given.hull_files,
        given.texture,
    )
    return given, notes


def compiled(path) -> mujoco.MjModel:
    """The model; a warning is a failure."""
    said = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            model = mujoco.MjModel.from_xml_path(str(path))
    finally:
        mujoco.set_mju_user_warning(before)
    assert said == []
    return model


def set_state(model: mujoco.MjModel, data: mujoco.MjData, obj: ArticulatedObject, q) -> None:
    for part, value in zip(obj.parts, q, strict=True):
        joint = part.joint
        if part.parent < 0 or joint.type == "fixed":
            continue
        metric = value if joint.rotates else value * obj.scale
        data.joint(f"{part.name}_joint").qpos[0] = metric
        if joint.type == "screw":
            data.joint(f"{part.name}_travel").qpos[0] = value * joint.pitch * obj.scale
    mujoco.mj_kinematics(model, data)


def largest_error(obj: ArticulatedObject, model: mujoco.MjModel, seed: int) -> float:
    """Largest distance of a part's box corners from where the object has them, in sizes of the
    object, over random states."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    at_start, worst = {}, 0.0
    set_state(model, data, obj, np.zeros(len(obj.parts)))
    for part in obj.parts:
        body = data.body(part.name)
        at_start[part.name] = body.xmat.reshape(3, 3).copy(), body.xpos.copy()
    for _ in range(STATES):
        q = np.array([rng.uniform(*p.joint.limits) if p.parent >= 0 else 0 for p in obj.parts])
        set_state(model, data, obj, q)
        for part, matrix in zip(obj.parts, obj.forward_kinematics(q), strict=True):
            corners = trimesh.bounds.corners(part.mesh.bounds)
            meant = trimesh.transform_points(corners, matrix) * obj.scale
            turn, origin = at_start[part.name]
            local = (corners * obj.scale - origin) @ turn
            body = data.body(part.name)
            seen = local @ body.xmat.reshape(3, 3).T + body.xpos
            worst = max(worst, float(np.abs(seen - meant).max()))
    return worst / float(np.ptp(obj.bounds, axis=0).max() * obj.scale)


def assert_same_object(loaded: ArticulatedObject, obj: ArticulatedObject) -> None:
    size = float(np.ptp(obj.bounds, axis=0).max() * obj.scale)
    assert {p.name for p in loaded.parts} == {p.name for p in obj.parts}
    for part in obj.parts:
        twin = loaded.parts[loaded.index(part.name)]
        parent = obj.parts[part.parent].name if part.parent >= 0 else None
        assert (loaded.parts[twin.parent].name if twin.parent >= 0 else None) == parent
        np.testing.assert_allclose(twin.mesh.bounds, part.mesh.bounds * obj.scale, atol=1e-6 * size)
        if parent is None:
            continue
        joint = dataclasses.replace(part.joint, origin=part.joint.origin * obj.scale)
        assert twin.joint.type == joint.type
        np.testing.assert_allclose(twin.joint.angle, joint.angle, atol=1e-9)
        travel = np.array(joint.travel) * obj.scale
        np.testing.assert_allclose(twin.joint.travel, travel, atol=1e-9)
        np.testing.assert_allclose(twin.joint.direction, joint.direction, atol=1e-9)
        if joint.rotates:
            assert line_distance(twin.joint, joint) < 1e-9
