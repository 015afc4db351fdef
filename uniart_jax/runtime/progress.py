"""What a command says while it works, on stderr; of long work how far it is: a bar with rate and
remaining time on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import contextlib
import datetime
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

PLAIN_INTERVAL = 30.0  # seconds between two lines where there is no terminal
Item = TypeVar("Item")


_quiet = False


def be_quiet(quiet: bool = True) -> None:
    """Consoles that ``messages`` gives from now on say nothing; ``-q`` of the command lines."""
    global _quiet
    _quiet = quiet


def messages(**options: Any) -> Console:
    """Where a command says what it does: stderr. ``options``: of ``rich.console.Console``."""
    return Console(stderr=True, highlight=False, quiet=_quiet, **options)


@contextlib.contextmanager
def working(console: Console, what: str) -> Iterator[Callable[[str], None]]:
    """Says what is being done while the block runs, and gives the function that says what comes
    next: on a terminal one line that changes, elsewhere (a file, a pipe) a line each."""
    if console.is_terminal:
        with console.status(escape(what)) as status:
            yield lambda text: status.update(escape(text))
        return
    said = ""

    def say(text: str) -> None:
        nonlocal said
        if text != said:
            console.print(f"· {text}", markup=False, soft_wrap=True)
        said = text

    say(what)
    yield say


class _Rate(ProgressColumn):
    def __init__(self, unit: str):
        super().__init__()
        self.unit = unit

    def render(self, task) -> Text:
        return Text(f"{task.speed:.2f} {self.unit}/s" if task.speed else f"- {self.unit}/s")


@contextlib.contextmanager
def advancing(
    what: str, total: int, *, done: int = 0, unit: str = "objects"
) -> Iterator[Callable[[], None]]:
    """A function to call after each of ``total`` pieces of work, ``done`` of which were there
    before."""
    console = messages(soft_wrap=True)
    if not console.is_terminal:
        yield _plain(console, what, total, done, unit)
        return
    columns = (
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(unit),
        TimeElapsedColumn(),
        TextColumn("ETA"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(what, total=total, completed=done)
        yield lambda: bar.advance(task)


def track(items: Iterable[Item], what: str, total: int, *, unit: str = "objects") -> Iterator[Item]:
    """``items`` as they come, counted."""
    with advancing(what, total, unit=unit) as advance:
        for item in items:
            yield item
            advance()


def duration(seconds: float) -> str:
    """For people: "0:01:40", "2 days, 3:04:05"."""
    return str(datetime.timedelta(seconds=max(0, round(seconds))))


def _plain(console: Console, what: str, total: int, done: int, unit: str) -> Callable[[], None]:
    start = shown = time.perf_counter()
    first, count = done, done

    def advance() -> None:
        nonlocal count, shown
        count += 1
        now = time.perf_counter()
        if count < total and now - shown < PLAIN_INTERVAL:
            return
        shown = now
        rate = (count - first) / max(now - start, 1e-9)
        left = duration((total - count) / rate)
        console.print(f"{what}: {count} of {total}  {rate:.3g} {unit}/s  ETA {left}")

    return advance
