"""The figures of methods as tables: ``table.md`` and the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from uniart_jax.evaluation.summary import FAILED
from uniart_jax.runtime.files import write_text

Row = Mapping[str, Mapping[str, float]]
TITLES = {
    "failures": "Failures",
    "surface": "Surface",
    "articulation": "Parts and joints",
    "pose_error": "Pose error",
    "singapo": "SINGAPO / CAGE protocol",
    "appearance": "Appearance",
    "openshape": "OpenShape",
    "physics": "Physics engines",
}


def markdown(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table of Markdown; ``head`` and each line are cells."""
    first, *others = (f"| {' | '.join(cells)} |" for cells in (head, *lines))
    return "\n".join([first, "|" + "---|" * len(head), *others])


def write_table(file: Path, content: Mapping[str, Any]) -> None:
    """Markdown: a table a family of figures, a line a method and, below it, one for each of its
    sets and categories."""
    write_text(file, "\n".join(_lines(content)) + "\n")


def print_table(content: Mapping[str, Any]) -> None:
    """A line a figure, a column a method: a terminal is narrower than it is high."""
    table = Table("", *content["methods"])
    for family, keys in _groups(content).items():
        table.add_section()
        table.add_row(f"[bold]{family}")
        for key in keys:
            rows = [method["rows"] for method in content["methods"].values()]
            cells = [_cell(row[key], row[FAILED]["count"]) for row in rows]
            table.add_row(_title(key, content), *cells)
    console = Console(highlight=False)
    console.print(table)
    for name, method in content["methods"].items():
        for line in _remarks(name, method):
            console.print(line, markup=False)


def _lines(content: Mapping[str, Any]) -> Iterator[str]:
    settings = content["settings"]
    yield (
        f"Reference {settings['reference']}. Samples of one object: {settings['samples']}. Mean "
        "and 95 % interval (bootstrap over objects, none where all agree); n = where a figure "
        "applies to fewer objects than there are; ↑ higher is better, ↓ lower."
    )
    for family, keys in _groups(content).items():
        yield f"\n## {family}\n"
        lines = []
        for name, method in content["methods"].items():
            lines.append(_line(_text(name), method["rows"], keys))
            for part in ("sets", "categories"):
                for group, rows in method[part].items():
                    lines.append(_line(f"{_text(name)}: {_text(group)}", rows, keys))
        yield markdown(["", "objects", *(_title(key, content) for key in keys)], lines)
    yield from _differences(content)
    for name, method in content["methods"].items():
        if remarks := list(_remarks(name, method)):
            yield ""
            yield from remarks
        if method["failures"]:
            yield f"\n## Failures of {_text(name)}\n"
            yield from (f"- {_text(n)}: {_text(why)}" for n, why in method["failures"].items())
        if method["confusion"]:
            yield f"\n## Joint types of {_text(name)}\n"
            yield from _confusion(method["confusion"])


def _differences(content: Mapping[str, Any]) -> Iterator[str]:
    """Each method minus the first, object by object."""
    found = content["differences"]
    if not found["methods"]:
        return
    yield f"\n## Differences to {_text(found['to'])}\n"
    yield (
        "Means over objects of the method's figure minus that of the first, and their 95 % "
        "intervals; one that holds 0 does not tell the two apart."
    )
    for family, keys in _groups(content).items():
        lines = [_line(_text(name), rows, keys) for name, rows in found["methods"].items()]
        yield ""
        yield markdown([family, "objects", *(_title(key, content) for key in keys)], lines)


def _groups(content: Mapping[str, Any]) -> dict[str, list[str]]:
    """Title of a family -> its figures."""
    groups: dict[str, list[str]] = content["groups"]
    return {TITLES.get(name, name): keys for name, keys in groups.items()}


def _title(key: str, content: Mapping[str, Any]) -> str:
    metric = content["metrics"][key]
    return f"{_text(metric['title'])} {'↑' if metric['better'] == 'higher' else '↓'}"


def _line(name: str, rows: Row, keys: list[str]) -> list[str]:
    objects = rows[FAILED]["count"]
    return [name, str(objects), *(_cell(rows[key], objects) for key in keys)]


def _cell(figure: Mapping[str, float], objects: float) -> str:
    """Mean and interval, and of how many objects where that is not all of them."""
    mean, low, high = (figure[key] for key in ("mean", "low", "high"))
    if math.isnan(mean):
        return "-"
    some = f" (n = {figure['count']:g})" if figure["count"] < objects else ""
    return with_interval(mean, math.nan if low == high else low, high) + some


def with_interval(mean: float, low: float, high: float, sign: str = "", most: int = 6) -> str:
    """``mean [low, high]``, or the mean alone where ``low`` is NaN, with three digits of what is
    largest, ``most`` behind the point; ``sign`` "+" writes that of numbers above 0 too."""
    ends = [] if math.isnan(low) else [low, high]
    largest = max(abs(value) for value in (mean, *ends))
    digits = min(max(2 - math.floor(math.log10(largest)), 1), most) if largest else 1
    told = [f"{value:{sign}.{digits}f}" for value in (mean, *ends)]
    return f"{told[0]} [{told[1]}, {told[2]}]" if ends else told[0]


def _remarks(name: str, method: Mapping[str, Any]) -> Iterator[str]:
    objects = len(method["objects"])
    if method["failures"]:
        yield (
            f"{name}: {len(method['failures'])} of {objects} objects have failures, counted with "
            "the worst values."
        )
    if method["uncolored"]:
        yield (
            f"{name}: {len(method['uncolored'])} of {objects} objects have no colours; for PSNR "
            "each part was given the mean colour of the true part that it was matched with, not "
            "its material."
        )


def _confusion(table: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    guesses = sorted({guess for row in table.values() for guess in row})
    lines = [[truth, *(f"{row.get(g, 0):g}" for g in guesses)] for truth, row in table.items()]
    yield markdown(["reference \\ prediction", *guesses], lines)


def _text(text: str) -> str:
    """Text of strangers in a cell of Markdown."""
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
