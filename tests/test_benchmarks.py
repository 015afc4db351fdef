"""What scripts of benchmarks/ make of their measurements, by numbers known beforehand."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from scipy import stats


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "benchmarks")
    return importlib.import_module


def test_a_solvers_interval_is_of_the_figure_that_it_stands_beside(script):
    solvers = script("solvers")
    rng = np.random.default_rng(0)
    ones = np.ones(6)
    values, base = rng.random(6), rng.random(6)
    half = stats.t.ppf(0.975, 5) * stats.sem(values - base)
    assert solvers.interval(values, base, ones) == pytest.approx(half)
    assert np.isnan(solvers.interval(values[:1], base[:1], ones[:1]))
    parts = np.array([0, 1, 2, 5, 1, 0])
    same = solvers.interval(parts * 0.75, parts * 0.25, parts)
    assert same == pytest.approx(0)  # every part better by the same, whatever the object

    def figures(right):
        row = {"structure": 0.5, "found": right, "right": right, "readings": right}
        return row | dict.fromkeys(("structure velocities", "latent velocities", "structure s", "latent s"), 1)  # fmt: skip

    objects = [{"euler 4": figures(r)} for r in ([], [True, False], [True])]
    (row,) = solvers.table(objects)
    assert row["right"] == pytest.approx(2 / 3) and row["right +-"] == 0
    (row,) = solvers.table(objects[:1])
    assert np.isnan(row["right"]) and np.isnan(row["right +-"])


def test_saves_are_counted_as_often_as_a_run_has_them(script):
    in_run = script("step_overhead").in_run
    times = [10.0 + i for i in range(41)]  # 40 steps of a second, two of them with a save in it
    times = [t + 3 * (t > 15) + 3 * (t > 35) for t in times]
    held = [(2.0, 9.0), (15.5, 3.0), (38.9, 3.0), (90.0, 5.0)]  # the first and last outside
    loop, save = in_run(times, held, save_every=20)
    assert (loop, save) == pytest.approx((46.0, 3.0))
    assert in_run(times, held, save_every=400)[0] == pytest.approx(40.3)
    assert in_run(times, [], save_every=400) == pytest.approx((46.0, 0.0))
