"""One prediction against its reference: all figures, or why there are none. This is what a worker
process of ``compare`` does."""

from __future__ import annotations

import collections
import dataclasses
import errno
import functools
import gc
import json
import math
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from uniart_jax.evaluation.families import Posed, load_family, measure_families, posed
from uniart_jax.evaluation.pairs import Missing, Source
from uniart_jax.evaluation.physics_checks import read_checks
from uniart_jax.evaluation.runner import DIED, Passing, error_line
from uniart_jax.objects.facing import faced
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.runtime.processes import time_limit

PHYSICS = "physics"  # figures that the assets' own files tell
_PASSING = {
    errno.ENOMEM,
    errno.EMFILE,
    errno.ENFILE,
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.ESTALE,
}


@dataclasses.dataclass(frozen=True)
class Reading:
    """How files are read: ``allow_outside``, ``within`` as ``load_object`` takes them, ``front`` as
    ``facing.faced``."""

    allow_outside: bool = False
    within: Path | None = None
    front: str = "-x"


@dataclasses.dataclass(frozen=True)
class Setup:
    """What all comparisons share.

    Attributes:
      families: family -> module, of ``families.FAMILIES``.
      options: family -> keywords of its ``measure``.
      limit: seconds for reading an object, and for each family of figures.
    """

    families: Mapping[str, str]
    options: Mapping[str, Mapping[str, Any]]
    limit: float = 600.0


@dataclasses.dataclass(frozen=True)
class Reference:
    """A truth; equal to another one if its fingerprint is."""

    name: str
    source: Source = dataclasses.field(compare=False)
    made_of: str
    reading: Reading = Reading()


@dataclasses.dataclass(frozen=True)
class Comparison:
    """One sample of one method.

    Attributes:
      made_of: fingerprint of prediction and reference; a kept result of another one is not taken.
      file: where the result is kept.
    """

    method: str
    sample: int
    prediction: Source | Missing
    reference: Reference
    made_of: str
    file: Path
    reading: Reading = Reading()


def compare_one(setup: Setup, one: Comparison) -> dict[str, Any] | Passing:
    """The figures of one prediction.

    Returns:
      ``figures`` {metric: number or None for "nothing to compare"}; a metric that is absent could
      not be measured, and ``failure`` says why. ``inapplicable``: those of the absent for which
      this reference has nothing to compare. Also ``category`` (the reference's), ``uncolored``,
      ``confusion``, ``seconds`` {step: s}. What failed for want of memory, of time
      (``Setup.limit``) or of room on a disk is ``Passing``.

    Raises:
      ValueError: the reference is at fault; no figure could be trusted.
    """
    gc.collect()  # meshes hold themselves in cycles: a worker would grow by 10 MB an object
    result = _blank(one)
    start = time.perf_counter()
    reference = load_reference(one.reference)
    result["category"] = reference.own.category or _category(one.reference.source)
    result["confusion"] = _all_missing(setup, reference.own)
    result["seconds"]["reference"] = time.perf_counter() - start
    if isinstance(one.prediction, Missing):
        return _failed(setup, one, result | {"failure": one.prediction.why})
    start = time.perf_counter()
    try:
        with time_limit(setup.limit):
            prediction = load_posed(one.prediction, one.reading)
    except Exception as error:  # one prediction must not cost the figures of all others
        failed = _failed(setup, one, result | {"failure": error_line(error)})
        return Passing(failed) if _passing(error) else failed
    result["seconds"]["prediction"] = time.perf_counter() - start
    made = measure_families(
        setup.families, prediction, reference, options=setup.options, limit=setup.limit
    )
    result["seconds"] |= made.seconds
    result["figures"] = _numbers(made.figures)
    result["confusion"] = _nested(made.confusion) if made.confusion else result["confusion"]
    result["uncolored"] = made.uncolored
    result["failure"] = "; ".join(f"{name}: {error_line(e)}" for name, e in made.errors.items())
    result["inapplicable"] = _inapplicable(setup, one.reference, made.errors)
    if isinstance(one.prediction, Path):
        checks = read_checks(one.prediction, allow_outside=one.reading.allow_outside)
        result["figures"] |= _numbers(checks)
    return Passing(result) if any(map(_passing, made.errors.values())) else result


def _failed(setup: Setup, one: Comparison, result: dict[str, Any]) -> dict[str, Any]:
    """The result of a prediction without any figure."""
    return result | {"inapplicable": _inapplicable(setup, one.reference, setup.families)}


def died(one: Comparison) -> Passing:
    """The result of a comparison that killed its worker; with fewer processes or more memory it
    may come through."""
    return Passing(_blank(one) | {"failure": DIED})


@functools.lru_cache(maxsize=1)  # several predictions of one object come one after the other
def load_reference(reference: Reference) -> Posed:
    """The truth as figures take it.

    Raises:
      ValueError: it cannot be used; one line that names it.
    """
    try:
        return load_posed(reference.source, reference.reading)
    except Exception as error:
        why = error_line(error)
        raise ValueError(f"reference '{reference.name}' cannot be used: {why}") from None


def load_posed(source: Source, reading: Reading = Reading()) -> Posed:
    """The object as figures take it.

    Args:
      reading: of a file; what is in memory stands as it should.

    Raises:
      ValueError, FileNotFoundError: it cannot be read, or holds numbers that are none.
    """
    if isinstance(source, Path):
        found = load_object(source, allow_outside=reading.allow_outside, within=reading.within)
        source = faced(found, reading.front)
    return posed(source if isinstance(source, ArticulatedObject) else source())


def _blank(one: Comparison) -> dict[str, Any]:
    return {
        "method": one.method,
        "name": one.reference.name,
        "sample": one.sample,
        "made_of": one.made_of,
        "category": "",
        "figures": {},
        "inapplicable": [],
        "failure": "",
        "uncolored": False,
        "confusion": {},
        "seconds": {},
    }


def _inapplicable(setup: Setup, reference: Reference, families: Iterable[str]) -> list[str]:
    """The figures of these families that have nothing to compare even where the reference is held
    against itself: no prediction can have them."""
    found: list[str] = []
    for family in families:
        known = reference.name, reference.made_of, family
        if known not in _NOTHING:
            truth, module = load_reference(reference), {family: setup.families[family]}
            alone = measure_families(module, truth, truth, options=setup.options, limit=setup.limit)
            _NOTHING[known] = [key for key, v in alone.figures.items() if math.isnan(v)]
        found += _NOTHING[known]
    return found


# By name, fingerprint and family, not by object: a worker would hold them all. Of failed
# predictions there may be many.
_NOTHING: dict[tuple[str, str, str], list[str]] = {}


def _all_missing(setup: Setup, reference: ArticulatedObject) -> dict[str, dict[str, int]]:
    """The confusion of joint types with nothing: what a prediction counts as that cannot be
    read."""
    modules = [load_family(family, module) for family, module in setup.families.items()]
    missing = next((m.MISSING for m in modules if hasattr(m, "confusion")), None)
    if missing is None:
        return {}
    counts = collections.Counter(part.joint.type for part in reference.parts)
    return _nested({(kind, missing): count for kind, count in counts.items()})


def _nested(table: Mapping[tuple[str, str], int]) -> dict[str, dict[str, int]]:
    """{reference's type: {prediction's type: parts}}, as JSON has it."""
    rows: dict[str, dict[str, int]] = {}
    for (truth, guess), count in sorted(table.items()):
        rows.setdefault(truth, {})[guess] = int(count)
    return rows


def _category(source: Source) -> str:
    """What an asset folder of ours says that it is; "" where it is none."""
    report = source / "report.json" if isinstance(source, Path) else None
    if report is None or not report.is_file() or report.is_symlink():
        return ""
    try:
        found = json.loads(report.read_text(encoding="utf-8")).get("category", "")
    except (ValueError, AttributeError):
        return ""
    return found if isinstance(found, str) else ""


def _numbers(figures: Mapping[str, float]) -> dict[str, float | None]:
    """As JSON has them: None for NaN."""
    return {name: None if math.isnan(v) else float(v) for name, v in figures.items()}


def _passing(error: Exception) -> bool:
    """Whether it may not come again: the machine was at fault rather than the asset."""
    return (
        isinstance(error, MemoryError | TimeoutError) or getattr(error, "errno", None) in _PASSING
    )
