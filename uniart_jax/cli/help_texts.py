"""What ``--help`` shows of an option: a plain word for its value, its default once, and plain words
about it."""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import io
import tokenize
import types
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import tyro

_EMPTY = ("None", "", "''")  # defaults that say nothing: the help's own words tell what is done
_WORDS = {int: "INT", float: "FLOAT", str: "STR", Path: "PATH"}


@functools.cache
def readable(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command (a function or dataclass) and the dataclasses in it, their annotations with what
    the help is to show.

    Without it, tyro shows ``{None}|{[{urdf,mjcf} [{urdf,mjcf} ...]]}``, ``(default: None)`` beside
    a default that the help names in words, the backticks of docstrings and comments, and their
    line breaks. What is parsed stays the same.
    """
    hints = get_type_hints(command, include_extras=True)
    comments = field_comments(command) if isinstance(command, type) else {}
    for name, parameter in inspect.signature(command).parameters.items():
        inner, *extras = _unwrapped(hints[name])
        if dataclasses.is_dataclass(inner):
            readable(inner)
            continue
        shown: dict[str, Any] = {}
        if (metavar := value_name(hints[name])) is not None:
            shown["metavar"] = metavar
        if name in comments:
            shown["help"] = without_backticks(comments[name])
        if parameter.default is not inspect.Parameter.empty:
            shown["help_behavior_hint"] = _default
        elif metavar is not None:
            shown["help_behavior_hint"] = "(required)"  # several, at least one
        if shown:
            # what the command itself says comes last and wins
            marked: Any = (inner, tyro.conf.arg(**shown), *extras)
            command.__annotations__[name] = Annotated[marked]  # type: ignore[misc]
    command.__doc__ = without_backticks(joined_lines(command.__doc__ or ""))
    return command


def _default(value: str) -> str:
    """What stands behind an option's help, of its default as words of a command line."""
    return "" if value in _EMPTY else f"(default: {value})"


def without_backticks(text: str) -> str:
    """A text for a terminal, its code as one types it."""
    return text.replace("``", "")


def field_comments(cls: type) -> dict[str, str]:
    """The comments above and beside the fields of a dataclass, by field, each on one line."""
    found: dict[str, str] = {}
    for base in cls.__mro__[:-1]:  # the last is object
        try:
            source = inspect.cleandoc("\n" + inspect.getsource(base))
        except OSError:  # only its bytes are there
            continue
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        comments = {t.start[0]: t for t in tokens if t.type == tokenize.COMMENT}
        whole = {row for row, t in comments.items() if t.line.lstrip().startswith("#")}
        for node in ast.parse(source).body[0].body:
            if isinstance(node, ast.AnnAssign):
                first, last = node.lineno, node.end_lineno or node.lineno
                while first - 1 in whole:
                    first -= 1
                rows = [comments[row] for row in range(first, last + 1) if row in comments]
                texts = (t.string.removeprefix("#").split("# noqa")[0].strip() for t in rows)
                if text := " ".join(filter(None, texts)):
                    found.setdefault(node.target.id, text)
    return found


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
    several = get_args(given[0])[-1:] == (Ellipsis,)
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
