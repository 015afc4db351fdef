"""Cupboards: what they promise beyond what all families do."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from overlaps import overlap, solid

from uniart_jax.procedural import BOX_SEPARATION, MAX_PARTS, box_separation, cupboard, joinery
from uniart_jax.procedural.cupboard_case import Cabinet
from uniart_jax.procedural.cupboard_plans import HUNG, KINDS, Cell, plan

HAIR = 1e-3  # of the smaller part's volume


def objects(count: int):
    made = [cupboard.build(np.random.default_rng([seed, 5])).normalized() for seed in range(count)]
    return [obj for obj in made if box_separation(obj) > BOX_SEPARATION]


def test_parts_are_closed_and_clear_of_their_cases_as_they_open():
    for number, obj in enumerate(objects(40)):
        solids = [solid(part.mesh) for part in obj.parts]
        assert len(obj.parts) <= MAX_PARTS
        for k, part in enumerate(obj.parts):
            assert part.mesh.is_watertight and part.mesh.volume > 0, f"{number} {part.name}"
            assert all(s.volume > 0 for s in part.mesh.split(only_watertight=False))
            if part.parent < 0:
                continue
            far = part.joint.limits[np.abs(part.joint.limits).argmax()]
            for share in (0.0, 0.25, 0.5, 1.0):
                there = solids[k].transform(part.joint.motion(share * far)[:3])
                shared = overlap(there, solids[0])
                assert shared < HAIR, f"{number} {part.name} at {share:.0%}: {shared:.2g}"


def test_most_have_one_or_two_doors_and_all_ways_of_opening_occur():
    made = objects(120)
    moving = [sum(part.parent >= 0 for part in obj.parts) for obj in made]
    assert 0.5 < np.mean(np.array(moving) <= 2) < 0.95
    assert min(moving) >= 1 and max(moving) >= 5
    names = Counter(part.label for obj in made for part in obj.parts)
    assert all(names[name] for name in ("door", "flap", "drawer"))
    wide = [
        np.abs(part.joint.limits).max() > np.deg2rad(150)
        for obj in made
        for part in obj.parts
        if part.joint.type == "revolute"
    ]
    assert 0.05 < np.mean(wide) < 0.4
    across = [
        part
        for obj in made
        for part in obj.parts
        if part.joint.type == "prismatic" and abs(part.joint.direction[1]) > 0.9
    ]
    assert across  # doors that slide


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("corner", "frame")])
def test_plans_cover_the_front_without_overlap(kind):
    low, high, half = 0.1, 2.0 if kind in ("tall", "wardrobe") else 0.8, 0.45
    hung = kind in HUNG
    for seed in range(30):
        cells = plan(np.random.default_rng(seed), kind, half, (0.0 if hung else low, high), 0.01)
        area = sum((c.y[1] - c.y[0]) * (c.z[1] - c.z[0]) for c in cells)
        assert area == pytest.approx(2 * half * (high - (0.0 if hung else low)))
        assert all(c.y[1] > c.y[0] and c.z[1] > c.z[0] for c in cells)


def test_fronts_that_stay_count_as_none():
    kinds = ("door", "double", "drawer", "false", "blank", "open")
    cells = tuple(Cell((0, 1), (k, k + 1), kind) for k, kind in enumerate(kinds))
    cab = Cabinet((0, 1), (0, 6), 0.5, 0.02, 0.002, 0.02, 0.0, 0.002, False, cells)
    assert cab.moving == 4


@pytest.mark.parametrize("kind", joinery.PANELS)
def test_every_panel_fills_its_box(kind):
    look = cupboard.style(np.random.default_rng(0), 0.008, hung=False, tall=False)
    lo, hi = np.array([-0.02, -0.3, 0.1]), np.array([0.0, 0.3, 0.9])
    mesh = joinery.panel(lo, hi, look, kind).mesh()
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds, [lo, hi], atol=1e-4)
