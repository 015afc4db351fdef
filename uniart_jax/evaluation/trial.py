"""One prediction against its reference: all figures, or why there are none. This is what a worker
process does."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import errno
import functools
import gc
import importlib
import json
import math
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from uniart_jax.evaluation.kept import keep
from uniart_jax.evaluation.kept_checks import read_checks
from uniart_jax.evaluation.metric import resting
from uniart_jax.evaluation.pairs import Missing, Source
from uniart_jax.objects.facing import faced
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.robot_object import one_line
from uniart_jax.processes import time_limit

# Family -> module with METRICS and measure(pred, ref, **options); loaded where it is needed.
FAMILIES = {
    name: f"uniart_jax.evaluation.{name}"
    for name in ("surface", "articulation", "pose_error", "singapo", "appearance", "openshape")
}
PHYSICS = "physics"  # figures that the assets' own files tell
DIED = "its worker process died (out of memory, a crash in C, or a call that never came back)"
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
    """What all trials share.

    Attributes:
      families: family -> module, of ``FAMILIES``. options: family -> keywords of its ``measure``.
      limit: seconds for reading an object, and for each family of figures.
    """

    families: Mapping[str, str]
    options: Mapping[str, Mapping[str, Any]]
    limit: float = 600.0


class Seen(NamedTuple):
    """An object as figures see it: at rest in metres (``metric.resting``), and made as large as all
    others (``metric.at_rest``)."""

    own: ArticulatedObject
    shown: ArticulatedObject


@dataclasses.dataclass(frozen=True)
class Reference:
    """A truth; equal to another one if its fingerprint is."""

    name: str
    source: Source = dataclasses.field(compare=False)
    made_of: str
    reading: Reading = Reading()


@dataclasses.dataclass(frozen=True)
class Trial:
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


def family_module(name: str, families: Mapping[str, str] = FAMILIES) -> ModuleType:
    """The module of a family of figures.

    Raises:
      ValueError: it is not there.
    """
    try:
        return importlib.import_module(families[name])
    except ModuleNotFoundError as error:
        raise ValueError(
            f"the figures '{name}' cannot be loaded ({error}); leave them out with --only"
        ) from None


def run_trial(setup: Setup, trial: Trial) -> dict[str, Any]:
    """The figures of one prediction; kept in ``trial.file``.

    Returns:
      ``figures`` {metric: number or None for "nothing to compare"}; a metric that is absent could
      not be measured, and ``failure`` says
      why. ``inapplicable``: those of the absent for which this reference has nothing to compare.
        Also ``category`` (the reference's), ``uncolored``,
      ``confusion``, ``seconds`` {step: s}. What failed for want of memory, of time
      (``Setup.limit``) or of room on a disk is not kept.

    Raises:
      ValueError: the reference is at fault; no figure could be trusted.
    """
    gc.collect()  # meshes hold themselves in cycles: a worker would grow by 10 MB an object
    result = _blank(trial)
    start = time.perf_counter()
    reference = see_reference(trial.reference)
    result["category"] = reference.own.category or _category(trial.reference.source)
    result["confusion"] = _all_missing(setup, reference.own)
    result["seconds"]["reference"] = time.perf_counter() - start
    if isinstance(trial.prediction, Missing):
        return _failed(setup, trial, result | {"failure": trial.prediction.why})
    start = time.perf_counter()
    try:
        with time_limit(setup.limit):
            prediction = see(trial.prediction, trial.reading)
    except Exception as error:  # one prediction must not cost the figures of all others
        return _failed(setup, trial, result | {"failure": _why(error)}, _passing(error))
    result["seconds"]["prediction"] = time.perf_counter() - start
    errors = _measure(setup, prediction, reference, result)
    result["failure"] = "; ".join(f"{family}: {_why(error)}" for family, error in errors.items())
    result["inapplicable"] = _inapplicable(setup, trial.reference, errors)
    if isinstance(trial.prediction, Path):
        checks = read_checks(trial.prediction, allow_outside=trial.reading.allow_outside)
        result["figures"] |= _numbers(checks)
    return result if any(map(_passing, errors.values())) else keep(trial.file, result)


def _failed(
    setup: Setup, trial: Trial, result: dict[str, Any], passing: bool = False
) -> dict[str, Any]:
    """The result of a prediction without any figure; kept unless what was wrong may not come
    again."""
    result["inapplicable"] = _inapplicable(setup, trial.reference, setup.families)
    return result if passing else keep(trial.file, result)


def died(trial: Trial) -> dict[str, Any]:
    """The result of a trial that killed its worker; not kept, since with fewer processes or more
    memory it may come through."""
    return _blank(trial) | {"failure": DIED}


@functools.lru_cache(maxsize=1)  # several predictions of one object come one after the other
def see_reference(reference: Reference) -> Seen:
    """The truth as figures see it.

    Raises:
      ValueError: it cannot be used; one line that names it.
    """
    try:
        return see(reference.source, reference.reading)
    except Exception as error:
        raise ValueError(f"reference '{reference.name}' cannot be used: {_why(error)}") from None


def see(source: Source, reading: Reading = Reading()) -> Seen:
    """The object as figures see it.

    Args:
      reading: of a file; what is in memory stands as it should.

    Raises:
      ValueError, FileNotFoundError: it cannot be read, or holds numbers that are none.
    """
    if isinstance(source, Path):
        found = load_object(source, allow_outside=reading.allow_outside, within=reading.within)
        source = faced(found, reading.front)
    obj = source if isinstance(source, ArticulatedObject) else source()
    if not all(np.isfinite(part.mesh.vertices).all() for part in obj.parts):
        raise ValueError("its meshes hold coordinates that are not finite")
    own = resting(obj)
    return Seen(own, own.normalized())


@contextlib.contextmanager
def light_jax(processes: int) -> Iterator[None]:
    """Worker processes started inside run JAX on the CPU with one thread; this process is left as
    it is."""
    wanted = {
        "JAX_PLATFORMS": "cpu",
        "NPROC": "1",  # XLA's pool of threads
        "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false".strip(),  # noqa: E501
    }
    before = {name: os.environ.get(name) for name in wanted}
    if processes > 1:
        os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _blank(trial: Trial) -> dict[str, Any]:
    return {
        "method": trial.method,
        "name": trial.reference.name,
        "sample": trial.sample,
        "made_of": trial.made_of,
        "category": "",
        "figures": {},
        "inapplicable": [],
        "failure": "",
        "uncolored": False,
        "confusion": {},
        "seconds": {},
    }


def _measure(
    setup: Setup,
    prediction: Seen,
    reference: Seen,
    result: dict[str, Any],
) -> dict[str, Exception]:
    """Every family's figures, into ``result``; what went wrong in those that have none."""
    errors: dict[str, Exception] = {}
    shown = prediction.shown, reference.shown
    for family in setup.families:
        module = _loaded(family, setup.families[family])
        start = time.perf_counter()
        options = dict(setup.options.get(family, {}))
        if getattr(module, "OWN_UNITS", False):
            options["own"] = prediction.own, reference.own
        try:
            with time_limit(setup.limit):
                found = module.measure(*shown, **options)
            if set(found) != set(module.METRICS):
                raise ValueError(
                    f"expected the figures {sorted(module.METRICS)}, got {sorted(found)}"
                )
            numbers = _numbers(found)
            if hasattr(module, "confusion"):
                result["confusion"] = _nested(module.confusion(*shown))
            if hasattr(module, "uncolored"):
                result["uncolored"] = bool(module.uncolored(prediction.shown))
        except Exception as error:  # figures of other families still stand
            errors[family] = error
        else:
            result["figures"] |= numbers
        result["seconds"][family] = time.perf_counter() - start
    return errors


def _inapplicable(setup: Setup, reference: Reference, families: Iterable[str]) -> list[str]:
    """The figures of these families that have nothing to compare even where the reference is held
    against itself: no prediction can have them."""
    found: list[str] = []
    for family in families:
        known = reference.name, reference.made_of, family
        if known not in _NOTHING:
            alone = dataclasses.replace(setup, families={family: setup.families[family]})
            lone = {"confusion": {}, "uncolored": False, "seconds": {}, "figures": {}}
            truth = see_reference(reference)
            _measure(alone, truth, truth, lone)
            nothing = [key for key, value in lone["figures"].items() if value is None]
            _NOTHING[known] = nothing
        found += _NOTHING[known]
    return found


# By name, fingerprint and family, not by object: a worker would hold them all. Of failed
# predictions there may be many.
_NOTHING: dict[tuple[str, str, str], list[str]] = {}


@functools.cache
def _loaded(family: str, module: str) -> ModuleType:
    found = family_module(family, {family: module})
    if "jax" in sys.modules:
        from uniart_jax.pipeline import enable_compilation_cache

        enable_compilation_cache()
    return found


def _all_missing(setup: Setup, reference: ArticulatedObject) -> dict[str, dict[str, int]]:
    """The confusion of joint types with nothing: what a prediction counts as that cannot be
    read."""
    modules = [_loaded(family, module) for family, module in setup.families.items()]
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
    """As JSON has them: None for NaN.

    Raises:
      ValueError: one is infinite.
    """
    for name, value in figures.items():
        if math.isinf(value):
            raise ValueError(f"'{name}' is infinite")
    return {name: None if math.isnan(v) else float(v) for name, v in figures.items()}


def _passing(error: Exception) -> bool:
    """Whether it may not come again: the machine was at fault rather than the asset."""
    return (
        isinstance(error, MemoryError | TimeoutError) or getattr(error, "errno", None) in _PASSING
    )


def _why(error: Exception) -> str:
    text = one_line(str(error))
    if isinstance(error, ValueError | OSError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
