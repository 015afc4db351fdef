"""Random shown states keep the contract: 0 within every joint's limits, normalised, the same
tree."""

from __future__ import annotations

import numpy as np
import pytest

from uniart_jax.objects.states import sample_state
from uniart_jax.procedural import SEEN_FAMILIES, generate


@pytest.mark.parametrize("family", SEEN_FAMILIES)
def test_contract(family):
    rng = np.random.default_rng(0)
    obj = generate(family, 1)
    for _ in range(6):
        shown = sample_state(obj, rng)
        lo, hi = shown.bounds
        np.testing.assert_allclose(lo + hi, 0, atol=1e-9)
        np.testing.assert_allclose((hi - lo).max(), 1, atol=1e-9)
        assert shown.parents == obj.parents
        for before, after in zip(obj.joints, shown.joints, strict=True):
            low, high = after.limits
            assert low <= 1e-12 and high >= -1e-12
            assert after.type == before.type
            if before.type != "prismatic":
                assert high - low == pytest.approx(before.limits[1] - before.limits[0])
            else:  # lengths scale with the object
                scaled = (before.limits[1] - before.limits[0]) * obj.scale / shown.scale
                assert high - low == pytest.approx(scaled)


def test_rest_is_common_and_states_differ():
    rng = np.random.default_rng(1)
    obj = generate("storage_furniture", 2)
    moved = [np.abs(sample_state(obj, rng).limits - obj.limits).max() > 1e-3 for _ in range(60)]
    assert 0.25 < 1 - np.mean(moved) < 0.75


def test_closing_again_gives_the_object_back():
    obj = generate("storage_furniture", 3)
    shown = sample_state(obj, np.random.default_rng(5))
    back = shown.shown_at(shown.rest()).normalized()
    np.testing.assert_allclose(back.boxes, obj.boxes, atol=1e-6)
