"""Several processes on this computer: they find one another, train what one does, agree, resume in
another number, and say what is wrong."""

import contextlib
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tiny_run
import toy_run
from collectives import least, received

from uniart_jax.data.order import local_rows
from uniart_jax.models.network import flat_names
from uniart_jax.training import distributed

ROOT = Path(__file__).parents[2]
TOLERANCE = 1e-5
LIMIT = 600  # seconds of any program here, however busy the machine


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def started(*programs: list):
    """All of them at once, their outputs captured; none outlives the block."""
    running = [
        subprocess.Popen(
            [sys.executable, *map(str, program)],
            cwd=ROOT,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        for program in programs
    ]
    try:
        yield running
    finally:
        for process in running:
            process.kill()
            process.wait()


def finished(*programs: list) -> list[tuple[int, str]]:
    """Exit code and stderr of each."""
    with started(*programs) as running:
        errors = [process.communicate(timeout=LIMIT)[1] for process in running]
        return [(process.returncode, text) for process, text in zip(running, errors, strict=True)]


def one_each(program: list, processes: int) -> list[list]:
    port = free_port()
    options = ["--processes", processes, "--port", port]
    return [[*program, *options, "--process", i] for i in range(processes)]


def check(expected: Path, found: Path) -> None:
    with np.load(expected) as a, np.load(found) as b:
        assert set(a.files) == set(b.files)
        for name in a.files:
            x, y = without_key_bias(name, a[name]), without_key_bias(name, b[name])
            np.testing.assert_allclose(y, x, rtol=0, atol=TOLERANCE, err_msg=name)


def without_key_bias(name: str, value: np.ndarray) -> np.ndarray:
    """A softmax does not see its keys' bias, so that its gradient is rounding alone, and Adam makes
    steps of it."""
    if name.endswith(("to_qkv.bias", "to_kv.bias")):
        parts = np.split(value, 3 if name.endswith("to_qkv.bias") else 2)
        del parts[-2]
        return np.concatenate(parts)
    return value


def toy(*options) -> list:
    return [toy_run.__file__, *options]


def test_two_processes_equal_one_and_either_goes_on_from_the_other(tmp_path):
    work, out = tmp_path / "work", tmp_path / "state.npz"
    straight = toy_run.train(tmp_path, toy_run.make_stage(6, 100), toy_run.make_batches())
    np.savez(
        tmp_path / "straight.npz", **{n: np.asarray(v) for n, v in flat_names(straight).items()}
    )
    toy_run.train(work, toy_run.make_stage(2, 100), toy_run.make_batches())
    two = one_each(toy(work, 4, 100, "--devices", 4, "--fsdp", 4, "--out", tmp_path / "4.npz"), 2)
    assert [code for code, _ in finished(*two)] == [0, 0]
    last = toy_run.train(work, toy_run.make_stage(6, 100), toy_run.make_batches())
    np.savez(out, **{n: np.asarray(v) for n, v in flat_names(last).items()})
    check(tmp_path / "straight.npz", out)
    rows = (work / "metrics/toy.jsonl").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == [f'{{"step": {i}' for i in range(1, 7)]
    assert not list(work.rglob("damaged-*"))


@pytest.mark.slow
def test_sigterm_to_one_process_saves_the_same_step_of_both(tmp_path):
    work = tmp_path / "work"
    programs = one_each(toy(work, 10_000, 10_000, "--slow", 0.05), 2)
    with started(*programs) as running:
        end = time.monotonic() + LIMIT
        while not (work / "metrics/toy.jsonl").exists() and time.monotonic() < end:
            time.sleep(0.1)
        running[1].send_signal(signal.SIGTERM)
        errors = [process.communicate(timeout=LIMIT)[1] for process in running]
        assert [process.returncode for process in running] == [143, 143], errors
    (saved,) = [path for path in (work / "checkpoints/toy").iterdir() if path.name.isdigit()]
    assert f"saved at step {saved.name}" in errors[0]
    # the arrays of both processes are in it: one process alone can go on
    steps = int(saved.name) + 1
    assert finished(toy(work, steps, 100, "--out", tmp_path / "one.npz"))[0][0] == 0
    assert int(np.load(tmp_path / "one.npz")["step"]) == steps


@pytest.mark.slow
def test_a_record_that_one_process_cannot_read_ends_both_at_once(tmp_path):
    """It comes while a step that is saved computes: nobody waits in a save for the one that has
    failed."""
    work = tmp_path / "work"
    first, second = one_each(toy(work, 100, 3), 2)
    begin = time.monotonic()
    found = finished(first, [*second, "--fail", 4])
    assert time.monotonic() - begin < LIMIT / 2
    assert all(code for code, _ in found), found
    assert "process 1 stopped: record 17 is damaged" in found[0][1]
    assert "ValueError: record 17 is damaged" in found[1][1]
    assert "process 0" not in found[1][1]
    assert [path.name for path in (work / "checkpoints/toy").iterdir()] == ["3"]


@pytest.mark.slow
def test_a_part_that_one_process_cannot_read_sets_the_checkpoint_aside_for_both(tmp_path):
    # small arrays would stand in the first process's file
    work, splits = tmp_path / "work", ("--devices", 2, "--fsdp", 4, "--width", 8192)
    assert [code for code, _ in finished(*one_each(toy(work, 4, 2, *splits), 2))] == [0, 0]
    parts = [p for p in (work / "checkpoints/toy/4").rglob("*") if p.is_file() and "/d/" in str(p)]
    theirs = [path for path in parts if "process_1" in str(path)]
    assert theirs and len(theirs) < len(parts)
    for path in theirs:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    begin = time.monotonic()
    found = finished(*one_each(toy(work, 6, 2, *splits), 2))
    assert time.monotonic() - begin < 250  # Orbax's barriers wait for 300
    assert [code for code, _ in found] == [0, 0], found
    assert found[0][1].count("4 is damaged (") == 1 and "resumed at step 2" in found[0][1]
    assert (
        "damaged" not in found[1][1]
        and "handler" not in found[0][1].split("4 is damaged")[1].split(");")[0]
    )
    assert {p.name for p in (work / "checkpoints/toy").iterdir()} == {"2", "damaged-4", "4", "6"}


def test_sigterm_ends_a_program_that_has_joined_the_others():
    """JAX's own handler would keep it for itself, until a loop listens again."""
    code = f"""
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
from uniart_jax.training import distributed
distributed.start("localhost:{free_port()}", 1, 0)
print("joined", flush=True)
for _ in range({10 * LIMIT}):  # a signal just before a long sleep would be seen after it
    time.sleep(0.1)
"""
    with started(["-c", code]) as (running,):
        assert running.stdout.readline().strip() == "joined"
        running.send_signal(signal.SIGTERM)
        running.communicate(timeout=LIMIT / 2)  # seconds; a busy machine takes its time
        assert running.returncode == 143


def command(config: Path, port: int, process: int, *options) -> list:
    where = ["--coordinator", f"localhost:{port}", "--processes", 2, "--process", process]
    return ["train.py", "--config", config, *where, *options]


@pytest.mark.slow
def test_other_settings_on_one_process_are_named_on_all(tmp_path):
    port, config = free_port(), ROOT / "configs/debug.py"
    found = finished(
        command(config, port, 0, "--workdir", tmp_path),
        command(config, port, 1, "--workdir", tmp_path, "--data.seed", 7),
    )
    for code, text in found:
        last = text.strip().splitlines()[-1]
        assert code == 2 and last.startswith("error: distributed: process 1"), text
        assert "mismatched: data.seed is 7, expected 0" in last
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_an_error_of_one_process_ends_both(tmp_path):
    """The second cannot write where its WORKDIR lies."""
    port, config = free_port(), ROOT / "configs/debug.py"
    (tmp_path / "elsewhere").write_text("a file")
    data = ["--data.records", tmp_path / "records", "--data.procedural", 0, "--data.validation", ""]
    (tmp_path / "records").mkdir()
    found = finished(
        command(config, port, 0, "--workdir", tmp_path / "work", *data),
        command(config, port, 1, "--workdir", tmp_path / "elsewhere", *data),
    )
    for code, text in found:
        last = text.strip().splitlines()[-1]
        assert code == 2 and last.startswith("error: ") and "Traceback" not in text, text
    assert "not the first process's folder" in found[0][1] + found[1][1]


@pytest.mark.slow
def test_a_process_that_does_not_come_is_one_line(tmp_path):
    program = command(ROOT / "configs/debug.py", free_port(), 0, "--wait", 3)
    ((code, text),) = finished([*program, "--workdir", tmp_path / "work"])
    assert code == 2 and "not all processes came to localhost" in text.strip().splitlines()[-1]


def test_a_port_in_use_is_one_line(tmp_path):
    with socket.socket(socket.AF_INET6) as taken:
        taken.bind(("::", 0))
        taken.listen()
        program = command(ROOT / "configs/debug.py", taken.getsockname()[1], 0)
        ((code, text),) = finished([*program, "--workdir", tmp_path / "work"])
    assert code == 2 and "is the port in use" in text.strip().splitlines()[-1]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("host:1", None, 0), "--processes missing"),
        ((None, 2, 0), "--coordinator missing"),
        (("host", 2, 0), "give HOST:PORT"),
        (("host:99999", 2, 0), "give HOST:PORT"),
        (("host:8476", 2, 2), "give 0 to 1"),
    ],
)
def test_what_is_missing_or_does_not_fit_is_named(options, said):
    with pytest.raises(ValueError, match=said):
        distributed.start(*options)


def test_no_cluster_is_said(monkeypatch):
    def refuse(
        *args, **options
    ):  # what it says where it finds none; here it would first say that JAX has computed already
        raise ValueError("coordinator_address should be defined.")

    monkeypatch.setattr(distributed.jax.distributed, "initialize", refuse)
    with pytest.raises(ValueError, match=r"no cluster detected .* --coordinator HOST:PORT"):
        distributed.start()


SLURM = {"SLURM_STEP_TASKS_PER_NODE": "1(x2)", "SLURM_NODEID": "1", "SLURM_LOCALID": "0"}


@pytest.mark.parametrize(
    ("changes", "devices"),
    [
        ({"SLURM_GPUS_ON_NODE": "8"}, list(range(8))),  # one task a node takes all
        ({"CUDA_VISIBLE_DEVICES": "0,1,2,3"}, [0, 1, 2, 3]),
        ({"SLURM_GPUS_ON_NODE": "8", "SLURM_STEP_TASKS_PER_NODE": "4,2", "SLURM_LOCALID": "1"}, [4, 5, 6, 7]),  # noqa: E501
        ({"SLURM_GPUS_ON_NODE": "8", "SLURM_STEP_TASKS_PER_NODE": "8(x2)", "SLURM_LOCALID": "3"}, [3]),  # noqa: E501
        ({"SLURM_STEP_TASKS_PER_NODE": "8(x2)", "SLURM_GPUS_PER_TASK": "1", "CUDA_VISIBLE_DEVICES": "5", "SLURM_LOCALID": "3"}, [0]),  # noqa: E501
        ({"SLURM_STEP_TASKS_PER_NODE": "4(x2)", "CUDA_VISIBLE_DEVICES": "2,3", "SLURM_LOCALID": "1"}, [0, 1]),  # bound to its own  # noqa: E501
        ({"SLURM_STEP_TASKS_PER_NODE": "4(x2)", "CUDA_VISIBLE_DEVICES": "0", "SLURM_LOCALID": "3"}, [0]),  # noqa: E501
        ({}, None),  # no GPUs
        ({"SLURM_GPUS_ON_NODE": "3", "SLURM_STEP_TASKS_PER_NODE": "2(x2)"}, None),
    ],
)  # fmt: skip
def test_slurm_tasks_share_their_nodes_gpus(changes, devices):
    assert distributed.slurm_devices(SLURM | changes) == devices
    assert distributed.slurm_devices({}) is None


def test_alone_everything_is_free():
    assert distributed.is_first() and distributed.broadcast_from_first([1, "a"]) == [1, "a"]
    assert distributed.largest([3, 4]) == [3, 4] and distributed.on_first_process(lambda: 5) == 5
    distributed.check_equal({"a": 1})
    with pytest.raises(KeyError), distributed.together():
        raise KeyError("as it is")


@pytest.mark.parametrize("accumulate", [1, 2, 3])
@pytest.mark.parametrize("processes", [1, 2, 4])
def test_a_micro_batch_is_the_same_items_for_any_number_of_processes(processes, accumulate):
    shares = [local_rows(24, i, processes, accumulate) for i in range(processes)]
    micro = [np.split(share, accumulate) for share in shares]
    parts = [np.concatenate([share[i] for share in micro]) for i in range(accumulate)]
    np.testing.assert_array_equal(np.concatenate(parts), np.arange(24))
    with pytest.raises(ValueError, match="25 cannot be shared equally"):
        local_rows(25, 0, 2, accumulate)


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """Records, and all stages trained by one process on one device."""
    folder = tmp_path_factory.mktemp("tiny")
    tiny_run.make_records(folder)
    ((code, text),) = finished([tiny_run.__file__, folder, "base", *tiny_run.STAGES])
    assert code == 0, text
    return folder


def check_sums_alone(run, name, devices):
    """Gradients and figures are summed, once, and nothing else is sent: no tokens, no pictures, not
    as sums either."""
    leaves = np.load(run / f"{name}.npz")
    parameters = sum(leaves[leaf].size for leaf in leaves if leaf.startswith("params."))
    programs = list(run.glob(f"{name}-*.hlo"))
    assert parameters and programs
    for program in programs:
        moved = received(program.read_text(), devices)
        assert set(moved) <= {"all-reduce"}
        assert 0.95 < moved["all-reduce"] / least(parameters, devices) < 1.02


@pytest.mark.slow
@pytest.mark.parametrize(
    ("devices", "fsdp"), [(d, f) for d in (2, 4, 8) for f in (1, 2, 4, 8) if f <= d]
)
def test_every_stage_on_every_split_of_the_devices(base, devices, fsdp):
    run = f"{devices}-{fsdp}"
    program = [tiny_run.__file__, base, run, *tiny_run.STAGES, "--devices", devices, "--fsdp", fsdp]
    ((code, text),) = finished(program)
    assert code == 0, text
    for name in tiny_run.STAGES:
        assert (f"{name}: fsdp {fsdp}: " in text) == (fsdp > 1)
        check(base / "base" / f"{name}.npz", base / run / f"{name}.npz")
        if fsdp == 1:
            check_sums_alone(base / run, name, devices)


@pytest.mark.slow
def test_every_stage_on_two_processes_with_evaluation(base):
    """Latents encoded by both, evaluation by the first."""
    (base / "shared").mkdir()
    program = [tiny_run.__file__, base, "shared", *tiny_run.STAGES, "--devices", 4, "--fsdp", 2]
    found = finished(*one_each([*program, "--validation"], 2))
    assert [code for code, _ in found] == [0, 0], found
    for name in tiny_run.STAGES:
        check(base / "base" / f"{name}.npz", base / "shared" / f"{name}.npz")
        assert (
            '"kind": "evaluation"' in (base / "shared" / name / f"metrics/{name}.jsonl").read_text()
        )
    assert "evaluation" not in found[1][1]  # the second says nothing


@pytest.mark.slow
def test_a_latent_flow_that_reads_pixels_on_several_devices_and_processes(base):
    program = [tiny_run.__file__, base]
    alone, split, whole, shared = (
        [*program, run, "latent_flow", "--pixels", *more]
        for run, more in (
            ("pixels", ()),
            ("pixels-split", ("--devices", 4, "--fsdp", 2)),
            ("pixels-whole", ("--devices", 4)),
            ("pixels-shared", ("--devices", 2, "--fsdp", 2)),
        )
    )
    for programs in ([alone], [split], [whole], one_each(shared, 2)):
        found = finished(*programs)
        assert not any(code for code, _ in found), found
    for run in ("pixels-split", "pixels-whole", "pixels-shared"):
        check(base / "pixels/latent_flow.npz", base / run / "latent_flow.npz")
    check_sums_alone(base / "pixels-whole", "latent_flow", 4)


@pytest.mark.slow
def test_latents_are_the_same_bytes_whoever_encodes(base):
    """Two processes encode for a flow that has none, in several shards."""
    program = [tiny_run.__file__, base, "encoded", "structure_flow", "--encode", 1]
    assert [code for code, _ in finished(*one_each(program, 2))] == [0, 0]
    ((code, text),) = finished([tiny_run.__file__, base, "alone", "structure_flow", "--encode", 1])
    assert code == 0, text
    mine, theirs = (base / run / "structure_flow/latents" for run in ("alone", "encoded"))
    names = sorted(path.name for path in mine.iterdir())
    assert len(names) > 4 and names == sorted(path.name for path in theirs.iterdir())
    for name in names:
        assert (mine / name).read_bytes() == (theirs / name).read_bytes(), name


@pytest.mark.slow
@pytest.mark.parametrize("name", ["uniart_vae", "latent_flow"])
def test_a_stage_with_plans_goes_on_in_another_number_of_processes(base, name):
    run = f"resumed-{name}"
    for steps, processes in ((2, 2), (4, 1), (5, 2)):
        program = [tiny_run.__file__, base, run, name, "--steps", steps, "--devices", 2]
        found = finished(*(one_each(program, 2) if processes == 2 else [program]))
        assert all(code == 0 for code, _ in found), found
    check(base / "base" / f"{name}.npz", base / run / f"{name}.npz")
