"""Weight maps: tables of (upstream name -> our path, change of layout), applied with all mismatches
reported at once.

``{i}`` in a pattern stands for a number and is carried over. Layouts (ours have the output channels
last):

    Linear        [O, I]           -> [I, O]
    Conv2d        [O, I, h, w]     -> [h, w, I, O]
    Conv3d        [O, I, x, y, z]  -> [x, y, z, I, O]
    SubMConv3d    [O, x, y, z, I]  -> [27, I, O], tap (x, y, z) row-major     (spconv stores its kernels so)

None is flipped: PyTorch, spconv and XLA all compute cross-correlations.
"""  # noqa: E501

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np


class Layout(NamedTuple):
    """A change of layout of a tensor with ``axes`` axes (None: any)."""

    name: str
    axes: int | None
    change: Callable[[np.ndarray], np.ndarray]


SAME = Layout("as it is", None, lambda x: x)
LINEAR = Layout("linear", 2, lambda w: w.T)
CONV2D = Layout("2D convolution", 4, lambda w: w.transpose(2, 3, 1, 0))
CONV3D = Layout("3D convolution", 5, lambda w: w.transpose(2, 3, 4, 1, 0))
SUBMANIFOLD = Layout(
    "submanifold convolution",
    5,
    lambda w: w.transpose(1, 2, 3, 4, 0).reshape(-1, w.shape[4], w.shape[0]),
)


class Rule(NamedTuple):
    """One line of a table."""

    pattern: str
    path: str
    layout: Layout = SAME


def weight_and_bias(name: str, layout: Layout) -> tuple[Rule, Rule]:
    """The two rules of a linear layer or a convolution."""
    return Rule(f"{name}.weight", f"{name}.kernel", layout), Rule(f"{name}.bias", f"{name}.bias")


def norm(name: str) -> tuple[Rule, Rule]:
    """The two rules of a norm with scale and bias."""
    return Rule(f"{name}.weight", f"{name}.scale"), Rule(f"{name}.bias", f"{name}.bias")


def convert(
    rules: Iterable[Rule],
    tensors: Mapping[str, np.ndarray],
    expected: Mapping[str, Any],
    what: str,
) -> dict[str, Any]:
    """Upstream's tensors under our names and in our layouts, as a nested dict.

    Args:
      rules: the table; every name must fit exactly one rule.
      tensors: each is used exactly once.
      expected: our parameters, nested, anything with ``shape``; each must be filled.
      what: a name for errors.

    Raises:
      ValueError: names that are extra, missing or taken twice, and tensors of another shape or
        type; all are listed.
    """
    compiled = [(_compiled(rule.pattern), rule) for rule in rules]
    wanted = flatten(expected)
    found: dict[str, np.ndarray] = {}
    sources: dict[str, str] = {}
    extra, twice, wrong = [], [], []
    for name, value in tensors.items():
        fitting = [(m, rule) for regex, rule in compiled if (m := regex.fullmatch(name))]
        if len(fitting) > 1:
            raise AssertionError(f"{name} fits several rules")  # the table is wrong, not the file
        path = _filled(fitting[0][1].path, fitting[0][0]) if fitting else ""
        if path not in wanted:
            extra.append(name)
            continue
        if path in found:
            twice.append(f"{name} and {sources[path]}")
            continue
        layout, shape = fitting[0][1].layout, tuple(wanted[path].shape)
        sources[path], found[path] = name, value
        if layout.axes not in (None, value.ndim):
            wrong.append(
                f"{name} {list(value.shape)} has not the {layout.axes} axes of a {layout.name}"
            )
        elif not np.issubdtype(value.dtype, np.floating):
            wrong.append(f"{name} is of type {value.dtype}")
        elif (changed := layout.change(value)).shape != shape:
            wrong.append(
                f"{name} {list(value.shape)} becomes {list(changed.shape)}, expected {list(shape)}"
            )
        else:
            found[path] = changed
    missing = [_upstream(compiled, path) for path in wanted if path not in found]
    lists = {
        "missing": missing,
        "extra": extra,
        "given twice": twice,
        "of another shape or type": wrong,
    }
    problems = [f"{kind}: {', '.join(sorted(names))}" for kind, names in lists.items() if names]
    if problems:
        raise ValueError(
            f"{what}: the tensors do not fit; {'; '.join(problems)}; is it the right class and "
            "config?"
        )
    return nest(found)


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Leaves of a nested dict by dotted name."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[prefix + key] = value
    return flat


def nest(flat: Mapping[str, Any]) -> dict[str, Any]:
    """``flatten`` undone."""
    tree: dict[str, Any] = {}
    for name, value in flat.items():
        *path, last = name.split(".")
        node = tree
        for part in path:
            node = node.setdefault(part, {})
        node[last] = value
    return tree


def _compiled(pattern: str) -> re.Pattern[str]:
    number = iter(range(9))
    return re.compile(
        re.sub(r"\\\{i\\\}", lambda _: f"(?P<n{next(number)}>[0-9]+)", re.escape(pattern))
    )


def _filled(path: str, match: re.Match[str]) -> str:
    for number in match.groups():
        path = path.replace("{i}", number, 1)
    return path


def _upstream(compiled: list[tuple[re.Pattern[str], Rule]], path: str) -> str:
    """The upstream name that would fill a path of ours; the path itself if no rule leads there."""
    for _, rule in compiled:
        if match := _compiled(rule.path).fullmatch(path):
            return _filled(rule.pattern, match)
    return path
