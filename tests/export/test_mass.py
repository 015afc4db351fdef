"""Mass and inertia that a body can have, whatever its mesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.export.mass import part_inertials


@pytest.mark.parametrize(
    "body",
    [
        trimesh.creation.box([1, 2, 3]),
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
        trimesh.creation.box([1e-6, 1, 1]),
        trimesh.Trimesh(trimesh.creation.box().vertices, trimesh.creation.box().faces[:7]),
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False),
        trimesh.Trimesh(
            trimesh.creation.box().vertices * [1, 1, 0], trimesh.creation.box().faces, process=False
        ),
    ],
)
def test_inertia_is_possible_whatever_the_mesh(body, recwarn):
    ((mass, center, inertia),) = part_inertials([body], 0.3, None, None)
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]
    principal = np.linalg.eigvalsh(inertia)
    assert mass >= 1e-3 and principal[0] > 0 and principal[0] + principal[1] > principal[2]
    assert np.all(center >= body.bounds[0] * 0.3 - 1e-3) and np.all(
        center <= body.bounds[1] * 0.3 + 1e-3
    )


def test_inertia_of_a_block():
    block = trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]])
    ((mass, center, inertia),) = part_inertials([block], 0.5, None, None)
    assert mass == pytest.approx(6 / 8 * 500)
    np.testing.assert_allclose(center, [0.25, 0.5, 0.75])
    expected = mass / 12 * np.diag([1 + 2.25, 0.25 + 2.25, 0.25 + 1])
    np.testing.assert_allclose(inertia, expected, rtol=1e-4)


@given(
    st.lists(st.tuples(*[st.floats(1e-5, 2.0)] * 3), min_size=1, max_size=6),
    st.floats(0.05, 3.0),
    st.floats(-5, 2.5).map(lambda digits: 10**digits),
)
def test_a_mass_is_shared_and_no_part_is_a_feather(extents, scale, total):
    meshes = [trimesh.creation.box(e) for e in extents]
    found = part_inertials(meshes, scale, None, total)
    masses = np.array([m for m, _, _ in found])
    assert masses.min() >= (1 - 1e-9) * 1e-3 * total
    assert masses.sum() == pytest.approx(total, rel=1e-9)
    for mass, _, inertia in found:
        principal = np.linalg.eigvalsh(inertia)
        assert (
            principal[0] >= 0.99 * 2 * mass * 1e-6
        )  # a gyration radius of a millimetre along two axes
        assert principal[0] + principal[1] > principal[2] * (1 + 1e-12)


def test_a_mass_goes_by_volume_and_a_density_counts():
    meshes = [trimesh.creation.box([1, 1, 1]), trimesh.creation.box([1, 1, 3])]
    shared = part_inertials(meshes, 0.2, None, 8.0)
    assert [m for m, _, _ in shared] == pytest.approx([2.0, 6.0])
    dense = part_inertials(meshes, 0.2, 1000.0, None)
    assert [m for m, _, _ in dense] == pytest.approx([8.0, 24.0])
    default = part_inertials(meshes, 0.2, None, None)
    ((alone, _, inertia),) = part_inertials(meshes[1:], 0.2, None, None)
    assert default[1][0] == pytest.approx(alone) == pytest.approx(12.0)
    np.testing.assert_allclose(default[1][2], inertia)


def test_two_thousand_feathers_and_a_giver_that_becomes_light_share_a_mass():
    cube = trimesh.creation.box([1, 1, 1])
    many = [m for m, _, _ in part_inertials([cube] * 2000, 0.01, None, 3.0)]
    assert sum(many) == pytest.approx(3.0) and min(many) == pytest.approx(3.0 / 2000)
    sides = [1.0] + [0.1 * 1.0001 ** (1 / 3)] * 20 + [0.05] * 20
    meshes = [trimesh.creation.box([s] * 3) for s in sides]
    masses = [m for m, _, _ in part_inertials(meshes, 1.0, None, 0.02)]
    assert sum(masses) == pytest.approx(0.02) and min(masses) == pytest.approx(2e-5)


@pytest.mark.parametrize(
    ("density", "mass", "message"),
    [
        (500.0, 3.0, "not both"),
        (0.0, None, "density must be a positive number"),
        (None, -1.0, "mass must be a positive number"),
        (None, float("nan"), "mass must be a positive number"),
        (float("inf"), None, "density must be a positive number"),
    ],
)
def test_bad_masses_are_one_line(density, mass, message):
    with pytest.raises(ValueError, match=message) as error:
        part_inertials([trimesh.creation.box()], 1.0, density, mass)
    assert "\n" not in str(error.value)
