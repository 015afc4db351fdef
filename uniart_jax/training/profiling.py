"""A trace of a run under way: ``kill -USR1 PID`` writes the next few steps to ``WORKDIR/profile``.

A signal and not an option, because what one wants to look at (a run that has become slow) has
started long ago. Open the folder with xprof (``xprof --logdir WORKDIR/profile``) or the
``*.trace.json.gz`` in it with Perfetto. Of several processes each traces itself.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

STEPS = 5


class Profiler:
    """Starts a trace at the step after SIGUSR1 and ends it ``STEPS`` later; a context manager, as
    the signal kills outside of it."""

    def __init__(self, folder: Path, say: Callable[[str], None]):
        self._folder, self._say = folder, say
        self._asked, self._until = False, 0
        self._old: Any = None

    def __enter__(self) -> Profiler:
        if threading.current_thread() is threading.main_thread() and hasattr(signal, "SIGUSR1"):
            self._old = signal.signal(signal.SIGUSR1, self._receive)
        return self

    def __exit__(self, *_: Any) -> None:
        if self._until:
            jax.profiler.stop_trace()
            self._until = 0
        if self._old is not None:
            signal.signal(signal.SIGUSR1, self._old)

    def _receive(self, _number: int, _frame: Any) -> None:
        self._asked = True

    def before(self, step: int) -> None:
        """Called before update number ``step``."""
        if self._asked and not self._until:
            self._asked, self._until = False, step + STEPS
            self._say(f"profile: tracing steps {step + 1} to {self._until}")
            jax.profiler.start_trace(str(self._folder))

    def after(self, step: int, settle: Callable[[], Any]) -> None:
        """Called after ``step`` updates were dispatched; ``settle`` waits for the device."""
        if self._until and step >= self._until:
            settle()
            jax.profiler.stop_trace()
            self._until = 0
            self._say(f"profile: written to {self._folder}")
