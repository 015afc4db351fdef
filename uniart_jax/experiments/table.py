"""The figures of arms as one table: ``table.md`` for people, ``metrics.json`` with everything.

Two things are random, and each has its interval:

* *objects*: an arm's mean over test objects, each first averaged over the trainings, has a percentile bootstrap over objects;
* *trainings*: the difference of an arm from the reference arm, on the same objects, has Student's t interval over seeds, paired by seed
  (equal seeds see equal batches). With one seed only, a percentile bootstrap over objects of their paired differences instead; for arms on
  other objects there is no pairing, and no difference is told.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from uniart_jax.evaluation.kept import keep, read_kept, without_nan
from uniart_jax.evaluation.summary import LEVEL, interval
from uniart_jax.experiments.design import Experiment
from uniart_jax.experiments.judge import METRICS, test_names

Values = dict[str, np.ndarray]  # figure -> [S, N], NaN where there is nothing to compare


def write_tables(experiment: Experiment, out: Path, count: int) -> dict[str, Any]:
    """Everything judged completely so far; returns what ``metrics.json`` holds, with NaN where that has null."""
    found = {name: collect(experiment, out, name, count) for name in experiment.arms}
    arms: dict[str, Any] = {}
    for name, (seeds, values, failures) in found.items():
        if not seeds:
            continue
        arms[name] = {
            "seeds": seeds,
            "objects": count,
            "failures": failures,
            "rows": {key: row(v) for key, v in values.items()},
        }
    tests = {name: arm.tests for name, arm in experiment.arms.items()}
    for name in arms:
        if name == experiment.reference or tests[name] != tests[experiment.reference]:
            continue
        pairs = matched_seeds(found[name], found[experiment.reference])
        if pairs is not None:
            ours, theirs = pairs
            arms[name]["differences"] = {k: difference(ours[k], theirs[k]) for k in ours}
    columns = [key for key in experiment.columns if any(key in a["rows"] for a in arms.values())]
    content = {
        "reference": experiment.reference,
        "columns": columns,
        "level": LEVEL,
        "arms": arms,
        "metrics": {key: {"title": METRICS[key].title, "better": METRICS[key].better, "about": METRICS[key].about} for key in columns},
    }  # fmt: skip
    keep(out / "metrics.json", without_nan(content))
    partial = out / "table.new"
    partial.write_text("\n".join(lines(content)) + "\n", encoding="utf-8")
    partial.replace(out / "table.md")
    return content


def collect(
    experiment: Experiment, out: Path, name: str, count: int
) -> tuple[list[int], Values, int]:
    """The seeds of an arm that are judged completely, their figures, and how many objects failed in them."""
    names = test_names(experiment.arms[name].tests, count)
    seeds, rows, failures = [], [], 0
    for folder in sorted((out / name).glob("seed-*"), key=lambda p: int(p.name[5:])):
        results = [read_kept(folder / "figures" / f"{n}.json") for n in names]
        if any(result is None for result in results):
            continue
        seeds.append(int(folder.name[5:]))
        rows.append([result["figures"] for result in results if result])
        failures += sum(bool(result["failure"]) for result in results if result)
    keys = list(rows[0][0]) if rows else []
    values = {
        key: np.array([[np.nan if (v := f[key]) is None else v for f in row] for row in rows], float)
        for key in keys
    }  # fmt: skip
    return seeds, values, failures


def matched_seeds(
    one: tuple[list[int], Values, int], other: tuple[list[int], Values, int]
) -> tuple[Values, Values] | None:
    """Both arms' figures of the seeds that both have; None where there are none, or not the same figures."""
    both = [s for s in one[0] if s in other[0]]
    if not both or one[1].keys() != other[1].keys():
        return None
    first, second = (
        {key: v[[seeds.index(s) for s in both]] for key, v in values.items()}
        for seeds, values, _ in (one, other)
    )
    return first, second


def row(values: np.ndarray) -> dict[str, Any]:
    """Mean of [S, N] over trainings and objects, its interval over objects, and each training's mean."""
    objects = over_seeds(values)
    objects = objects[~np.isnan(objects)]
    low, high = interval(objects)
    return {
        "mean": float(objects.mean()) if len(objects) else float("nan"),
        "low": low,
        "high": high,
        "seeds": [float(np.nanmean(v)) if not np.isnan(v).all() else float("nan") for v in values],
    }


def difference(values: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """Mean of [S, N] minus another [S, N] of the same seeds and objects, and its interval (the module's head)."""
    apart = values - reference
    known = ~np.isnan(apart)
    if not known.any():
        return dict.fromkeys(("mean", "low", "high"), float("nan"))
    if len(apart) == 1:
        low, high = interval(apart[0][known[0]])
        return {"mean": float(np.nanmean(apart)), "low": low, "high": high}
    by_seed = np.array([v[k].mean() for v, k in zip(apart, known, strict=True) if k.any()])
    number, mean = len(by_seed), by_seed.mean()
    half = np.nan
    if number > 1:
        half = stats.t.ppf((1 + LEVEL) / 2, number - 1) * by_seed.std(ddof=1) / number**0.5
    return {"mean": float(mean), "low": float(mean - half), "high": float(mean + half)}


def over_seeds(values: np.ndarray) -> np.ndarray:
    """[N] mean of [S, N] over the trainings where it is known; NaN where it never is."""
    known = ~np.isnan(values)
    total = np.where(known, values, 0).sum(0)
    return np.where(known.any(0), total / np.maximum(known.sum(0), 1), np.nan)


def lines(content: dict[str, Any]) -> list[str]:
    """Markdown: means, then differences from the reference."""
    columns, arms = content["columns"], content["arms"]
    arrows = {"higher": "↑", "lower": "↓"}
    titles = [f"{content['metrics'][c]['title']} {arrows[content['metrics'][c]['better']]}" for c in columns]  # fmt: skip
    text = [
        f"| arm | seeds | objects | {' | '.join(titles)} |",
        "|" + "---|" * (len(columns) + 3),
    ]
    for name, arm in arms.items():
        cells = [cell(arm["rows"].get(c)) for c in columns]
        text.append(f"| {name} | {len(arm['seeds'])} | {arm['objects']} | {' | '.join(cells)} |")
    apart = {name: arm["differences"] for name, arm in arms.items() if "differences" in arm}
    if apart:
        text += [
            "",
            f"| minus {content['reference']} | {' | '.join(titles)} |",
            "|" + "---|" * (len(columns) + 1),
        ]
        for name, found in apart.items():
            cells = [cell(found.get(c), sign="+") for c in columns]
            text.append(f"| {name} | {' | '.join(cells)} |")
    failed = [f"{name} {arm['failures']}" for name, arm in arms.items() if arm["failures"]]
    if failed:
        text += ["", f"Objects without a result, counted with the worst values: {', '.join(failed)}."]  # fmt: skip
    return text


def cell(figure: dict[str, float] | None, sign: str = "") -> str:
    """``mean [low, high]`` with three digits of what is largest."""
    if figure is None or np.isnan(figure["mean"]):
        return "-"
    mean, low, high = (figure[key] for key in ("mean", "low", "high"))
    ends = [] if np.isnan(low) else [low, high]
    largest = max(abs(v) for v in (mean, *ends))
    digits = min(max(2 - int(np.floor(np.log10(largest))), 1), 5) if largest else 1
    told = [f"{v:{sign}.{digits}f}" for v in (mean, *ends)]
    return f"{told[0]} [{told[1]}, {told[2]}]" if ends else told[0]
