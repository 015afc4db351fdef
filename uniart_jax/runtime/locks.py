"""Folders that only one process at a time may work in. A lock goes with its process, however that
ends."""

from __future__ import annotations

import contextlib
import fcntl
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO


@contextlib.contextmanager
def exclusive_lock(folder: Path, wait: Callable[[], None] | None = None) -> Iterator[None]:
    """One process at a time in ``folder``: two would write each other's files. Where the file
    system knows no locks, nothing is held.

    Args:
      wait: called if another process has it, which is then waited for.

    Raises:
      ValueError: another process has it, and nobody wants to wait.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        if not try_lock(file):
            if wait is None:
                raise ValueError(
                    f"{folder}: another process works on it; wait for it, or stop it first"
                )
            wait()
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def in_turn(folder: Path, wait: Callable[[], None]) -> Iterator[None]:
    """One process at a time makes ``folder``, which several need; the others call ``wait``, and
    wait."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with folder.with_name(f".{folder.name}.lock").open("w") as file:
        if not try_lock(file):
            wait()
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def try_lock(file: TextIO) -> bool:
    """Whether this process has the lock of an open file now."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
