"""bfloat16 is what products run in, and nothing else: parameters, norms, softmax, losses, gradients
and moments are float32."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.config import (
    Config,
    FlowConfig,
    GridConfig,
    ModelConfig,
    StageConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.training.flops import matmul_flops
from uniart_jax.training.flow_losses import make_latent_flow_loss, make_structure_flow_loss
from uniart_jax.training.state import TrainState, make_optimizer
from uniart_jax.training.vae_losses import make_structure_vae_loss, make_uniart_vae_loss
from uniart_jax.voxels.typed_batches import Condition, PictureBatch, StructureBatch, VoxelBatch

FLOW = FlowConfig(
    model_channels=32, num_blocks=2, num_heads=2, cond_channels=32, patch_size=2, stem="patch"
)
MODEL = ModelConfig(
    grid=GridConfig(resolution=8, subdivisions=2, max_parts=4),
    structure_vae=StructureVAEConfig(
        patch_size=2, channels=(32, 64), latent_channels=3, num_res_blocks=1, num_res_blocks_middle=1  # noqa: E501
    ),
    uniart_vae=UniArtVAEConfig(
        width=32, num_blocks=2, num_heads=2, latent_channels=4, attention="serial", window=16,
        visual_channels=0, geometry_channels=32, articulation_channels=32, part_segment=16,
    ),
    structure_flow=dataclasses.replace(FLOW, patch_size=1),
    latent_flow=FLOW,
    compute_dtype="bfloat16",
)  # fmt: skip
SUMS = {
    "exp",
    "exp2",
    "log",
    "rsqrt",
    "sqrt",
    "div_sqrt",
    "cumsum",
    "erf_inv",
}  # of softmax and norms


def batch(name, items=2, width=64):
    cells, zero = MODEL.grid.subdivisions**3, np.zeros
    coords = zero((items, width, 3), np.int32)
    coords[:] = np.stack(np.unravel_index(np.arange(width), (8, 8, 8)), -1)
    counts = np.full(items, width, np.int32)
    part = zero((items, width), np.int32)
    plans = voxel_plans(coords, counts, MODEL.uniart_vae, MODEL.grid, voxel_part=part)
    plans = {**plans, "flow": flow_plan(coords, counts, FLOW, MODEL.grid)}
    seen = Condition(zero((items, 9, 32), np.float32))
    if name == "structure_vae":
        return PictureBatch(occupancy=zero((items, 8, 8, 8), np.uint8))
    if name == "structure_flow":
        return StructureBatch(zero((items, 2, 2, 2, 3), np.float32), seen=seen)
    return VoxelBatch(
        coords, counts, part,
        sdf=zero((items, width, cells), np.int8), color=zero((items, width, cells, 3), np.uint8),
        owner=zero((items, width, cells), np.uint8), boxes=zero((items, 4, 6), np.float32),
        codes=zero((items, 4, 9), np.float32), parents=zero((items, 4), np.int32),
        latent=zero((items, width, 4), np.float32), plans=plans, seen=seen,
    )  # fmt: skip


def equations(jaxpr):
    for eqn in getattr(jaxpr, "jaxpr", jaxpr).eqns:
        yield eqn
        for value in jax.tree.leaves(
            tuple(eqn.params.values()), is_leaf=lambda v: hasattr(v, "eqns")
        ):
            if hasattr(value, "eqns"):
                yield from equations(value)


LOSSES = {
    "structure_vae": make_structure_vae_loss,
    "uniart_vae": make_uniart_vae_loss,
    "structure_flow": make_structure_flow_loss,
    "latent_flow": make_latent_flow_loss,
}


@pytest.mark.parametrize("name", LOSSES)
def test_only_products_run_in_bfloat16(name):
    config = Config(model=MODEL)
    network = build(name, MODEL)
    channels = {"structure_flow": 3, "latent_flow": 4}.get(name)
    statistics = [np.zeros(channels), np.ones(channels)] if channels else []
    loss_fn = LOSSES[name](network, config, *statistics)
    params = network.abstract()
    gradient = jax.value_and_grad(loss_fn, has_aux=True)
    jaxpr, out = jax.make_jaxpr(gradient, return_shape=True)(params, batch(name), jax.random.key(0))
    assert {leaf.dtype for leaf in jax.tree.leaves(params)} == {np.dtype("float32")}
    (loss, metrics), grads = out
    assert {leaf.dtype for leaf in jax.tree.leaves((loss, metrics, grads))} == {np.dtype("float32")}
    products = matmul_flops(jaxpr)
    assert products["bfloat16"] > 0.8 * products.total(), products
    narrow = [
        e
        for e in equations(jaxpr)
        if e.primitive.name in SUMS and any(v.aval.dtype == jnp.bfloat16 for v in e.invars)
    ]
    assert not narrow, narrow
    assert any(e.primitive.name == "rsqrt" for e in equations(jaxpr))  # that a norm would be seen
    optimizer = make_optimizer(StageConfig())
    moments = jax.eval_shape(optimizer.init, params)
    state = TrainState(jax.ShapeDtypeStruct((), jnp.int32), params, moments, params)
    updates, after = jax.eval_shape(optimizer.update, grads, moments, params)
    wide = {leaf.dtype for leaf in jax.tree.leaves((state, updates, after))}
    assert wide == {np.dtype("float32"), np.dtype("int32")}  # the counters
