"""Stages of the image backbones: what size they give, and what sees what."""

import jax
import numpy as np
import pytest
from flax import nnx

from uniart_jax.models.network import flat_names
from uniart_jax.nn.stem import StemStage


@pytest.mark.parametrize("stride", [2, 4])
def test_a_stage_is_so_many_times_smaller_and_reads_what_is_near(stride):
    stage = StemStage(3, 5, stride, nnx.Rngs(0), np.float32)
    graph, state = nnx.split(stage)
    run = jax.jit(lambda x: nnx.merge(graph, state)(x))
    x = np.random.default_rng(0).random((2, 32, 32, 3), np.float32)
    out = np.asarray(run(x))
    assert out.shape == (2, 32 // stride, 32 // stride, 5)
    moved = x.copy()
    moved[1, 0, 0] += 1
    changed = (np.asarray(run(moved)) != out).any(-1)
    assert not changed[0].any() and changed[1, 0, 0]
    assert not changed[1, 4:].any() and not changed[1, :, 4:].any()


def test_names_of_parameters_are_those_of_checkpoints():
    names = flat_names(nnx.to_pure_dict(nnx.state(StemStage(3, 5, 4, nnx.Rngs(0), np.float32))))
    layers = ("conv1", "conv2", "down")
    assert sorted(names) == [f"{n}.{leaf}" for n in layers for leaf in ("bias", "kernel")]
