"""Several processes that train together: how they find one another, agree, wait and fail.

Devices talk by collectives inside compiled programs. What hosts have to tell one another (shapes,
verdicts, "done", "failed") goes through the key-value store of ``jax.distributed``'s coordinator
instead: it waits for hours without a time-out, needs no device, and does not stand behind a running
step.

All processes call these functions in the same order. With one process each is free and does
nothing.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import jax
from jax.experimental import multihost_utils

from uniart_jax.models.network import differences

T = TypeVar("T")
POLL = 1000  # milliseconds between two looks at whether another process has failed
FAREWELL = 20.0  # seconds in which the others can hear of a failure
STOP_AFTER = 4  # steps from a signal to the step that all save
_STOP = "uniart/stop"
_FAILED, _HEARD = "uniart/failed", "uniart/heard"
_meetings = itertools.count()


class OtherFailed(ValueError):
    """Another process failed: which one, and why."""

    def __init__(self, process: int, reason: str):
        super().__init__(f"process {process} stopped: {reason}")
        self.process, self.reason = process, reason


def start(
    coordinator: str | None = None,
    processes: int | None = None,
    process: int | None = None,
    wait: float = 300.0,
) -> None:
    """Join the other processes; before anything else that touches a device. SIGTERM goes on to do
    what the program has told it to.

    Args:
      coordinator: HOST:PORT of process 0. None: TPU pods, SLURM, Open MPI and Kubernetes are
        detected (``jax.distributed.initialize``).
      processes, process: how many there are and which this is, with ``coordinator``.
      wait: seconds for all of them to come. Then this process ends with one line and exit code 2:
        JAX would abort.

    Raises:
      ValueError: numbers that do not fit, an environment that is not known, or a port that cannot
        be opened.
    """
    by_hand = {"coordinator": coordinator, "processes": processes, "process": process}
    missing = [f"--{name}" for name, value in by_hand.items() if value is None]
    if (coordinator is None and len(missing) < 3) or (coordinator is not None and missing):
        raise ValueError(
            f"distributed: {', '.join(missing)} missing; give --coordinator HOST:PORT --processes "
            "N --process I, or --distributed alone where it can be detected"
        )
    if coordinator is not None:
        _, colon, port = coordinator.rpartition(":")
        if not (colon and port.isdecimal() and 0 < int(port) < 2**16):
            raise ValueError(
                f"--coordinator '{coordinator}': give HOST:PORT of process 0, such as node0:8476"
            )
        assert processes is not None and process is not None
        if not 0 <= process < processes:
            raise ValueError(
                f"--process {process} of --processes {processes}: give 0 to {processes - 1}, each "
                "once"
            )
        if process == 0:
            _check_port(coordinator, int(port))
    where = coordinator or "the coordinator of this cluster"
    with contextlib.suppress(
        AttributeError
    ):  # its own handler would swallow SIGTERM until a loop listens; older versions have neither
        jax.config.update("jax_enable_preemption_service", False)
    with _time_limit(
        wait,
        f"not all processes came to {where} within {wait:g} s; start all of them with the same "
        "--processes and different --process, and check that the port can be reached",
    ):
        try:
            jax.distributed.initialize(
                coordinator,
                processes,
                process,
                local_device_ids=slurm_devices(os.environ) if coordinator is None else None,
                # by the caller's numbers alone, even inside a SLURM job
                cluster_detection_method=None if coordinator is None else "deactivate",
                initialization_timeout=int(wait) + 3600,  # ours is sooner
            )
        except RuntimeError as error:
            reason = str(error).splitlines()[0]
            raise ValueError(
                f"distributed: cannot start at {where} ({reason}); is the port in use, or this not "
                "its host? choose another port on all processes"
            ) from None
        except ValueError as error:
            raise ValueError(
                f"distributed: no cluster detected ({error}); give --coordinator HOST:PORT "
                "--processes N --process I"
            ) from None


def _check_port(coordinator: str, port: int) -> None:
    """ValueError if a port of this computer cannot be opened: JAX (jaxlib 0.10) may end the process
    instead of raising."""
    family = socket.AF_INET6 if socket.has_dualstack_ipv6() else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # what a run before has left
        try:
            trial.bind(("", port))
        except OSError as error:
            raise ValueError(
                f"distributed: cannot start at {coordinator} ({error.strerror or error}); is the "
                "port in use? choose another port on all processes"
            ) from None


def slurm_devices(environment: Mapping[str, str]) -> list[int] | None:
    """The GPUs of this task of a SLURM job: those that it sees, shared equally by the tasks on its
    node, or all of them where they are fewer than the tasks (each task then sees its own alone);
    None elsewhere (JAX's own choice).

    JAX takes one GPU a task, so that a single task on a node of eight would leave seven idle.
    """
    get = environment.get
    if not all(
        name in environment
        for name in ("SLURM_STEP_TASKS_PER_NODE", "SLURM_NODEID", "SLURM_LOCALID")
    ):
        return None
    visible = get("CUDA_VISIBLE_DEVICES")
    seen = (
        len([d for d in visible.split(",") if d])
        if visible
        else int(get("SLURM_GPUS_ON_NODE", "0"))
    )
    tasks: list[int] = []
    for number, times in re.findall(
        r"(\d+)(?:\(x(\d+)\))?", environment["SLURM_STEP_TASKS_PER_NODE"]
    ):
        tasks += [int(number)] * int(times or 1)
    here = 1 if "SLURM_GPUS_PER_TASK" in environment else tasks[int(environment["SLURM_NODEID"])]
    if seen < here:
        return list(range(seen)) or None
    if seen % here:
        return None
    share, local = seen // here, int(environment["SLURM_LOCALID"]) % here
    return list(range(local * share, (local + 1) * share))


def is_first() -> bool:
    """Whether this process writes and speaks."""
    return jax.process_index() == 0


@contextlib.contextmanager
def together() -> Iterator[None]:
    """What one process raises inside is raised by all that wait or ask in here; one that cannot be
    told, because it is in a collective, ends by JAX's heartbeat.

    Raises:
      ValueError: another process failed; it says which, and why.
    """
    try:
        yield
    except BaseException as error:  # a signal ends a process by SystemExit
        if not jax.distributed.is_initialized():
            raise
        signalled = not isinstance(error, Exception)
        me, store = jax.process_index(), _store()
        found = (error.process, error.reason) if isinstance(error, OtherFailed) else None
        cause, message = found or (me, "a signal" if signalled else _in_a_line(error))
        with contextlib.suppress(RuntimeError):  # somebody was faster
            store.key_value_set(_FAILED, json.dumps([cause, message]))
        who, why = _failure() or (cause, message)
        with contextlib.suppress(RuntimeError):
            store.key_value_set(f"{_HEARD}/{me}", "")
        if who != me:
            if why == message:  # all of them found it
                raise
            raise OtherFailed(who, why) from None
        if not _all_heard(store):
            if not signalled:
                print(f"error: {message}", file=sys.stderr, flush=True)
            # an orderly exit would wait for them
            os._exit(
                error.code if isinstance(error, SystemExit) and isinstance(error.code, int) else 2
            )
        raise


def wait() -> None:
    """Until every process is here."""
    _meet("", lambda _: "")


def broadcast_from_first(value: T) -> T:
    """The first process's value (JSON-able) on all processes. For what is read from files: they may
    appear later on other hosts."""
    return json.loads(_meet(json.dumps(value), lambda texts: texts[0]))


def on_first_process(action: Callable[[], T]) -> T | None:
    """Call ``action()`` on the first process while the others wait; they return None. All raise
    what it raises."""
    result = action() if is_first() else None
    wait()
    return result


def evaluate_on_first(evaluate: Callable[..., Any] | None) -> Callable[..., Any] | None:
    """An evaluation (``loop.run_stage``) that runs on one device of the first process while the
    other processes wait; with one process it is unchanged."""
    if evaluate is None or jax.process_count() == 1:
        return evaluate

    def run(state: Any, step: int) -> tuple[dict[str, Any], dict[str, Any]]:
        whole = multihost_utils.process_allgather(state.ema, tiled=True)  # with all processes

        def judge() -> Any:
            placed = jax.device_put(whole, jax.local_devices()[0])
            return evaluate(state._replace(ema=placed), step)

        return on_first_process(judge) or ({}, {})

    return run


def largest(values: Sequence[int]) -> list[int]:
    """Elementwise over processes.

    Raises:
      ValueError: another number of values.
    """

    def combine(texts: list[str]) -> str:
        rows = [json.loads(text) for text in texts]
        if len({len(row) for row in rows}) > 1:
            return json.dumps([])
        return json.dumps([max(column) for column in zip(*rows, strict=True)])

    found = json.loads(_meet(json.dumps([int(v) for v in values]), combine))
    if len(found) != len(values):
        raise ValueError(
            "distributed: the processes' batches differ in structure; do all read the same "
            "records with the same config?"
        )
    return found


def stop_together(step: int, signal: int | None) -> int | None:
    """The signal that all processes obey after ``step``, a few steps after one of them was given
    it; None: go on. Asked once a step, by all.

    Steps compute together, so no process is further than a step from another.
    """
    if jax.process_count() == 1:
        return signal
    store = _store()
    if signal is not None:
        with contextlib.suppress(RuntimeError):  # somebody has said so before
            store.key_value_set(_STOP, json.dumps([step + STOP_AFTER, signal]))
    try:
        at, agreed = json.loads(store.key_value_try_get(_STOP))
    except RuntimeError:  # no such key
        return None
    return agreed if step >= at else None


def shared_error(error: Exception | None) -> Exception | None:
    """What went wrong here, or else on another process (``OtherFailed``); None where all went well.
    So all go on, or none."""
    if jax.process_count() == 1:
        return error
    mine = "" if error is None else json.dumps([jax.process_index(), _in_a_line(error)])
    found = _meet(mine, lambda texts: next(filter(None, texts), ""))
    return OtherFailed(*json.loads(found)) if found and error is None else error


def check_equal(settings: Mapping[str, Any]) -> None:
    """Compare JSON-able settings by name.

    Raises:
      ValueError: on every process, if one has others than the first; it is named, and what differs.
    """

    def combine(texts: list[str]) -> str:
        first, *others = [json.loads(text) for text in texts]
        for number, other in enumerate(others, 1):
            if differ := differences(first, other):
                return (
                    f"process {number} was started with other settings than process 0 "
                    f"({'; '.join(differ)}); start all with the same command and files"
                )
        return ""

    if problem := _meet(json.dumps(settings), combine):
        raise ValueError(f"distributed: {problem}")


def _in_a_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _store() -> Any:
    # not public, but what Orbax builds on as well
    from jax._src.distributed import global_state

    return global_state.client


def _meet(text: str, combine: Callable[[list[str]], str]) -> str:
    """The texts of all processes, combined by the first: 2 N messages, and none to wait for but the
    slowest process."""
    count, me = jax.process_count(), jax.process_index()
    if count == 1:
        return combine([text])
    number, store = next(_meetings), _store()
    if me:
        store.key_value_set(f"uniart/{number}/{me}", text)
        return _read(f"uniart/{number}/all")
    answer = combine([text, *(_read(f"uniart/{number}/{i}") for i in range(1, count))])
    store.key_value_set(f"uniart/{number}/all", answer)
    store.key_value_delete(f"uniart/{number - 1}")  # whoever is here has read it
    return answer


def _read(key: str) -> str:
    """The value of a key as soon as it is there."""
    store = _store()
    while True:
        try:
            return store.blocking_key_value_get(key, POLL)
        except RuntimeError as error:
            if "DEADLINE_EXCEEDED" not in str(error):
                raise
        if failure := _failure():
            raise OtherFailed(*failure)


def _failure() -> tuple[int, str] | None:
    try:
        who, why = json.loads(_store().key_value_try_get(_FAILED))
    except RuntimeError:  # no such key
        return None
    return who, why


def _all_heard(store: Any) -> bool:
    end = time.monotonic() + FAREWELL
    while time.monotonic() < end:
        if len(store.key_value_dir_get(_HEARD)) == jax.process_count():
            return True
        time.sleep(0.1)
    return False


@contextlib.contextmanager
def _time_limit(seconds: float, message: str) -> Iterator[None]:
    """End the program with a line and exit code 2: the call inside can neither be interrupted nor
    fail by itself."""

    def end() -> None:
        print(f"error: distributed: {message}", file=sys.stderr, flush=True)
        os._exit(2)

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
