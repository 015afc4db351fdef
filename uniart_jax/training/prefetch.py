"""The next batch, made and sent to the device while the current step runs there.

One batch ahead, on the loop's own thread: a step is dispatched and computes by itself, so the host is free, and several hosts
launch their programs in one order. The position to save is that of the last batch *used*, not of the one that waits.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from typing import Any

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
        """Make and send the next batch, unless one waits. What goes wrong is raised when that batch is asked for."""
        if self._waiting is not None or self._error is not None:
            return
        begin = time.perf_counter()
        try:
            batch = self._put(next(self._batches))
            self._waiting = batch, copy.deepcopy(self._batches.get_state())
        except Exception as error:  # the steps before it can still be saved
            self._error = error
        self.seconds = time.perf_counter() - begin

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
