"""Values of a layout's JSON: rows of tables, numbers, lengths; errors of one line."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

LIMIT = 1.0  # that coordinates may have in object units, from the middle
FARTHEST = 100.0  # and in metres
LARGEST = 1e12  # of a number; what is larger counts as not finite


def json_rows(data: Any, name: str, most: int) -> list[dict[str, Any]]:
    """``data["rows"]`` of the entry ``name`` ("leg", "panel", "part 2: board").

    Raises:
      ValueError: one line; it is no table, has more than ``most`` rows, or one that is no object.
    """
    if not isinstance(data, dict) or not isinstance(data.get("rows"), list):
        raise ValueError(f'layout: {name}s must be null or have a list "rows"')
    rows = data["rows"]
    if len(rows) > most:
        raise ValueError(f"layout: {name}s: {len(rows)} rows; give at most {most}")
    for k, row in enumerate(rows):
        if not isinstance(row, dict):
            raise ValueError(f"layout: {name} {k} is not an object")
    return rows


def json_object(row: dict, name: str, where: str) -> dict[str, Any]:
    """The entry ``name`` of a row, an object itself."""
    if not isinstance(row.get(name), dict):
        raise ValueError(f"{where}: {name} is missing or no object")
    return row[name]


def check_names(row: dict, known: Collection[str], where: str) -> None:
    """ValueError that names an entry of a row that is not known."""
    if unknown := [name for name in row if name not in known]:
        raise ValueError(f"{where}: no entry '{unknown[0]}'; there are {', '.join(known)}")


def json_numbers(row: dict, name: str, count: int, where: str) -> np.ndarray:
    """[count] finite numbers."""
    values = row.get(name)
    if not (
        isinstance(values, list)
        and len(values) == count
        and all(type(v) in (int, float) and abs(v) < LARGEST for v in values)
    ):
        raise ValueError(f"{where}: {name} must be {count} finite numbers")
    return np.array(values, np.float64)


def json_share(value: Any, what: str) -> float:
    """A number in 0..1."""
    if type(value) not in (int, float) or not 0 <= value <= 1:
        raise ValueError(f"{what} {value!r} is not in 0..1")
    return float(value)


def plain(values: Any, digits: int = 6) -> list[float]:
    """Numbers as JSON holds them, in one list."""
    return [round(float(v), digits) for v in np.ravel(values)]
