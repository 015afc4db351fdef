"""Parts as bodies: metres, one for every part, and sound to simulate."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from asset_objects import hollow_box, make_cabinet

from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.physics import Box, Hull
from uniart_jax.export.urdf import write_urdf
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def bounds(shape) -> np.ndarray:
    if isinstance(shape, Hull):
        return shape.mesh.bounds
    half = np.abs(shape.rotation) @ shape.size / 2
    return np.array([shape.center - half, shape.center + half])


def test_bodies_are_the_parts_in_metres():
    obj = make_cabinet()
    bodies = make_bodies(obj, [p.mesh for p in obj.parts])
    assert len(bodies) == len(obj.parts)
    size = float(np.ptp(obj.bounds, axis=0).max()) * obj.scale
    for part, body in zip(obj.parts, bodies, strict=True):
        moving = part.parent >= 0 and part.joint.type != "fixed"
        assert (body.dynamics is not None) == moving
        found = np.array([bounds(s) for s in body.shapes])
        seen = np.array([found[:, 0].min(0), found[:, 1].max(0)])
        np.testing.assert_allclose(seen, part.mesh.bounds * obj.scale, atol=0.0075 * size)
        assert np.linalg.eigvalsh(body.inertia)[0] > 0
    assert sum(isinstance(s, Box) for s in bodies[0].shapes) == 5
    volume = sum(p.mesh.volume for p in obj.parts) * obj.scale**3
    assert sum(b.mass for b in bodies) == pytest.approx(500 * volume, rel=0.02)


def test_mass_and_density():
    obj = make_cabinet()
    meshes = [p.mesh for p in obj.parts]
    shared = make_bodies(obj, meshes, mass=12.0)
    assert sum(b.mass for b in shared) == pytest.approx(12.0, rel=0.01)
    dense = make_bodies(obj, meshes, density=1000.0)
    default = make_bodies(obj, meshes)
    assert dense[0].mass == pytest.approx(2 * default[0].mass)
    ratio = dense[1].dynamics.damping / default[1].dynamics.damping
    assert ratio == pytest.approx(2, rel=0.01)
    with pytest.raises(ValueError, match="not both"):
        make_bodies(obj, meshes, density=500.0, mass=12.0)
    with pytest.raises(ValueError, match="5 meshes for 6 parts"):
        make_bodies(obj, meshes[1:])


def test_bodies_are_the_same_every_time():
    obj = make_cabinet()
    first, second = (make_bodies(obj, [p.mesh for p in obj.parts]) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.mass == b.mass and a.dynamics == b.dynamics and len(a.shapes) == len(b.shapes)
        for one, two in zip(a.shapes, b.shapes, strict=True):
            np.testing.assert_array_equal(bounds(one), bounds(two))


def test_an_open_drawer_catches_a_ball(tmp_path):
    """Dropped into a drawer that is pulled out of its cabinet while it falls, a ball comes to rest
    in it."""
    cabinet = hollow_box([-0.2, -0.25, -0.2], [0.2, 0.25, 0.2], 0.02)
    outer = trimesh.creation.box(bounds=[[-0.2, -0.2, -0.15], [0.1, 0.2, 0.1]])
    inner = trimesh.creation.box(bounds=[[-0.18, -0.18, -0.13], [0.08, 0.18, 0.2]])
    drawer = trimesh.boolean.difference([outer, inner], engine="manifold")
    slide = Joint([0, 0, 0], [-1, 0, 0], travel=(-0.01, 0.28))
    obj = ArticulatedObject((Part("cabinet", cabinet), Part("drawer", drawer, 0, slide)))
    bodies = make_bodies(obj, [p.mesh for p in obj.parts])
    assert not [s for b in bodies for s in b.shapes if isinstance(s, Hull)]
    path = write_urdf(obj, tmp_path, [[], []], bodies, [[], []])
    spec = mujoco.MjSpec.from_file(str(path))
    ball = spec.worldbody.add_body(name="ball", pos=[-0.3, 0, 0.2])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0], mass=0.05)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("drawer_joint").qpos[0] = 0.2
    push = 4 * bodies[1].dynamics.friction
    for _ in range(1500):
        data.joint("drawer_joint").qfrc_applied[0] = push if data.time < 2 else 0
        mujoco.mj_step(model, data)
    assert data.joint("drawer_joint").qpos[0] > 0.26
    x, y, z = data.body("ball").xpos
    assert -0.46 < x < -0.2 and abs(y) < 0.18
    assert z == pytest.approx(-0.13 + 0.03, abs=0.01)  # on its floor
