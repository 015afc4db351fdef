"""What a run says: the terminal, TensorBoard and ``metrics/<stage>.jsonl``, the same numbers in all
of them.

Beside a stage's own losses every row about training holds ``grad_norm``, ``learning_rate`` and

    samples_per_second, steps_per_second   without the time of compiling, saving and evaluating
    data_wait_seconds                      of making batches while the device had nothing to do, since the last row (at most)
    save_seconds                           that saving held the loop up, since the last row
    peak_share                             products of the step a second / measured rate of a large product (``training.flops``), where that can be measured
    memory_gib, peak_memory_gib            of the fullest device of this process, where the device counts them
    programs                               compiled so far: one for each set of batch shapes (voxel bucket); the log says which when it compiles
    program_<label>_steps, _samples_per_second, _padding     of each of them (label: padded width and a digest of all shapes), where there are several: how often it ran, how fast, the share of its voxels that was padding
    padding                                share of the voxels of all batches that was padding (stages that take voxels as lists)
    clip_threshold                         where it adapts
    skipped                                share of the steps that were not finite, where they may be passed over; the means above are over the others
"""  # noqa: E501

from __future__ import annotations

import contextlib
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

import jax
import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from uniart_jax.config import StageConfig
from uniart_jax.runtime.files import write_text
from uniart_jax.runtime.progress import PLAIN_INTERVAL, duration, messages
from uniart_jax.training.board import Board
from uniart_jax.training.flops import matmul_peak
from uniart_jax.training.programs import Program
from uniart_jax.training.state import make_schedule

Scalars = dict[str, float]


class Meter:
    """Metrics since the last row, fetched one step late and checked for finiteness, and where the
    time went.

    Attributes:
      passed_over: the last so many steps were not finite.
    """

    def __init__(
        self, name: str, stage: StageConfig, say: Callable[[str], None] = lambda line: None
    ):
        """``say``: is told when steps begin to be passed over."""
        self.name, self.stage, self._say = name, stage, say
        self.passed_over = 0
        self.latest: Scalars = {}
        self._pending: tuple[int, Any, Program | None] | None = None
        self._compiled = False
        self._schedule = make_schedule(stage)
        self._start = self._settled = time.perf_counter()
        self._clear()

    def _clear(self) -> None:
        self._seen: list[Scalars] = []
        self._steps, self._seconds = 0, 0.0
        self._flops: Counter[str] = Counter()
        self._waited, self._saved = 0.0, 0.0
        self._of_program: dict[str, list[tuple[float, Scalars]]] = {}

    def waited(self, seconds: float) -> None:
        """Before a step is dispatched: its batch took so long. That counts where the device has
        already finished the step before."""
        if self._pending is None or self._pending[1]["loss"].is_ready():
            self._waited += seconds

    def saved(self, seconds: float) -> None:
        """Saving took so long."""
        self._saved += seconds

    def add(self, step: int, metrics: Any, program: Program | None = None) -> None:
        """``metrics`` of update ``step`` are under way; those of the one before are waited for."""
        self.settle()
        self._pending = (step, metrics, program)

    def settle(self) -> None:
        """Until the last step is done.

        Raises:
          FloatingPointError: its loss or gradients are not finite, and no more such steps in a row
            may be passed over (``StageConfig.skip_not_finite``).
        """
        if self._pending is None:
            return
        (step, metrics, program), self._pending = self._pending, None
        values = {key: float(value) for key, value in jax.device_get(metrics).items()}
        finite, may = values.pop("finite"), self.stage.skip_not_finite
        self.passed_over = 0 if finite else self.passed_over + 1
        if not finite:
            bad = sorted(key for key, value in values.items() if not math.isfinite(value))
            what = f"{self.name}: {', '.join(bad)} not finite at step {step}"
            if self.passed_over > may:
                before = f" and the {may} before it" if may else ""
                raise FloatingPointError(
                    f"{what}{before}; stopped, nothing saved since the last checkpoint; lower the "
                    "learning rate or look at the data"
                )
            if self.passed_over == 1:
                self._say(f"{what}; passed over (up to {may} in a row are)")
        if may:
            values["skipped"] = float(not finite)
        self.latest = values
        values = values if finite else {"skipped": 1.0}
        self._seen.append(values)
        now, begin = time.perf_counter(), self._settled
        self._settled = now
        if not self._compiled:  # the first step is mostly compilation
            self._compiled = True
            self._start = now
            return
        self._steps += 1
        if program is not None:
            self._flops.update(program.flops)
            self._of_program.setdefault(program.label, []).append((now - begin, values))

    def row(self, step: int, programs: int | None = None) -> Scalars:
        """Means over the steps where a metric is a number (a batch may have none), rates, and a new
        start."""
        result = {}
        for key in dict.fromkeys(key for seen in (self.latest, *self._seen) for key in seen):
            values = [v for seen in self._seen if math.isfinite(v := seen.get(key, math.nan))]
            result[key] = math.fsum(values) / len(values) if values else math.nan
        result["learning_rate"] = float(self._schedule(step - 1))
        if self._steps and self._seconds > 0:
            result["steps_per_second"] = self._steps / self._seconds
            result["samples_per_second"] = self._steps * self.stage.batch_size / self._seconds
            ideal = ideal_seconds(self._flops)
            if ideal:
                result["peak_share"] = ideal / self._seconds
        result["data_wait_seconds"], result["save_seconds"] = self._waited, self._saved
        result |= device_memory()
        if programs is not None:
            result["programs"] = programs
        for label, ran in sorted(self._of_program.items()) if (programs or 0) > 1 else ():
            result[f"program_{label}_steps"] = len(ran)
            seconds = math.fsum(taken for taken, _ in ran)
            rate = len(ran) * self.stage.batch_size / max(seconds, 1e-9)
            result[f"program_{label}_samples_per_second"] = rate
            padding = [seen["padding"] for _, seen in ran if "padding" in seen]
            if padding:
                result[f"program_{label}_padding"] = math.fsum(padding) / len(padding)
        self._clear()
        return result

    def pause(self) -> None:
        """Wait for the device and stop the clock: compiling, saving and evaluating are no part of
        samples a second."""
        self.settle()
        self._seconds += time.perf_counter() - self._start
        self._start = time.perf_counter()

    def restart(self) -> None:
        """Go on after a pause."""
        self._start = self._settled = time.perf_counter()


def ideal_seconds(flops: Counter[str]) -> float | None:
    """Seconds that products, counted by dtype, would take all devices at the rate of a large
    product of that dtype; None where one is not known."""
    peaks = {dtype: matmul_peak(dtype) for dtype in flops}
    rates = {dtype: peak * jax.device_count() for dtype, peak in peaks.items() if peak}
    return sum(n / rates[dtype] for dtype, n in flops.items()) if len(rates) == len(peaks) else None


def device_memory() -> Scalars:
    """GiB in use, and most ever in use, of the fullest device of this process; empty where devices
    do not count them (CPU)."""
    found = [stats for d in jax.local_devices() if (stats := d.memory_stats())]
    names = {"bytes_in_use": "memory_gib", "peak_bytes_in_use": "peak_memory_gib"}
    return {
        name: max(stats[key] for stats in found) / 2**30
        for key, name in names.items()
        if found and all(key in stats for stats in found)
    }


class Reporter:
    """Terminal, TensorBoard and ``metrics/<name>.jsonl`` of a stage; only the first process
    writes."""

    def __init__(self, name: str, workdir: Path, step: int, stage: StageConfig):
        self.name, self.stage = name, stage
        self.writes = jax.process_index() == 0
        self.console = messages(soft_wrap=True)
        self._next_line = 0.0
        self._start = (step, time.perf_counter())
        self._bar: Progress | None = None
        if not self.writes:
            return
        self.path = workdir / "metrics" / f"{name}.jsonl"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        _drop_after(self.path, step)
        self.board = Board(workdir / "tensorboard" / name, step + 1)
        if self.console.is_terminal:
            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
            )
            bar = Progress(*columns, TextColumn("{task.fields[info]}"), console=self.console)
            self._task = bar.add_task(name, total=stage.steps, completed=step, info="")
            self._bar = bar

    def __enter__(self) -> Reporter:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        if self.writes:
            with contextlib.nullcontext() if error is None else contextlib.suppress(OSError):
                self.board.close()  # a full disk was told already

    def say(self, text: str) -> None:
        """One line for a person."""
        if self.writes:
            self.console.print(text, markup=False)

    def log(
        self, step: int, kind: str, scalars: Scalars, images: dict[str, np.ndarray] | None = None
    ) -> None:
        """A row of numbers, and pictures, to the log files."""
        if not self.writes:
            return
        values = {key: float(value) for key, value in scalars.items()}
        # JSON has no NaN.
        row = {key: value if math.isfinite(value) else None for key, value in values.items()}
        row = {"step": step, "kind": kind, "time": round(time.time(), 3), **row}
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            for key, value in values.items():
                if math.isfinite(value):
                    self.board.scalar(f"{kind}/{key}", value, step)
            for key, image in (images or {}).items():
                self.board.image(f"{kind}/{key}", np.asarray(image), step)
            if kind != "train" or images:
                self.board.flush()
        except OSError as error:  # a failed write does not say which file it was
            if error.errno is None:
                raise
            where = f"{self.path} or its TensorBoard file"
            raise OSError(error.errno, error.strerror, where) from None
        if kind != "train" or images:
            self.say(f"{self.name} {step}: " + "  ".join(f"{k} {v:.4g}" for k, v in values.items()))

    def progress(self, step: int, latest: Scalars) -> None:
        """The bar, or a line now and then."""
        if not self.writes or not latest:
            return
        now = time.perf_counter()
        begin, start = self._start
        rate = (step - begin) / max(now - start, 1e-9)
        info = f"loss {latest['loss']:.4g}  {rate * self.stage.batch_size:.3g} samples/s"
        if self._bar is not None:
            self._bar.update(self._task, completed=step, info=info)
        elif now >= self._next_line or step == self.stage.steps:
            self._next_line = now + PLAIN_INTERVAL
            left = duration((self.stage.steps - step) / rate)
            self.say(f"{self.name} {step}/{self.stage.steps}  {info}  ETA {left}")
            sys.stderr.flush()


def has_row(workdir: Path, name: str, step: int, kind: str) -> bool:
    """Whether the log of stage ``name`` holds a row of this kind about this step."""
    path = workdir / "metrics" / f"{name}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    start = f'{{"step": {step}, "kind": "{kind}", '  # as ``Reporter.log`` writes it
    return any(line.startswith(start) and line.endswith("}") for line in lines)


def _drop_after(path: Path, step: int) -> None:
    """Remove the rows of steps that a killed run reported and did not save; a torn last line goes
    too."""
    if not path.exists():
        return
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            if json.loads(line)["step"] <= step:
                kept.append(line + "\n")
        except (ValueError, KeyError, TypeError):
            continue
    write_text(path, "".join(kept))
