"""Worker processes for work in numpy: one thread each, gone when their parent is."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "IGL_NUM_THREADS")

Submit = Callable[..., "Future[Any]"]


@contextlib.contextmanager
def process_pool(processes: int) -> Iterator[Submit]:
    """``submit(function, *args, **kwargs)`` -> Future, run by one of ``processes`` spawned workers; 1 = by this process, at once.

    Workers import the function by its module, so the caller's main module must be importable. Leaving cancels what has not begun.
    """
    if processes == 1:
        yield _at_once
        return
    # Workers read these when numpy is imported: with one BLAS thread each, processes do not fight for cores.
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    pool = ProcessPoolExecutor(
        processes, mp_context=multiprocessing.get_context("spawn"), initializer=_die_with_parent
    )
    try:
        yield pool.submit
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _at_once(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Future[Any]:
    future: Future[Any] = Future()
    try:
        future.set_result(function(*args, **kwargs))
    except Exception as error:
        future.set_exception(error)
    return future


def _die_with_parent() -> None:
    """End this worker when its parent is gone: a parent killed outright cannot tell it to."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch():
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
