"""The steps of sampling as jitted functions: image -> condition, condition -> structure latent,
condition and voxels -> UniArt latents.

``pipeline.Pipeline`` puts them together; ``validation`` runs them on a network that is still
training.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from uniart_jax.config import FlowConfig, ModelConfig, SampleConfig
from uniart_jax.flow.guidance import guide
from uniart_jax.flow.solvers import Solution, Velocity, solve
from uniart_jax.models.flow_trunk import T_MIN
from uniart_jax.models.network import build
from uniart_jax.nn.grids import CELL_STEP, flow_plan
from uniart_jax.voxels.joint_code import FIXED_AXIS, canonical
from uniart_jax.voxels.part_table import SMALLEST_SIDE, THRESHOLD, PartTable
from uniart_jax.voxels.typed_batches import Condition, VoxelBatch

for _kind in (Condition, Solution):  # what programs that are kept return
    export.register_namedtuple_serialization(_kind, serialized_name=f"uniart_jax.{_kind.__name__}")

WIDTH_STEP = 4096  # voxels beyond the largest bucket are padded to multiples of this


def make_conditioner(model: ModelConfig) -> Callable[..., Condition]:
    """Jitted (image encoder's params, images [B, S, S, 3] in [0, 1]) -> what the flows see of
    them."""
    network = build("image_encoder", model)
    flow = model.structure_flow
    closely = model.latent_flow.pixel_channels + flow.pixel_channels + flow.refine_channels > 0

    @jax.jit
    def run(params, images):
        seen = network.apply(params, images)
        close = (seen["pixels"][:, None], seen["camera"][:, None]) if closely else ()
        return Condition(seen["tokens"], seen.get("volume"), *close)

    return run


class FoundLayouts(NamedTuple):
    """What a layout network finds in B images: their parts, the surest first, and camera codes
    [B, 7]."""

    table: PartTable
    cameras: jax.Array


def make_layout_finder(model: ModelConfig) -> Callable[..., FoundLayouts]:
    """Jitted (layout network's params, images [B, S, S, 3] in [0, 1]) -> ``FoundLayouts``. Images
    of any size: they are resampled.

    ``inference.layouts.LayoutPredictor`` and ``voxels.read_layout`` do the same with more care (two
    looks, a tree, exact joints) on the host; this is what a training step can afford.
    """
    network = build("layout", model)

    @jax.jit
    def run(params, images):
        side = model.layout.image_size
        shape = (len(images), side, side, 3)
        out = network.apply(params, jax.image.resize(images, shape, "bilinear"))
        table = found_table(out["parts"][-1], out["parents"], model.grid.max_parts)
        return FoundLayouts(table, out["camera"])

    return run


def found_table(parts: dict[str, jax.Array], parents: jax.Array, most: int) -> PartTable:
    """Outputs of a layout network as part tables: of each item the at most ``most`` rows that
    exist (``part_table.THRESHOLD``), but one at least, the surest first.

    Args:
      parts: corners [B, Q, 6], codes [B, Q, 9], exists [B, Q] logits, colors [B, Q, 3].
      parents: [B, Q, Q] logits child -> parent, the diagonal the root's. Each row takes its
        likeliest parent; that they form a tree is not enforced.
    """
    order = jnp.argsort(-parts["exists"], axis=-1)[:, :most]
    exist = jax.nn.sigmoid(parts["exists"]) > THRESHOLD
    counts = jnp.clip(exist.sum(-1), 1, order.shape[1])
    there = jnp.arange(most) < counts[:, None]

    def take(rows):
        rows = jnp.take_along_axis(rows, order[..., None], 1)
        rows = jnp.pad(rows, ((0, 0), (0, most - rows.shape[1]), (0, 0)))
        return jnp.where(there[..., None], rows, 0)

    lower, upper = jnp.split(take(parts["corners"]), 2, -1)
    size = jnp.maximum(upper - lower, SMALLEST_SIDE)
    boxes = jnp.where(there[..., None], jnp.concatenate([(lower + upper) / 2, size], -1), 0)
    codes = take(canonical(parts["codes"], jnp))
    scores = jnp.take_along_axis(take(parents), order[:, None], 2)
    scores = jnp.pad(scores, ((0, 0), (0, 0), (0, most - scores.shape[2])))
    likeliest = jnp.where(there[:, None], scores, -jnp.inf).argmax(-1)
    moves = jnp.linalg.norm(codes[..., 1:4], axis=-1) > FIXED_AXIS
    moves &= likeliest != jnp.arange(most)  # a root is fixed
    return PartTable(
        boxes,
        jnp.where(moves[..., None], codes, 0),
        jnp.where(there, likeliest, 0).astype(jnp.int32),
        jnp.clip(take(parts["colors"]), 0, 1),
        counts.astype(jnp.int32),
    )


def make_structure_sampler(model: ModelConfig, options: SampleConfig) -> Callable[..., Solution]:
    """Jitted (params, (mean, std), condition, key) -> structure latents [B, s, s, s, C] and what
    they cost."""
    network = build("structure_flow", model)
    vae = model.structure_vae
    side = model.grid.resolution // vae.patch_size // 2 ** (len(vae.channels) - 1)

    @jax.jit
    def run(params, statistics, condition, key):
        mean, std = statistics
        noise = jax.random.normal(
            key, (condition.tokens.shape[0], side, side, side, vae.latent_channels)
        )

        def velocity(x, t, seen):
            return network.apply(params, x, t, seen.tokens, seen.volume, **views_and_layout(seen))

        nothing = jax.tree.map(jnp.zeros_like, condition)
        guided = guide(velocity, condition, nothing, options.guidance, options.guidance_interval)
        found = _solve(guided, noise, options, model.structure_flow)
        return found._replace(x=found.x * std + mean)

    return run


def make_structure_decoder(model: ModelConfig) -> Callable[..., jax.Array]:
    """Jitted (structure VAE's params, structure flow's, latents [B, s, s, s, C], condition) ->
    occupancy logits [B, R, R, R], refined where the flow has a refiner."""
    vae, flow = build("structure_vae", model), build("structure_flow", model)

    @jax.jit
    def run(vae_params, flow_params, latent, condition):
        logits = vae.apply(vae_params, latent, method="decode")
        if not model.structure_flow.refine_channels:
            return logits
        seen = (condition.pixels, condition.cameras, condition.layout)
        return flow.apply(flow_params, logits, *seen, method="refine")

    return run


def make_latent_sampler(model: ModelConfig, options: SampleConfig) -> Callable[..., Solution]:
    """Jitted (params, (mean, std), condition, key, voxels) -> UniArt latents [B, V, C], padding
    zero, and what they cost; ``voxels``: a ``VoxelBatch`` with the plan "flow"."""
    network = build("latent_flow", model)
    channels = model.uniart_vae.latent_channels

    @jax.jit
    def run(params, statistics, condition, key, voxels):
        mean, std = statistics
        coords, counts = voxels.coords, voxels.counts
        valid = (jnp.arange(coords.shape[1]) < counts[:, None])[..., None]
        noise = jnp.where(valid, jax.random.normal(key, (*coords.shape[:2], channels)), 0)

        def velocity(x, t, seen):
            given = flow_arguments(voxels, seen)
            return network.apply(params, x, t, seen.tokens, seen.volume, **given)

        nothing = jax.tree.map(jnp.zeros_like, condition)
        guided = guide(velocity, condition, nothing, options.guidance, options.guidance_interval)
        found = _solve(guided, noise, options, model.latent_flow, valid)
        return found._replace(x=jnp.where(valid, found.x * std + mean, 0))

    return run


def _solve(
    velocity: Velocity,
    noise: jax.Array,
    options: SampleConfig,
    flow: FlowConfig,
    valid: jax.Array | None = None,
) -> Solution:
    return solve(
        velocity,
        noise,
        options.solver,
        options.steps,
        options.rescale_t,
        tolerance=options.tolerance if options.adaptive else None,
        valid=valid,
        end=T_MIN if flow.prediction == "data" else 0.0,
    )


def pad_coords(
    coords: Sequence[np.ndarray], buckets: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Voxel lists [V_i, 3] as padded coords [B, V, 3] and counts [B]; V is the smallest bucket that
    holds all, or beyond the largest the next multiple of ``WIDTH_STEP``."""
    longest = max(len(c) for c in coords)
    beyond = -(-longest // WIDTH_STEP) * WIDTH_STEP
    width = min((b for b in buckets if b >= longest), default=beyond)
    padded = np.zeros((len(coords), width, 3), np.int32)
    for row, voxels in zip(padded, coords, strict=True):
        row[: len(voxels)] = voxels
    return padded, np.array([len(c) for c in coords], np.int32)


def flow_inputs(coords: np.ndarray, counts: np.ndarray, model: ModelConfig) -> VoxelBatch:
    """Padded voxels with the latent flow's plan."""
    plan = flow_plan(coords, counts, model.latent_flow, model.grid, round_to=CELL_STEP)
    return VoxelBatch(coords, counts, plans={"flow": plan})


def views_and_layout(seen: Condition) -> dict[str, Any]:
    """What both flows see beside tokens and volume, as arguments by name."""
    return {"views": (seen.pixels, seen.cameras), "layout": seen.layout}


def flow_arguments(voxels: VoxelBatch, seen: Condition) -> dict[str, Any]:
    """The latent flow's arguments by name: the voxels, and what it sees of images beside tokens and
    volume."""
    return {
        "coords": voxels.coords,
        "counts": voxels.counts,
        "plan": voxels.plans["flow"],
        **views_and_layout(seen),
    }


def join_views(condition: Condition, items: int = 1) -> Condition:
    """Several views [B N, ...], N of each of B ``items``, as one condition [B, ...] of each,
    without a layout: tokens and maps side by side, volumes (aligned with the object) averaged."""
    tokens, volume, *views = condition[:4]
    mean = None if volume is None else volume.reshape(items, -1, *volume.shape[1:]).mean(1)
    pixels, cameras = (None if v is None else v.reshape(items, -1, *v.shape[2:]) for v in views)
    return Condition(tokens.reshape(items, -1, tokens.shape[-1]), mean, pixels, cameras)


def reads_layout_cameras(model: ModelConfig) -> bool:
    """Whether flows see the first view of an image through its layout's camera, where it has one,
    in place of the image encoder's: where the structure flow reads pixels. The latent flow then
    reads through it too, also one that was trained on the encoder's."""
    return model.structure_flow.pixel_channels > 0


def with_layout_cameras(condition: Condition, cameras: jax.Array) -> Condition:
    """The condition of B items whose first views are seen through the camera codes [B, 7] of their
    layouts, where the item has a layout."""
    there = condition.layout.counts[:, None] > 0
    first = jnp.where(there, cameras, condition.cameras[:, 0])
    return condition._replace(cameras=condition.cameras.at[:, 0].set(first))


def with_first_view_cameras(
    condition: Condition, cameras: Sequence[np.ndarray | None]
) -> Condition:
    """The condition of B items with camera codes [7] of their first views, where one is given, in
    place of the image encoder's estimates."""
    if condition.cameras is None or all(camera is None for camera in cameras):
        return condition
    codes = np.array(condition.cameras)
    for item, camera in zip(codes, cameras, strict=True):
        if camera is not None:
            item[0] = camera
    return condition._replace(cameras=codes)
