"""Nearest distances equal a KD tree's on every kind of set, whatever the order and the padding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from uniart_jax.evaluation import nearest
from uniart_jax.evaluation.nearest import (
    chamfer,
    f_score,
    mutual_distances,
    nearest_distances,
    posed_points,
)
from uniart_jax.objects.kinematics import Joint, forward_kinematics

TOLERANCE = 1e-5


def point_set(kind: str, number: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (number, 3))
    if kind == "clustered":
        middle = rng.uniform(-0.5, 0.5, (5, 3))
        points = middle[rng.integers(5, size=number)] + 1e-3 * points
    elif kind == "equal":
        points[:] = points[0]
    elif kind == "collinear":
        points = points[:1] + points[:, :1] * np.array([[0.3, -0.2, 0.9]])
    elif kind == "planar":
        points[:, 2] = 0.25
    elif kind == "repeated":
        points = points[rng.integers(max(1, number // 20), size=number)]
    elif kind == "outlier":
        points[0] = 300.0
    elif kind == "sphere":  # every point as far from the middle
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points


KINDS = ("random", "clustered", "equal", "collinear", "planar", "repeated", "outlier", "sphere")


def tree(a, b):
    return cKDTree(b.astype(np.float32)).query(a.astype(np.float32))[0]


@given(
    st.sampled_from(KINDS),
    st.sampled_from(KINDS),
    st.integers(1, 1500),
    st.integers(1, 1500),
    st.integers(0, 99),
)
def test_equals_a_kd_tree(kind_a, kind_b, n, m, seed):
    a, b = point_set(kind_a, n, seed), point_set(kind_b, m, seed + 1)
    there, back = mutual_distances(a, b)
    assert there.shape == (n,) and back.shape == (m,)
    np.testing.assert_allclose(there, tree(a, b), atol=TOLERANCE)
    np.testing.assert_allclose(back, tree(b, a), atol=TOLERANCE)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (64, 65), (511, 512), (4096, 4097)])
def test_equals_a_kd_tree_at_the_edges_of_blocks_and_sizes(n, m):
    a, b = point_set("random", n, 1), point_set("planar", m, 2)
    there, back = mutual_distances(a, b)
    np.testing.assert_allclose(there, tree(a, b), atol=TOLERANCE)
    np.testing.assert_allclose(back, tree(b, a), atol=TOLERANCE)
    np.testing.assert_array_equal(nearest_distances(a, b), there)


def test_equal_points_are_at_zero():
    a = point_set("random", 3000, 0)
    assert nearest_distances(a, a[::-1]).max() == 0


@settings(max_examples=15)
@given(st.integers(2, 1500), st.integers(0, 99))
def test_order_does_not_matter(number, seed):
    rng = np.random.default_rng(seed)
    a, b = point_set("random", number, seed), point_set("clustered", 700, seed)
    one, other = rng.permutation(number), rng.permutation(700)
    np.testing.assert_array_equal(nearest_distances(a[one], b[other]), nearest_distances(a, b)[one])


@pytest.mark.parametrize("together", [1, 4, nearest.TOGETHER])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (300, 513), (700, 512)])
def test_padding_reaches_no_valid_result(together, n, m):
    rng = np.random.default_rng(0)
    a, b = (np.asarray(point_set("random", k, k), np.float32)[None] for k in (n, m))
    expected = tree(a[0], b[0]), tree(b[0], a[0])
    for rubbish in (np.nan, np.inf, -1e30, 0.0, rng.uniform(-0.5, 0.5, 3)):
        padded = [
            np.concatenate([p, np.broadcast_to(np.float32(rubbish), (1, 1024 - p.shape[1], 3))], 1)
            for p in (a, b)
        ]
        there, back = nearest._mutual(padded[0], n, padded[1], m, together=together)
        np.testing.assert_allclose(there[0, :n], expected[0], atol=TOLERANCE)
        np.testing.assert_allclose(back[0, :m], expected[1], atol=TOLERANCE)


def test_a_batch_equals_its_pairs():
    a = np.stack([point_set(kind, 900, k) for k, kind in enumerate(KINDS)]).reshape(2, 4, 900, 3)
    b = np.stack([point_set("random", 600, k) for k in range(8)]).reshape(2, 4, 600, 3)
    there, back = mutual_distances(a, b)
    for i in np.ndindex(2, 4):
        one = mutual_distances(a[i], b[i])
        np.testing.assert_array_equal(there[i], one[0])
        np.testing.assert_array_equal(back[i], one[1])
    assert chamfer(a, b).shape == (2, 4)
    assert chamfer(a, b)[1, 2] == pytest.approx(
        (tree(a[1, 2], b[1, 2]).mean() + tree(b[1, 2], a[1, 2]).mean()) / 2, abs=1e-6
    )


def test_blocks_are_compact():
    """Else the search visits most of them, and is brute force under another name."""
    curve = np.linspace(0, 1, 4096)
    a = np.stack([curve, 0 * curve, 0 * curve], 1).astype(np.float32)
    blocks = jax.jit(nearest._blocks)(jnp.asarray(a), len(a))
    width = np.asarray(blocks[3] - blocks[2]).max(1)
    np.testing.assert_allclose(width, 63 / 4095, rtol=1e-3)  # consecutive points of the line


def test_the_curve_has_no_jumps():
    """The first 2^9 cells of a cube of 8^3 are visited one by one, each beside the last."""
    cell = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3)
    coarse, fine = jax.jit(nearest._hilbert)(jnp.asarray(cell, jnp.uint32))
    assert not np.asarray(coarse).any() and len(set(np.asarray(fine).tolist())) == 512
    steps = np.abs(np.diff(cell[np.argsort(np.asarray(fine))], axis=0)).sum(1)
    np.testing.assert_array_equal(steps, 1)
    far = cell * 2**13  # the same cube at the coarse end
    coarse, fine = jax.jit(nearest._hilbert)(jnp.asarray(far, jnp.uint32))
    steps = np.abs(np.diff(cell[np.lexsort((fine, coarse))], axis=0)).sum(1)
    np.testing.assert_array_equal(steps, 1)


def test_chamfer_and_f_score_by_hand():
    a, b = np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 2], [0, 0, 4]])
    assert chamfer(a, b) == pytest.approx((2 + (2 + 4) / 2) / 2)
    assert f_score(a, b, 2.5) == pytest.approx(2 * 1 * 0.5 / 1.5)  # all of a, half of b
    assert f_score(a, b, 1.0) == 0
    assert f_score(a, a, 0.0) == 1


@pytest.mark.parametrize(
    ("a", "b", "why"),
    [
        (np.zeros((0, 3)), np.zeros((1, 3)), "n > 0"),
        (np.zeros((4, 2)), np.zeros((1, 3)), "expected points"),
        (np.zeros((2, 4, 3)), np.zeros((4, 3)), "in pairs"),
        (np.full((4, 3), np.nan), np.zeros((4, 3)), "not finite"),
        (np.zeros((4, 3)), np.full((4, 3), np.inf), "not finite"),
    ],
)
def test_what_cannot_be_compared_is_an_error(a, b, why):
    with pytest.raises(ValueError, match=why):
        nearest_distances(a, b)


def test_points_are_carried_by_their_parts():
    hinge = Joint([0.5, 0, 0], [0, 0, 1], angle=(0, np.pi / 2))
    joints = [Joint.fixed(), hinge, Joint([0, 0, 0], [0, 0, 1], travel=(0, 0.4))]
    motions = np.stack(
        [forward_kinematics([-1, 0, 1], joints, [0, s * np.pi / 2, s * 0.4]) for s in (0, 1)]
    )
    points, part = np.array([[0.1, 0.2, 0.3], [0.5, 0.25, 0], [0.5, 0.25, 0]]), np.array([0, 1, 2])
    found = posed_points(points, part, motions)
    np.testing.assert_allclose(found[0], points, atol=1e-6)
    np.testing.assert_allclose(found[1], [[0.1, 0.2, 0.3], [0.25, 0, 0], [0.25, 0, 0.4]], atol=1e-6)
