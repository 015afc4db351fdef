"""Means over samples and objects, and their intervals, against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.evaluation.metric import Metric
from uniart_jax.evaluation.summary import (
    chosen_samples,
    drawn_sample,
    interval,
    object_figures,
    paired_differences,
    sum_confusions,
    summarize_objects,
)

METRICS = {
    "pose_error": Metric("pose error", "lower", 1.0, ""),
    "psnr": Metric("PSNR", "higher", 0.0, ""),
    "axis": Metric("axis", "lower", 180.0, ""),
}


def result(failure: str = "", **figures) -> dict:
    return {"figures": figures, "failure": failure, "confusion": {}}


A = result(pose_error=0.2, psnr=20.0, axis=None)
B = result(pose_error=0.1, psnr=10.0, axis=None)
BAD = result("cannot be read") | {"inapplicable": ["axis"]}
LOST = result("cannot be read")  # and the reference has an axis


def of(results, samples):
    return object_figures(chosen_samples(results, METRICS, samples, "pose_error"), METRICS)


def test_samples_become_one_figure():
    figures, why = of([A, B], "mean")
    assert figures["pose_error"] == pytest.approx(0.15) and figures["psnr"] == 15.0
    assert np.isnan(figures["axis"]) and figures["failed"] == 0 and why == ""
    assert of([A, B], "first")[0]["psnr"] == 20.0
    assert of([A, B], "best")[0]["psnr"] == 10.0  # the better pose, although its picture is worse


def test_a_failed_sample_counts_with_the_worst():
    figures, why = of([A, BAD], "mean")
    assert figures["pose_error"] == pytest.approx(0.6) and figures["psnr"] == 10.0
    assert (
        np.isnan(figures["axis"]) and figures["failed"] == 0.5
    )  # no prediction of it could have one
    known = result(pose_error=0.2, psnr=20.0, axis=30.0)
    assert of([known, LOST], "mean")[0]["axis"] == 105.0
    assert why == "1 of 2 samples: cannot be read"
    assert of([BAD, A], "first")[0]["psnr"] == 0.0
    figures, why = of([BAD, A], "best")
    assert figures["psnr"] == 20.0 and why == ""
    assert of([BAD], "mean")[1] == "cannot be read"


def test_a_family_that_fell_over_leaves_the_others():
    figures, why = of([result("axis: crashed", pose_error=0.2, psnr=20.0)], "mean")
    assert (figures["pose_error"], figures["psnr"], figures["axis"]) == (0.2, 20.0, 180.0)
    assert figures["failed"] == 1 and why == "axis: crashed"
    assert np.isnan(object_figures([LOST], METRICS, ["axis"])[0]["axis"])


def test_the_picture_is_of_a_sample_that_counts():
    rows = [r | {"sample": i} for i, r in enumerate([A, B, BAD])]
    drawn = {
        s: drawn_sample(chosen_samples(rows, METRICS, s, "pose_error"), METRICS, "pose_error")
        for s in ("mean", "best", "first")
    }
    assert drawn == {"mean": 0, "best": 1, "first": 0}
    assert (
        drawn_sample(rows[2:], METRICS, "pose_error") == 2 and drawn_sample(rows, METRICS, "") == 0
    )


def test_what_does_not_apply_is_left_out_and_counted():
    objects = {
        "a": {"x": 1.0, "y": np.nan},
        "b": {"x": 3.0, "y": np.nan},
        "c": {"x": np.nan, "y": np.nan},
    }
    rows = summarize_objects(objects, list(objects))
    assert rows["x"]["mean"] == 2.0 and rows["x"]["count"] == 2
    assert rows["y"]["count"] == 0 and np.isnan(rows["y"]["mean"])
    assert summarize_objects(objects, ["a"])["x"]["mean"] == 1.0
    assert np.isnan(summarize_objects(objects, ["a"])["x"]["low"])  # one object tells no spread


def test_differences_are_of_the_same_objects():
    ours = {"a": {"x": 1.0, "y": 2.0}, "b": {"x": 5.0, "y": np.nan}}
    theirs = {"a": {"x": 0.5, "y": 1.0}, "b": {"x": 4.5, "y": 1.0}}
    rows = paired_differences(ours, theirs)
    assert rows["x"] == {
        "mean": 0.5,
        "low": 0.5,
        "high": 0.5,
        "count": 2,
    }  # alike, however far the objects are apart
    assert rows["y"]["mean"] == 1.0 and rows["y"]["count"] == 1


def test_the_interval_is_the_known_one():
    rng = np.random.default_rng(3)
    for n in (60, 400):
        values = rng.normal(5, 2, n)
        low, high = interval(values)
        half = 1.96 * values.std() / n**0.5  # of the mean, for large n
        assert (high - low) / 2 == pytest.approx(half, rel=0.1)
        assert (high + low) / 2 == pytest.approx(values.mean(), abs=0.1 * half)


def test_about_19_of_20_intervals_hold_the_truth():
    rng = np.random.default_rng(0)
    hits = [
        low <= 0.3 <= high for low, high in (interval(rng.random(50) < 0.3) for _ in range(200))
    ]
    assert 0.90 <= np.mean(hits) <= 0.985


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=30), st.floats(-10, 10))
def test_the_interval_holds_its_values_and_moves_with_them(values, shift):
    values = np.array(values)
    low, high = interval(values)
    assert values.min() - 1e-6 <= low <= high <= values.max() + 1e-6
    assert interval(values) == (low, high)
    assert interval(values + shift) == pytest.approx((low + shift, high + shift), abs=1e-6)


def test_confusions_add_up_over_objects_not_samples():
    one = {"confusion": {"revolute": {"fixed": 2, "revolute": 2}}}
    none: dict = {"confusion": {}}
    other = {"confusion": {"revolute": {"revolute": 1}, "fixed": {"fixed": 1}}}
    assert sum_confusions([[one, none], [other]]) == {
        "fixed": {"fixed": 1},
        "revolute": {"fixed": 1, "revolute": 2},
    }
