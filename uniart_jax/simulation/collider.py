"""How deep an object's parts dig into each other at any joint state, by its collision shapes.

MuJoCo finds the contacts; the poses are ours (``forward_kinematics``), so a joint can be tried
before any file is written.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from uniart_jax.export.physics import Body, Box
from uniart_jax.objects.object import ArticulatedObject

Pair = tuple[int, int]


class Collider:
    """The shapes of all parts as free bodies, made once for many states. Depths are metres."""

    def __init__(self, obj: ArticulatedObject, bodies: Sequence[Body]):
        self.scale = obj.scale
        spec = mujoco.MjSpec()
        spec.memory = 64 * 2**20
        for k, body in enumerate(bodies):
            part = spec.worldbody.add_body(name=f"{k}", mass=1.0, inertia=[1.0, 1.0, 1.0])
            part.explicitinertial = True
            part.add_freejoint()
            for i, shape in enumerate(body.shapes):
                if isinstance(shape, Box):
                    quat = np.zeros(4)
                    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(shape.rotation).ravel())
                    part.add_geom(
                        type=mujoco.mjtGeom.mjGEOM_BOX,
                        size=shape.size / 2,
                        pos=shape.center,
                        quat=quat,
                    )
                    continue
                mesh = spec.add_mesh(name=f"{k}-{i}")
                mesh.uservert = np.asarray(shape.mesh.vertices, np.float64).ravel()
                mesh.userface = np.asarray(shape.mesh.faces, np.int32).ravel()
                part.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.owner = self.model.geom_bodyid - 1  # geoms are the shapes in their order

    def depths(self, poses: np.ndarray) -> dict[Pair, float]:
        """{(a, b): metres} of every pair of parts a < b that dig into each other, at ``poses`` [K,
        4, 4] from the shown state, object units."""
        found: dict[Pair, float] = {}
        for (i, j), depth in self.shape_depths(poses).items():
            a, b = sorted((int(self.owner[i]), int(self.owner[j])))
            found[a, b] = max(found.get((a, b), 0.0), depth)
        return found

    def shape_depths(self, poses: np.ndarray) -> dict[Pair, float]:
        """The same of every pair i < j of shapes, numbered through all parts."""
        qpos = self.data.qpos.reshape(-1, 7)
        qpos[:, :3] = poses[:, :3, 3] * self.scale
        for k, pose in enumerate(poses):
            mujoco.mju_mat2Quat(qpos[k, 3:], np.ascontiguousarray(pose[:3, :3]).ravel())
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        contact = self.data.contact
        found: dict[Pair, float] = {}
        for (i, j), d in zip(np.sort(contact.geom, 1).tolist(), contact.dist.tolist(), strict=True):
            found[i, j] = max(found.get((i, j), 0.0), -d)
        return found
