"""Worker processes: same results as in this process, errors told, surroundings left as they
were."""

import contextlib
import operator
import os
import signal
import threading
import time

import pytest

from uniart_jax.runtime.processes import map_isolated, map_ordered, process_pool, time_limit


@pytest.mark.parametrize("processes", [1, 2])
def test_results_and_errors_come_back(processes, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("IGL_NUM_THREADS", raising=False)
    with process_pool(processes) as submit:
        futures = [submit(operator.pow, 2, k) for k in range(5)]
        broken = submit(operator.truediv, 1, 0)
        assert [f.result() for f in futures] == [1, 2, 4, 8, 16]
        with pytest.raises(ZeroDivisionError):
            broken.result()
        threads = submit(os.getenv, "OMP_NUM_THREADS").result()
    assert threads == ("7" if processes == 1 else "1")
    assert os.environ["OMP_NUM_THREADS"] == "7" and "IGL_NUM_THREADS" not in os.environ


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_order_and_none_is_begun_early(processes):
    asked = []

    def items():
        for k in range(6):
            asked.append(k)
            yield k

    with process_pool(processes) as submit:
        results = map_ordered(submit, str, items(), 2)
        assert next(results) == "0" and asked == [0, 1, 2]
        assert list(results) == ["1", "2", "3", "4", "5"]


def test_a_dead_worker_is_told_in_one_line():
    with pytest.raises(ValueError, match="worker process died"), process_pool(2) as submit:
        submit(os._exit, 1).result()


def test_an_item_that_kills_its_worker_costs_only_itself():
    """Signal 9 is a worker out of memory; signal 0 does nothing."""
    items = [0, 0, 9, 0, 9, 9, 0, 0, 0]
    results = map_isolated(2, signal.raise_signal, items, 4, "dead {}".format)
    assert list(results) == [f"dead {k}" if k else None for k in items]
    assert list(map_isolated(1, str, [1, 2], 4, str)) == ["1", "2"]


def test_an_item_alone_that_kills_its_worker():
    assert list(map_isolated(2, signal.raise_signal, [9], 4, "dead {}".format)) == ["dead 9"]


def counted(number: int) -> int:
    """The sum is one call in C that no alarm interrupts."""
    with time_limit(0.5):
        return sum(range(number))


def test_a_call_that_does_not_come_back_costs_only_itself():
    results = map_isolated(2, counted, [3, 10**12, 4], 4, "dead {}".format)
    assert list(results) == [3, f"dead {10**12}", 6]


def test_time_limits_end_what_python_runs_and_leave_no_alarm():
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(TimeoutError, match=r"longer than 0\.05 seconds"), time_limit(0.05):
        time.sleep(10)
    with time_limit(0.05):
        pass
    time.sleep(0.1)
    assert signal.getsignal(signal.SIGALRM) == before
    found = []  # elsewhere than in a main thread there is none
    thread = threading.Thread(target=lambda: found.append(counted(3)))
    thread.start()
    thread.join()
    assert found == [3]


def test_time_limits_hold_whatever_is_caught_inside():
    for caught in (Exception, BaseException):
        with pytest.raises(TimeoutError), time_limit(0.05):
            for _ in range(2):
                with contextlib.suppress(caught):
                    time.sleep(0.2)


def test_workers_that_cannot_start_are_told(monkeypatch):
    """Not taken for items that kill: those would be written down as failed."""
    monkeypatch.setattr("uniart_jax.runtime.processes._begin", os.abort)
    with pytest.raises(ValueError, match="cannot start"):
        list(map_isolated(2, str, [1, 2, 3], 4, str))
