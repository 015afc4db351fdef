"""The next batch, made and sent to the device while the current step runs there.

One batch ahead, on the loop's own thread: a step is dispatched and computes by itself, so the host
is free, and several hosts launch their programs in one order. The position to save is that of the
last batch *used*, not of the one that waits.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from typing import Any

import jax

from uniart_jax.training import distributed
from uniart_jax.training.checkpoints import CheckpointableIterator


class Prefetch:
    """Device batches of an iterator of host batches; itself a ``CheckpointableIterator``.

    Attributes:
      seconds: that the last batch took to be made and sent.
    """

    def __init__(self, batches: CheckpointableIterator, put: Callable[[Any], Any]):
        self._batches, self._put = batches, put
        self._waiting: tuple[Any, Any] | None = None
        self._error: Exception | None = None
        self._position = copy.deepcopy(batches.get_state())
        self.seconds = 0.0

    def fetch(self) -> None:
        """Make and send the next batch, unless one waits. What goes wrong is raised when that batch
        is asked for: the steps before it can still be saved.

        Several processes agree on whether all have made theirs: none saves or evaluates without the
        others. What goes wrong in sending on one process is raised at once, for the others wait for
        it there.
        """
        if self._waiting is not None or self._error is not None:
            return
        begin = time.perf_counter()
        batch, failed = None, None
        try:
            batch = next(self._batches)
        except Exception as error:
            failed = error
        self._error = distributed.shared_error(failed)
        if self._error is None:
            try:
                self._waiting = self._put(batch), copy.deepcopy(self._batches.get_state())
            except Exception as error:
                if jax.process_count() > 1:
                    raise
                self._error = error
        self.seconds = time.perf_counter() - begin

    @property
    def agreed(self) -> bool:
        """Whether the next batch failed and all processes know of it."""
        return self._error is not None

    def __next__(self) -> Any:
        self.fetch()
        if self._waiting is None:
            assert self._error is not None
            raise self._error
        (batch, self._position), self._waiting = self._waiting, None
        return batch

    def get_state(self) -> Any:
        """The host iterator's state after the last batch that was given out."""
        return self._position

    def set_state(self, state: Any) -> None:
        self._batches.set_state(state)
        self._position, self._waiting, self._error = copy.deepcopy(state), None, None
