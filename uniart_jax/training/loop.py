"""The loop of one stage: resume, step, report, evaluate, save; it ends at the last step, a signal
or values that are not finite.

Order in which a run comes back: the newest good checkpoint of ``WORKDIR/checkpoints/<stage>`` gives
weights, moments, average, step and place in the data; what the log files hold beyond that step is
dropped; an evaluation that was due at that step and is not in them is made up for; without a
checkpoint the given state starts at step 0.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import StageConfig
from uniart_jax.runtime.progress import messages
from uniart_jax.training.checkpoints import CheckpointableIterator, Checkpoints
from uniart_jax.training.dashboard import Meter, Reporter, Scalars, has_row
from uniart_jax.training.distributed import broadcast_from_first, is_first, largest, stop_together
from uniart_jax.training.prefetch import Prefetch
from uniart_jax.training.profiling import Profiler
from uniart_jax.training.programs import Programs
from uniart_jax.training.state import TrainState

Evaluate = Callable[[TrainState, int], tuple[Scalars, dict[str, np.ndarray]]]


def run_stage(
    name: str,
    *,
    state: TrainState,
    train_step: Programs,
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
      state: a fresh state (donated), whose structure and shardings a checkpoint must have; these
        alone (``state.abstract_state``) where there is a checkpoint.
      train_step: of ``make_train_step``.
      batches: host batches, endless, with ``get_state`` and ``set_state``.
      put: host batch -> what ``train_step`` takes, such as ``functools.partial(put_batch,
        mesh=mesh)``; for the next batch while a step computes.
      key: of the run; the step number is folded into it.
      checkpoints: where this stage is saved every ``save_every`` steps and at its end.
      workdir: gets ``tensorboard/<name>``, ``metrics/<name>.jsonl`` and, on SIGUSR1, ``profile``
        (``training.profiling``).
      evaluate: (state, step) -> (scalars, images [H, W, 3] in [0, 1] or uint8), every
        ``evaluate_every`` steps and at the end.

    A stage whose last step is saved and evaluated is only restored. SIGTERM and SIGINT save and
    raise SystemExit(128 + signal), also where they come while the last step is saved or evaluated,
    so that no next stage begins.

    Raises:
      FloatingPointError: loss or gradients are not finite, in more steps in a row than may be
        passed over; step and metrics are named and nothing is saved.
      ValueError: the checkpoint is of another config, or the data ended.
    """
    restored = checkpoints.restore(state, batches)
    state = state if restored is None else restored
    step, workdir = int(state.step), Path(workdir)
    due = step > 0 and (step % stage.evaluate_every == 0 or step >= stage.steps)
    missed = evaluate is not None and due
    missed = missed and not broadcast_from_first(has_row(workdir, name, step, "evaluation"))
    if step >= stage.steps and is_first():
        messages(soft_wrap=True).print(
            f"{name}: already trained ({step} steps); skipped", markup=False
        )
    if step >= stage.steps and not missed:
        return state
    with (
        Reporter(name, workdir, step, stage) as report,
        _Signals() as signals,
        Profiler(workdir / "profile", report.say) as profiler,
    ):
        if 0 < step < stage.steps:
            report.say(f"{name}: resumed at step {step}")
        if missed and evaluate is not None:
            report.log(step, "evaluation", *evaluate(state, step))
        meter, ahead = Meter(name, stage, report.say), Prefetch(batches, put)
        stop, owed = None, False
        while step < stage.steps:
            profiler.before(step)
            try:
                batch = next(ahead)
            except Exception as error:
                if ahead.agreed and step:  # what was learned so far is sound
                    meter.settle()
                    checkpoints.save(step, state, ahead, wait=True)
                    report.say(f"{name}: a batch failed; saved at step {step}")
                if isinstance(error, StopIteration):
                    raise ValueError(f"{name}: the data ended at step {step}; repeat it") from None
                raise
            meter.waited(ahead.seconds)
            if not train_step.is_compiled(batch):
                meter.pause()
                report.say(f"{name}: step {step + 1} {train_step.precompile(state, batch, key)}")
                meter.restart()
            state, metrics = train_step(state, batch, key)
            step += 1
            last = step == stage.steps
            log, test = step % stage.log_every == 0, step % stage.evaluate_every == 0
            stop = signals.asked(step)
            save = owed or step % stage.save_every == 0 or last or stop is not None
            if not last and stop is None:
                ahead.fetch()
            # One step behind, so that the device has its next step before this one is done, and no
            # queue of batches builds up.
            meter.add(step, metrics, train_step.latest)
            profiler.after(step, meter.settle)
            if log or test or save:
                meter.pause()
            if log or last:
                report.log(step, "train", meter.row(step, len(train_step.compiled)))
            # a checkpoint in the midst of steps that are passed over would let a run that ends
            # there go on when it is started again
            owed = save and meter.passed_over > 0 and not last and stop is None
            if save and not owed:
                begin = time.perf_counter()
                checkpoints.save(step, state, ahead, wait=last or stop is not None)
                meter.saved(time.perf_counter() - begin)
            if stop is not None:
                break
            if evaluate is not None and (test or last):
                report.log(step, "evaluation", *evaluate(state, step))
            if log or test or save:
                meter.restart()
            report.progress(step, meter.latest)
    # By now another signal ends the program as usual: none is lost in between.
    stop = signals.heard() if stop is None else stop
    if stop is not None:
        report.say(
            f"{name}: {signal.Signals(stop).name}; saved at step {step}; the same command resumes"
        )
        raise SystemExit(128 + stop)
    return state


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

    def asked(self, step: int) -> int | None:
        """The signal to obey after ``step``: several processes must save the same one, so there
        they obey a few steps later, together."""
        return stop_together(step, self._received)

    def heard(self) -> int | None:
        """The signal that any process has received."""
        return largest([self._received or 0])[0] or None
