"""Tables of a layout's JSON beside its parts: legs, panels and boards."""

from __future__ import annotations

from typing import Any

FARTHEST = 100.0  # that coordinates may have: metres, where there is no picture


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
