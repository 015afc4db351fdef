"""Results that stay: long work that was stopped goes on in the same folder, and never with results
of other settings."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from uniart_jax.runtime.files import write_text


def claim(out: Path, settings: dict[str, Any], what: str) -> None:
    """Begin in ``out``, or go on there with the same settings.

    Raises:
      ValueError: results of other settings lie there; ``what`` says in words what differs.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / "settings.json"
    if file.is_file() and read_kept(file) != settings:
        raise ValueError(f"{out}: it holds results of {what}; choose another --out")
    keep(file, settings)


def keep(file: Path, result: dict[str, Any]) -> dict[str, Any]:
    """Write a result, complete or not at all; returns it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, json.dumps(result, indent=2, allow_nan=False) + "\n")
    return result


def read_kept(file: Path) -> dict[str, Any] | None:
    """What ``keep`` wrote; None where nothing is, or nothing that can be read."""
    try:
        return json.loads(file.read_text())
    except (OSError, ValueError):
        return None


def without_nan(value: Any) -> Any:
    """Nested dictionaries and lists with None for the numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
