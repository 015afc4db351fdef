"""Shapes of arrays, written beside the fields of a named tuple and checked there. numpy only.

    class Points(NamedTuple):
        coords: Annotated[Array, "B V 3", "int"]  # three axes, the last of length 3
        image: Annotated[Array, "B ... 3"]        # any axes between, any type

A letter, or a word, is one length throughout a tuple, and ``B`` also in the tuples that it holds.
``check_shapes`` looks at shapes and types, not at values, so it runs on every batch of a training,
in tests and out of them.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Annotated, Any, get_origin, get_type_hints

import numpy as np

Array = Any  # numpy on the host, jax within a program
KINDS = {"int": "iu", "float": "fV", "bool": "b"}  # numpy's letters; V: bfloat16
SHARED = "B"


def check_shapes(value: Any, sizes: Mapping[str, int] | None = None, name: str = "batch") -> None:
    """Whether the arrays of a named tuple are as its fields say; None has no shape.

    Args:
      sizes: lengths that are known before. name: of the tuple, for messages.

    Raises:
      ValueError: an array has other axes, another length or another kind of number; which, and what
        was expected.
    """
    known = dict(sizes or {})
    for field, (shape, kind) in _annotated(type(value)).items():
        if (array := getattr(value, field)) is not None:
            _check_array(array, shape, kind, known, f"{name} '{field}'")
    shared = {k: v for k, v in known.items() if k == SHARED}
    for field, inner in zip(value._fields, value, strict=True):
        if _is_named(inner):
            check_shapes(inner, shared, f"{name} '{field}'")


def _is_named(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(value, "_fields")


@functools.cache
def _annotated(kind: type) -> dict[str, tuple[tuple[str, ...], str]]:
    """(axes, kind of number or "") of each field that has a shape."""
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is Annotated:
            axes, *number = hint.__metadata__
            found[name] = (tuple(axes.split()), number[0] if number else "")
    return found


def _check_array(
    array: Any, shape: tuple[str, ...], kind: str, known: dict[str, int], name: str
) -> None:
    held = tuple(np.shape(array))
    if "..." in shape:
        cut = shape.index("...")
        after = len(shape) - cut - 1
        wrong = len(held) < len(shape) - 1
        pairs = [*zip(shape[:cut], held, strict=False)]
        pairs += zip(shape[cut + 1 :], held[len(held) - after :], strict=False)
    else:
        wrong = len(held) != len(shape)
        pairs = [*zip(shape, held, strict=False)]
    expected = ", ".join(shape)
    for axis, length in pairs:
        fixed = int(axis) if axis.isdigit() else known.setdefault(axis, length)
        wrong = wrong or fixed != length
    if wrong:
        sizes = ", ".join(f"{a} = {known[a]}" for a in dict.fromkeys(shape) if a in known)
        where = f" with {sizes}" if sizes else ""
        raise ValueError(f"{name} has the shape {list(held)}; expected [{expected}]{where}")
    dtype = getattr(array, "dtype", None)
    if kind and dtype is not None and dtype.kind not in KINDS[kind]:
        raise ValueError(f"{name} is {dtype}; expected {kind} [{expected}]")
