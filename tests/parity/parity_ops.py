"""TRELLIS's single operations (``ops.npz``).

Not checked, because nothing here has them: subdivision, 1^3 submanifold convolution and sparse
group norm (``subdiv_*``, ``conv1``, ``gn``: the mesh decoder's up-path) and the dice loss
(``dice``: TRELLIS's training of the structure VAE; ours is a cross-entropy).
"""

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jax.experimental import io_callback
from parity_cases import last, pad, spread

from uniart_jax.config import GaussianConfig
from uniart_jax.flow.guidance import guide
from uniart_jax.flow.rectified import interpolate, predicted_sample, velocity_target
from uniart_jax.flow.solvers import euler, time_steps
from uniart_jax.models.flow_transformer import _patchify, _unpatchify
from uniart_jax.models.gaussian_decoder import offset_perturbation
from uniart_jax.nn.blocks import RMSNorm
from uniart_jax.nn.convolution import SubmanifoldConv, depth_to_space
from uniart_jax.nn.embeddings import position_embedding, timestep_embedding
from uniart_jax.nn.grids import plan_neighbors, plan_pool
from uniart_jax.nn.pooling import downsample, upsample
from uniart_jax.nn.segments import plan_segments
from uniart_jax.nn.voxel_plans import window_ids
from uniart_jax.weights.mapping import SUBMANIFOLD

CLOSE = dict(rtol=1e-4, atol=1e-5)
SIGMA = 1e-5
NOT_OURS = {"subdiv_coords", "subdiv_feats", "conv1", "gn", "dice"}


def check_ops(case):
    seen = set()
    for check in (check_embeddings, check_dense, check_windows, check_sparse, check_sampler):
        seen |= check(case.inputs, case.outputs)
    assert seen | NOT_OURS >= case.outputs.keys()  # nothing is passed over in silence


def check_embeddings(given, out):
    # angles up to 1000 in float32 carry an error of 6e-5
    time = jax.jit(timestep_embedding)(given["t"])
    np.testing.assert_allclose(time, out["timestep_embedding_256"], rtol=1e-4, atol=2e-4)
    places = [key for key in out if key.startswith("ape_")]
    for key in places:
        width = int(key.removeprefix("ape_"))
        ours = jax.jit(position_embedding, static_argnums=1)(given["ape_coords"], width)
        np.testing.assert_allclose(ours, out[key], **CLOSE)
    offsets = offset_perturbation(GaussianConfig(num_gaussians=32))
    np.testing.assert_allclose(offsets, out["gs_offset_perturbation_32"], **CLOSE)
    return {"timestep_embedding_256", "gs_offset_perturbation_32", *places}


def check_dense(given, out):
    patches = np.asarray(jax.jit(_patchify, static_argnums=1)(last(given["patch_x"]), 2))
    expected = last(out["patchify_2"])
    np.testing.assert_array_equal(patches, expected.reshape(patches.shape))
    back = jax.jit(_unpatchify, static_argnums=(1, 2))(patches, expected.shape[1], 2)
    np.testing.assert_array_equal(back, last(out["unpatchify_2"]))
    shuffled = jax.jit(depth_to_space, static_argnums=1)(last(given["shuffle_x"]), 2)
    np.testing.assert_array_equal(shuffled, last(out["pixel_shuffle_3d_2"]))
    norm = RMSNorm(*given["rms_gamma"].shape)
    norm.gamma[...] = jnp.asarray(given["rms_gamma"])
    np.testing.assert_allclose(jax.jit(lambda x: norm(x))(given["rms_x"]), out["rms"], **CLOSE)
    return {"patchify_2", "unpatchify_2", "pixel_shuffle_3d_2", "rms"}


def check_windows(given, out):
    """The same partition (numbers of windows differ), of the same sizes, in the plan too."""
    coords, counts, rows = pad(given["sp_coords"])
    seen = set()
    for shift in (0, 4):
        keys = {name: f"win8_s{shift}_{name}" for name in ("id", "batch", "seqlens")}
        ids = window_ids(coords, 8, shift)
        ours, theirs = np.stack([rows[0], ids[rows]]), np.stack([rows[0], out[keys["id"]]])
        labels = [np.unique(x, axis=1, return_inverse=True)[1] for x in (ours, theirs)]
        pairs = np.unique(np.stack(labels), axis=1)
        assert pairs.shape[1] == labels[0].max() + 1 == labels[1].max() + 1
        plan = plan_segments(ids, counts, ((64, 512),))
        lengths = np.sort(plan.buckets[0].length[plan.buckets[0].length > 0])
        np.testing.assert_array_equal(lengths, np.sort(out[keys["seqlens"]]))
        windows = [len(np.unique(ids[b, :n])) for b, n in enumerate(counts)]
        np.testing.assert_array_equal(windows, np.bincount(out[keys["batch"]]))
        seen |= set(keys.values())
    return seen


def check_sparse(given, out):
    coords, counts, rows = pad(given["sp_coords"])
    feats = spread(given["sp_feats"], coords, rows)
    kernel = SUBMANIFOLD.change(given["conv3_weight_KRSC"])
    layer = SubmanifoldConv(*kernel.shape[1:], nnx.Rngs(0))
    layer.kernel[...], layer.bias[...] = jnp.asarray(kernel), jnp.asarray(given["conv3_bias"])
    convolved = jax.jit(lambda x, plan: layer(x, plan))(feats, plan_neighbors(coords, counts))
    np.testing.assert_allclose(np.asarray(convolved)[rows], out["conv3"], **CLOSE)
    pool = plan_pool(coords, counts, 2, coords.shape[1])
    cells = jax.jit(downsample)(feats, pool)
    valid = np.arange(pool.coords.shape[1]) < pool.counts[:, None]
    np.testing.assert_array_equal(pool.coords[valid], out["down_coords"][:, 1:])
    np.testing.assert_array_equal(np.nonzero(valid)[0], out["down_coords"][:, 0])
    np.testing.assert_allclose(np.asarray(cells)[valid], out["down_feats"], **CLOSE)
    raised = np.asarray(jax.jit(upsample)(cells, pool))
    np.testing.assert_allclose(raised[rows], out["up_feats"], **CLOSE)
    return {"conv3", "down_coords", "down_feats", "up_feats"}


def check_sampler(given, out):
    """12 steps, rescale 3, guidance 5 within [.5, 1], of the velocity .3 x + t + condition,
    condition 1 or 0."""
    x0, noise, t = (given[f"fm_{name}"] for name in ("x0", "eps", "t"))
    np.testing.assert_allclose(jax.jit(interpolate)(x0, noise, t, SIGMA), out["fm_xt"], **CLOSE)
    np.testing.assert_allclose(velocity_target(x0, noise, SIGMA), out["fm_v"], **CLOSE)
    np.testing.assert_allclose(time_steps(12, 3.0), out["t_seq_12_r3"], rtol=1e-6)
    calls = []

    def velocity(x, t, condition):
        io_callback(lambda t: calls.extend(1000 * np.asarray(t)), None, t, ordered=True)
        return 0.3 * x + (t[:, None] + condition)[..., None]

    start, one = given["noise"], np.ones((1, 1), np.float32)
    guided = guide(velocity, one, 0 * one, 5.0, (0.5, 1.0))
    sample = np.asarray(jax.jit(lambda x: euler(guided, x, 12, 3.0))(start))
    jax.effects_barrier()
    taken = len(calls)
    velocity_at_noise = np.asarray(jax.jit(guided)(start, np.float32(1)))
    np.testing.assert_allclose(sample, out["sample"], **CLOSE)
    np.testing.assert_allclose(calls[:taken], out["sampler_t_calls"], **CLOSE)
    first = predicted_sample(start, velocity_at_noise, one[0], SIGMA)
    np.testing.assert_allclose(first, out["pred_x_0_first"], **CLOSE)
    return {"fm_xt", "fm_v", "t_seq_12_r3", "sample", "sampler_t_calls", "pred_x_0_first"}
