"""JSON that strangers wrote: parsed within a limit of bytes and of nesting."""

from __future__ import annotations

import json
from typing import Any


def parse_json(data: bytes, what: str, max_bytes: int, *, nan: bool = False):
    """What a JSON file holds.

    Args:
      data: the file; read at most ``max_bytes + 1`` of it.
      what: the file in words, for errors.
      nan: take NaN and Infinity, which JSON does not have but Python writes.

    Raises:
      ValueError: too large, not UTF-8, not JSON, nested too deeply; one line that begins with
        ``what``.
    """
    if len(data) > max_bytes:
        raise ValueError(f"{what} has more than {max_bytes // 2**20} MiB")
    try:
        return json.loads(data.decode("utf-8-sig"), parse_constant=float if nan else _no_number)
    except RecursionError:
        raise ValueError(f"{what} is not JSON that can be read: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{what} is not JSON: {error}") from None


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is no number")


def is_whole(value: Any) -> bool:
    """Whether it is a whole number of JSON, which True is not."""
    return isinstance(value, int) and not isinstance(value, bool)
