"""Solids of revolution, read off meshes."""

import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.data.mirror import mirror_revolutions
from uniart_jax.data.revolutions import revolutions_of
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.revolution_table import RADII, revolution_rows

TO_X, TO_Y = (trimesh.transformations.rotation_matrix(np.pi / 2, a) for a in ((0, 1, 0), (1, 0, 0)))
TURNS = {0: TO_X, 1: np.linalg.inv(TO_Y), 2: np.eye(4)}  # the upper end stays the upper one


def part_of(*meshes, turn=None, shift=(0, 0, 0)):
    mesh = trimesh.boolean.union(meshes) if len(meshes) > 1 else meshes[0].copy()
    if turn is not None:
        mesh.apply_transform(turn)
    mesh.apply_translation(shift)
    return Part("part", mesh)


def only(part):
    return revolutions_of(ArticulatedObject((part,)))[0]


def cone(low=0.1, high=0.2, height=0.3):
    """Wider at its upper end."""
    outline = np.array([[0, 0], [low, 0], [high, height], [0, height]])
    return trimesh.creation.revolve(outline, sections=48)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_cone_is_told_by_its_axis_centre_and_radii(axis):
    shift = np.array([0.03, -0.05, 0.07])
    found = only(part_of(cone(), turn=TURNS[axis], shift=shift))
    assert found.axis == axis
    np.testing.assert_allclose(found.center, np.delete(shift, axis), atol=2e-3)
    middles = (np.arange(RADII) + 0.5) / RADII
    np.testing.assert_allclose(found.radii, 0.1 + 0.1 * middles, atol=3e-3)


def test_a_handle_does_not_move_it():
    handle = trimesh.creation.box((0.2, 0.04, 0.2)).apply_translation((0.2, 0, 0))
    body = trimesh.creation.cylinder(0.15, 0.3, sections=48)
    found = only(part_of(body, handle))
    assert found.axis == 2
    np.testing.assert_allclose(found.center, 0, atol=3e-3)
    np.testing.assert_allclose(found.radii, 0.15, atol=3e-3)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.box((0.3, 0.3, 0.3)),
        trimesh.creation.cylinder(0.1, 0.3, sections=48).apply_scale((1, 0.5, 1)),
        trimesh.creation.cylinder(0.01, 0.3, sections=48),
        trimesh.creation.cylinder(0.15, 0.3, sections=4),
        trimesh.util.concatenate(
            [trimesh.creation.box((0.03, 0.03, 0.3)).apply_translation((x, y, 0)) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]  # noqa: E501
        ),
        trimesh.creation.box((0.02, 0.3, 0.3)) + trimesh.creation.box((0.05, 0.02, 0.2)).apply_translation((0.034, 0, 0)),  # noqa: E501
    ],
    ids=["box", "oval", "rod", "turned box", "four posts", "plate with a handle"],
)  # fmt: skip
def test_what_is_not_round_or_too_thin_is_none(mesh):
    assert only(part_of(mesh)) is None


def test_an_open_mesh_is_none():
    mesh = trimesh.creation.cylinder(0.15, 0.3, sections=48)
    assert only(Part("part", trimesh.Trimesh(mesh.vertices, mesh.faces[1:]))) is None


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rows_are_mirrored_as_their_objects_are(axis):
    part = part_of(cone(), turn=TURNS[axis], shift=(0.03, -0.05, 0.07))
    flip = np.diag([1.0, -1, 1, 1])
    turned = Part("part", part.mesh.copy().apply_transform(flip))
    mirrored = mirror_revolutions(revolution_rows([only(part)], 2))
    np.testing.assert_allclose(mirrored, revolution_rows([only(turned)], 2), atol=2e-3)
    assert (mirrored[0, 0], mirrored[1].any()) == (1 + axis, False)
    np.testing.assert_allclose(mirror_revolutions(mirrored), revolution_rows([only(part)], 2))


def test_bodies_of_jars_are_round_and_those_of_cabinets_are_not():
    """The second jar is a rectangle with round corners."""
    jars, cabinets = (
        [revolutions_of(procedural.generate(family, seed))[0] for seed in range(4)]
        for family in ("jar", "storage_furniture")
    )
    assert [jar is not None for jar in jars] == [True, False, True, True]
    assert cabinets == [None] * 4
