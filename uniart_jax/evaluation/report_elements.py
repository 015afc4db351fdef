"""Pieces of the report: numbers, tables and plots as HTML elements. Text is text: lxml escapes
whatever a name holds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from lxml.builder import E

from uniart_jax.objects.names import printable

MARKS = 8  # colours of methods
BINS = 24
WIDTH, HEIGHT = 240, 26  # of a plot, its own units
GROUND = 20  # where its bars stand; the interval is drawn below


def text(value: Any) -> str:
    """What a stranger wrote, in one line that HTML can hold."""
    return printable(str(value), "?")


def known(value: Any) -> bool:
    """Whether it is a number; figures that do not apply are None or NaN."""
    return value is not None and math.isfinite(value)


def decimals(values: Iterable[Any]) -> int:
    """How many digits behind the point a column gets: its largest value has four digits above 1,
    three up to 1; at most six places."""
    largest = max((abs(v) for v in values if known(v)), default=0.0)
    digits = 4 if largest > 1 else 3
    return int(np.clip(digits - math.ceil(math.log10(largest)), 0, 6)) if largest else 1


def number(value: Any, digits: int) -> str:
    return f"{value:.{digits}f}" if known(value) else "–"


def element(tag: str, *children: Any, **attributes: Any):
    """An element; ``class_`` is its class, ``stroke_width`` its stroke-width, empty attributes are
    left out."""
    given = {name.rstrip("_").replace("_", "-"): text(v) for name, v in attributes.items()}
    return E(tag, {name: value for name, value in given.items() if value}, *children)


def interval_cell(figure: Mapping[str, Any], digits: int, best: bool = False):
    """A mean above its interval."""
    cell = element("td", number(figure.get("mean"), digits))
    if known(figure.get("low")) and known(figure.get("high")):
        low, high = (number(figure[end], digits) for end in ("low", "high"))
        cell.append(element("small", f"[{low}, {high}]"))
    if best:
        cell.set("class", "best")
    return cell


def name_cell(name: str, mark: int | None = None, suffix: str = ""):
    cell = element("td", class_="name", title=name)
    if mark is None:
        cell.text = text(name) + suffix
    else:
        sign = element("span", class_=f"mark m{mark % MARKS}")
        sign.tail = text(name) + suffix
        cell.append(sign)
    return cell


def table(head: Sequence[Any], rows: Iterable[Any], names: int = 1):
    """A table that scrolls sideways if it must; ``head`` holds texts or elements, the first
    ``names`` columns are left-aligned."""
    cells = []
    for i, title in enumerate(head):
        cell = element("th", title)
        if i < names:
            cell.set("class", "name")
        cells.append(cell)
    content = element("table", element("thead", E.tr(*cells)), element("tbody", *rows))
    return element("div", content, class_="wide")


def clearly_best(figures: Mapping[str, Mapping[str, Any]], better: str) -> str | None:
    """The method whose interval lies wholly on the better side of every other's, if there are two
    and all have one."""
    if len(figures) < 2:
        return None
    if not all(known(f.get(end)) for f in figures.values() for end in ("mean", "low", "high")):
        return None
    sign = 1 if better == "higher" else -1
    best = max(figures, key=lambda method: sign * figures[method]["mean"])
    near, far = ("low", "high") if sign > 0 else ("high", "low")
    others = [f for method, f in figures.items() if method != best]
    return best if all(sign * figures[best][near] > sign * f[far] for f in others) else None


def histogram(
    values: Sequence[Any],
    figure: Mapping[str, Any],
    ends: tuple[float, float],
    mark: int,
):
    """An SVG of how values lie between ``ends``, their mean and its interval below."""
    lo, hi = ends
    place = lambda v: 1 + (v - lo) / (hi - lo) * (WIDTH - 2)  # noqa: E731
    svg = element("svg", viewBox=f"0 0 {WIDTH} {HEIGHT}", preserveAspectRatio="none")
    color = f"m{mark % MARKS}"
    found = np.array([v for v in values if known(v)], float)
    if len(found):
        counts, edges = np.histogram(found, BINS, ends)
        left = place(edges[:-1])
        path = "".join(
            f"M{x:.1f} {GROUND}v-{h:.1f}h{(WIDTH - 2) / BINS - 0.6:.1f}v{h:.1f}z"
            for x, h in zip(left, counts / counts.max() * (GROUND - 1), strict=True)
            if h
        )
        svg.append(element("path", d=path, class_=f"bars {color}"))
    line = {"x1": 0, "x2": WIDTH, "y1": GROUND, "y2": GROUND}
    svg.append(element("line", class_="ground", **line))
    below = GROUND + 3
    if known(figure.get("low")) and known(figure.get("high")):
        line = {"x1": f"{place(figure['low']):.1f}", "x2": f"{place(figure['high']):.1f}"}
        svg.append(element("line", class_=color, y1=below, y2=below, stroke_width=2, **line))
    if known(figure.get("mean")):
        x = f"{place(figure['mean']):.1f}"
        svg.append(element("line", class_=color, x1=x, x2=x, y1=0, y2=HEIGHT))
    return svg


def ends_of(values: Iterable[Any]) -> tuple[float, float]:
    """The range of a plot, never empty."""
    found = [v for v in values if known(v)]
    lo, hi = (min(found), max(found)) if found else (0.0, 1.0)
    room = 0.5 * abs(lo) or 0.5
    return (lo, hi) if hi - lo > 1e-9 * max(abs(lo), abs(hi)) else (lo - room, hi + room)
