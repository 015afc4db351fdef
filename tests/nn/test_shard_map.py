"""On many devices, what gathers by positions stays where its items are: the same numbers, and
nothing is sent but gradients."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from collectives import least, received

from uniart_jax.nn.attention import attend_segments
from uniart_jax.nn.gathers import flat_positions
from uniart_jax.nn.segments import join_shares, pack_segments, plan_segments

PROGRAM = """
import sys
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_num_cpu_devices", 8)
from flax import nnx
from uniart_jax.config import FlowConfig, GridConfig, MeshConfig, UniArtVAEConfig
from uniart_jax.nn.attention import attend, attend_segments
from uniart_jax.nn.convolution import SubmanifoldConv
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.pooling import at_cells, downsample, repeat_plan, upsample
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.training.sharding import make_mesh, put_batch

rng = np.random.default_rng(0)
items, width, grid = 8, 60, GridConfig(8, 2, 8)
counts = rng.integers(20, width, items).astype(np.int32)
coords = np.zeros((items, width, 3), np.int32)
for b, n in enumerate(counts):
    coords[b, :n] = np.stack(np.unravel_index(np.sort(rng.choice(512, n, replace=False)), (8,) * 3), 1)
batch = {"coords": coords, "counts": counts, "voxel_part": rng.integers(0, 5, (items, width)).astype(np.int32)}
x = np.where((np.arange(width) < counts[:, None])[..., None], rng.normal(size=(items, width, 12)), 0).astype(np.float32)
flow = flow_plan(coords, counts, FlowConfig(stem="conv", patch_size=2, io_channels=(8,)), grid)
layer = SubmanifoldConv(12, 12, nnx.Rngs(0))
graph, weights = nnx.split(layer)
volume = rng.normal(size=(items, 4, 4, 4, 12)).astype(np.float32)

def loss(weights, x, counts, plans, flow, volume):
    qkv = jnp.concatenate([x, jnp.sin(x), x], -1).reshape(-1, 3, 2, 6)
    for plan in plans.values():
        x = x + attend_segments(qkv, plan).reshape(x.shape)
    heads = x.reshape(items, width, 2, 6)
    x = x + attend(heads, heads, heads, counts).reshape(x.shape)
    x = x + nnx.merge(graph, weights)(x, flow.neighbors[0])
    cells = downsample(x, flow.pools[0]) + at_cells(volume, flow.pools[0].coords)
    twice = upsample(jnp.repeat(cells, 2, 0), repeat_plan(flow, 2).pools[0])
    return jnp.square(x).sum() + jnp.sin(twice).sum()

step = jax.jit(jax.value_and_grad(loss, (0, 1)))
made = {"config": UniArtVAEConfig(window=4), "grid": grid}
plans = lambda shares: voxel_plans(**batch, **made, shares=shares)
expected = step(weights, x, counts, plans(1), flow, volume)
mesh = make_mesh(MeshConfig(fsdp=int(sys.argv[1])))
with jax.set_mesh(mesh):
    given = put_batch((x, counts, plans(8), flow, volume), mesh)
    program = step.lower(jax.device_put(weights, jax.NamedSharding(mesh, jax.P())), *given).compile()
    found = program(jax.device_put(weights, jax.NamedSharding(mesh, jax.P())), *given)
for a, b in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-5 * np.abs(a).max())

from uniart_jax.nn.shard_map import on_single_device, shard_map_items
seen = []
with jax.set_mesh(mesh):
    def look(x):
        seen.append(on_single_device())
        return x

    jax.jit(lambda x: shard_map_items(look, (look(x),)))(given[0])
    assert seen == [False, True], seen
    # six items on eight devices, and one share of eight items: no part of its own for each, the
    # same numbers
    six = voxel_plans(**{k: v[:6] for k, v in batch.items()}, **made)
    for n, own in ((8, plans(1)), (6, six)):
        for name, plan in own.items():
            qkv = np.repeat(x[:n, :, None, :6], 3, 2).reshape(-1, 3, 2, 3)
            mine = jax.jit(attend_segments)(qkv, plan)
            with jax.set_mesh(mesh):
                np.testing.assert_allclose(mine, jax.jit(lambda a, p: attend_segments(a, p))(qkv, plan), atol=1e-5)
print(program.as_text())
"""  # noqa: E501


@pytest.mark.parametrize("fsdp", [pytest.param(1, marks=pytest.mark.slow), 4])
def test_eight_devices_send_nothing_but_sums(fsdp):
    env = {**os.environ, "JAX_PLATFORMS": "cpu"}
    program = [sys.executable, "-c", PROGRAM, str(fsdp)]
    ran = subprocess.run(
        program, env=env, text=True, capture_output=True, cwd=Path(__file__).parents[2]
    )
    assert not ran.returncode, ran.stderr[-2000:]
    moved = received(ran.stdout, 8)
    assert set(moved) <= {"all-reduce"}
    assert (
        0.95 < moved["all-reduce"] / least(27 * 12 * 12 + 12, 8) < 1.02
    )  # the loss and the convolution's gradient


def test_a_plan_of_other_tokens_is_an_error():
    plan = plan_segments(np.zeros((2, 6), int), np.array([6, 4]), ((2, 6),))
    with pytest.raises(ValueError, match="10 tokens, but a plan of 12"):
        attend_segments(jnp.zeros((10, 3, 1, 4)), plan)


def test_shares_of_other_lengths_are_an_error():
    ids = np.zeros((1, 12), int)
    plans = [pack_segments(ids, np.array([n]), (4, 12)) for n in (3, 12)]
    with pytest.raises(ValueError, match="buckets are of other lengths"):
        join_shares(plans)


def test_flat_positions_keep_what_is_missing_missing():
    index = np.array([[0, 2, 3], [1, 3, 7]])
    np.testing.assert_array_equal(flat_positions(jnp.asarray(index), 3), [[0, 2, 6], [4, 6, 6]])
    np.testing.assert_array_equal(flat_positions(index[:1], 3), index[:1])


@pytest.mark.parametrize("kernel", ["xla", "splash"])
@pytest.mark.parametrize("kind", ["buckets", "packed"])
def test_a_plan_of_shares_attends_as_one_of_the_whole(kind, kernel):
    """On one device too, where shares are joined: several buckets, forward and gradient."""
    rng = np.random.default_rng(0)
    ids, counts = rng.integers(0, 4, (4, 50)), np.array([50, 31, 1, 44])

    def make(rows):
        if kind == "packed":
            return pack_segments(ids[rows], counts[rows], (40,))
        some = len(counts[rows])
        return plan_segments(ids[rows], counts[rows], ((some * 6, 8), (some * 5, 40)))

    whole, halves = make(slice(0, 4)), [make(slice(0, 2)), make(slice(2, 4))]
    qkv = rng.normal(size=(200, 3, 2, 8)).astype(np.float32)

    def run(plan):
        def loss(x):
            out = attend_segments(x, plan, kernel=kernel)
            return jnp.sin(out).sum(), out

        return jax.jit(jax.grad(loss, has_aux=True))(qkv)

    for a, b in zip(run(whole), run(join_shares(halves)), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)
