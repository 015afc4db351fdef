"""What a run says about itself: where time went, what a step computes, what was compiled, a trace
when it is asked for."""

import json
import os
import signal
import time
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import toy_run

from uniart_jax.config import StageConfig
from uniart_jax.training import dashboard, flops
from uniart_jax.training.flops import matmul_flops
from uniart_jax.training.programs import Program, Programs
from uniart_jax.training.state import create_state, make_optimizer
from uniart_jax.training.step import make_train_step


def rows(workdir):
    lines = (workdir / "metrics/toy.jsonl").read_text().splitlines()
    return [row for row in map(json.loads, lines) if row["kind"] == "train"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Ten steps that are told to trace themselves before the third."""
    workdir = tmp_path_factory.mktemp("run")
    batches = toy_run.make_batches()

    class Asks:
        drawn = 0

        def __next__(self):
            self.drawn += 1
            if self.drawn == 3:
                os.kill(os.getpid(), signal.SIGUSR1)
            return next(batches)

        get_state, set_state = batches.get_state, batches.set_state

    before = signal.getsignal(signal.SIGUSR1)
    toy_run.train(workdir, toy_run.make_stage(10, 4, log_every=2, schedule="constant"), Asks())
    assert signal.getsignal(signal.SIGUSR1) is before
    return workdir


def test_a_row_holds_rates_and_waits(run):
    first, *_, last = rows(run)
    assert first["learning_rate"] == last["learning_rate"] == pytest.approx(1e-2)
    assert last["samples_per_second"] == pytest.approx(8 * last["steps_per_second"])
    assert last["data_wait_seconds"] >= 0
    saves = {row["step"]: row["save_seconds"] for row in rows(run)}
    # a row is written before its step is saved: the saves after steps 4 and 8 stand in the next
    # rows
    assert [step for step, seconds in saves.items() if seconds > 0] == [6, 10]
    assert 0 < last["peak_share"] < 1.5
    assert last["programs"] == 1
    assert "peak_memory_gib" not in last or last["peak_memory_gib"] > 0


def test_a_trace_is_written_on_demand(run):
    assert list((run / "profile").rglob("*.xplane.pb"))


def test_memory_is_of_the_fullest_device(monkeypatch):
    class Device:
        def __init__(self, used):
            self.used = used

        def memory_stats(self):
            return self.used and {"bytes_in_use": self.used, "peak_bytes_in_use": 2 * self.used}

    monkeypatch.setattr(jax, "local_devices", lambda: [Device(2**30), Device(2**31)])
    assert dashboard.device_memory() == {"memory_gib": 2.0, "peak_memory_gib": 4.0}
    monkeypatch.setattr(jax, "local_devices", lambda: [Device(None)])
    assert dashboard.device_memory() == {}


def test_waiting_for_data_counts_only_when_the_device_is_idle():
    class Value:
        def __init__(self, ready):
            self.ready = ready

        def is_ready(self):
            return self.ready

    meter = dashboard.Meter("toy", StageConfig())
    meter.waited(1.0)  # the first batch
    for ready, seconds in ((False, 10.0), (True, 100.0)):
        meter._pending = (1, {"loss": Value(ready)}, None)
        meter.waited(seconds)
    meter._pending = None
    assert meter.row(1)["data_wait_seconds"] == 101.0


def test_every_program_has_its_own_rate(monkeypatch):
    """Seconds between the ends of steps: those of program 1 take one, those of program 2 three."""
    clock = [0.0]
    monkeypatch.setattr(dashboard.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(dashboard, "matmul_peak", lambda dtype: 4e9)
    meter = dashboard.Meter("toy", StageConfig(batch_size=6))

    def of(number):
        shapes = {"coords": f"int32[6, {number}, 3]"}
        return Program(number, print, shapes, Counter(float32=10**9), 0.0, 0)

    for step, number in enumerate([1, 1, 2, 1, 2]):
        padded = {"padding": jnp.float32(0.1 * step)} if number == 2 else {}
        meter.add(step, {"loss": jnp.float32(1), "finite": True, **padded}, of(number))
        clock[0] += {1: 1.0, 2: 3.0}[number]
    meter.pause()
    row = meter.row(5, programs=2)
    assert [of(n).label.split("_")[0] for n in (1, 2)] == ["1", "2"]
    for n in (1, 2):
        row = {key.replace(of(n).label, str(n)): value for key, value in row.items()}
    assert (row["program_1_steps"], row["program_2_steps"]) == (2, 2)  # without the first
    assert row["program_1_samples_per_second"] == pytest.approx(6)
    assert row["program_2_samples_per_second"] == pytest.approx(2)
    assert row["program_2_padding"] == pytest.approx((0.2 + 0.4) / 2)
    assert "program_1_padding" not in row
    assert row["steps_per_second"] == pytest.approx(4 / 8)
    assert row["peak_share"] == pytest.approx(4e9 / 4e9 / 8 / jax.device_count())
    assert not any(name.startswith("program_") for name in meter.row(6, programs=1))


def test_a_metric_that_the_last_step_lacks_is_kept():
    meter = dashboard.Meter("toy", StageConfig())
    for legs in ({"legs": 2.0}, {}, {"legs": 4.0}, {}):
        meter.add(1, {"loss": jnp.float32(1), "finite": True, **legs})
    meter.settle()
    assert meter.row(4)["legs"] == 3


def test_compiling_is_charged_to_no_program(tmp_path, monkeypatch):
    """A new shape at the fourth step; compiling takes a hundred seconds by the clock."""
    ahead, clock = [0.0], time.perf_counter
    monkeypatch.setattr(dashboard.time, "perf_counter", lambda: clock() + ahead[0])
    compile_ = Programs.compile

    def slow(self, *arguments):
        ahead[0] += 100
        return compile_(self, *arguments)

    monkeypatch.setattr(Programs, "compile", slow)
    batches = toy_run.make_batches()

    class Narrower:
        drawn = 0

        def __next__(self):
            self.drawn += 1
            batch = next(batches)
            return {n: v[:2] for n, v in batch.items()} if self.drawn in (4, 6) else batch

        get_state, set_state = batches.get_state, batches.set_state

    toy_run.program.cache_clear()
    toy_run.train(tmp_path, toy_run.make_stage(8, 100, log_every=8), Narrower())
    toy_run.program.cache_clear()
    (row,) = rows(tmp_path)
    assert ahead[0] == 200 and row["programs"] == 2
    labels = [
        key.split("_")[1] for key in row if key.startswith("program_") and key.endswith("_steps")
    ]
    assert sorted(row[f"program_{n}_steps"] for n in labels) == [2, 5]
    seconds = [
        row[f"program_{n}_steps"] * 8 / row[f"program_{n}_samples_per_second"] for n in labels
    ]
    assert sum(seconds) < 100 and 7 / row["steps_per_second"] < 100


def test_products_are_counted_with_their_loops():
    n = 8

    def body(carry, _):
        return jnp.tanh(carry @ carry), None

    def f(x):
        x = jax.lax.scan(body, x, None, length=5)[0]
        x = jax.lax.cond(x[0, 0] > 0, lambda x: x @ x @ x, lambda x: x @ x, x)
        return jax.checkpoint(lambda x: x @ x)(x).astype(jnp.bfloat16) @ x.astype(jnp.bfloat16)

    x = jnp.ones((n, n))
    counts = matmul_flops(jax.make_jaxpr(f)(x))
    assert counts == {"float32": (5 + 2 + 1) * 2 * n**3, "bfloat16": 2 * n**3}
    kernel, image = jnp.ones((3, 3, 4, 6)), jnp.ones((1, 10, 10, 4))
    conv = jax.make_jaxpr(
        lambda i, k: jax.lax.conv_general_dilated(
            i, k, (1, 1), "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC")
        )
    )
    assert matmul_flops(conv(image, kernel)).total() == 2 * 100 * 6 * 9 * 4


def test_the_peak_is_measured_once():
    begin = time.perf_counter()
    rate = flops.matmul_peak("float32")
    first = time.perf_counter() - begin
    begin = time.perf_counter()
    assert flops.matmul_peak("float32") == rate > 1e8
    assert time.perf_counter() - begin < max(first, 1e-3)


def test_a_device_without_room_for_a_large_product_has_no_peak(monkeypatch):
    def full(*_):
        raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory")

    monkeypatch.setattr(flops, "_measured", full)
    assert flops.matmul_peak.__wrapped__("float32") is None
    monkeypatch.setattr(dashboard, "matmul_peak", lambda dtype: 2e9 if dtype == "float32" else None)
    count = jax.device_count()
    assert dashboard.ideal_seconds(Counter(float32=10**9)) == pytest.approx(0.5 / count)
    assert dashboard.ideal_seconds(Counter(float32=10**9, bfloat16=1)) is None


def init(key):
    return {"kernel": jax.random.normal(key, (3, 2))}


def test_every_set_of_shapes_is_compiled_once_and_said():
    traces = []

    def loss_fn(params, batch, key):
        traces.append(1)
        return jnp.mean((batch["x"] @ params["kernel"]) ** 2), {}

    optimizer = make_optimizer(StageConfig())
    state = create_state(init, optimizer, jax.random.key(0))
    step = make_train_step(loss_fn, optimizer, 0.9)
    said = []
    for width in (4, 8, 4, 8, 8, 4):
        batch = {"x": np.ones((width, 3), np.float32), "counts": np.ones(4, np.int32)}
        before = len(step.compiled)
        state, _ = step(state, batch, jax.random.key(0))
        said += [step.describe()] if len(step.compiled) > before else []
    assert len(traces) == len(step.compiled) == len(said) == 2
    assert "compiled program 1" in said[0] and "counts int32[4], x float32[4, 3]" in said[0]
    assert "compiled program 2" in said[1] and ": x float32[8, 3];" in said[1]
    assert step.latest.shapes["x"] == "float32[4, 3]"
