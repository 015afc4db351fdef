"""Means and differences of arms, and what their intervals are over."""

import numpy as np
import pytest
from scipy import stats

from uniart_jax.experiments.intervals import difference, row, unpaired
from uniart_jax.experiments.table import Judged, lines, matched, over


def test_intervals_over_objects_and_over_trainings():
    rng = np.random.default_rng(0)
    objects, noise = rng.normal(size=40), rng.normal(size=(3, 1)) * 0.1
    reference = objects + rng.normal(size=(3, 1))
    values = reference + 0.5 + noise
    found = difference(values, reference)  # objects and the seeds' own level cancel
    low, high = stats.t.interval(0.95, 2, 0.5 + noise.mean(), stats.sem(noise[:, 0]))
    assert found == pytest.approx({"mean": 0.5 + noise.mean(), "low": low, "high": high})
    single = difference(objects[None] + 1, objects[None])
    assert single == pytest.approx({"mean": 1, "low": 1, "high": 1})
    mean = row(np.stack([objects, objects + 1]))
    assert mean["mean"] == pytest.approx(objects.mean() + 0.5)
    assert mean["seeds"] == pytest.approx([objects.mean(), objects.mean() + 1])
    width = 2 * 1.96 * objects.std() / 40**0.5
    assert mean["high"] - mean["low"] == pytest.approx(width, rel=0.15)


def test_what_cannot_be_compared_is_left_out_of_means():
    gap = np.array([[1.0, np.nan, 3.0], [3.0, np.nan, np.nan]])
    assert row(gap)["mean"] == pytest.approx(2.5)  # objects: (1 + 3) / 2 and 3
    apart = difference(gap, np.zeros((2, 3)))
    assert apart["mean"] == pytest.approx(2.5)  # seeds: 2 and 3
    assert np.isnan(difference(np.full((1, 2), np.nan), np.zeros((1, 2)))["mean"])


def test_arms_on_other_objects_are_two_independent_samples():
    rng = np.random.default_rng(1)
    seen, unseen = rng.normal(30, 3, (1, 60)), rng.normal(24, 4, (1, 50))
    found = unpaired(unseen, seen, "higher")
    apart = found["difference"]
    assert apart["mean"] == pytest.approx(unseen.mean() - seen.mean())
    error = (unseen.var() / 50 + seen.var() / 60) ** 0.5  # no pairing: variances add
    assert apart["high"] - apart["low"] == pytest.approx(2 * 1.96 * error, rel=0.1)
    kept = found["kept"]
    assert kept["mean"] == pytest.approx(unseen.mean() / seen.mean())
    assert kept["low"] < kept["mean"] < kept["high"] < 1
    distance = unpaired(np.full((1, 9), 0.02), np.full((1, 7), 0.01), "lower")
    assert distance["kept"] == pytest.approx({"mean": 0.5, "low": 0.5, "high": 0.5})
    nothing = unpaired(np.full((1, 9), np.nan), np.ones((1, 7)), "lower")
    assert np.isnan(nothing["kept"]["mean"]) and np.isnan(nothing["difference"]["mean"])
    assert np.isnan(unpaired(np.ones((1, 9)), np.zeros((1, 7)), "higher")["kept"]["mean"])


def judged(seeds, trained=True):
    return Judged(seeds, {}, 3, trained, 0, 0, {}, {})


def test_what_is_not_trained_is_held_against_every_training():
    three, alone = judged([0, 1, 2]), judged([0], trained=False)
    assert matched(alone, three) == ([0, 0, 0], [0, 1, 2])
    assert matched(three, alone) == ([0, 1, 2], [0, 0, 0])
    assert matched(alone, alone) == ([0], [0])
    assert matched(judged([0, 2]), three) == ([0, 1], [0, 2])
    assert matched(judged([3]), three) == ([], [])


def test_a_table_says_what_its_intervals_are_over():
    figure = {"mean": 1.0, "low": 0.5, "high": 1.5}
    arm = {
        "seeds": [0, 1],
        "objects": 3,
        "parameters": 1234,
        "failures": 0,
        "faulty": 0,
        "rows": {"x": figure},
    }
    kinds = {
        "many": {"over": "trainings", "pairs": 2},
        "one": {"over": "objects", "pairs": 1},
        "none": {"over": "objects", "pairs": 0},
        "others": {"over": "other objects", "kept": {"x": figure}},
    }
    arms = {"base": arm} | {
        name: arm | kind | {"against": "base", "differences": {"x": figure}}
        for name, kind in kinds.items()
    }
    told = [over(arms[name]) for name in kinds]
    assert told == ["2 trainings", "objects, one training", "objects", "other objects"]
    metric = {"title": "X", "better": "higher", "about": ""}
    content = {
        "columns": ["x"],
        "level": 0.95,
        "arms": arms,
        "metrics": {"x": metric},
        "broken": {"one": {1: "loss is nan"}},
        "unfinished": {},
        "objects": 3,
    }
    arms["many"] |= {"failures": 2, "faulty": 1}
    text = "\n".join(lines(content))
    assert "counted with the worst values: many 2." in text and "is at fault: many 1." in text
    assert "| base | 2 | 3 | 1,234 | 1.00 [0.50, 1.50] |" in text
    for name, kind in zip(kinds, told, strict=True):
        assert f"| {name} | base | {kind} | +1.00 [+0.50, +1.50] |" in text
    assert "| others | base | other objects | 1.00 [0.50, 1.50] |" in text
    assert "Trainings of one without a result, in no figure above: seed 1: loss is nan." in text
