"""The loop of all evaluations: order, what is stored and taken again, what a bad item costs."""

from __future__ import annotations

import functools
import json
import math
import os
import signal

import pytest

from uniart_jax.evaluation.result_store import ResultStore
from uniart_jax.evaluation.runner import (
    DIED,
    Passing,
    error_line,
    run,
    run_or_reason,
    run_staged,
    write_metrics,
)


def double(folder, item):
    """Twice the item; says in a file that it was asked."""
    with (folder / "asked").open("a") as file:
        file.write(f"{item}\n")
    if item == 13:
        raise ValueError("13 is\nno number")
    if item == 66:
        os.kill(os.getpid(), signal.SIGKILL)
    return Passing({"value": 2 * item}) if item == 7 else {"value": 2 * item}


def asked(folder):
    lines = (folder / "asked").read_text().split() if (folder / "asked").exists() else []
    return sorted(map(int, lines))


@pytest.fixture
def store(tmp_path):
    return ResultStore(lambda item: tmp_path / "results" / f"{item}.json")


def values(results):
    return [result["value"] for result in results]


def test_results_are_in_order_and_made_once(tmp_path, store, capsys):
    measure = functools.partial(double, tmp_path)
    assert values(run(measure, [3, 1, 2], "numbers", store=store)) == [6, 2, 4]
    assert values(run(measure, [2, 4, 3], "numbers", store=store)) == [4, 8, 6]
    assert asked(tmp_path) == [1, 2, 3, 4]
    assert "numbers: 2 of 3 were made before" in capsys.readouterr().err


def test_a_stopped_run_goes_on(tmp_path, store):
    measure = functools.partial(double, tmp_path)
    with pytest.raises(ValueError, match="13"):
        list(run(measure, [1, 2, 13, 4], "numbers", store=store))
    assert {p.name for p in (tmp_path / "results").iterdir()} == {"1.json", "2.json"}
    assert values(run(measure, [1, 2, 4], "numbers", store=store)) == [2, 4, 8]
    assert asked(tmp_path) == [1, 2, 4, 13]


def test_what_may_come_out_better_is_not_kept(tmp_path, store):
    measure = functools.partial(double, tmp_path)
    for _ in range(2):
        assert values(run(measure, [7, 8], "numbers", store=store)) == [14, 16]
    assert asked(tmp_path) == [7, 7, 8]


def test_a_result_of_something_else_and_a_broken_file_are_made_again(tmp_path, store):
    measure = functools.partial(double, tmp_path)
    list(run(measure, [1, 2, 3], "numbers", store=store))
    (tmp_path / "results/1.json").write_text("{")
    changed = ResultStore(store.file, lambda item, result: item != 2)
    assert values(run(measure, [1, 2, 3], "numbers", store=changed)) == [2, 4, 6]
    assert asked(tmp_path) == [1, 1, 2, 2, 3]


def test_workers_make_the_same_and_one_that_dies_costs_its_item_alone(tmp_path, store):
    measure = functools.partial(double, tmp_path)
    died = lambda item: Passing({"value": -item})  # noqa: E731
    items = [1, 66, 2, 3]
    made = run(measure, items, "numbers", processes=2, store=store, died=died)
    assert values(made) == [2, -66, 4, 6]
    assert {p.name for p in (tmp_path / "results").iterdir()} == {"1.json", "2.json", "3.json"}
    with pytest.raises(ValueError, match="a worker process died"):
        list(run(measure, [66], "numbers", processes=2))


def test_a_bad_item_is_its_reason(tmp_path):
    measure = functools.partial(double, tmp_path)
    assert list(run_or_reason(measure, [1, 13], "numbers")) == [{"value": 2}, "13 is no number"]
    assert list(run_or_reason(measure, [66], "numbers", processes=2)) == [DIED]


def test_stages_meet_in_order_and_jobs_may_be_none(tmp_path):
    seen = []

    def predict(item, drawn):
        seen.append((item, drawn["value"]))
        return [functools.partial(double, tmp_path, item * 10 + i) for i in range(item % 3)]

    draw = functools.partial(double, tmp_path)
    made = run_staged(draw, predict, [1, 2, 3, 4, 5], "numbers")
    assert seen == [(1, 2), (2, 4), (3, 6), (4, 8), (5, 10)]
    assert [values(jobs) for jobs in made] == [[20], [40, 42], [], [80], [100, 102]]


def test_errors_are_one_line():
    assert error_line(ValueError("two\nlines")) == "two lines"
    assert error_line(FileNotFoundError("x: no such file")) == "x: no such file"
    assert error_line(KeyError("x")) == "KeyError: 'x'"
    assert error_line(MemoryError()) == "MemoryError"


def test_metrics_are_json(tmp_path):
    write_metrics(tmp_path, {"a": math.nan, "b": [1.5, math.inf]}, "| a |")
    assert json.loads((tmp_path / "metrics.json").read_text()) == {"a": None, "b": [1.5, None]}
    assert (tmp_path / "table.md").read_text() == "| a |\n"
