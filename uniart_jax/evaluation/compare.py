"""Predictions against references: every family of figures over every object, for one method or
several. ``uniart evaluate PRED REF``.

    OUT/metrics.json    {"methods": {method: {"rows", "categories", "sets", "objects", "failures", "drawn", "uncolored", "confusion"}},
                        "differences": {"to": the first method, "methods": {each other: rows}},
                          "metrics", "groups", "settings"}
    OUT/table.md        a table a family of figures, a line a method
    OUT/report.html     the same for people: distributions, and pictures of the worst
    OUT/results/<method>/<name>/<sample>.json     one prediction's figures, written when they are there

Work that was stopped goes on with the same command: a result is taken as it is if its prediction
and its reference have not changed. A bad prediction is a failure that counts with the worst values;
a bad reference is an error, since nothing can be held against it.
"""  # noqa: E501

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import uniart_jax
from uniart_jax.evaluation import physics_checks
from uniart_jax.evaluation.articulation import MISSING, SURPLUS
from uniart_jax.evaluation.comparison import (
    PHYSICS,
    Comparison,
    Reading,
    Reference,
    Setup,
    compare_one,
    died,
    load_posed,
    load_reference,
)
from uniart_jax.evaluation.families import FAMILIES, family_module
from uniart_jax.evaluation.metric import Metric
from uniart_jax.evaluation.pairs import (
    Missing,
    Pair,
    Predictions,
    Source,
    check_out,
    find_pairs,
    find_references,
    fingerprint,
    read_sets,
    shared_files,
)
from uniart_jax.evaluation.report import write_report
from uniart_jax.evaluation.result_store import ResultStore, check_settings
from uniart_jax.evaluation.runner import DIED, run, write_metrics
from uniart_jax.evaluation.summary import (
    FAILED,
    FAILED_METRIC,
    LEVEL,
    RESAMPLES,
    SEED,
    Samples,
    chosen_samples,
    drawn_sample,
    object_figures,
    paired_differences,
    sum_confusions,
    summarize_objects,
)
from uniart_jax.evaluation.table import print_table, write_table
from uniart_jax.objects.facing import FRONTS, check_front
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.runtime.progress import messages

# Raised when a kept result would have other numbers or fields: older ones are not taken.
RESULTS = 2
Results = dict[tuple[str, str, int], dict[str, Any]]  # method, object, sample
console = messages()


def compare(
    methods: Mapping[str, Predictions],
    reference: Path | Mapping[str, Source],
    out: Path,
    *,
    only: Sequence[str] | None = None,
    samples: Samples = "mean",
    processes: int = 1,
    allow_outside: bool = False,
    openshape: Path | None = None,
    front: str = "-x",
    ref_front: str = "-x",
    families: Mapping[str, str] = FAMILIES,
) -> dict[str, Any]:
    """Hold each method's predictions against the references; writes what the module's head lists
    and prints a table.

    Args:
      methods: name -> folder of assets, or {object: object or several, as files, in memory, or
        functions that make them}.
      reference: folder of assets, or {object: the same}.
      only: families of figures; default all, "openshape" where its weights are given.
      samples: how several samples of an object become one figure (``summary``).
      processes: worker processes; 1 = this one.
      allow_outside: follow links out of the folders and read what assets name outside them.
      front, ref_front: which way predictions and references face in their own frame, of
        ``facing.FRONTS``, where they are files.
      openshape: its converted weights.
      families: name -> module with ``METRICS`` and ``measure``.

    Returns:
      What ``metrics.json`` holds, with NaN where that has null.

    Raises:
      FileNotFoundError: a folder that is not there or holds nothing. ValueError: no name in common,
        a reference that cannot be used, results of something else in ``out``, figures that cannot
        be had.
    """
    out = Path(out)
    check_front(front, "evaluate: front")
    check_front(ref_front, "evaluate: ref-front")
    groups, metrics = _metrics(only, openshape, families)
    if samples == "best" and "pose_error" not in groups:
        raise ValueError(
            "evaluate: the best sample is the one with the smallest pose error: add pose_error to "
            "--only"
        )
    references = find_references(reference, allow_outside=allow_outside)
    sets = read_sets(reference, list(references)) if isinstance(reference, Path) else {}
    pairs: dict[str, list[Pair]] = {}
    for method, predictions in methods.items():
        pairs[method], surplus = find_pairs(predictions, references, allow_outside=allow_outside)
        if surplus:
            console.print(
                f"{method}: {len(surplus)} without a reference are left out: "
                f"{', '.join(surplus[:5])}{', ...' if len(surplus) > 5 else ''}",
                markup=False,
            )
    check_out(
        out,
        [*references.values(), *(x for found in pairs.values() for p in found for x in p.samples)],
    )
    settings = {
        "reference": _said(reference),
        "methods": {method: _said(p) for method, p in methods.items()},
        "figures": list(groups),
        "openshape": f"{openshape} {fingerprint(openshape)}" if openshape else "",
        "allow_outside": allow_outside,
        "version": uniart_jax.__version__,
        "results": RESULTS,
    }
    turned = {"front": front, "ref_front": ref_front}
    settings |= {key: value for key, value in turned.items() if value != FRONTS[0]}
    check_settings(out, settings, "other predictions, references or figures")
    if only is None and openshape is None and "openshape" in families:
        module = family_module("openshape", families)
        console.print(f"OpenShape similarity is {module.NOT_COMPUTED}", markup=False)
    options = {"openshape": {"weights": openshape}} if openshape else {}
    setup = Setup({name: families[name] for name in groups if name != PHYSICS}, options)
    readings = {m: _reading(p, reference, allow_outside, front) for m, p in methods.items()}
    shared = {m: shared_files(p, pairs[m], out) for m, p in methods.items()}
    shared_truth = shared_files(reference, pairs[next(iter(pairs))], out)
    reading = _reading(reference, next(iter(methods.values())), allow_outside, ref_front)
    work = list(_comparisons(pairs, out, readings, shared, reading, shared_truth))
    results = _run(setup, work, processes)
    _tell_of_refusals(results)
    content = {
        "methods": {
            method: _method(method, found, results, metrics, groups, samples, sets)
            for method, found in pairs.items()
        },
        "metrics": {
            key: {"title": m.title, "better": m.better, "about": m.about}
            for key, m in {**metrics, FAILED: FAILED_METRIC}.items()
        },
        "groups": {"failures": [FAILED], **groups},
        "settings": {
            **settings,
            "samples": samples,
            "interval": {
                "level": LEVEL,
                "resamples": RESAMPLES,
                "seed": SEED,
                "method": "percentile bootstrap over objects",
            },
        },
    }
    first, *others = content["methods"]
    content["differences"] = {
        "to": first,
        "methods": {
            method: paired_differences(*(content["methods"][m]["objects"] for m in (method, first)))
            for method in others
        },
    }
    write_metrics(out, content)
    write_table(out / "table.md", content)
    with console.status("drawing the worst"):
        write_report(out, content, functools.partial(_load_pair, work, results, content["methods"]))
    print_table(content)
    return content


def _metrics(
    only: Sequence[str] | None, openshape: Path | None, families: Mapping[str, str]
) -> tuple[dict[str, list[str]], dict[str, Metric]]:
    """The figures of every family that is wanted, and what they are."""
    known = [*families, PHYSICS]
    if only is None:
        only = [name for name in known if name != "openshape" or openshape]
    if unknown := [name for name in only if name not in known]:
        raise ValueError(
            f"evaluate: no figures are called '{unknown[0]}'; there are {', '.join(known)}"
        )
    if "openshape" in only and openshape is None:
        raise ValueError("evaluate: the figures 'openshape' need weights: --openshape WEIGHTS")
    if "openshape" in only:
        family_module("openshape", families).load(openshape)  # a mistake shows before the work
    groups: dict[str, list[str]] = {}
    metrics: dict[str, Metric] = {}
    for name in (n for n in known if n in only):
        module = physics_checks if name == PHYSICS else family_module(name, families)
        if repeated := set(metrics) & set(module.METRICS):
            raise ValueError(
                f"evaluate: two families have a figure '{min(repeated)}', one is {name}"
            )
        groups[name] = list(module.METRICS)
        metrics |= module.METRICS
    if not metrics:
        raise ValueError(f"evaluate: no figures were chosen; there are {', '.join(known)}")
    return groups, metrics


def _reading(source: Predictions, other: Predictions, allow_outside: bool, front: str) -> Reading:
    """Assets of one folder may share what lies in it; not where the ``other`` side lies in it too,
    whose meshes a prediction could name as its own."""
    within = source if isinstance(source, Path) and source.is_dir() else None
    if within and isinstance(other, Path) and other.resolve().is_relative_to(within.resolve()):
        within = None
    return Reading(allow_outside, within, front)


def _comparisons(
    pairs: Mapping[str, list[Pair]],
    out: Path,
    readings: Mapping[str, Reading],
    shared: Mapping[str, str],
    reading: Reading,
    shared_truth: str,
) -> Iterator[Comparison]:
    """All samples of all methods, those of one object one after the other.

    Args:
      readings, shared: of each method; ``reading``, ``shared_truth``: of the references. What is
        shared is what ``pairs.shared_files`` gives.
    """
    for same in zip(*pairs.values(), strict=True):
        source = same[0].reference
        reference = Reference(
            same[0].name, source, fingerprint(source, out) + shared_truth, reading
        )
        for method, pair in zip(pairs, same, strict=True):
            for i, prediction in enumerate(pair.samples):
                file = out / "results" / method / pair.name / f"{i}.json"
                made_of = f"{fingerprint(prediction, out)}{shared[method]} {reference.made_of}"
                yield Comparison(method, i, prediction, reference, made_of, file, readings[method])


def _tell_of_refusals(results: Results) -> None:
    """Where none of a method's predictions could be read and one named files outside its folder."""
    for method in dict.fromkeys(m for m, *_ in results):
        found = [r for (m, *_), r in results.items() if m == method]
        refused = [r["failure"] for r in found if "--allow-outside" in r["failure"]]
        if refused and not any(r["figures"] for r in found):
            console.print(
                f"{method}: no prediction could be read, the first because: {refused[0]}",
                markup=False,
                soft_wrap=True,
            )


def _run(setup: Setup, work: Sequence[Comparison], processes: int) -> Results:
    """All results, those that lie there and those that are missing."""
    store = ResultStore[Comparison](
        lambda one: one.file, lambda one, found: found.get("made_of") == one.made_of
    )
    compare = functools.partial(compare_one, setup)
    made = run(compare, work, "comparisons", processes=processes, store=store, died=died)
    return _with_known(
        {
            (one.method, one.reference.name, one.sample): result
            for one, result in zip(work, made, strict=True)
        }
    )


def _with_known(results: Results) -> Results:
    """Results of workers that died, with what other results of the object tell of its truth:
    category, parts to be found, figures that nothing can have."""
    known: dict[str, list[dict[str, Any]]] = {}
    for (_, name, _), result in results.items():
        if result["failure"] != DIED:
            known.setdefault(name, []).append(result)
    filled = {}
    for key, result in results.items():
        others = known.get(key[1], [])
        if result["failure"] == DIED and others:
            confusion = next((o["confusion"] for o in others if o["confusion"]), {})
            missing = {
                kind: {MISSING: sum(row.values())}
                for kind, row in confusion.items()
                if kind != SURPLUS
            }
            lacking = [
                {k for k, v in o["figures"].items() if v is None} | {*o["inapplicable"]}
                for o in others
            ]
            result = result | {
                "category": others[0]["category"],
                "confusion": missing,
                "inapplicable": sorted(set.intersection(*lacking) - set(physics_checks.METRICS)),
            }
        filled[key] = result
    return filled


def _method(
    method: str,
    pairs: Sequence[Pair],
    results: Results,
    metrics: Mapping[str, Metric],
    groups: Mapping[str, list[str]],
    samples: Samples,
    sets: Mapping[str, str],
) -> dict[str, Any]:
    """Everything that is told of one method."""
    by_name = {p.name: [results[method, p.name, i] for i in range(len(p.samples))] for p in pairs}
    every = [r for found in by_name.values() for r in found]
    optional = [
        key for key in groups.get(PHYSICS, []) if all(r["figures"].get(key) is None for r in every)
    ]  # nobody validated anything: not computed rather than failed
    chosen, objects, failures, categories, drawn = {}, {}, {}, {}, {}
    for name, found in by_name.items():
        chosen[name] = chosen_samples(found, metrics, samples, _best_by(groups))
        drawn[name] = drawn_sample(chosen[name], metrics, _best_by(groups))
        objects[name], why = object_figures(chosen[name], metrics, optional)
        if why:
            failures[name] = why
        categories[name] = next((r["category"] for r in found if r["category"]), "")
    parts = {
        "categories": _grouped(categories),
        "sets": _grouped(sets),
    }
    return {
        "rows": summarize_objects(objects, list(objects)),
        **{
            part: {group: summarize_objects(objects, names) for group, names in members.items()}
            for part, members in parts.items()
        },
        "objects": objects,
        "failures": failures,
        "drawn": {
            p.name: _called(p.samples[drawn[p.name]], drawn[p.name])
            for p in pairs
            if len(p.samples) > 1
        },
        "uncolored": [name for name, found in chosen.items() if any(r["uncolored"] for r in found)],
        "confusion": sum_confusions(list(chosen.values())),
    }


def _load_pair(
    work: Sequence[Comparison],
    results: Results,
    methods: Mapping[str, Mapping[str, Any]],
    method: str,
    name: str,
) -> tuple[ArticulatedObject, ArticulatedObject]:
    """Prediction and reference to be drawn: of several samples that which ``drawn`` names.

    Raises:
      ValueError: there is no such prediction, or it could not be read: it is not tried again, here
        nothing would stop it.
    """
    same = [t for t in work if (t.method, t.reference.name) == (method, name)]
    called = methods[method]["drawn"].get(name)
    one = next(t for t in same if called in (None, _called(t.prediction, t.sample)))
    found = results[method, name, one.sample]
    if isinstance(one.prediction, Missing) or not found["figures"]:
        raise ValueError(found["failure"])
    reference = load_reference(one.reference)
    return load_posed(one.prediction, one.reading).shown, reference.shown


def _called(prediction: Source | Missing, sample: int) -> str:
    """The name of a sample: of its folder or file, or its number."""
    return prediction.name if isinstance(prediction, Path) else f"sample {sample}"


def _best_by(groups: Mapping[str, list[str]]) -> str:
    return next(iter(groups.get("pose_error", [])), "")


def _grouped(groups: Mapping[str, str]) -> dict[str, list[str]]:
    """Group -> its members, both in alphabetical order; what has no group is left out."""
    members: dict[str, list[str]] = {}
    for name, group in sorted(groups.items()):
        if group:
            members.setdefault(group, []).append(name)
    return dict(sorted(members.items()))


def _said(source: Path | Mapping[str, Any]) -> str:
    return str(source) if isinstance(source, Path) else "in memory"
