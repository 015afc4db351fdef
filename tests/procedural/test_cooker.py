"""What cookers and built-in appliances promise: parts that move as theirs do, in closed solids that
do not run into one another."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from overlaps import HAIR, check_clear, check_closed, overlap, solid

from uniart_jax.procedural import BOX_SEPARATION, box_separation, controls, cooker

COUNT = 40


def kind(part) -> str:
    return f"{part.name.split('_')[0]} {part.joint.type}"


@pytest.fixture(scope="module")
def cookers():
    return [cooker.build(np.random.default_rng(seed)).normalized() for seed in range(COUNT)]


def test_cookers_are_closed_and_clear(cookers):
    for seed, obj in enumerate(cookers):
        check_closed(obj, f"cooker {seed}")
        check_clear(obj, f"cooker {seed}")


def test_fronts_clear_their_siblings_as_each_opens_by_itself(cookers):
    for seed, obj in enumerate(cookers):
        fronts = [k for k, p in enumerate(obj.parts) if p.name.split("_")[0] in ("door", "drawer")]
        solids = {k: solid(obj.parts[k].mesh) for k in fronts}
        for k, share in itertools.product(fronts, (0.04, 0.1, 0.25, 0.5, 1.0)):
            part = obj.parts[k]
            there = solids[k].transform(part.joint.motion(share * part.joint.limits[1])[:3])
            for other in set(fronts) - {k}:
                if obj.parts[other].parent != k != obj.parts[k].parent != other:
                    met = overlap(there, solids[other])
                    assert met < HAIR, f"cooker {seed} {part.name} {obj.parts[other].name}"


def test_every_cooker_moves(cookers):
    for seed, obj in enumerate([*cookers, cooker.build(np.random.default_rng(46))]):
        assert any(part.joint.type != "fixed" for part in obj.parts), f"cooker {seed}"


def test_cookers_have_what_real_ones_have(cookers):
    counts = Counter(kind(part) for obj in cookers for part in obj.parts)
    knobs = counts["knob continuous"], counts["knob revolute"]
    assert knobs[0] > 2 * knobs[1] > 0  # most turn without end
    assert min(counts[k] for k in ("door revolute", "drawer prismatic", "rack prismatic")) > 0
    assert np.mean([box_separation(obj) > BOX_SEPARATION for obj in cookers]) > 0.9
    tilted = [
        abs(part.joint.direction[2]) > 0.1
        for obj in cookers
        for part in obj.parts
        if part.name.startswith("knob")
    ]
    assert 0.05 < np.mean(tilted) < 0.6


def test_knobs_with_stops_turn_clockwise(cookers):
    for obj in cookers:
        for part in obj.parts:
            if part.name.startswith("knob") and part.joint.type == "revolute":
                low, high = part.joint.limits
                toward = part.joint.direction * (1 if high > -low else -1)
                assert toward[0] > 0 or toward[2] < -0.9  # away from who stands before or above


def test_rows_of_knobs_stay_apart_and_leave_the_span_free():
    rng = np.random.default_rng(0)
    uneven = 0
    for _ in range(300):
        half, pitch, count = (
            rng.uniform(0.1, 0.6),
            rng.uniform(0.03, 0.12),
            int(rng.integers(0, 10)),
        )
        ys, span = controls.uneven_row(rng, count, half, pitch)
        assert len(ys) <= count and np.all(np.abs(ys) <= half + 1e-9)
        gaps = np.diff(ys)
        assert np.all(gaps > pitch * (1 - 1e-9))
        uneven += len(gaps) > 1 and np.ptp(gaps) > 0.2 * pitch
        if span is not None:
            assert all(y < span[0] - 0.5 * pitch or y > span[1] + 0.5 * pitch for y in ys)
    assert uneven > 100
