"""Results that stay: long work that was stopped goes on in the same folder, and never with results
of other settings."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from uniart_jax.runtime.files import write_text

Item = TypeVar("Item")


def check_settings(out: Path, settings: dict[str, Any], what: str) -> None:
    """Begin in ``out``, or go on there with the same settings.

    Raises:
      ValueError: results of other settings lie there; ``what`` says in words what differs.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / "settings.json"
    if file.is_file() and read_result(file) != settings:
        raise ValueError(f"{out}: it holds results of {what}; choose another --out")
    write_result(file, settings)


def write_result(file: Path, result: dict[str, Any]) -> dict[str, Any]:
    """Write a result, complete or not at all; returns it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, json.dumps(result, indent=2, allow_nan=False) + "\n")
    return result


def read_result(file: Path) -> dict[str, Any] | None:
    """What ``write_result`` wrote; None where nothing is, or nothing that can be read."""
    try:
        return json.loads(file.read_text())
    except (OSError, ValueError):
        return None


@dataclasses.dataclass(frozen=True)
class ResultStore(Generic[Item]):
    """Where results stay, a JSON file an item.

    Attributes:
      file: of an item.
      is_current: whether the result that lies there is one of the item as it is now.
    """

    file: Callable[[Item], Path]
    is_current: Callable[[Item, dict[str, Any]], bool] = lambda item, result: True

    def read(self, item: Item) -> dict[str, Any] | None:
        """The item's result of an earlier run, if there is one that counts."""
        found = read_result(self.file(item))
        return found if found is not None and self.is_current(item, found) else None


def without_nan(value: Any) -> Any:
    """Nested dictionaries and lists with None for the numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
