"""Nearest distances equal those of all pairs, on every kind of set."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from uniart_jax.evaluation.nearest import (
    chamfer,
    f_score_of,
    mutual_distances,
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


def all_pairs(a, b):
    return cdist(a.astype(np.float32), b.astype(np.float32)).min(1)


@given(
    st.sampled_from(KINDS),
    st.sampled_from(KINDS),
    st.integers(1, 400),
    st.integers(1, 400),
    st.integers(0, 99),
)
def test_equals_all_pairs(kind_a, kind_b, n, m, seed):
    a, b = point_set(kind_a, n, seed), point_set(kind_b, m, seed + 1)
    there, back = mutual_distances(a, b)
    assert there.shape == (n,) and back.shape == (m,)
    np.testing.assert_allclose(there, all_pairs(a, b), atol=TOLERANCE)
    np.testing.assert_allclose(back, all_pairs(b, a), atol=TOLERANCE)


def test_equal_points_are_at_zero():
    a = point_set("random", 3000, 0)
    assert mutual_distances(a, a[::-1])[0].max() == 0


@settings(max_examples=15)
@given(st.integers(2, 1500), st.integers(0, 99))
def test_order_does_not_matter(number, seed):
    rng = np.random.default_rng(seed)
    a, b = point_set("random", number, seed), point_set("clustered", 700, seed)
    one, other = rng.permutation(number), rng.permutation(700)
    moved, expected = mutual_distances(a[one], b[other])[0], mutual_distances(a, b)[0]
    np.testing.assert_array_equal(moved, expected[one])


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
        (all_pairs(a[1, 2], b[1, 2]).mean() + all_pairs(b[1, 2], a[1, 2]).mean()) / 2, abs=1e-6
    )


def test_chamfer_and_f_score_by_hand():
    a, b = np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 2], [0, 0, 4]])
    assert chamfer(a, b) == pytest.approx((2 + (2 + 4) / 2) / 2)
    found = mutual_distances(a, b)
    assert f_score_of(*found, 2.5) == pytest.approx(2 * 1 * 0.5 / 1.5)  # all of a, half of b
    assert f_score_of(*found, 1.0) == 0
    assert f_score_of(*mutual_distances(a, a), 0.0) == 1


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
        mutual_distances(a, b)


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
