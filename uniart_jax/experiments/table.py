"""The figures of arms as one table: ``table.md`` for people, ``metrics.json`` with everything.
Which intervals there are: ``intervals``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.evaluation.result_store import read_result, without_nan, write_result
from uniart_jax.evaluation.summary import LEVEL
from uniart_jax.evaluation.table import markdown, with_interval
from uniart_jax.experiments.design import Experiment
from uniart_jax.experiments.evaluate_arm import METRICS, TRUTH, parameter_count, test_names
from uniart_jax.experiments.intervals import difference, row, unpaired
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.runtime.files import write_text

FAILED = "failure.json"  # in a training's folder: why it has no result


@dataclasses.dataclass(frozen=True)
class Judged:
    """What is known of an arm.

    Attributes:
      seeds: that are judged completely.
      values: figure -> [S, N], NaN where there is nothing to compare.
      trained: whether seeds are trainings; else there is one, and it stands for all.
      failures: objects that failed, over all seeds. faulty: objects without a truth. broken:
        trainings without a result, and why.
      unfinished: trainings that are not judged on all objects yet, and on how many they are.
    """

    seeds: list[int]
    values: dict[str, np.ndarray]
    objects: int
    trained: bool
    failures: int
    faulty: int
    broken: dict[int, str]
    unfinished: dict[int, int]


def write_tables(experiment: Experiment, out: Path, count: int) -> dict[str, Any]:
    """Everything judged completely so far; returns what ``metrics.json`` holds, with NaN where that
    has null."""
    found = {name: collect(experiment, out, name, count) for name in experiment.arms}
    arms: dict[str, Any] = {}
    for name, judged in found.items():
        if not judged.seeds:
            continue
        arms[name] = {
            "seeds": judged.seeds,
            "objects": judged.objects,
            "parameters": parameters(experiment, name),
            "failures": judged.failures,
            "faulty": judged.faulty,
            "rows": {key: row(v) for key, v in judged.values.items()},
        }
        against = experiment.arms[name].reference or experiment.reference
        if name != against and found[against].seeds:
            arms[name] |= compare(experiment, name, against, found)
    columns = [key for key in experiment.columns if any(key in a["rows"] for a in arms.values())]
    content = {
        "reference": experiment.reference,
        "columns": columns,
        "objects": count,
        "level": LEVEL,
        "arms": arms,
        "broken": {name: judged.broken for name, judged in found.items() if judged.broken},
        "unfinished": {name: judged.unfinished for name, judged in found.items() if judged.unfinished},  # noqa: E501
        "metrics": {key: {"title": METRICS[key].title, "better": METRICS[key].better, "about": METRICS[key].about} for key in columns},  # noqa: E501
    }  # fmt: skip
    write_result(out / "metrics.json", without_nan(content))
    write_text(out / "table.md", "\n".join(lines(content)) + "\n")
    return content


def collect(experiment: Experiment, out: Path, name: str, count: int) -> Judged:
    """What lies in ``out`` of an arm."""
    names = test_names(experiment.arms[name].tests, count)
    seeds, rows, reasons, broken = [], [], [], {}
    folders = {int(p.name[5:]): p for p in (out / name).glob("seed-*") if p.name[5:].isdecimal()}
    unfinished = {}
    for seed, folder in sorted(folders.items()):
        if failed := read_result(folder / FAILED):
            broken[seed] = failed["failure"]
            continue
        results = [read_result(folder / "figures" / f"{n}.json") for n in names]
        if None in results:
            unfinished[seed] = len(results) - results.count(None)
            continue
        if len({tuple(sorted(result["figures"])) for result in results if result}) > 1:
            raise ValueError(
                f"{folder}: figures of several versions; remove that folder's figures/, and they "
                "are judged again"
            )
        seeds.append(seed)
        rows.append([result["figures"] for result in results if result])
        reasons += [result["failure"] for result in results if result and result["failure"]]
    keys = dict.fromkeys(key for row in rows for figures in row for key in figures)
    values = {
        key: np.array([[np.nan if (v := f.get(key)) is None else v for f in row] for row in rows], float)  # noqa: E501
        for key in keys
    }  # fmt: skip
    trained = bool(experiment.trained(name).stages)
    faulty = sum(reason.startswith(TRUTH) for reason in reasons)
    failures = len(reasons) - faulty
    return Judged(seeds, values, len(names), trained, failures, faulty, broken, unfinished)


def parameters(experiment: Experiment, name: str) -> int:
    """Of the networks that an arm is judged by."""
    arm, made = experiment.arms[name], experiment.trained(name)
    config = made.config if made.stages else Checkpoint.find(made.init).config
    return parameter_count(config.model, arm.pipeline_stage)


def compare(
    experiment: Experiment, name: str, against: str, found: dict[str, Judged]
) -> dict[str, Any]:
    """``against``, ``differences`` {figure: mean, low, high}, ``over`` what their intervals are,
    and of other objects ``kept``; {} without equal seeds."""
    one, other = found[name], found[against]
    shared = [key for key in one.values if key in other.values]
    if experiment.arms[name].tests != experiment.arms[against].tests:
        both = {k: unpaired(one.values[k], other.values[k], METRICS[k].better) for k in shared}
        return {
            "against": against,
            "over": "other objects",
            "differences": {key: v["difference"] for key, v in both.items()},
            "kept": {key: v["kept"] for key, v in both.items()},
        }
    ours, theirs = matched(one, other)
    if not ours:
        return {}
    return {
        "against": against,
        "over": "trainings" if len(ours) > 1 else "objects",
        "pairs": len(ours) if one.trained or other.trained else 0,
        "differences": {
            key: difference(one.values[key][ours], other.values[key][theirs]) for key in shared
        },
    }


def matched(one: Judged, other: Judged) -> tuple[list[int], list[int]]:
    """Rows of both that belong together: equal seeds; what is not trained, with every training of
    the other."""
    if one.trained and other.trained:
        both = [seed for seed in one.seeds if seed in other.seeds]
        return [one.seeds.index(s) for s in both], [other.seeds.index(s) for s in both]
    number = max(len(one.seeds) if one.trained else 1, len(other.seeds) if other.trained else 1)
    first, second = (list(range(number)) if j.trained else [0] * number for j in (one, other))
    return first, second


def lines(content: dict[str, Any]) -> list[str]:
    """Markdown: means, differences, what is kept on other objects, and what the intervals are."""
    columns, arms = content["columns"], content["arms"]
    arrows = {"higher": "↑", "lower": "↓"}
    titles = [
        f"{content['metrics'][c]['title']} {arrows[content['metrics'][c]['better']]}"
        for c in columns
    ]
    rows = []
    for name, arm in arms.items():
        numbers = [str(len(arm["seeds"])), str(arm["objects"]), f"{arm['parameters']:,}"]
        rows.append([name, *numbers, *(cell(arm["rows"].get(c)) for c in columns)])
    text = [markdown(["arm", "seeds", "objects", "parameters", *titles], rows)]
    for key, title, sign in (("differences", "minus", "+"), ("kept", "share kept of", "")):
        some = {name: arm for name, arm in arms.items() if key in arm}
        rows = [
            [name, arm["against"], over(arm), *(cell(arm[key].get(c), sign) for c in columns)]
            for name, arm in some.items()
        ]
        if some:
            text += ["", markdown(["arm", title, "interval over", *titles], rows)]
    text += ["", f"In brackets: {content['level']:.0%} intervals, of means over objects."]
    if any("one training" in over(arm) for arm in arms.values() if "over" in arm):
        text += ["Over objects of one training: of these networks, no evidence on what was varied."]
    for key, told in (
        ("failures", "of which something failed, counted with the worst values"),
        ("faulty", "left out, because the truth is at fault"),
    ):
        if some := [f"{name} {arm[key]}" for name, arm in arms.items() if arm[key]]:
            text += ["", f"Objects {told}: {', '.join(some)}."]
    for name, broken in content["broken"].items():
        told = "; ".join(f"seed {seed}: {reason}" for seed, reason in broken.items())
        text += ["", f"Trainings of {name} without a result, in no figure above: {told}."]
    for name, unfinished in content["unfinished"].items():
        told = ", ".join(
            f"seed {seed}: {number} of {content['objects']}" for seed, number in unfinished.items()
        )
        text += ["", f"Not yet judged on all objects, in no figure above: {name} ({told})."]
    return text


def over(arm: dict[str, Any]) -> str:
    """What an arm's interval of its difference is over, in words."""
    if arm["over"] == "trainings":
        return f"{arm['pairs']} trainings"
    return "objects, one training" if arm.get("pairs") == 1 else arm["over"]


def cell(figure: dict[str, float] | None, sign: str = "") -> str:
    """``mean [low, high]`` with three digits of what is largest."""
    if figure is None or np.isnan(figure["mean"]):
        return "-"
    return with_interval(figure["mean"], figure["low"], figure["high"], sign, most=5)
