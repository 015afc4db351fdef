"""Shapes beside the fields of named tuples."""

from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.nn.shapes import Array, check_shapes


class Inner(NamedTuple):
    table: Annotated[Array, "B K", "int"]


class Outer(NamedTuple):
    coords: Annotated[Array, "B V 3", "int"]
    values: Annotated[Array, "B V", "float"] = None
    image: Annotated[Array, "B ... 3"] = None
    inner: Inner | None = None
    anything: Array = None


def outer(**changes):
    right = Outer(
        coords=np.zeros((2, 5, 3), np.int32),
        values=np.zeros((2, 5), np.float32),
        image=np.zeros((2, 4, 6, 6, 3)),
        inner=Inner(np.zeros((2, 7), np.int32)),
        anything=np.zeros(9),
    )
    return right._replace(**changes)


def test_what_is_right_passes_on_the_host_and_within_a_program():
    check_shapes(outer())
    check_shapes(outer(image=np.zeros((2, 3)), values=None, inner=None))
    check_shapes(outer(values=jnp.zeros((2, 5), jnp.bfloat16)))
    check_shapes(outer(inner=Inner(np.zeros((2, 5), np.uint8))))  # K is a length of its own
    jax.jit(check_shapes)(outer())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"coords": np.zeros((2, 5, 2), int)},
            r"batch 'coords' has the shape \[2, 5, 2\]; expected \[B, V, 3\] with B = 2, V = 5",
        ),
        ({"coords": np.zeros((2, 5), int)}, r"'coords' has the shape \[2, 5\]; expected \[B, V, 3"),
        ({"values": np.zeros((2, 6))}, r"'values' has the shape \[2, 6\]; expected .* V = 5"),
        ({"values": np.zeros((2, 5), int)}, r"'values' is int64; expected float \[B, V\]"),
        ({"coords": np.zeros((2, 5, 3))}, "'coords' is float64; expected int"),
        ({"image": np.zeros((3, 4, 3))}, r"'image' has the shape \[3, 4, 3\]"),
        ({"image": np.zeros((2, 4, 4))}, r"'image' has the shape \[2, 4, 4\]"),
        ({"image": np.zeros(2)}, r"'image' has the shape \[2\]"),
        (
            {"inner": Inner(np.zeros((3, 7), int))},
            r"batch 'inner' 'table' has the shape \[3, 7\]; expected \[B, K\] with B = 2",
        ),
    ],
)
def test_what_is_wrong_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        check_shapes(outer(**changes))
