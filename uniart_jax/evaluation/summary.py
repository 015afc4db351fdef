"""From figures of single predictions to figures of methods: over samples, then over objects, with
95 % intervals.

Samples of one object are brought to one number first, so that an object counts once however often
it was sampled:

* ``mean``: the mean over samples, a failed sample with the worst value wherever the reference has
  something to compare;
* ``best``: the sample with the smallest pose error, one sample for all figures and not the best of
  each;
* ``first``: the first sample.

Intervals are percentile bootstraps over objects (2,000 resamples, always the same), never over
samples, which are not independent. A figure that does not apply to an object (None) is left out of
means; ``count`` tells for how many it does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from uniart_jax.evaluation.metric import Figures, Metric

Samples = Literal["mean", "best", "first"]
RESAMPLES = 2000
LEVEL = 0.95
SEED = 0
CHUNK = 1 << 22  # resampled values in memory at a time
FAILED = "failed"
FAILED_METRIC = Metric(
    "failed",
    "lower",
    1.0,
    "Share of predictions that are missing, cannot be read, or made a figure fail; what could not "
    "be measured counts with the worst value.",
)


def chosen_samples(
    results: Sequence[Mapping[str, Any]],
    metrics: Mapping[str, Metric],
    samples: Samples,
    best_by: str = "",
) -> list[Mapping[str, Any]]:
    """The samples of one object that count.

    Args:
      results: of ``comparison.compare_one``, in the samples' order.
      best_by: the figure that ``best`` goes by; of equals the first.
    """
    if samples == "mean":
        return list(results)
    if samples == "first":
        return [results[0]]
    values = _losses(results, metrics, best_by)
    return [results[int(np.argmin(np.where(np.isnan(values), np.inf, values)))]]


def drawn_sample(
    results: Sequence[Mapping[str, Any]], metrics: Mapping[str, Metric], worst_by: str
) -> int:
    """Of the samples that count, the number of that which a picture should show: the worst that has
    figures, as it tells most about the mean."""
    good = [result for result in results if result["figures"]] or list(results)
    if worst_by not in metrics:
        return int(good[0]["sample"])
    values = _losses(good, metrics, worst_by)
    return int(good[int(np.argmax(np.where(np.isnan(values), -np.inf, values)))]["sample"])


def _losses(
    results: Sequence[Mapping[str, Any]], metrics: Mapping[str, Metric], key: str
) -> np.ndarray:
    """[N] a figure of each sample, lower is better; NaN where it does not apply."""
    sign = 1 if metrics[key].better == "lower" else -1
    return np.array([sign * _filled(result, metrics, ())[key] for result in results])


def object_figures(
    results: Sequence[Mapping[str, Any]],
    metrics: Mapping[str, Metric],
    optional: Sequence[str] = (),
) -> tuple[Figures, str]:
    """One object's figures from the samples that count, and why any of them failed ("" if none
    did).

    Args:
      optional: figures that a failed prediction lacks rather than has at their worst.
    """
    rows = [_filled(result, metrics, optional) for result in results]
    figures = {key: mean_known([row[key] for row in rows]) for key in rows[0]}
    failures = [result["failure"] for result in results if result["failure"]]
    why = "; ".join(dict.fromkeys(failures))
    some = 0 < len(failures) < len(results)
    return figures, f"{len(failures)} of {len(results)} samples: {why}" if some else why


def summarize_objects(
    objects: Mapping[str, Figures], names: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Metric -> {"mean", "low", "high", "count"} over the objects called ``names``; NaN where
    nothing applies, no interval for one object."""
    keys = list(next(iter(objects.values())))
    table = np.array([[objects[name][key] for key in keys] for name in names])
    rows = {}
    for key, column in zip(keys, table.T, strict=True):
        known = column[~np.isnan(column)]
        low, high = interval(known)
        rows[key] = {"mean": mean_known(known), "low": low, "high": high, "count": len(known)}
    return rows


def paired_differences(
    objects: Mapping[str, Figures], others: Mapping[str, Figures]
) -> dict[str, dict[str, float]]:
    """``summarize_objects`` of each object's figure minus the same object's in ``others``: what two
    methods' own intervals, of the same objects, do not tell."""
    apart = {
        name: {key: value - others[name][key] for key, value in figures.items()}
        for name, figures in objects.items()
    }
    return summarize_objects(apart, list(apart))


def interval(values: np.ndarray) -> tuple[float, float]:
    """Percentile bootstrap of the mean of [n] values; NaN for fewer than two."""
    if len(values) < 2:
        return np.nan, np.nan
    tail = (1 - LEVEL) / 2
    means = resampled(values, np.random.default_rng(SEED))
    low, high = np.quantile(means, [tail, 1 - tail])
    return float(low), float(high)


def resampled(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """[RESAMPLES] means of [n] values drawn with replacement."""
    n = len(values)
    step = max(1, CHUNK // n)
    means = [
        values[rng.integers(0, n, (min(step, RESAMPLES - start), n))].mean(1)
        for start in range(0, RESAMPLES, step)
    ]
    return np.concatenate(means)


def sum_confusions(objects: Sequence[Sequence[Mapping[str, Any]]]) -> dict[str, dict[str, float]]:
    """{reference's joint type: {predicted type: parts}} over objects, of each the mean over its
    samples that count; types sorted."""
    total: dict[str, dict[str, float]] = {}
    for results in objects:
        for result in results:
            for truth, row in result["confusion"].items():
                into = total.setdefault(truth, {})
                for guess, count in row.items():
                    into[guess] = into.get(guess, 0) + count / len(results)
    return {truth: dict(sorted(row.items())) for truth, row in sorted(total.items())}


def _filled(
    result: Mapping[str, Any], metrics: Mapping[str, Metric], optional: Sequence[str]
) -> Figures:
    """Every metric's value: NaN where nothing is to be compared, the worst where something was and
    could not be measured."""
    found = result["figures"]
    row = {}
    for key, metric in metrics.items():
        absent = None if key in optional or key in result.get("inapplicable", ()) else metric.worst
        value = found.get(key, absent)
        row[key] = np.nan if value is None else float(value)
    return row | {FAILED: float(bool(result["failure"]))}


def mean_known(values: Sequence[float] | np.ndarray) -> float:
    known = [v for v in values if not np.isnan(v)]
    return float(np.mean(known)) if known else float("nan")
