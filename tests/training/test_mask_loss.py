"""The mask network's loss: least for the true mask, alike for small and large objects."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.training.mask_loss import DICE, dice_of, make_mask_loss, overlap
from uniart_jax.voxels.typed_batches import MaskBatch


class Fixed:
    """A network that gives its parameters."""

    def apply(self, params, image):
        return params


def square(side, size=16):
    mask = np.zeros((1, size, size), np.float32)
    mask[0, :side, :side] = 1
    return mask


@jax.jit
def loss_of(logits, mask):
    batch = MaskBatch(jnp.zeros((*mask.shape, 3)), mask)
    return make_mask_loss(Fixed())(logits, batch, jax.random.key(0))


def test_the_true_mask_costs_nothing_and_all_else_does():
    mask = square(5)
    best, metrics = loss_of(20 * (2 * mask - 1), mask)
    assert best < 1e-5 and metrics["iou"] == 1
    unsure, metrics = loss_of(np.zeros_like(mask), mask)
    expected = np.log(2) + DICE * (1 - (mask.sum() + 1) / (0.5 * mask.size + mask.sum() + 1))
    assert unsure == pytest.approx(expected, rel=1e-5) and metrics["iou"] == 0
    worse, _ = loss_of(-20 * (2 * mask - 1), mask)
    assert worse > unsure


def test_the_gradient_leads_to_the_mask():
    mask = square(5)
    gradient_of = jax.jit(jax.grad(lambda logits: loss_of(logits, mask)[0]))
    gradient = gradient_of(np.zeros_like(mask))
    assert ((np.asarray(gradient) < 0) == (mask > 0)).all()


def test_a_missed_object_costs_as_much_whether_it_is_small_or_large():
    dice = jax.jit(dice_of)
    for side in (4, 12):
        assert 1 - float(dice(np.zeros((1, 16, 16), np.float32), square(side))[0]) > 0.9


def test_overlap_counts_pixels():
    share, logits = jax.jit(overlap), 4 * square(4) - 2
    found = [float(share(logits, square(side))[0]) for side in (4, 2, 0)]
    assert found == [1, pytest.approx(4 / 16), 0]
    assert float(share(-np.ones((1, 16, 16), np.float32), square(0))[0]) == 1
