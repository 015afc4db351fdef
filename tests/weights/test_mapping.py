"""Weight tables: every problem is told at once, and every upstream name is used exactly once."""

import numpy as np
import pytest

from uniart_jax.weights.compose import prefixes
from uniart_jax.weights.mapping import (
    CONV2D,
    CONV3D,
    LINEAR,
    SUBMANIFOLD,
    Rule,
    convert,
    flatten,
    nest,
    norm,
    weight_and_bias,
)

TABLE = (
    *weight_and_bias("blocks.{i}.mlp.{i}", LINEAR),
    *norm("blocks.{i}.norm"),
    Rule("old_gamma", "gamma"),
    Rule("new_gamma", "gamma"),
)


def expected(**changes):
    shapes = {
        "blocks.0.mlp.2.kernel": (3, 4),
        "blocks.0.mlp.2.bias": (4,),
        "blocks.0.norm.scale": (3,),
        "blocks.0.norm.bias": (3,),
        "gamma": (2,),
    } | changes
    return nest({name: np.empty(shape) for name, shape in shapes.items()})


def tensors():
    return {
        "blocks.0.mlp.2.weight": np.arange(12, dtype=np.float32).reshape(4, 3),
        "blocks.0.mlp.2.bias": np.zeros(4, np.float16),
        "blocks.0.norm.weight": np.ones(3, np.float32),
        "blocks.0.norm.bias": np.zeros(3, np.float32),
        "new_gamma": np.ones(2, np.float32),
    }


def test_numbers_are_carried_over_and_widths_kept():
    found = flatten(convert(TABLE, tensors(), expected(), "net"))
    np.testing.assert_array_equal(
        found["blocks.0.mlp.2.kernel"], tensors()["blocks.0.mlp.2.weight"].T
    )
    assert found["blocks.0.mlp.2.bias"].dtype == np.float16
    assert found.keys() == flatten(expected()).keys()


def test_all_problems_are_told_at_once():
    given = tensors() | {
        "blocks.0.mlp.2.weight": np.zeros((3, 4), np.float32),
        "blocks.0.norm.weight": np.zeros(3, np.int64),
        "blocks.1.mlp.2.bias": np.zeros(4, np.float32),
        "head.weight": np.zeros(2, np.float32),
        "old_gamma": np.ones(2, np.float32),
    }
    del given["blocks.0.norm.bias"]
    with pytest.raises(ValueError) as error:
        convert(TABLE, given, expected(), "net")
    message = str(error.value)
    assert "\n" not in message and message.startswith("net: the tensors do not fit")
    for part in (
        "missing: blocks.0.norm.bias;",
        "extra: blocks.1.mlp.2.bias, head.weight;",
        "given twice: old_gamma and new_gamma;",
        "blocks.0.mlp.2.weight [3, 4] becomes [4, 3], expected [3, 4]",
        "blocks.0.norm.weight is of type int64",
    ):
        assert part in message
    given = tensors() | {"blocks.0.mlp.2.weight": np.zeros(12, np.float32)}
    with pytest.raises(ValueError, match=r"mlp\.2\.weight \[12\] has not the 2 axes of a linear"):
        convert(TABLE, given, expected(), "net")


@pytest.mark.parametrize(
    ("layout", "shape", "result"),
    [
        (LINEAR, (2, 3), (3, 2)),
        (CONV2D, (2, 3, 4, 5), (4, 5, 3, 2)),
        (CONV3D, (2, 3, 4, 5, 6), (4, 5, 6, 3, 2)),
        (SUBMANIFOLD, (2, 3, 3, 3, 5), (27, 5, 2)),
    ],
)
def test_layouts(layout, shape, result):
    value = np.random.default_rng(0).normal(size=shape)
    changed = layout.change(value)
    assert changed.shape == result
    if layout is SUBMANIFOLD:
        np.testing.assert_array_equal(changed[(1 * 3 + 0) * 3 + 2], value[:, 1, 0, 2, :].T)
    if layout is CONV3D:
        assert changed[3, 4, 5, 2, 1] == value[1, 2, 3, 4, 5]


def test_what_is_new_is_named_by_the_shortest_prefix():
    names = ["a.x.0", "a.x.1", "a.y", "b.z", "b.w", "bc"]
    assert prefixes(names, ["a.x.0", "a.x.1", "b.z", "b.w"]) == ("a.x", "b")
    assert prefixes(names, ["a.x.1", "bc"]) == ("a.x.1", "bc")
    assert prefixes(names, []) == ()
