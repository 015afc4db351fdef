"""The loss of solids of revolution."""

import jax
import numpy as np
import pytest

from uniart_jax.training.revolution_loss import revolution_losses
from uniart_jax.voxels.revolution_table import RADII, Revolution, revolution_rows
from uniart_jax.voxels.typed_batches import LayoutBatch

ROUND = Revolution(2, np.array([0.1, -0.2]), np.linspace(0.1, 0.2, RADII))
losses = jax.jit(revolution_losses)


def batch_of(rows):
    boxes = np.tile(np.array([0, 0, 0, 0.4, 0.4, 0.3], np.float32), (1, 3, 1))
    given = dict.fromkeys(("image", "camera", "codes", "parents", "colors", "part_counts"))
    return LayoutBatch(**given, boxes=boxes, revolutions=rows[None])


def said(axes, axis=2, center=(0.1, -0.2), radii=ROUND.radii):
    """Of each part: sure of an axis; what is said of that axis, and nonsense of the others."""
    out = {
        "axis": np.full((1, 3, 4), -20, np.float32),
        "centers": np.full((1, 3, 3, 2), 9, np.float32),
        "radii": np.full((1, 3, 3, RADII), 9, np.float32),
    }
    for part, chosen in enumerate(axes):
        out["axis"][0, part, chosen] = 20
    out["centers"][:, :, axis], out["radii"][:, :, axis] = center, radii
    return out


BATCH = batch_of(revolution_rows([None, ROUND, None], 3))
WEIGHTS = np.array([[0.5, 0.5, 0.0]], np.float32)


def test_the_truth_costs_nothing_whatever_is_said_of_other_axes_and_parts():
    terms = losses(said([0, 3, 1]), BATCH, WEIGHTS)
    assert float(terms["revolutions"]) == pytest.approx(0, abs=1e-6)


def test_the_wrong_axis_costs_its_parts_weight():
    terms = losses(said([0, 0, 0]), BATCH, WEIGHTS)
    assert float(terms["revolutions"]) == pytest.approx(0.5 * 40, rel=1e-3)


def test_an_outline_is_off_in_shares_of_half_its_box():
    """Half of the sides across is .2; a weight of the object does not change a mean."""
    out = said([0, 3, 0], radii=ROUND.radii + 0.02)
    share = 0.02 / 0.2 * RADII / (RADII + 2)
    for weights in (WEIGHTS, WEIGHTS / 4):
        terms = losses(out, BATCH, weights)
        assert float(terms["revolutions_outline"]) == pytest.approx(share, rel=1e-4)


def test_a_batch_without_round_parts_has_no_outline():
    terms = losses(said([0, 0, 0]), batch_of(revolution_rows([None] * 3, 3)), WEIGHTS)
    assert float(terms["revolutions_outline"]) == 0
    assert np.isfinite(float(terms["revolutions"]))


def test_a_batch_without_them_is_refused():
    with pytest.raises(ValueError, match="no revolutions"):
        revolution_losses(said([0, 3, 0]), BATCH._replace(revolutions=None), WEIGHTS)
