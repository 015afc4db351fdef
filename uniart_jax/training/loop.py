"""The loop of one stage: resume, step, report, evaluate, save; it ends at the last step, a signal or a value that is not finite.

Order in which a run comes back: the newest good checkpoint of ``WORKDIR/checkpoints/<stage>`` gives weights, moments, average, step
and place in the data; what the log files hold beyond that step is dropped; without a checkpoint the given state starts at step 0.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from tensorboardX import SummaryWriter

from uniart_jax.config import StageConfig
from uniart_jax.progress import PLAIN_INTERVAL, duration
from uniart_jax.training.checkpoints import CheckpointableIterator, Checkpoints
from uniart_jax.training.state import TrainState
from uniart_jax.training.step import TrainStep

Scalars = dict[str, float]
Evaluate = Callable[[TrainState, int], tuple[Scalars, dict[str, np.ndarray]]]


def run_stage(
    name: str,
    *,
    state: TrainState,
    train_step: TrainStep,
    batches: CheckpointableIterator,
    put: Callable[[Any], Any],
    key: jax.Array,
    checkpoints: Checkpoints,
    stage: StageConfig,
    workdir: str | Path,
    evaluate: Evaluate | None = None,
) -> TrainState:
    """Train one network from where it stands to ``stage.steps`` and return its state.

    Args:
      name: of the stage; names its logs and its line on the terminal.
      state: a fresh state (donated) and the structure and shardings that a checkpoint must have.
      train_step: of ``make_train_step``.
      batches: host batches, endless, with ``get_state`` and ``set_state``.
      put: host batch -> device batch, such as ``functools.partial(put_batch, mesh=mesh)``.
      key: of the run; the step number is folded into it.
      checkpoints: where this stage is saved every ``save_every`` steps and at its end.
      workdir: gets ``tensorboard/<name>`` and ``metrics/<name>.jsonl``.
      evaluate: (state, step) -> (scalars, images [H, W, 3] in [0, 1] or uint8), every ``evaluate_every`` steps and at the end.

    A stage whose last step is saved is only restored. SIGTERM and SIGINT save and raise SystemExit(128 + signal).

    Raises:
      FloatingPointError: loss or gradients are not finite; step and metrics are named and nothing is saved.
      ValueError: the checkpoint is of another config, or the data ended.
    """
    restored = checkpoints.restore(state, batches)
    state = state if restored is None else restored
    step = int(state.step)
    if step >= stage.steps:
        print(f"{name}: already trained ({step} steps); skipped", file=sys.stderr)
        return state
    with _Reporter(name, Path(workdir), step, stage) as report, _Signals() as signals:
        if step:
            report.say(f"{name}: resumed at step {step}")
        window = _Window(name)
        while step < stage.steps:
            try:
                batch = next(batches)
            except StopIteration:
                raise ValueError(f"{name}: the data ended at step {step}; repeat it") from None
            state, metrics = train_step(state, put(batch), key)
            step += 1
            last = step == stage.steps
            # One step behind, so that the host makes the next batch while the device works, and no queue of batches builds up.
            window.add(step, metrics)
            stop = signals.asked(step % stage.log_every == 0)
            log, test = step % stage.log_every == 0, step % stage.evaluate_every == 0
            save = step % stage.save_every == 0 or last or stop is not None
            if log or test or save:
                window.pause()
            if log or last:
                report.log(step, "train", window.means(stage.batch_size))
            if save:
                checkpoints.save(step, state, batches, wait=last or stop is not None)
            if stop is not None:
                report.say(
                    f"{name}: {signal.Signals(stop).name}; saved at step {step}; the same command resumes"
                )
                raise SystemExit(128 + stop)
            if evaluate is not None and (test or last):
                report.log(step, "evaluation", *evaluate(state, step))
            if log or test or save:
                window.restart()
            report.progress(step, window.latest)
    return state


class _Window:
    """Metrics since the last log line, fetched one step late and checked for finiteness."""

    def __init__(self, name: str):
        self.name = name
        self.latest: Scalars = {}
        self._pending: tuple[int, Any] | None = None
        self._seen: list[Scalars] = []
        self._steps, self._seconds, self._start = 0, 0.0, time.perf_counter()
        self._compiled = False

    def add(self, step: int, metrics: Any) -> None:
        self.settle()
        self._pending = (step, metrics)

    def settle(self) -> None:
        if self._pending is None:
            return
        (step, metrics), self._pending = self._pending, None
        values = {key: float(value) for key, value in jax.device_get(metrics).items()}
        if not values.pop("finite"):
            bad = sorted(key for key, value in values.items() if not math.isfinite(value))
            raise FloatingPointError(
                f"{self.name}: {', '.join(bad)} not finite at step {step}; stopped, nothing saved since the last checkpoint; "
                "lower the learning rate or look at the data"
            )
        self.latest = values
        self._seen.append(values)
        if self._compiled:
            self._steps += 1
        else:  # the first step is mostly compilation
            self._compiled = True
            self._start = time.perf_counter()

    def means(self, batch_size: int) -> Scalars:
        """Mean of each metric over the steps where it is a number (one may be undefined on a batch), and samples a second."""
        result = {}
        for key in self.latest:
            values = [seen[key] for seen in self._seen if math.isfinite(seen[key])]
            result[key] = math.fsum(values) / len(values) if values else math.nan
        if self._steps and self._seconds > 0:
            result["samples_per_second"] = self._steps * batch_size / self._seconds
        self._seen, self._steps, self._seconds = [], 0, 0.0
        return result

    def pause(self) -> None:
        """Wait for the device and stop the clock: saving and evaluating are no part of samples a second."""
        self.settle()
        self._seconds += time.perf_counter() - self._start
        self._start = time.perf_counter()

    def restart(self) -> None:
        self._start = time.perf_counter()


class _Signals:
    """Remembers the first SIGTERM or SIGINT; a second one acts as usual."""

    def __init__(self) -> None:
        self._received: int | None = None
        self._old: dict[int, Any] = {}

    def __enter__(self) -> _Signals:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGTERM, signal.SIGINT):
                self._old[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_: Any) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
        self._old = {}

    def _receive(self, number: int, _frame: Any) -> None:
        self._received = number
        self.__exit__()

    def asked(self, meeting: bool) -> int | None:
        """The signal to obey now. Several processes must save together, so there they agree at ``meeting`` steps only."""
        if jax.process_count() == 1:
            return self._received
        if not meeting:
            return None
        everyone = multihost_utils.process_allgather(np.asarray(self._received or 0))
        return int(np.max(everyone)) or None


class _Reporter:
    """Terminal, TensorBoard and ``metrics/<name>.jsonl`` of a stage; only the first process writes."""

    def __init__(self, name: str, workdir: Path, step: int, stage: StageConfig):
        self.name, self.stage = name, stage
        self.writes = jax.process_index() == 0
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._next_line = 0.0
        self._start = (step, time.perf_counter())
        self._bar: Progress | None = None
        if not self.writes:
            return
        self.path = workdir / "metrics" / f"{name}.jsonl"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        _drop_after(self.path, step)
        self.board = SummaryWriter(str(workdir / "tensorboard" / name), purge_step=step + 1)
        if self.console.is_terminal:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())  # fmt: skip
            bar = Progress(*columns, TextColumn("{task.fields[info]}"), console=self.console)
            self._task = bar.add_task(name, total=stage.steps, completed=step, info="")
            self._bar = bar

    def __enter__(self) -> _Reporter:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        if self.writes:
            self.board.close()

    def say(self, text: str) -> None:
        """One line for a person."""
        if self.writes:
            self.console.print(text, markup=False)

    def log(self, step: int, kind: str, scalars: Scalars, images: dict[str, np.ndarray] | None = None) -> None:  # fmt: skip
        """A row of numbers, and pictures, to the log files."""
        if not self.writes:
            return
        values = {key: float(value) for key, value in scalars.items()}
        # JSON has no NaN.
        row = {key: value if math.isfinite(value) else None for key, value in values.items()}
        row = {"step": step, "kind": kind, "time": round(time.time(), 3), **row}
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        for key, value in values.items():
            if math.isfinite(value):
                self.board.add_scalar(f"{kind}/{key}", value, step)
        for key, image in (images or {}).items():
            self.board.add_image(f"{kind}/{key}", np.asarray(image), step, dataformats="HWC")
        if kind != "train" or images:
            self.board.flush()
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


def _drop_after(path: Path, step: int) -> None:
    """Remove the rows of steps that a killed run reported and did not save; a torn last line goes too."""
    if not path.exists():
        return
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            if json.loads(line)["step"] <= step:
                kept.append(line + "\n")
        except (ValueError, KeyError, TypeError):
            continue
    temporary = path.with_suffix(".tmp")
    temporary.write_text("".join(kept), encoding="utf-8")
    temporary.replace(path)
