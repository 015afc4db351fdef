"""What the desk family promises: closed parts that clear one another, drawers on two sides, doors,
leaves, lids and casters that move as such things do."""

from __future__ import annotations

import numpy as np
import pytest
from overlaps import check_clear, check_closed, loose

from uniart_jax.procedural import BOX_SEPARATION, MAX_PARTS, box_separation, desk

SEEDS = range(60)
TYPES = {
    "drawer": {"prismatic"},
    "door": {"revolute"},
    "flap": {"revolute"},
    "leaf": {"revolute"},
    "lid": {"revolute"},
    "fork": {"continuous"},
    "wheel": {"continuous"},
    "handle": {"fixed"},
}


@pytest.fixture(scope="module")
def tables():
    made = [desk.build(np.random.default_rng([seed, 5])).normalized() for seed in SEEDS]
    return [t for t in made if len(t.parts) <= MAX_PARTS and box_separation(t) > BOX_SEPARATION]


def test_few_are_drawn_again(tables):
    assert len(tables) >= 0.95 * len(SEEDS)


def test_parts_are_closed_and_clear(tables):
    for number, table in enumerate(tables):
        check_closed(table, f"desk {number}")
        check_clear(table, f"desk {number}")


def test_joints_suit_what_moves(tables):
    labels = set()
    for table in tables:
        for part in table.parts[1:]:
            assert part.joint.type in TYPES[part.label], part.name
            assert part.joint.limits[0] == 0 or part.joint.type == "continuous"
            assert np.sort(part.mesh.extents)[1] > 0.015 or part.label in ("handle", "wheel")
            labels.add(part.label)
    assert {"drawer", "door", "leaf", "wheel"} <= labels


def test_nothing_floats(tables):
    for number, table in enumerate(tables):
        for part in table.parts:
            assert part.label in ("fork", "handle") or not loose(part.mesh, 6e-4), (
                f"{number} {part.name}"
            )


def test_drawers_open_on_two_sides_and_some_are_thin(tables):
    drawers = [p for table in tables for p in table.parts if p.label == "drawer"]
    forward = [float(p.joint.direction[0]) for p in drawers]
    assert min(forward) == pytest.approx(-1) and max(forward) == pytest.approx(1)
    fronts = np.array([p.mesh.extents[2] for p in drawers])
    assert np.mean(fronts < 0.08) > 0.15 and np.mean(fronts > 0.15) > 0.1
