"""A stage's loop: resuming is exact, it stops on what is not finite, on a signal and at the end,
and says so."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest
import toy_run

from uniart_jax.models.network import flat_names

PROGRAM = [sys.executable, str(Path(toy_run.__file__))]


def assert_same(a, b):
    a, b = flat_names(a), flat_names(b)
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(np.asarray(a[name]), np.asarray(b[name]), err_msg=name)


def rows(workdir: Path) -> list[dict]:
    return [json.loads(line) for line in (workdir / "metrics/toy.jsonl").read_text().splitlines()]


def losses(workdir: Path) -> list[tuple[int, float]]:
    return [(row["step"], row["loss"]) for row in rows(workdir) if row["kind"] == "train"]


def saved_steps(workdir: Path) -> list[int]:
    return sorted(int(p.name) for p in (workdir / "checkpoints/toy").iterdir() if p.name.isdigit())


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """Twelve steps without a break: (workdir, state, batches seen)."""
    workdir, seen = tmp_path_factory.mktemp("straight"), []
    state = toy_run.train(workdir, toy_run.make_stage(12, 4), toy_run.make_batches(seen))
    return workdir, state, seen


def test_training_lowers_the_loss_and_moves_the_average(straight):
    workdir, state, _ = straight
    first, last = losses(workdir)[0][1], losses(workdir)[-1][1]
    assert last < 0.7 * first
    assert int(state.step) == 12
    moved = jax.tree.map(lambda p, e: float(abs(p - e).max()), state.params, state.ema)
    assert all(value > 0 for value in jax.tree.leaves(moved))


def test_stopping_and_resuming_equals_straight(tmp_path, straight, capsys):
    workdir, expected, seen_straight = straight
    seen = []
    toy_run.train(tmp_path, toy_run.make_stage(2, 2), toy_run.make_batches(seen))
    resumed = toy_run.train(tmp_path, toy_run.make_stage(12, 5), toy_run.make_batches(seen))
    assert_same(expected, resumed)
    assert seen == seen_straight
    assert losses(tmp_path) == losses(workdir)
    assert "resumed at step 2" in capsys.readouterr().err


def test_a_finished_stage_is_only_restored(straight, capsys):
    workdir, state, _ = straight
    before = (workdir / "metrics/toy.jsonl").read_bytes()
    seen = []
    again = toy_run.train(workdir, toy_run.make_stage(12, 4), toy_run.make_batches(seen))
    assert_same(state, again)
    assert seen == []
    assert (workdir / "metrics/toy.jsonl").read_bytes() == before
    assert "already trained (12 steps)" in capsys.readouterr().err


def test_stops_where_values_are_not_finite_and_saves_nothing_after(tmp_path):
    stage = toy_run.make_stage(9, 1, log_every=100, keep_checkpoints=9)
    with pytest.raises(FloatingPointError, match=r"toy: error, grad_norm, loss .* step 3;"):
        toy_run.train(tmp_path, stage, toy_run.make_batches(nan_at=(3,)))
    assert saved_steps(tmp_path) == [1, 2]


@pytest.mark.slow
def test_steps_that_are_not_finite_are_passed_over_as_often_as_asked(tmp_path, capsys):
    stage = toy_run.make_stage(8, 2, log_every=8, skip_not_finite=1)
    state = toy_run.train(tmp_path / "a", stage, toy_run.make_batches(nan_at=(4, 6)))
    assert int(state.step) == 8 and all(np.isfinite(x).all() for x in jax.tree.leaves(state))
    assert saved_steps(tmp_path / "a") == [5, 7, 8]  # 4 and 6 wait for a sound step
    (row,) = rows(tmp_path / "a")
    assert row["skipped"] == 2 / 8 and np.isfinite(row["loss"]) and np.isfinite(row["grad_norm"])
    said = capsys.readouterr().err
    assert said.count("passed over (up to 1 in a row are)") == 2 and "not finite at step 6" in said
    short = toy_run.make_stage(5, 2, skip_not_finite=1)
    toy_run.train(tmp_path / "b", short, toy_run.make_batches(nan_at=(4,)))
    assert_same(state, toy_run.train(tmp_path / "b", stage, toy_run.make_batches(nan_at=(1,))))


def test_more_steps_in_a_row_that_are_not_finite_end_the_run(tmp_path):
    stage = toy_run.make_stage(9, 1, log_every=100, skip_not_finite=2, keep_checkpoints=9)
    for done in (0, 3):  # started again, it comes no further
        bad = range(4 - done, 9)
        with pytest.raises(FloatingPointError, match="at step 6 and the 2 before it; stopped"):
            toy_run.train(tmp_path, stage, toy_run.make_batches(nan_at=bad))
        assert saved_steps(tmp_path) == [1, 2, 3]


def test_reports_evaluates_and_logs_on_time(tmp_path, capsys):
    from tensorboardX.proto.event_pb2 import Event

    evaluated = []

    def evaluate(state, step):
        evaluated.append((step, int(state.step)))
        return {"parts": step / 10, "screws": float("nan")}, {"sample": np.zeros((4, 4, 3))}

    stage = toy_run.make_stage(5, 100, log_every=2, evaluate_every=3)
    toy_run.train(
        tmp_path,
        stage,
        toy_run.make_batches(),
        evaluate=evaluate,
    )
    assert evaluated == [(3, 3), (5, 5)]
    assert {"loss", "error", "grad_norm", "samples_per_second"} <= set(rows(tmp_path)[-2])
    kinds = [(row["step"], row["kind"]) for row in rows(tmp_path)]
    assert kinds == [(2, "train"), (3, "evaluation"), (4, "train"), (5, "train"), (5, "evaluation")]
    assert rows(tmp_path)[1]["parts"] == 0.3
    assert rows(tmp_path)[1]["screws"] is None
    err = capsys.readouterr().err
    assert "toy 5/5" in err and "samples/s" in err and "ETA" in err
    data = next((tmp_path / "tensorboard/toy").iterdir()).read_bytes()
    tags = set()
    while data:  # a record: length, checksum, event, checksum
        size = int.from_bytes(data[:8], "little")
        tags |= {value.tag for value in Event.FromString(data[12 : 12 + size]).summary.value}
        data = data[16 + size :]
    assert {"train/loss", "evaluation/parts", "evaluation/sample"} <= tags


def test_a_mean_over_the_log_interval_is_reported(tmp_path, straight):
    toy_run.train(tmp_path, toy_run.make_stage(4, 100, log_every=2), toy_run.make_batches())
    single = [loss for _, loss in losses(straight[0])]
    pairs = [(single[0] + single[1]) / 2, (single[2] + single[3]) / 2]
    assert [step for step, _ in losses(tmp_path)] == [2, 4]
    np.testing.assert_allclose([loss for _, loss in losses(tmp_path)], pairs, rtol=1e-6)


def test_data_that_ends_is_an_error(tmp_path):
    class Ends:
        def __next__(self):
            raise StopIteration

        def get_state(self):
            return 0

        def set_state(self, state):
            pass

    with pytest.raises(ValueError, match="the data ended at step 0"):
        toy_run.train(tmp_path, toy_run.make_stage(2, 2), Ends())


@pytest.mark.slow
def test_a_batch_that_fails_costs_no_step(tmp_path, straight, capsys):
    batches = toy_run.make_batches()

    class Damaged:
        drawn = 0

        def __next__(self):
            self.drawn += 1
            if self.drawn == 8:
                raise ValueError("record 17 is damaged")
            return next(batches)

        get_state, set_state = batches.get_state, batches.set_state

    stage = toy_run.make_stage(12, 100)
    with pytest.raises(ValueError, match="record 17 is damaged"):
        toy_run.train(tmp_path, stage, Damaged())
    assert saved_steps(tmp_path) == [7] and "saved at step 7" in capsys.readouterr().err
    state = toy_run.train(tmp_path, stage, toy_run.make_batches())  # once it is mended
    assert_same(state, straight[1])


def evaluation(calls):
    def evaluate(state, step):
        calls.append(step)
        return {"parts": float(np.asarray(state.ema["out"]["bias"]).sum())}, {}

    return evaluate


@pytest.mark.slow
@pytest.mark.parametrize("stopped", [3, 6])
def test_an_evaluation_that_a_signal_forestalls_is_made_up_for(tmp_path, stopped):
    """At the last step too, which has only been saved then: the rows are those of a run without a
    break."""
    stage = toy_run.make_stage(6, 100, evaluate_every=3)
    batches = toy_run.make_batches()

    class Stops:
        drawn = 0

        def __next__(self):
            self.drawn += 1
            if self.drawn == stopped:
                os.kill(os.getpid(), signal.SIGTERM)
            return next(batches)

        get_state, set_state = batches.get_state, batches.set_state

    calls, unbroken = [], []
    toy_run.train(tmp_path / "a", stage, toy_run.make_batches(), evaluate=evaluation(unbroken))
    with pytest.raises(SystemExit) as error:
        # the batch of step n is drawn, and the signal comes, when step n - 1 is past asking
        toy_run.train(tmp_path / "b", stage, Stops(), evaluate=evaluation(calls))
    assert error.value.code == 143
    assert saved_steps(tmp_path / "b") == [stopped] and stopped not in calls
    for _ in range(2):
        toy_run.train(tmp_path / "b", stage, toy_run.make_batches(), evaluate=evaluation(calls))
    assert calls == unbroken == [3, 6]


@pytest.mark.parametrize("at", [pytest.param(3, marks=pytest.mark.slow), 6])
def test_a_signal_while_a_step_is_saved_or_evaluated_is_obeyed(tmp_path, at):
    calls = []

    def killed(state, step):
        if step == at:
            os.kill(os.getpid(), signal.SIGTERM)
        return evaluation(calls)(state, step)

    stage = toy_run.make_stage(6, 100, evaluate_every=3)
    old = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as error:
        toy_run.train(tmp_path, stage, toy_run.make_batches(), evaluate=killed)
    assert error.value.code == 143 and signal.getsignal(signal.SIGTERM) is old
    toy_run.train(tmp_path, stage, toy_run.make_batches(), evaluate=evaluation(calls))
    assert calls == [3, 6]


def test_a_last_step_that_was_killed_while_it_was_evaluated_is_evaluated_later(tmp_path, straight):
    class Killed(BaseException):
        pass

    def killed(state, step):
        raise Killed

    calls, stage = [], toy_run.make_stage(12, 4)
    with pytest.raises(Killed):
        toy_run.train(tmp_path, stage, toy_run.make_batches(), evaluate=killed)
    for _ in range(2):
        state = toy_run.train(tmp_path, stage, toy_run.make_batches(), evaluate=evaluation(calls))
    assert calls == [12]
    assert_same(straight[1], state)
    assert [row["kind"] for row in rows(tmp_path)] == ["train"] * 12 + ["evaluation"]


def start(workdir: Path, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [*PROGRAM, str(workdir), *arguments], stderr=subprocess.PIPE, text=True, env=dict(os.environ)  # noqa: E501
    )  # fmt: skip


def wait_for(condition, process: subprocess.Popen, seconds: float = 300.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None and time.monotonic() < end
        time.sleep(0.0005)


def test_sigterm_saves_and_the_same_command_resumes(tmp_path, straight):
    _, expected, seen_straight = straight
    process = start(tmp_path, "12", "1000", "--slow", "0.1")
    log = tmp_path / "metrics/toy.jsonl"
    wait_for(lambda: log.exists() and log.stat().st_size > 0, process)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=300)
    assert process.returncode == 128 + signal.SIGTERM, err
    (step,) = saved_steps(tmp_path)
    assert 0 < step < 12
    assert f"SIGTERM; saved at step {step}" in err
    seen = []
    resumed = toy_run.train(tmp_path, toy_run.make_stage(12, 4), toy_run.make_batches(seen))
    assert_same(expected, resumed)
    assert seen == seen_straight[step:]


def killed_during_a_save(workdir: Path, delay: float) -> None:
    process = start(workdir, "2000", "1", "--slow", "0.01")
    folder = workdir / "checkpoints/toy"
    newest = max(saved_steps(workdir), default=0) if folder.exists() else 0

    def saving() -> bool:
        names = [p.name for p in folder.iterdir()] if folder.exists() else []
        done = max((int(n) for n in names if n.isdigit()), default=0)
        return done > newest and any("tmp" in n for n in names)

    wait_for(saving, process)
    time.sleep(delay)
    process.kill()
    process.communicate()


def killed_at_any_moment(workdir: Path, delay: float) -> None:
    """So long after the first step that this process reported."""
    log = workdir / "metrics/toy.jsonl"
    size = log.stat().st_size if log.exists() else 0
    process = start(workdir, "2000", "1", "--slow", "0.01")
    wait_for(lambda: log.exists() and log.stat().st_size > size, process)
    time.sleep(delay)
    process.kill()
    process.communicate()


def check_killed_equals_straight(workdir: Path) -> None:
    steps = saved_steps(workdir / "killed")
    total = steps[-1] + 3
    stage = toy_run.make_stage(total, 1)
    expected = toy_run.train(
        workdir / "straight", toy_run.make_stage(total, 10**9), toy_run.make_batches()
    )
    assert_same(expected, toy_run.train(workdir / "killed", stage, toy_run.make_batches()))
    assert losses(workdir / "straight") == losses(workdir / "killed")


@pytest.mark.slow  # by day a damaged newest checkpoint (test_checkpoints.py), and SIGTERM
def test_kill_9_during_a_save_loses_nothing_but_time(tmp_path):
    killed_during_a_save(tmp_path / "killed", 0.0)
    check_killed_equals_straight(tmp_path)


@pytest.mark.slow
def test_kill_9_twenty_times(tmp_path):
    draw = random.Random(0)
    for _ in range(10):
        killed_during_a_save(tmp_path / "killed", draw.uniform(0, 0.02))
        killed_at_any_moment(tmp_path / "killed", draw.uniform(0, 0.5))
    check_killed_equals_straight(tmp_path)
