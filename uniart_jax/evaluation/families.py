"""Families of figures: which there are, and all figures of one prediction against its truth.

A family is one module with ``METRICS`` and ``measure(pred, ref, **options)`` (``metric``).
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import math
import multiprocessing
import os
import sys
import time
from collections.abc import Mapping
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from uniart_jax.evaluation.metric import Figures, resting
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.runtime.processes import time_limit

# Family -> its module, loaded where it is needed.
FAMILIES = {
    name: f"uniart_jax.evaluation.{name}"
    for name in ("surface", "articulation", "pose_error", "singapo", "appearance", "openshape")
}


class Posed(NamedTuple):
    """An object as figures take it: at rest in metres (``metric.resting``), and made as large as
    all others (``metric.at_rest``)."""

    own: ArticulatedObject
    shown: ArticulatedObject


class Measured(NamedTuple):
    """What was measured of one prediction.

    Attributes:
      figures: NaN where there is nothing to compare; a family that failed has none.
      errors: of families that failed.
      seconds: of each family.
      confusion: (reference's joint type, prediction's) -> parts, of the family that counts them.
      uncolored: whether the prediction has no colours, if a family looks at them.
    """

    figures: Figures
    errors: dict[str, Exception]
    seconds: dict[str, float]
    confusion: dict[tuple[str, str], int]
    uncolored: bool


def posed(obj: ArticulatedObject) -> Posed:
    """The object as figures take it.

    Raises:
      ValueError: it holds coordinates that are not finite, or has no extent.
    """
    if not all(np.isfinite(part.mesh.vertices).all() for part in obj.parts):
        raise ValueError("its meshes hold coordinates that are not finite")
    own = resting(obj)
    return Posed(own, own.normalized())


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


@functools.cache
def load_family(name: str, module: str) -> ModuleType:
    """``family_module``. Where it needs jax, a worker runs that on the CPU with one thread, and
    compiled programs are kept for the next process."""
    if multiprocessing.parent_process() is not None and "jax" not in sys.modules:
        flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false"
        os.environ.update(JAX_PLATFORMS="cpu", NPROC="1", XLA_FLAGS=flags.strip())
    found = family_module(name, {name: module})
    if jax := sys.modules.get("jax"):
        if multiprocessing.parent_process() is not None:
            jax.config.update("jax_platforms", "cpu")
        from uniart_jax.runtime.compilation_cache import enable_compilation_cache

        enable_compilation_cache()
    return found


def measure_families(
    families: Mapping[str, str],
    pred: Posed,
    ref: Posed,
    *,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    limit: float | None = None,
) -> Measured:
    """All figures of these families; what one of them raises is in ``errors``, the others stand.

    Args:
      families: family -> module. options: family -> keywords of its ``measure``.
      limit: seconds for each family; None: none.
    """
    out = Measured({}, {}, {}, {}, False)
    for family, name in families.items():
        module = load_family(family, name)
        start = time.perf_counter()
        given = dict((options or {}).get(family, {}))
        if getattr(module, "OWN_UNITS", False):
            given["own"] = pred.own, ref.own
        try:
            with time_limit(limit) if limit else contextlib.nullcontext():
                found = module.measure(pred.shown, ref.shown, **given)
            _check(found, module)
            if hasattr(module, "confusion"):
                out.confusion.update(module.confusion(pred.shown, ref.shown))
            if hasattr(module, "uncolored"):
                out = out._replace(uncolored=bool(module.uncolored(pred.shown)))
        except Exception as error:  # figures of other families still stand
            out.errors[family] = error
        else:
            out.figures.update(found)
        out.seconds[family] = time.perf_counter() - start
    return out


def _check(figures: Figures, module: ModuleType) -> None:
    """Raises ValueError: they are not those of ``METRICS``, or one is infinite."""
    if set(figures) != set(module.METRICS):
        raise ValueError(f"expected the figures {sorted(module.METRICS)}, got {sorted(figures)}")
    if bad := [name for name, value in figures.items() if math.isinf(value)]:
        raise ValueError(f"'{bad[0]}' is infinite")
