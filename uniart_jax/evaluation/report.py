"""``report.html``: a comparison for people, in one file that any browser opens from disk, without
scripts and without a network.

Tables of all figures, how they are distributed, the worst predictions under their truths, joint
types, failures by name and reason. What ``compare`` writes to ``metrics.json`` is all that goes in,
besides the objects that are drawn. The page's policy (CSP) lets nothing run and nothing be fetched,
whatever an object is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import lxml.html

from uniart_jax.evaluation.report_elements import (
    clearly_best,
    decimals,
    element,
    ends_of,
    histogram,
    interval_cell,
    known,
    name_cell,
    number,
    table,
    text,
)
from uniart_jax.evaluation.report_pictures import data_uri, draw_pair
from uniart_jax.evaluation.table import TITLES
from uniart_jax.export.html_page import content_hash, fill
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.runtime.files import write_text

WORST = 10  # predictions of each method that are drawn
WORST_BY = "pose_error"
SHADES = 5  # of a table of joint types
NO_TYPES = ("missing", "surplus")  # rows and columns of such a table that are no types
Pair = tuple[ArticulatedObject, ArticulatedObject]
LoadPair = Callable[[str, str], Pair]
Content = Mapping[str, Any]


def write_report(out: Path, content: Content, load_pair: LoadPair | None = None) -> Path:
    """Write ``out/report.html``, complete or not at all.

    Args:
      content: {"methods": {name: {"rows": {metric: {"mean", "low", "high", "count"}}, "objects":
        {object: {metric: value}},
        "categories", "sets": {group: rows}, "failures": {object: why}, "confusion": {truth: {guess:
          count}}, "uncolored": [object],
        "drawn": {object: name of the sample}}},
        "metrics": {metric: {"title", "better", "about"}}, "groups": {family: [metric]}, "settings":
          {...}}; all but rows, objects and metrics
        may be absent, and values None or NaN.
      load_pair: (method, object) -> (prediction, reference), both from ``metric.at_rest``; None:
        nothing is drawn.
    """
    files = resources.files("uniart_jax.evaluation") / "report_files"
    style = (files / "report.css").read_text("utf-8")
    holes = {
        "policy": f"default-src 'none'; style-src {content_hash(style)}; img-src data:; "
        "base-uri 'none'; form-action 'none'",
        "style": style,
        "body": lxml.html.tostring(_page(content, load_pair), encoding="unicode"),
    }
    page = fill((files / "template.html").read_text("utf-8"), holes)
    file = Path(out) / "report.html"
    write_text(file, page)
    return file


def worst_objects(method: Content, by: str = WORST_BY) -> list[str]:
    """The objects of a method that have the figure, the largest first, then by name."""
    values = {name: figures.get(by) for name, figures in method["objects"].items()}
    return sorted((n for n in values if known(values[n])), key=lambda n: (-values[n], n))


def _page(content: Content, load_pair: LoadPair | None):
    sections = {
        "Summary": _summary(content),
        "Worst": _worst(content, load_pair),
        "Distributions": _distributions(content),
        "Sets": _grouped(content, "sets"),
        "Categories": _grouped(content, "categories"),
        "Joint types": _confusions(content),
        "Failures": _failures(content),
        "Objects": _objects(content),
        "Settings": _settings(content),
    }
    methods = content["methods"]
    count = max((len(m["objects"]) for m in methods.values()), default=0)
    page = element(
        "main",
        element("h1", "Evaluation"),
        element("p", f"{count} objects · {', '.join(map(text, methods))}", class_="soft"),
    )
    nav = element("nav")
    page.append(nav)
    for title, parts in sections.items():
        if found := list(parts):
            anchor = title.lower().replace(" ", "-")
            nav.append(element("a", title, href=f"#{anchor}"))
            page.append(element("section", element("h2", title), *found, id=anchor))
    return page


def _families(content: Content) -> dict[str, list[str]]:
    """Title of a family -> its figures; those of no family come last."""
    groups: dict[str, list[str]] = {
        str(TITLES.get(name, name)): keys for name, keys in content.get("groups", {}).items()
    }
    rest = [key for key in content["metrics"] if all(key not in keys for keys in groups.values())]
    return {**groups, "Other" if groups else "Figures": rest} if rest else groups


def _title(content: Content, key: str) -> str:
    metric = content["metrics"][key]
    return (
        f"{text(metric['title'])}\N{NO-BREAK SPACE}{'↑' if metric['better'] == 'higher' else '↓'}"
    )


def _heads(content: Content, keys: list[str]) -> list:
    return [element("span", _title(content, k), title=content["metrics"][k]["about"]) for k in keys]


def _digits(content: Content, key: str) -> int:
    return decimals(m["rows"].get(key, {}).get("mean") for m in content["methods"].values())


def _summary(content: Content) -> Iterator:
    methods = content["methods"]
    note = "Mean over objects and its interval; ↑ higher is better, ↓ lower."
    if interval := content.get("settings", {}).get("interval"):
        note += f" Intervals: {_said(interval)}."
    if len(methods) > 1:
        note += (
            " Green: better than every other method with intervals that do not overlap; a value "
            "that is not green may still be better, for the methods met the same objects."
        )
    yield element("p", note, class_="soft")
    for family, keys in _families(content).items():
        rows = []
        best = {
            key: clearly_best(
                {name: m["rows"].get(key, {}) for name, m in methods.items()},
                content["metrics"][key]["better"],
            )
            for key in keys
        }
        for mark, (name, method) in enumerate(methods.items()):
            cells = []
            for key in keys:
                figure = method["rows"].get(key, {})
                cell = interval_cell(figure, _digits(content, key), best[key] == name)
                if known(figure.get("count")) and figure["count"] < len(method["objects"]):
                    cell.append(element("small", f"n = {figure['count']:g}"))
                cells.append(cell)
            rows.append(element("tr", name_cell(name, mark), *cells))
        yield element("h3", family)
        yield table(["", *_heads(content, keys)], rows)
    for name, method in methods.items():
        total = len(method["objects"])
        if bare := method.get("uncolored"):
            yield element(
                "p",
                f"{text(name)}: {len(bare)} of {total} objects without colours; for PSNR each part "
                "was given the mean colour of the true part that it was matched with, not its "
                "material (†).",
            )
        if failed := method.get("failures"):
            yield element(
                "p",
                f"{text(name)}: {len(failed)} of {total} objects with failures, counted with the "
                "worst values.",
            )


def _worst(content: Content, load_pair: LoadPair | None) -> Iterator:
    if load_pair is None or WORST_BY not in content["metrics"]:
        return
    title = text(content["metrics"][WORST_BY]["title"])
    yield element(
        "p",
        f"The largest {title} first. Truth above, prediction below; the same colour says that the "
        "parts were matched; lines are axes, arrows the way that sliding parts open.",
        class_="soft",
    )
    for i, (name, method) in enumerate(content["methods"].items()):
        shown = list(_pairs(content, name, method, load_pair))
        box = element("details", element("summary", f"{text(name)}: worst {len(shown)}"), *shown)
        if i == 0:
            box.set("open", "")
        yield box


def _pairs(content: Content, name: str, method: Content, load_pair: LoadPair) -> Iterator:
    place = 0
    for obj in worst_objects(method):
        if place == WORST:
            return
        try:
            drawn = element("img", src=data_uri(draw_pair(*load_pair(name, obj))), alt=obj)
        except Exception as error:  # one picture must not cost the report
            if obj in method.get("failures", {}):  # there is nothing to draw, as that list tells
                continue
            drawn = element("p", f"No picture: {text(error) or type(error).__name__}")
        place += 1
        figures = method["objects"][obj]
        digits = _digits(content, WORST_BY)
        head = (
            f"{place}. {text(obj)}: {text(content['metrics'][WORST_BY]['title'])} "
            f"{number(figures[WORST_BY], digits)}"
        )
        if obj in (drawn_samples := method.get("drawn", {})):
            head += f" (drawn: {text(drawn_samples[obj])})"
        told = [
            element("div", element("dt", text(content["metrics"][key]["title"])),
                    element("dd", number(value, _digits(content, key))))
            for key, value in figures.items() if key in content["metrics"]
        ]  # fmt: skip
        yield element("article", element("h4", head), drawn, element("dl", *told), class_="pair")


def _distributions(content: Content) -> Iterator:
    methods = content["methods"]
    yield element(
        "p",
        "Objects by figure, from the smallest to the largest value of any method. Upright line: "
        "the mean; bar below: its interval.",
        class_="soft",
    )
    for family, keys in _families(content).items():
        panels = []
        for key in keys:
            values = {n: [f.get(key) for f in m["objects"].values()] for n, m in methods.items()}
            ends = ends_of(v for found in values.values() for v in found)
            digits = _digits(content, key)
            rows = []
            for mark, (name, method) in enumerate(methods.items()):
                figure = method["rows"].get(key, {})
                plot = element("td", histogram(values[name], figure, ends, mark), class_="plot")
                mean = element("td", number(figure.get("mean"), digits))
                rows.append(element("tr", name_cell(name, mark), plot, mean))
            scale = element("div", *(element("span", number(end, digits)) for end in ends))
            foot = element("tr", element("td"), element("td", scale), element("td"))
            panels.append(
                element("div", element("h4", _title(content, key)),
                        element("p", text(content["metrics"][key]["about"])),
                        element("table", element("tbody", *rows), element("tfoot", foot)),
                        class_="panel")
            )  # fmt: skip
        yield element("h3", family)
        yield element("div", *panels, class_="panels")


def _grouped(content: Content, part: str) -> Iterator:
    """Tables over the groups of ``part``, "sets" or "categories"."""
    methods = content["methods"]
    groups = dict.fromkeys(group for m in methods.values() for group in m.get(part, {}))
    if not groups:
        return
    for i, (family, keys) in enumerate(_families(content).items()):
        rows = []
        for group in groups:
            first = True
            for mark, (name, method) in enumerate(methods.items()):
                if (found := method.get(part, {}).get(group)) is None:
                    continue
                counts = [f["count"] for f in found.values() if known(f.get("count"))]
                rows.append(
                    element("tr", name_cell(group if first else ""), name_cell(name, mark),
                            element("td", f"{max(counts):g}" if counts else "–"),
                            *(interval_cell(found.get(k, {}), _digits(content, k)) for k in keys),
                            class_="first" if first else "")
                )  # fmt: skip
                first = False
        grid = table(
            [part[:-1] if part == "sets" else "category", "method", "n", *_heads(content, keys)],
            rows,
            2,
        )
        box = element("details", element("summary", family), grid)
        if i == 0:
            box.set("open", "")
        yield box


def _confusions(content: Content) -> Iterator:
    matrices = []
    for name, method in content["methods"].items():
        if not (found := method.get("confusion")):
            continue
        guesses = _ordered(guess for row in found.values() for guess in row)
        rows = []
        for truth in _ordered(found):
            row = found[truth]
            total = sum(row.values())
            cells = []
            for guess in guesses:
                count = row.get(guess, 0)
                share = count / total if total else 0.0
                kind = f"s{round(SHADES * share)}" + (" right" if guess == truth else "")
                cell = element("td", f"{count:g}", class_=kind, title=f"{share:.0%} of {truth}")
                cells.append(cell)
            rows.append(element("tr", name_cell(truth), *cells))
        grid = table(["truth \\ prediction", *map(text, guesses)], rows)
        matrices.append(element("div", element("h3", text(name)), grid))
    if matrices:
        yield element("div", *matrices, class_="matrices")


def _ordered(types: Iterable[str]) -> list[str]:
    """Joint types by name, those that are none behind them."""
    return sorted(set(types), key=lambda name: (name in NO_TYPES, name))


def _failures(content: Content) -> Iterator:
    rows = [
        element("tr", name_cell(name, mark), name_cell(obj), element("td", text(why), class_="reason"))  # noqa: E501
        for mark, (name, method) in enumerate(content["methods"].items())
        for obj, why in method.get("failures", {}).items()
    ]  # fmt: skip
    yield table(["method", "object", "reason"], rows, 3) if rows else element("p", "None.")


def _objects(content: Content) -> Iterator:
    """Every figure of every object."""
    methods = content["methods"]
    names = dict.fromkeys(obj for m in methods.values() for obj in m["objects"])
    for family, keys in _families(content).items():
        digits = {key: _digits(content, key) for key in keys}
        rows = []
        for obj in names:
            first = True
            for mark, (name, method) in enumerate(methods.items()):
                if obj not in method["objects"]:
                    continue
                figures = method["objects"][obj]
                sign = " †" if obj in method.get("uncolored", ()) else ""
                kinds = ["first"] * first + ["failed"] * (obj in method.get("failures", {}))
                cells = (element("td", number(figures.get(k), digits[k])) for k in keys)
                rows.append(
                    element(
                        "tr",
                        name_cell(obj, None, sign),
                        name_cell(name, mark),
                        *cells,
                        class_=" ".join(kinds),
                    )
                )
                first = False
        grid = table(["object", "method", *_heads(content, keys)], rows, 2)
        yield element("details", element("summary", f"{family}: {len(names)} objects"), grid)


def _settings(content: Content) -> Iterator:
    rows = [
        element("tr", name_cell(key), element("td", text(_said(value)), class_="reason"))
        for key, value in content.get("settings", {}).items()
    ]
    if rows:
        yield table(["", "value"], rows, 2)


def _said(value: Any) -> str:
    """A setting in words: {"level": 0.95, "n": 3} is "level 0.95, n 3"."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_said(item)}" for key, item in value.items())
    return ", ".join(map(_said, value)) if isinstance(value, list | tuple) else str(value)
