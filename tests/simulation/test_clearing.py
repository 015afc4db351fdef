"""Shapes that scrape are cut back; what bars the way is not."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from test_refine import box, make

from uniart_jax.objects.kinematics import Joint
from uniart_jax.simulation.clearing import LEAST, SHALLOW, clear
from uniart_jax.simulation.collider import Collider
from uniart_jax.simulation.refine import mend

DRAWER = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0.0, 0.4))


def shelf(bump: float, scale: float = 1.0):
    """A floor with a sill of height ``bump`` before a block that slides over it."""
    boxes = {
        "floor": [box([-0.5, -0.4, -0.1], [0.5, 0.4, 0.0]), box([-0.3, -0.4, 0.0], [-0.2, 0.4, bump])],  # noqa: E501
        "block": [box([-0.15, -0.3, 0.002], [0.45, 0.3, 0.3])],
    }  # fmt: skip
    return make(boxes, {"block": DRAWER}, {"block": "floor"}, scale)


def deepest(obj, bodies) -> float:
    collider = Collider(obj, bodies)
    states = np.linspace(0, 0.4, 60)
    found = [collider.depths(obj.forward_kinematics([0, q])) for q in states]
    return max(max(d.values(), default=0.0) for d in found) / obj.scale


@pytest.mark.parametrize("scale", [1.0, 0.02])
def test_a_low_sill_no_longer_catches(scale):
    obj, bodies = shelf(0.02, scale)
    assert deepest(obj, bodies) > LEAST
    cut, (line,) = clear(obj, bodies)
    assert deepest(obj, cut) < 2 * LEAST
    assert "'floor' and 'block'" in line and f"{0.018 * scale:.3g} m" in line
    assert [(b.mass, b.dynamics) for b in cut] == [(b.mass, b.dynamics) for b in bodies]


def test_a_high_sill_stays_and_draws_the_limit_in():
    obj, bodies = shelf(3 * SHALLOW)
    cut, lines = clear(obj, bodies)
    assert lines == () and all(
        a is b
        for one, two in zip(bodies, cut, strict=True)
        for a, b in zip(one.shapes, two.shapes, strict=True)
    )
    # the sill is met after .05 of .4: too little to keep
    same, _ = mend(obj, bodies, [part.mesh for part in obj.parts])
    assert "left as it is" in same.provenance[-1]


def test_free_objects_are_left_alone():
    obj, bodies = shelf(0.001)
    cut, lines = clear(obj, bodies)
    assert lines == () and all(a.shapes == b.shapes for a, b in zip(bodies, cut, strict=True))
