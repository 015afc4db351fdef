"""Depths between parts at any state, and that export's shapes leave room where the parts do."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

pytest.importorskip("mujoco")

from uniart_jax import procedural
from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.physics import Body, Box, Hull
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.collider import Collider


@pytest.mark.parametrize("scale", [1.0, 0.01, 40.0])
@pytest.mark.parametrize("kind", ["box", "hull"])
def test_depth_of_a_block_pushed_into_another(scale, kind):
    one, two = trimesh.creation.box([1, 1, 1]), trimesh.creation.box([1, 1, 1])
    two.apply_translation([1.5, 0, 0])
    joint = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 1.0))
    obj = ArticulatedObject((Part("a", one), Part("b", two, 0, joint)), scale=scale)

    def shape(mesh):
        metric = trimesh.Trimesh(mesh.vertices * scale, mesh.faces)
        if kind == "hull":
            return Hull(metric)
        return Box(metric.bounds.mean(0), metric.extents, np.eye(3))

    bodies = [Body(1.0, np.zeros(3), np.eye(3), (shape(m),), None) for m in (one, two)]
    collider = Collider(obj, bodies)
    assert collider.depths(obj.forward_kinematics([0, 0.4])) == {}
    found = collider.depths(obj.forward_kinematics([0, 0.7]))
    assert found == {(0, 1): pytest.approx(0.2 * scale, rel=1e-3)}


@pytest.mark.parametrize(
    ("family", "seed"),
    [
        ("microwave", 1_000_006),  # many buttons once used up the pieces that the chamber needs
        ("refrigerator", 1_000_002),
        ("dishwasher", 1_000_003),  # racks over the opened door
        ("washer", 1_000_033),  # a lid before knobs
    ],
)
def test_true_objects_do_not_run_into_themselves(family, seed):
    obj = procedural.generate(family, seed)
    collider = Collider(obj, make_bodies(obj, [part.mesh for part in obj.parts]))
    rest, opened = obj.rest(), obj.open()
    assert max(collider.depths(obj.forward_kinematics(rest)).values(), default=0) < 0.01 * obj.scale
    doors = np.array([p.joint.rotates and p.joint.type == "revolute" for p in obj.parts])
    for fraction in np.linspace(0.1, 1, 10):
        way = rest + fraction * (opened - rest)
        for q in (np.where(doors, way, rest), np.where(doors, opened, way)):  # doors first
            depths = collider.depths(obj.forward_kinematics(q))
            assert max(depths.values(), default=0) < 0.01 * obj.scale
