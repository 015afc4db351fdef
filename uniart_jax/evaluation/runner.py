"""The one loop of all evaluations: from items to results.

    run          items -> measure(item), by worker processes, in order, counted; results are kept as they
                 come, and taken from there by the next run
    run_staged   items -> draw(item) -> predict here, where networks are -> finish

What an item is (a prediction and its reference, an asset, the number of a held-out object) and what
is measured of it is the caller's: ``compare``, ``assets``, ``layout``, ``physics``, ``procedural``,
``baselines``, ``experiments.evaluate_arm``. How far the work is stands on stderr. A command that
was stopped goes on with the same command; files are complete or absent
(``result_store.write_result``).
"""  # noqa: E501

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from uniart_jax.evaluation.result_store import ResultStore, without_nan, write_result
from uniart_jax.objects.names import one_line
from uniart_jax.runtime.files import write_text
from uniart_jax.runtime.processes import map_isolated, map_ordered, process_pool
from uniart_jax.runtime.progress import messages, track

DIED = "its worker process died (out of memory, a crash in C, or a call that never came back)"
Item = TypeVar("Item")
Drawn = TypeVar("Drawn")


class Passing(NamedTuple):
    """A result that is not kept, since the next run may have a better one: the machine was at fault
    (memory, time, a full disk), not the item."""

    result: Any


def run(
    measure: Callable[[Item], Any],
    items: Sequence[Item],
    what: str,
    *,
    processes: int = 1,
    store: ResultStore[Item] | None = None,
    died: Callable[[Item], Any] | None = None,
    unit: str = "objects",
) -> Iterator[Any]:
    """The result of every item, in the items' order.

    Args:
      measure: item -> result, or ``Passing``; run by ``processes`` workers, which import it by its
        module; 1 = by this process.
      what: the items in words, for those who wait.
      store: where results stay. They must be what JSON holds.
      died: the result of an item that killed its worker; without it that is an error.

    Raises:
      ValueError: a worker died and ``died`` is None. What ``measure`` raises.
    """
    found = [store.read(item) if store else None for item in items]
    files = [store.file(item) if store else None for item in items]
    missing = [i for i, result in enumerate(found) if result is None]
    if len(missing) < len(items):
        messages().print(f"{what}: {len(items) - len(missing)} of {len(items)} were made before")
    jobs = [(items[i], files[i]) for i in missing]
    made = map_isolated(
        processes,
        functools.partial(_measure, measure),
        jobs,
        2 * processes,
        functools.partial(_lost, died),
    )
    counted = track(made, what, len(missing), unit=unit)
    for result in found:
        yield next(counted) if result is None else result
    next(counted, None)  # the bar ends


def run_or_reason(
    measure: Callable[[Item], Any], items: Sequence[Item], what: str, *, processes: int = 1
) -> Iterator[Any]:
    """``run`` where one bad item must not cost the others: what it raises is its result, as text
    (``error_line``)."""
    tried = functools.partial(_result_or_reason, measure)
    return run(tried, items, what, processes=processes, died=lambda item: DIED)


def run_staged(
    draw: Callable[[Item], Drawn],
    predict: Callable[[Item, Drawn], Iterable[Callable[[], Any]]],
    items: Sequence[Item],
    what: str,
    *,
    processes: int = 1,
) -> list[list[Any]]:
    """Items that workers draw, this process looks at in order, and workers finish.

    Args:
      draw: item -> what is drawn; large, so only a few are made ahead.
      predict: (item, drawn) -> functions for workers to call; it runs here, where networks are.

    Returns:
      Of each item what its functions returned.

    Raises:
      ValueError: a worker died. What the functions raise.
    """
    ahead = 1 if processes == 1 else 2 * processes
    begun: list[list[Future[Any]]] = []
    with process_pool(processes) as submit:
        drawn = track(map_ordered(submit, draw, items, ahead), what, len(items))
        for item, one in zip(items, drawn, strict=True):
            begun.append([submit(job) for job in predict(item, one)])
            for future in begun[-1 - ahead] if len(begun) > ahead else ():
                future.result()  # wait rather than pile them up
        return [[future.result() for future in futures] for futures in begun]


def write_metrics(out: Path, content: dict[str, Any], table: str = "") -> None:
    """``metrics.json``, with null for numbers that JSON does not have, and ``table.md``."""
    write_result(out / "metrics.json", without_nan(content))
    if table:
        write_text(out / "table.md", table + "\n")


def error_line(error: Exception) -> str:
    """An error in one line: its message, after its type where that alone says what happened."""
    text = one_line(str(error))
    if isinstance(error, ValueError | OSError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _measure(measure: Callable[[Item], Any], job: tuple[Item, Path | None]) -> Any:
    item, file = job
    return _settled(measure(item), file)


def _lost(died: Callable[[Item], Any] | None, job: tuple[Item, Path | None]) -> Any:
    if died is None:
        raise ValueError(
            "a worker process died (out of memory?); run the same command again,"
            " with fewer processes if it repeats"
        )
    item, file = job
    return _settled(died(item), file)


def _settled(result: Any, file: Path | None) -> Any:
    if isinstance(result, Passing):
        return result.result
    return result if file is None else write_result(file, result)


def _result_or_reason(measure: Callable[[Item], Any], item: Item) -> Any:
    try:
        return measure(item)
    except Exception as error:  # one item must not cost the results of all others
        return error_line(error)
