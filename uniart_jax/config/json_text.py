"""Frozen dataclasses as JSON, and back; what does not fit is told by its dotted name."""

from __future__ import annotations

import dataclasses
import json
import reprlib
from typing import Any, Literal, get_args, get_origin, get_type_hints

# Options of trainings that are gone, by dotted name. A checkpoint's config.json names every option
# that there was when it was written; what its networks make does not depend on these.
RETIRED = frozenset({"loss.decoded"})


def to_json(config: Any) -> str:
    """A config as indented JSON; ``from_json`` reads it back."""
    return json.dumps(dataclasses.asdict(config), indent=2, sort_keys=True)


def from_json(cls: type, text: str) -> Any:
    """Rebuild a config dataclass from ``to_json``'s text.

    Raises:
      ValueError: the text is not JSON, or its fields are not those of ``cls`` (all strange names
        are listed).
    """
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:  # the latter: nested without end
        raise ValueError(f"config: not valid JSON ({error})") from None
    strange: list[str] = []
    config = _build(cls, data, "", strange)
    if strange:
        raise ValueError("config: unknown or malformed fields: " + ", ".join(strange))
    return config


def _build(cls: type, data: Any, path: str, strange: list[str]) -> Any:
    if not isinstance(data, dict):
        strange.append(path.rstrip(".") or "<root>")
        return cls()
    hints = get_type_hints(cls)
    values = {}
    for name, value in data.items():
        hint = hints.get(name)
        if hint is None and path + name in RETIRED:
            continue
        if hint is None:
            strange.append(path + name)
        elif isinstance(hint, type) and dataclasses.is_dataclass(hint):
            values[name] = _build(hint, value, f"{path}{name}.", strange)
        elif get_origin(hint) is tuple and isinstance(value, list):
            values[name] = tuple(value)
        elif get_origin(hint) is Literal:
            if value in get_args(hint):
                values[name] = value
            else:
                strange.append(f"{path}{name}={reprlib.repr(value)}")
        elif isinstance(value, bool) != (hint is bool) or not isinstance(
            value, (hint, int) if hint is float else hint
        ):
            strange.append(f"{path}{name}={reprlib.repr(value)}")
        else:
            values[name] = value
    return cls(**values)
