"""Layouts with errors and bent pictures: what stays true of them."""

import numpy as np
import pytest

from uniart_jax.data.layout_errors import bend, with_errors

TABLE = {
    "boxes": np.array([[0, 0, 0, 1, 1, 1], [0, 0.2, 0, 0.1, 0.2, 0.3], [0.1, 0, 0, 0.2, 0.1, 0.1]]),
    "codes": np.arange(27.0).reshape(3, 9),
    "parents": np.array([0, 0, 1]),
    "colors": np.eye(3),
}


def test_without_strength_the_parts_are_only_in_another_order():
    orders = set()
    for seed in range(20):
        found = with_errors(TABLE, 0.0, np.random.default_rng(seed))
        order = np.abs(found["codes"][:, None] - TABLE["codes"]).sum(-1).argmin(1)
        orders.add(tuple(order.tolist()))
        for name in ("boxes", "codes", "colors"):
            np.testing.assert_allclose(found[name], TABLE[name][order], atol=1e-6)
        np.testing.assert_array_equal(order[found["parents"]], TABLE["parents"][order])
        np.testing.assert_array_equal(order, found["part"])
    assert len(orders) > 3


@pytest.mark.parametrize("strength", [0.5, 1.0])
def test_errors_keep_a_tree_and_sound_boxes(strength):
    sizes, moved, turned = [], [], 0
    for seed in range(300):
        found = with_errors(TABLE, strength, np.random.default_rng(seed))
        count = len(found["boxes"])
        sizes.append(count)
        if not count:
            continue
        assert (found["boxes"][:, 3:] > 0).all()
        assert (found["parents"] == np.arange(count)).sum() == 1
        at = np.arange(count)
        for _ in range(count):
            at = found["parents"][at]
        assert len(set(at.tolist())) == 1  # all end at the root
        order = np.abs(found["codes"][:, None, :7] - TABLE["codes"][:, :7]).sum(-1).argmin(1)
        moved.append(np.abs(found["boxes"] - TABLE["boxes"][order]).max())
        turned += (found["codes"][:, 7] < 0).sum()
    counts = np.bincount(sizes, minlength=4) / len(sizes)
    assert 0.05 < counts[0] < 0.17 and counts[3] > 0.6 and counts[1:3].sum() > 0.02
    assert 0 < np.median(moved) < 0.05 and np.mean(np.array(moved) < 1e-6) > 0.25 and turned
    a, b = (with_errors(TABLE, strength, np.random.default_rng(3)) for _ in range(2))
    assert all(np.array_equal(a[name], b[name]) for name in a)


def test_pictures_are_bent_a_little():
    image = np.zeros((64, 64, 3), np.float32)
    image[20:44, 20:44] = [0.2, 0.5, 1.0]
    bent = [bend(image, 0.04, np.random.default_rng(seed)) for seed in range(8)]
    for other in bent:
        assert other.shape == image.shape and other.dtype == np.float32
        assert other.min() >= 0 and other.max() <= 1 + 1e-6
        assert (other[26:38, 26:38] == image[26:38, 26:38]).all()  # within reach, all the same
        assert not other[:8].any()
    assert max(np.abs(other - image).max() for other in bent) > 0.5
    assert (bend(image, 0.0, np.random.default_rng(0)) == image).all()
