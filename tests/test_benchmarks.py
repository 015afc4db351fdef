"""What scripts of benchmarks/ make of their measurements, by numbers known beforehand."""

import importlib
from pathlib import Path

import pytest


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "benchmarks")
    return importlib.import_module


def test_saves_are_counted_as_often_as_a_run_has_them(script):
    in_run = script("step_overhead").in_run
    times = [10.0 + i for i in range(41)]  # 40 steps of a second, two of them with a save in it
    times = [t + 3 * (t > 15) + 3 * (t > 35) for t in times]
    held = [(2.0, 9.0), (15.5, 3.0), (38.9, 3.0), (90.0, 5.0)]  # the first and last outside
    loop, save = in_run(times, held, save_every=20)
    assert (loop, save) == pytest.approx((46.0, 3.0))
    assert in_run(times, held, save_every=400)[0] == pytest.approx(40.3)
    assert in_run(times, [], save_every=400) == pytest.approx((46.0, 0.0))
