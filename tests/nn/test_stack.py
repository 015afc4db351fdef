import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from uniart_jax.nn.blocks import TransformerBlock
from uniart_jax.nn.stack import run_stack

MODES = [(scan, remat) for scan in (False, True) for remat in (False, True)]


def stack(depth, width=16):
    return nnx.List([TransformerBlock(width, 2, 4.0, nnx.Rngs(i)) for i in range(depth)])


def step(depth, scan, remat, period=2):
    """(loss and gradients of a stack's parameters and input, its inputs)."""
    graph, state = nnx.split(stack(depth))
    lengths = [np.int32([9, 4]), np.int32([5, 9])]

    def loss(state, h):
        blocks = nnx.merge(graph, state)
        out = run_stack(
            blocks, lambda b, i, h: b(h, lengths[i]), h, scan=scan, remat=remat, period=period
        )
        return jnp.square(out).mean()

    h = np.random.default_rng(1).normal(size=(2, 9, 16)).astype(np.float32)
    return jax.value_and_grad(loss, (0, 1)), (state, h)


@functools.cache
def values(depth, scan, remat):
    function, inputs = step(depth, scan, remat)
    return jax.tree.leaves(jax.jit(function)(*inputs))


NIGHTLY = {(1, False, True), (4, False, True), (1, True, False), (4, True, True)}


@pytest.mark.parametrize(
    ("depth", "scan", "remat"),
    [
        pytest.param(*way, marks=pytest.mark.slow if way in NIGHTLY else ())
        for depth in (1, 4, 5)  # shorter than the loop, whole loops, one left over
        for way in ((depth, *mode) for mode in MODES[1:])
    ],
)
def test_all_modes_give_the_same_numbers(depth, scan, remat):
    found, expected = values(depth, scan, remat), values(depth, False, False)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6)


def program(depth, scan, remat):
    function, inputs = step(depth, scan, remat)
    return jax.jit(function).lower(*inputs)


def test_a_scanned_program_does_not_grow_with_depth():
    short, long = (len(program(depth, True, True).as_text()) for depth in (4, 12))
    assert long < 1.5 * short
    assert len(program(12, False, False).as_text()) > 2 * long


def test_remat_keeps_no_activations():
    kept, again = (
        program(12, True, remat).compile().memory_analysis().temp_size_in_bytes
        for remat in (False, True)
    )
    assert again < 0.6 * kept
