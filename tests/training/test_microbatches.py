"""Gradient accumulation: micro-batches make the update of the whole batch, on one device and on
several."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import toy_run

from uniart_jax.config import FlowConfig, GridConfig, ModelConfig, StageConfig, UniArtVAEConfig
from uniart_jax.models.network import build, flat_names
from uniart_jax.nn.grids import CELL_STEP, flow_plan
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.training.microbatches import split_batch
from uniart_jax.training.state import create_state, make_optimizer
from uniart_jax.training.step import make_train_step
from uniart_jax.voxels.typed_batches import VoxelBatch

TOLERANCE = 1e-5
MODEL = ModelConfig(
    grid=GridConfig(resolution=8, subdivisions=2, max_parts=4),
    uniart_vae=UniArtVAEConfig(
        width=16, num_blocks=2, num_heads=2, latent_channels=4, attention="serial", window=16,
        visual_channels=0, geometry_channels=8, articulation_channels=8, part_segment=16,
    ),
    latent_flow=FlowConfig(
        model_channels=16, num_blocks=1, num_heads=2, cond_channels=8, patch_size=2, stem="patch"
    ),
)  # fmt: skip


def still(params, batch, key):
    """The toy's loss without its noise, and a metric that is a number for some items only."""
    block, out = params["blocks"][0], params["out"]
    y = jnp.tanh(batch["x"] @ block["kernel"] + block["bias"]) @ out["kernel"] + out["bias"]
    loss = jnp.mean((y - batch["y"]) ** 2)
    late = batch["x"][:, 0] > 1.2
    return loss, {"mean": y.mean(), "late": jnp.where(late, 1.0, 0.0).sum() / late.sum()}


def trained(batches, accumulate):
    stage = StageConfig(learning_rate=1e-2, warmup_steps=0)
    optimizer = make_optimizer(stage)
    state = create_state(toy_run.init, optimizer, jax.random.key(0))
    step = make_train_step(still, optimizer, stage.ema_decay, accumulate=accumulate)
    rows = []
    for batch in batches:
        state, metrics = step(state, batch, jax.random.key(1))
        rows.append({name: float(value) for name, value in metrics.items()})
    return flat_names(state), rows, step


def close(a, b):
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_allclose(
            np.asarray(a[name]), np.asarray(b[name]), rtol=0, atol=TOLERANCE, err_msg=name
        )


@pytest.fixture(scope="module")
def batches():
    iterator = toy_run.make_batches()
    return [next(iterator) for _ in range(5)]


def test_micro_batches_make_the_update_of_the_whole(batches):
    whole, rows, _ = trained(batches, 1)
    parts, found, step = trained([split_batch(b, 4, MODEL) for b in batches], 4)
    close(whole, parts)
    assert len(step.compiled) == 1
    for one, other in zip(rows, found, strict=True):
        for name in ("loss", "mean", "grad_norm"):
            assert other[name] == pytest.approx(one[name], abs=TOLERANCE)
        # the mean over the micro-batches where it is a number
        assert np.isnan(one["late"]) == np.isnan(other["late"])
        assert np.isnan(one["late"]) or other["late"] == 1.0


def test_micro_batches_of_other_shapes_too(batches):
    def unequal(batch):
        """The first part is longer by items that do not count."""
        first, second = split_batch(batch, 2, MODEL)
        padded = {name: np.concatenate([value, value]) for name, value in first.items()}
        return padded, second

    whole, _, _ = trained(batches, 1)
    close(whole, trained([unequal(b) for b in batches], 2)[0])


def test_one_loop_holds_all_micro_batches(batches):
    """The program does not grow with their number, and its products are all counted."""
    flops = [
        trained([split_batch(batches[0], n, MODEL)], n)[2].latest.flops.total() for n in (2, 8)
    ]
    assert flops[0] == flops[1] == trained(batches[:1], 1)[2].latest.flops.total()


def test_sharded_micro_batches_equal_those_of_one_device(tmp_path):
    """Two micro-batches of four items, each split over four devices."""
    stage = toy_run.make_stage(5, 100, accumulate=2)
    alone = flat_names(toy_run.train(tmp_path / "1", stage, toy_run.make_batches()))
    out = tmp_path / "4.npz"
    subprocess.run(
        [sys.executable, toy_run.__file__, str(tmp_path / "4"), "5", "100", "--accumulate", "2",
         "--devices", "4", "--fsdp", "2", "--out", str(out)],
        check=True,
    )  # fmt: skip
    close(alone, dict(np.load(out)))


def test_items_that_do_not_divide():
    with pytest.raises(ValueError, match=r"8 items .* do not divide into 3 micro-batches"):
        split_batch({"x": np.zeros((8, 2))}, 3, MODEL)


def voxels(items=4, width=64):
    rng = np.random.default_rng(0)
    counts = rng.integers(30, width, items).astype(np.int32)
    coords = np.zeros((items, width, 3), np.int32)
    for b, n in enumerate(counts):
        chosen = np.sort(rng.choice(8**3, n, replace=False))
        coords[b, :n] = np.stack(np.unravel_index(chosen, (8, 8, 8)), -1)
    valid = np.arange(width) < counts[:, None]
    normal = lambda *s: np.where(valid[..., None], rng.normal(size=(items, width, *s)), 0).astype(  # noqa: E731
        np.float32
    )  # noqa: E731, RUF100
    part = np.where(valid, rng.integers(0, 4, (items, width)), 0).astype(np.int32)
    return VoxelBatch(coords, counts, part, latent=normal(4))


@pytest.mark.slow
def test_parts_of_a_batch_of_voxels_mean_what_the_whole_means():
    """Positions in plans are those of the micro-batch: a decoder and a flow give each item what
    they give it in the whole batch."""
    batch = voxels()
    plans = voxel_plans(batch.coords, batch.counts, MODEL.uniart_vae, MODEL.grid)
    flow = flow_plan(batch.coords, batch.counts, MODEL.latent_flow, MODEL.grid, round_to=CELL_STEP)
    network = build("latent_flow", MODEL)
    params = jax.tree.map(
        lambda s: jnp.asarray(np.random.default_rng(1).normal(0, 0.2, s.shape), jnp.float32),
        network.abstract(),
    )
    tokens = np.random.default_rng(2).normal(size=(4, 3, 8)).astype(np.float32)

    def velocity(part, tokens):
        t = jnp.full(len(tokens), 0.5)
        return network.apply(
            params,
            part.latent,
            t,
            tokens,
            None,
            coords=part.coords,
            counts=part.counts,
            plan=part.plans["flow"],
        )

    whole = velocity(batch._replace(plans={"flow": flow}), tokens)
    parts = split_batch(batch._replace(plans={"flow": flow}), 2, MODEL)
    shapes = [jax.tree.map(np.shape, part) for part in parts]
    assert shapes[0] == shapes[1]
    found = jnp.concatenate(
        [velocity(p, tokens[i : i + 2]) for p, i in zip(parts, (0, 2), strict=True)]
    )
    np.testing.assert_allclose(found, whole, atol=TOLERANCE)

    for part, at in zip(split_batch(batch._replace(plans=plans), 2, MODEL), (0, 2), strict=True):
        assert part.plans.keys() == plans.keys() == {"window_0", "window_1"}
        (bucket,) = part.plans["window_1"].buckets
        rows = bucket.index[bucket.length > 0]
        place = np.unique(rows[rows < 2 * 64])
        valid = np.flatnonzero(np.arange(64) < batch.counts[at : at + 2, None])
        np.testing.assert_array_equal(place, valid)
