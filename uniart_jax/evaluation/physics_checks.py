"""What physics engines said of an asset when it was validated: read from its own files, never run
here.

``validation.json`` (``uniart validate``, ``uniart evaluate physics``) tells every check and every
joint, ``report.json`` (written with the asset) the checks alone. An asset with neither, or with one
that cannot be read, has no figures: where another asset of the same method has them it counts with
the worst, so that validating only what is sound does not pay.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.evaluation.metric import Figures, Metric
from uniart_jax.objects.json_text import parse_json
from uniart_jax.simulation.primitives import REACH
from uniart_jax.simulation.sweep import DEPTH

BESIDE = ("geometry", "plausibility")  # checks that no engine ran
MAX_BYTES = 64 * 2**20
METRICS = {
    "sound": Metric(
        "sound",
        "higher",
        0.0,
        "Share of assets that pass every check, in every physics engine that ran and without, "
        "as the asset's own files say; one that was not validated counts as 0 where another of "
        "the method was.",
    ),
    "joints_work": Metric(
        "joints work",
        "higher",
        0.0,
        f"Share of driven joints that come to {REACH:.0%} of their range without running into "
        "anything, as validation.json says; 0 where an engine refused the asset, and for an asset "
        "without that file where another of the method has it.",
    ),
}


def read_checks(asset: Path, *, allow_outside: bool = False) -> Figures:
    """Those figures of the asset at ``asset`` that its files tell; NaN: it was validated and has no
    joint that was driven."""
    folder = asset if asset.is_dir() else asset.parent
    validation = _read(folder / "validation.json", folder, allow_outside)
    if "engines" in validation:
        beside = {name: validation.get(name) for name in BESIDE}
        checks = {**_dict(validation["engines"]), **beside}
    else:
        checks = _dict(_read(folder / "report.json", folder, allow_outside).get("validation"))
    passed = [
        _dict(c).get("passed") is True for where in checks.values() for c in _dict(where).values()
    ]
    ran = any(_dict(where) for engine, where in checks.items() if engine not in BESIDE)
    refused = any(_dict(_dict(c).get("loads")).get("passed") is False for c in checks.values())
    works = [
        _works(_dict(joint))
        for joints in _dict(validation.get("joints")).values()
        for joint in _dict(joints).values()
    ]
    told: Figures = {"sound": float(all(passed))} if ran else {}
    if refused:  # in that engine no joint works
        told["joints_work"] = 0.0
    elif "joints" in validation:
        told["joints_work"] = float(np.mean(works)) if works else np.nan
    return told


def _works(joint: dict[str, Any]) -> bool:
    reached, collision = joint.get("reached"), joint.get("collision")
    if not isinstance(reached, int | float) or not isinstance(collision, int | float):
        return False
    return reached >= REACH and collision <= DEPTH


def _read(file: Path, folder: Path, allow_outside: bool) -> dict[str, Any]:
    if not allow_outside and not file.resolve().is_relative_to(folder.resolve()):
        return {}
    try:
        with file.open("rb") as opened:
            return _dict(parse_json(opened.read(MAX_BYTES + 1), file.name, MAX_BYTES))
    except (OSError, ValueError):
        return {}


def _dict(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
