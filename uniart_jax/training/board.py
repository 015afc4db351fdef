"""TensorBoard's event files, written by the thread that has something to write.

``tensorboardX.SummaryWriter`` writes in a thread of its own: on a full disk that thread dies with a
traceback, and the program then waits for it without end.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog
from tensorboardX.summary import image, scalar

FLUSH = 60.0  # seconds after which what was written is sent to the disk


class Board:
    """One event file in ``folder``, which is made.

    Args:
      step: what earlier files in the folder say of this step and later ones is no longer shown.

    Every method raises OSError where the disk does not take what is written.
    """

    def __init__(self, folder: Path, step: int):
        folder.mkdir(parents=True, exist_ok=True)
        self._flushed = time.monotonic()
        self._writer = EventsWriter(str(folder / "events"))
        self._writer.write_event(Event(step=step, file_version="brain.Event:2"))
        begin = SessionLog(status=SessionLog.START)
        self._writer.write_event(Event(step=step, session_log=begin))

    def scalar(self, tag: str, value: float, step: int) -> None:
        """A number."""
        self._add(scalar(tag, value), step)

    def image(self, tag: str, pixels: np.ndarray, step: int) -> None:
        """A picture [H, W, 3], in [0, 1] or uint8."""
        self._add(image(tag, pixels, dataformats="HWC"), step)

    def flush(self) -> None:
        """Until all of it is on the disk."""
        self._writer.flush()
        self._flushed = time.monotonic()

    def close(self) -> None:
        """End the file."""
        self._writer.close()

    def _add(self, summary, step: int) -> None:
        self._writer.write_event(Event(wall_time=time.time(), step=step, summary=summary))
        if time.monotonic() - self._flushed > FLUSH:
            self.flush()
