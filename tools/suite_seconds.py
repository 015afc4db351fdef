"""What each test module costs, as a plugin of pytest:

PYTHONPATH=tools python -m pytest -p suite_seconds tests/nn tests/models

After the tests a line a module, the dearest first: its tests, processor seconds (of what its tests
start too, which a busy machine changes less than the clock's), how many programs JAX compiled and
how many it read from its cache, and the most memory that the process held, in MB.
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

try:
    import resource
except ImportError:  # Windows
    sys.exit("suite_seconds: this system does not count processor seconds of a process")


@dataclasses.dataclass
class Cost:
    tests: int = 0
    seconds: float = 0.0
    compiled: int = 0
    read: int = 0
    megabytes: float = 0.0


COSTS: dict[str, Cost] = {}
_now = Cost()  # of the module whose tests run
_listening = False


def seconds() -> float:
    """Processor seconds of this process and of those that it has waited for."""
    both = (resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


def peak() -> float:
    """MB that this process has held at most since the last call; 0 where the system does not
    say."""
    file = Path("/proc/self/status")  # Linux's
    if not file.exists():
        return 0.0
    line = next(line for line in file.read_text().splitlines() if line.startswith("VmHWM"))
    with contextlib.suppress(OSError):  # a container may not
        Path("/proc/self/clear_refs").write_text("5")  # the next call's begins here
    return int(line.split()[1]) * 1024 / 1e6


def listen() -> None:
    """Count what JAX compiles, once a test has imported it."""
    global _listening
    if _listening or "jax" not in sys.modules:
        return
    from jax import monitoring

    def event(name: str, **_: object) -> None:
        _now.compiled += name.endswith("/cache_misses")
        _now.read += name.endswith("/cache_hits")

    monitoring.register_event_listener(event)
    _listening = True


def table(costs: dict[str, Cost]) -> str:
    lines = ["tests  CPU s  compiled  read     MB  module"]
    for module, cost in sorted(costs.items(), key=lambda item: -item[1].seconds):
        numbers = f"{cost.tests:5}  {cost.seconds:5.1f}  {cost.compiled:8}  {cost.read:4}"
        lines.append(f"{numbers}  {cost.megabytes:5.0f}  {module}")
    total = sum(cost.seconds for cost in costs.values())
    return "\n".join([*lines, f"{total:.0f} CPU seconds in all, without collecting"])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    global _now
    _now = COSTS.setdefault(item.nodeid.split("::")[0], Cost())
    listen()
    peak()
    before = seconds()
    try:
        return (yield)
    finally:
        listen()
        _now.tests += 1
        _now.seconds += seconds() - before
        _now.megabytes = max(_now.megabytes, peak())


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    terminalreporter.write_line(f"\n{table(COSTS)}")
