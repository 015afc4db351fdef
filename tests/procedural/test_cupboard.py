"""Cupboards: what they promise beyond what all families do."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections import Counter

import numpy as np
import pytest
from overlaps import HAIR, check_clear, check_closed, overlap

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import BOX_SEPARATION, box_separation, cupboard, joinery
from uniart_jax.procedural.cabinet import Cell
from uniart_jax.procedural.cupboard_case import Cabinet, carcass, fronts
from uniart_jax.procedural.cupboard_plans import HUNG, KINDS, plan
from uniart_jax.procedural.shapes import Assembly, Shape, box


@functools.cache
def build(seed: int) -> ArticulatedObject:
    return cupboard.build(np.random.default_rng([seed, 5])).normalized()


def objects(count: int) -> list[ArticulatedObject]:
    made = [build(seed) for seed in range(count)]
    return [obj for obj in made if box_separation(obj) > BOX_SEPARATION]


def test_parts_are_closed_and_clear_of_their_cases_as_they_open():
    for number, obj in enumerate(objects(40)):
        check_closed(obj, f"cupboard {number}")
        check_clear(obj, f"cupboard {number}")


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


@pytest.mark.parametrize("inset", [False, True])
def test_half_fronts_hang_on_what_carries_them(inset):
    """At the case's outer edge; at the inner one only where a board stands, which touches the
    frame."""
    cells = (Cell((-0.4, 0.4), (0.0, 0.7), "half"),)
    cab = Cabinet((-0.4, 0.4), (0, 0.7), 0.5, 0.02, 0.002, 0.02, 0.0, 0.002, inset, cells)
    inner = []
    for seed in range(60):
        look = cupboard.style(np.random.default_rng(seed), 0.008, hung=False, tall=False)
        body, asm = Shape(), Assembly()
        later = fronts(np.random.default_rng(seed), body, cab, look)
        board = body.solid()
        root = asm.add("body", Shape().add(box([0, -0.4, 0], [0.5, 0.4, 0.7]), look.face))
        later[0](asm, root)
        door = asm.object().parts[1]
        hinged = float(door.joint.origin[1])
        inner.append(abs(hinged) < 0.3)
        assert not inner[-1] or not board.is_empty()
        if inset and not board.is_empty():
            lo, hi = np.split(np.array(board.bounding_box()), 2)
            np.testing.assert_allclose([lo[2], hi[2]], [0.02, 0.68], atol=1e-6)
            assert np.isclose(max(hi[1], -lo[1]), 0.38, atol=1e-6)
    assert 0 < np.mean(inner) < 0.5


def test_inset_fronts_that_stay_stand_in_pockets():
    cells = (Cell((-0.4, 0.4), (0.0, 0.3), "false"), Cell((-0.4, 0.4), (0.3, 0.7), "door"))
    for roofless, seed in itertools.product((False, True), range(10)):
        rows = cells if not roofless else (
            dataclasses.replace(cells[1], z=(0.0, 0.4)), dataclasses.replace(cells[0], z=(0.4, 0.7))
        )  # fmt: skip
        cab = Cabinet((-0.4, 0.4), (0, 0.7), 0.5, 0.02, 0.002, 0.02, 0.0, 0.002, True, rows,
                      roofless=roofless)  # fmt: skip
        rng = np.random.default_rng(seed)
        look = cupboard.style(rng, 0.008, hung=False, tall=False)
        case, front = Shape(), Shape()
        carcass(rng, case, cab, look, look.face, look.face)
        fronts(rng, front, cab, look)
        assert overlap(front.solid(), case.solid()) < HAIR
        assert front.solid().min_gap(case.solid(), 1.0) < 1e-4


@pytest.mark.parametrize("pull", [k for k in joinery.PULLS if k != "none"])
@pytest.mark.parametrize("kind", ["slab", "shaker", "raised", "louvre", "border"])
def test_pulls_of_drawers_touch_their_fronts(kind, pull):
    look = cupboard.style(np.random.default_rng(1), 0.008, hung=False, tall=False)
    look = dataclasses.replace(look, pull=pull, centred=True)
    lo, hi = np.array([-0.02, -0.3, 0.1]), np.array([0.0, 0.3, 0.5])
    bare = joinery.front(lo, hi, look, "+z", kind, pulled=False).solid()
    whole = joinery.front(lo, hi, look, "+z", kind).solid()
    assert len(whole.decompose()) == len(bare.decompose())
    assert whole.volume() > bare.volume()


@pytest.mark.parametrize("kind", joinery.PANELS)
def test_every_panel_fills_its_box(kind):
    look = cupboard.style(np.random.default_rng(0), 0.008, hung=False, tall=False)
    lo, hi = np.array([-0.02, -0.3, 0.1]), np.array([0.0, 0.3, 0.9])
    mesh = joinery.panel(lo, hi, look, kind).mesh()
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds, [lo, hi], atol=1e-4)
