"""Means of figures, differences between arms, and their 95 % intervals: over what they are, is
always said.

* ``trainings``: arms that were trained more than once, on the same objects: Student's t over the
  differences of equal seeds, which see equal batches. What was not trained has one value, which is
  held against every training of the other.
* ``objects``: of one training, or none. A bootstrap over the objects' paired differences: how sure
  the figure of *these* networks is. Another training would give others, so it is no evidence about
  what was varied in training.
* ``other objects``: arms on different objects. Both bootstrapped, independently; also the share
  that is kept.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from scipy import stats

from uniart_jax.evaluation.summary import LEVEL, SEED, interval, resampled


def row(values: np.ndarray) -> dict[str, Any]:
    """Mean of [S, N] over trainings and objects, its interval over objects, and each training's
    mean."""
    objects = known(over_seeds(values))
    low, high = interval(objects)
    return {
        "mean": float(objects.mean()) if len(objects) else float("nan"),
        "low": low,
        "high": high,
        "seeds": [float(np.nanmean(v)) if not np.isnan(v).all() else float("nan") for v in values],
    }


def difference(values: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """Mean of [S, N] minus another [S, N] of the same seeds and objects; with one seed an interval
    over objects, else over seeds."""
    apart = values - reference
    if np.isnan(apart).all():
        return {key: float("nan") for key in ("mean", "low", "high")}
    if len(apart) == 1:
        low, high = interval(known(apart[0]))
        return {"mean": float(np.nanmean(apart)), "low": low, "high": high}
    by_seed = np.array([known(v).mean() for v in apart if len(known(v))])
    mean, half = by_seed.mean(), half_width(by_seed)
    return {"mean": float(mean), "low": float(mean - half), "high": float(mean + half)}


def half_width(values: np.ndarray) -> float:
    """Half of Student's t interval of the mean of [n]; NaN of one."""
    n = len(values)
    if n < 2:
        return float("nan")
    return float(stats.t.ppf((1 + LEVEL) / 2, n - 1) * values.std(ddof=1) / n**0.5)


def unpaired(
    values: np.ndarray, reference: np.ndarray, better: Literal["higher", "lower"]
) -> dict[str, dict[str, float]]:
    """[S, N] against [S', N'] on other objects.

    Returns:
      "difference": of the means. "kept": the share of the reference that is kept, over 1 where this
        is better: this / reference where higher is better, else
      reference / this.
    """
    ours, theirs = (known(over_seeds(v)) for v in (values, reference))
    nothing = {key: float("nan") for key in ("mean", "low", "high")}
    if not len(ours) or not len(theirs):
        return {"difference": nothing, "kept": nothing}
    rng = np.random.default_rng(SEED)
    draws = [resampled(v, rng) for v in (ours, theirs)]
    means = [np.array([v.mean()]) for v in (ours, theirs)]

    def told(of: Any) -> dict[str, float]:
        with np.errstate(divide="ignore", invalid="ignore"):
            mean, many = of(*means)[0], of(*draws)
        if not np.isfinite(mean):
            return nothing
        few = min(len(ours), len(theirs)) < 2 or not np.isfinite(many).all()
        tail = (1 - LEVEL) / 2
        low, high = (np.nan, np.nan) if few else np.quantile(many, [tail, 1 - tail])
        return {"mean": float(mean), "low": float(low), "high": float(high)}

    ratio = (lambda a, b: a / b) if better == "higher" else (lambda a, b: b / a)
    return {"difference": told(lambda a, b: a - b), "kept": told(ratio)}


def over_seeds(values: np.ndarray) -> np.ndarray:
    """[N] mean of [S, N] over the trainings where it is known; NaN where it never is."""
    there = ~np.isnan(values)
    total = np.where(there, values, 0).sum(0)
    return np.where(there.any(0), total / np.maximum(there.sum(0), 1), np.nan)


def known(values: np.ndarray) -> np.ndarray:
    """Without NaN."""
    return values[~np.isnan(values)]
