"""Measurements in a process of their own: one that runs out of memory, hangs or breaks the device
loses its own result and no other.

A script hands jobs (plain dictionaries) to itself started again with ``--worker``; the worker
writes one line of JSON a job. The parent never touches the accelerator, so that a worker has all of
it.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
from results import machine, matmul_peaks

MARK = "result: "
BROKEN = ("CUDA_ERROR", "illegal memory", "INTERNAL", "unspecified launch")  # device unusable after
Job = dict[str, Any]


class Clock:
    """What is left of a time limit."""

    def __init__(self, minutes: float):
        self.end = time.monotonic() + 60 * minutes

    def left(self) -> float:
        return self.end - time.monotonic()


def compile_quickly() -> None:
    """Workers started from now on compile fast instead of well: for sizes that measure nothing."""
    fast = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {fast}".strip()


def run_jobs(
    jobs: Sequence[Job], seconds: float, *, each: float = 180
) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Each job with its result, in order, as they come; ``{"raised": why}`` where it has none. Jobs
    that ``seconds`` leave no time for are left out.

    Args:
      each: seconds that one job may take, its worker's start included.
    """
    clock, waiting = Clock(seconds / 60), list(jobs)
    while waiting and clock.left() > 1:
        with tempfile.TemporaryFile("w+") as errors:
            worker = subprocess.Popen(
                [sys.executable, sys.argv[0], "--worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
            try:
                for result in _results(worker, waiting, clock, each):
                    yield waiting.pop(0), result
            finally:
                worker.kill()
                code = worker.wait()
            if waiting and clock.left() > 1 and code:
                errors.seek(0)
                why = (
                    f"worker ended with {code} (-9: more than {each:.0f} s): {_last(errors.read())}"
                )
                yield waiting.pop(0), {"raised": why}


def _results(
    worker: subprocess.Popen, jobs: Sequence[Job], clock: Clock, each: float
) -> Iterator[dict]:
    lines: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        for line in worker.stdout:
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    worker.stdin.write(json.dumps(list(jobs)))
    worker.stdin.close()
    while True:
        try:
            line = lines.get(timeout=max(0.1, min(each, clock.left())))
        except queue.Empty:
            return
        if line is None:
            worker.wait()
            return
        if line.startswith(MARK):
            yield json.loads(line.removeprefix(MARK))


def accelerator(clock: Clock, tiny: bool, job: Job) -> tuple[Job, str, bool]:
    """What workers find, as ``describe`` says it; the backend's name, and whether sizes must be
    tiny. The accelerator is the workers' from now on. The program ends where there is none.

    Args:
      job: that a worker answers with ``describe``.
    """
    jax.config.update("jax_platforms", "cpu")
    (_, about), *_ = run_jobs([{**job, "side": 512 if tiny else 8192}], clock.left())
    if "raised" in about:
        sys.exit(f"the accelerator does not work: {about['raised']}")
    backend = about.pop("backend")
    if backend == "cpu":
        compile_quickly()
    return about, backend, tiny or backend == "cpu"


def describe(job: Job) -> dict[str, Any]:
    """The worker's side of ``accelerator``."""
    found = {"machine": machine(), "backend": jax.default_backend()}
    return {**found, "peaks": matmul_peaks(job["side"])}


def work(measure: Callable[[Job], dict[str, Any]]) -> None:
    """The worker's side: measure each job on standard input; one that raises is a result too."""
    for job in json.load(sys.stdin):
        broken = False
        try:
            result = measure(job)
        except Exception as error:  # any failure of a kernel is a finding
            text = " ".join(f"{type(error).__name__}: {error}".split())
            broken = any(word in text for word in BROKEN)
            result = {"raised": text[:300]}
        print(MARK + json.dumps(result, default=float), flush=True)
        if broken:
            return


def _last(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1][:300] if lines else "no message"
