"""What ``--help`` shows of an option: a plain word for its value, and its default once."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import tyro

Command = TypeVar("Command", bound=Callable[..., Any])
_EMPTY = (None, (), "")  # defaults that say nothing: the help's own words tell what is done then
_WORDS = {int: "INT", float: "FLOAT", str: "STR", Path: "PATH"}


def readable(command: Command) -> Command:
    """The command (a function or dataclass), its annotations with what its help is to show.

    Without it, tyro shows ``{None}|{[{urdf,mjcf} [{urdf,mjcf} ...]]}`` and ``(default: None)``
    beside a default that the help names in words. What is parsed stays the same.
    """
    hints = get_type_hints(command, include_extras=True)
    for name, parameter in inspect.signature(command).parameters.items():
        shown: dict[str, Any] = {}
        if (metavar := value_name(hints[name])) is not None:
            shown["metavar"] = metavar
        if parameter.default is inspect.Parameter.empty:
            if shown:
                shown["help_behavior_hint"] = "(required)"  # several, at least one
        elif any(parameter.default is empty or parameter.default == empty for empty in _EMPTY):
            shown["help_behavior_hint"] = ""
        if shown:
            # what the command itself says comes last and wins
            inner, *extras = _unwrapped(hints[name])
            marked: Any = (inner, tyro.conf.arg(**shown), *extras)
            command.__annotations__[name] = Annotated[marked]  # type: ignore[misc]
    command.__doc__ = joined_lines(command.__doc__ or "")
    return command


def joined_lines(text: str) -> str:
    """A docstring with each paragraph and each entry of its sections on one line: the terminal
    breaks it where it is too narrow, tyro would break it where the source does as well."""
    lines: list[str] = []
    for line in inspect.cleandoc(text).splitlines():
        indent = len(line) - len(line.lstrip())
        last = lines[-1] if lines else ""
        deeper = indent > len(last) - len(last.lstrip())
        goes_on = bool(last.strip() and line.strip()) and not last.endswith(":")
        if goes_on and (deeper or indent == 0):
            lines[-1] = f"{last} {line.strip()}"
        else:
            lines.append(line)
    return "\n".join(lines)


def value_name(hint: Any) -> str | None:
    """The word for an option's value ("PATH", "{euler,heun}", "INT ..."); None: tyro's own will do.

    Only what may be absent and what may be several needs one.
    """
    inner, *extras = _unwrapped(hint)
    kinds = get_args(inner) if get_origin(inner) in (Union, types.UnionType) else (inner,)
    given = [kind for kind in kinds if kind is not type(None)]
    if len(given) != 1 or given[0] is bool:
        return None
    several = get_origin(given[0]) is tuple
    optional = len(kinds) > 1
    if not optional and not several:
        return None
    one = get_args(given[0])[0] if several else given[0]
    word = _WORDS.get(one)
    if get_origin(one) is Literal:
        word = "{" + ",".join(map(str, get_args(one))) + "}"
    if word is None:
        return None
    if tyro.conf.Positional in extras:
        return f"{word} [{word} ...]" if several else f"[{word}]"
    return f"{word} ..." if several else word


def _unwrapped(hint: Any) -> tuple[Any, ...]:
    """A type and what ``Annotated`` holds beside it."""
    return get_args(hint) if get_origin(hint) is Annotated else (hint,)
