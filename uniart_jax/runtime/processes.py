"""Worker processes for work in numpy: one thread each, gone when their parent is."""

from __future__ import annotations

import collections
import contextlib
import faulthandler
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "IGL_NUM_THREADS")

Submit = Callable[..., "Future[Any]"]
_is_worker = False


@contextlib.contextmanager
def process_pool(processes: int) -> Iterator[Submit]:
    """``submit(function, *args, **kwargs)`` -> Future, run by one of ``processes`` spawned workers;
    1 = by this process, at once.

    Workers import the function by its module, so the caller's main module must be importable.
    Leaving cancels what has not begun.

    Raises:
      ValueError: a worker died.
    """
    if processes == 1:
        yield _at_once
        return
    try:
        with _workers(processes) as submit:
            yield submit
    except BrokenProcessPool:
        raise ValueError(
            "a worker process died (out of memory?); run the same command again,"
            " with fewer processes if it repeats"
        ) from None


@contextlib.contextmanager
def _workers(processes: int) -> Iterator[Submit]:
    # Workers read these when numpy is imported: with one BLAS thread each, processes do not fight
    # for cores.
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(processes, mp_context=spawn, initializer=_begin)
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield pool.submit
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def map_ordered(
    submit: Submit, function: Callable[..., Any], items: Iterable[Any], ahead: int
) -> Generator[Any, None, None]:
    """Results of ``function(item)`` in the items' order, at most ``ahead`` of them begun before
    they are asked for."""
    pending: collections.deque[Future[Any]] = collections.deque()
    for item in items:
        if len(pending) >= ahead:
            yield pending.popleft().result()
        pending.append(submit(function, item))
    while pending:
        yield pending.popleft().result()


def map_isolated(
    processes: int,
    function: Callable[[Any], Any],
    items: Iterable[Any],
    ahead: int,
    died: Callable[[Any], Any],
) -> Generator[Any, None, None]:
    """Results of ``function(item)`` in the items' order; ``died(item)`` for an item that kills its
    worker (memory, a crash in C).

    When a worker dies, the items that were under way are done again, each by a worker of its own,
    to learn which of them it was. With ``processes`` = 1 this process does them, and dies itself.

    Raises:
      ValueError: no worker can start.
    """
    left = collections.deque(items)
    if processes == 1:
        yield from (function(item) for item in left)
        return
    while left:
        try:
            with _workers(processes) as submit:
                for result in map_ordered(submit, function, list(left), ahead):
                    left.popleft()
                    yield result
        except BrokenProcessPool:
            for _ in range(min(ahead, len(left))):
                item = left.popleft()
                try:
                    with _workers(1) as submit:
                        _check_start(submit)
                        result = submit(function, item).result()
                except BrokenProcessPool:
                    result = died(item)
                yield result


class _OutOfTimeError(BaseException):
    """No Exception, so that code which takes any error for a broken file lets it pass."""


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """TimeoutError at the latest on leaving if what is inside takes longer, and as soon as the main
    thread runs a line of Python again. Not nested.

    A worker of ``process_pool`` or ``map_isolated`` that a call in C still holds after twice as
    long is ended; ``map_isolated`` then names its item. In this process such a call cannot be
    stopped; outside of main threads, and where there are no alarms (Windows), nothing is.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(
        signal, "setitimer"
    ):
        yield
        return
    fired = []

    def stop(*_: Any) -> None:
        fired.append(True)
        raise _OutOfTimeError

    before = signal.signal(signal.SIGALRM, stop)
    # Again every second: what is raised in a destructor or a callback is lost.
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    nowhere = open(os.devnull, "w") if _is_worker else None  # noqa: SIM115 - closed below
    if nowhere is not None:  # a thread in C: it needs no lock that the call may hold
        faulthandler.dump_traceback_later(2 * seconds, exit=True, file=nowhere)
    try:
        yield
    except _OutOfTimeError:
        pass
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        if nowhere is not None:
            faulthandler.cancel_dump_traceback_later()
            nowhere.close()
    if fired:
        raise TimeoutError(f"it took longer than {seconds:g} seconds")


def _check_start(submit: Submit) -> None:
    try:
        submit(os.getpid).result()
    except BrokenProcessPool:
        raise ValueError(
            "worker processes cannot start: run from a file whose main module can be imported (if "
            "__name__ == '__main__'), or with one process"
        ) from None


def _at_once(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Future[Any]:
    future: Future[Any] = Future()
    try:
        future.set_result(function(*args, **kwargs))
    except Exception as error:
        future.set_exception(error)
    return future


def _begin() -> None:
    """Leave Ctrl-C to the parent, and end when the parent is gone: one killed outright cannot tell
    its workers."""
    global _is_worker
    _is_worker = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch():
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
