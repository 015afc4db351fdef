"""What the two flows minimise: ``make_*`` gives ``loss_fn(params, batch, key) -> (loss, scalar
metrics)``. Batches are those of ``data.latents`` with what an image encoder sees, ``seen``, in
place of the picture (``with_image_condition``); every loss is a mean per object, then over
objects."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.config import Config
from uniart_jax.flow.rectified import flow_loss, interpolate, predicted_sample, sample_times
from uniart_jax.inference.samplers import (
    FoundLayouts,
    flow_arguments,
    join_views,
    make_structure_sampler,
    views_and_layout,
    with_layout_cameras,
)
from uniart_jax.models.network import Network, build
from uniart_jax.models.voxel_batch import valid_tokens
from uniart_jax.training.found_layouts import choose
from uniart_jax.training.losses import (
    LossFn,
    LossFnWithFrozen,
    occupancy_iou,
    occupancy_terms,
    part_weights,
)
from uniart_jax.voxels.typed_batches import Condition


def normalize(latent: jax.Array, mean: Any, std: Any) -> jax.Array:
    """Channels of a latent [..., C] to mean 0 and deviation 1."""
    return (latent - jnp.asarray(mean)) / jnp.asarray(std)


def with_image_condition(
    loss_fn: LossFn,
    condition: Callable[..., Condition],
    find: Callable[..., FoundLayouts] | None = None,
    share: float = 0.0,
    layout_cameras: bool = False,
) -> LossFnWithFrozen:
    """A flow's loss of batches with ``image`` [B, H, W, 3], or N views [B, N, H, W, 3], in place of
    what an image encoder sees in them: (params, batch, key, frozen) -> as ``loss_fn``.

    ``frozen``: parameters of the image encoder, of what else ``loss_fn`` is given after its key
    and, with ``find``, of the layout network. Nothing is differentiated by them.

    Args:
      condition: (encoder's parameters, images) -> what the flow sees
        (``inference.samplers.make_conditioner``), through the cameras that the encoder estimates.
      find: (layout network's parameters, images) -> what that network finds
        (``inference.samplers.make_layout_finder``); its parts are shown in place of the batch's own
        to a ``share`` of the items; of several views it looks at the first.
      layout_cameras: items with a layout are seen through the cameras that ``find`` estimates
        (``inference.samplers.reads_layout_cameras``); of several views the first.
    """

    def seeing(params, batch, key, frozen):
        encoder, *more = frozen
        image, layout, cameras = batch.image, batch.layout, None
        if image.ndim == 5:
            seen = condition(encoder, image.reshape(-1, *image.shape[2:]))
            seen, image = join_views(seen, len(image)), image[:, 0]
        else:
            seen = condition(encoder, image)
        if find is not None:
            found, cameras = find(more.pop(), image)
            chosen = jax.random.bernoulli(jax.random.fold_in(key, 2), share, found.counts.shape)
            layout = choose(chosen, found, layout)
        seen = seen._replace(layout=layout)
        if layout_cameras and cameras is not None:
            seen = with_layout_cameras(seen, cameras)
        batch = batch._replace(image=None, layout=layout, seen=seen)
        return loss_fn(params, batch, key, *more)

    return seeing


def make_structure_flow_loss(network: Network, config: Config, mean: Any, std: Any) -> Any:
    """Rectified flow of the dense structure latent; ``draws_per_image`` noise draws share one
    image's condition.

    With ``loss.decoded_structure``, what the structure VAE makes of the flow's x_0 is held against
    the true occupancy, as its own training does; with ``loss.refined``, a share of the loss is
    ``make_refiner_loss``. With either, the function takes the structure VAE's parameters after the
    key, and batches hold ``occupancy`` [B, R, R, R].
    """
    flow, weights = config.model.structure_flow, config.loss
    share = weights.refined
    if not 0 <= share <= 1 or (share and not flow.refine_channels):
        raise ValueError(
            f"config: loss.refined is {share}; give 0 to 1, and "
            "model.structure_flow.refine_channels where it is above 0"
        )
    refine = make_refiner_loss(network, config, mean, std) if share else None
    vae = build("structure_vae", config.model) if weights.decoded_structure > 0 else None

    def loss_fn(params, batch, key, vae_params=None):
        if refine is None:
            return velocity_loss(params, batch, key, vae_params)
        loss, metrics = refine(params, batch, jax.random.fold_in(key, 1), vae_params)
        if share == 1:
            return loss, metrics
        other, more = velocity_loss(params, batch, key, vae_params)
        return share * loss + (1 - share) * other, metrics | more

    def velocity_loss(params, batch, key, vae_params):
        x0 = jnp.repeat(normalize(batch.structure, mean, std), weights.draws_per_image, axis=0)
        t, noise, seen = sample_noise_and_time(batch.seen, x0, key, config)
        x = interpolate(x0, noise, t)
        v = network.apply(params, x, t, seen.tokens, seen.volume, **views_and_layout(seen))
        error = flow_loss(v, x0, noise)
        loss, metrics = summarize_flow(error, v, x, x0, t, None, flow.prediction)
        if vae is None:
            return loss, metrics
        guess = predicted_sample(x, v, t) * jnp.asarray(std) + jnp.asarray(mean)
        logits = vae.apply(vae_params, guess, method="decode")
        occupancy = jnp.repeat(batch.occupancy, weights.draws_per_image, axis=0)
        terms = occupancy_terms(logits, occupancy)
        loss = loss + weights.decoded_structure * (terms["entropy"] + terms["dice"])
        return loss, metrics | {f"decoded_{name}": term for name, term in terms.items()}

    return loss_fn


def make_refiner_loss(network: Network, config: Config, mean: Any, std: Any) -> LossFnWithFrozen:
    """Cross-entropy and Dice of the refiner's logits on what the structure flow samples in one step
    and the structure VAE decodes; only the refiner is differentiated. Takes the structure VAE's
    parameters after the key."""
    model, once = config.model, {"steps": 1, "solver": "euler", "adaptive": False}
    options = dataclasses.replace(config.sample_structure, **once)
    sample, vae = make_structure_sampler(model, options), build("structure_vae", model)

    def loss_fn(params, batch, key, vae_params):
        seen, frozen = batch.seen, jax.lax.stop_gradient(params)
        latent = sample(frozen, (mean, std), seen, key).x
        logits = jax.lax.stop_gradient(vae.apply(vae_params, latent, method="decode"))
        given = (seen.pixels, seen.cameras, seen.layout)
        refined = network.apply(params, logits, *given, method="refine")
        metrics = occupancy_terms(refined, batch.occupancy)
        metrics["iou_before"] = occupancy_iou(logits, batch.occupancy.astype(jnp.float32))
        return metrics["entropy"] + metrics["dice"], metrics

    return loss_fn


def make_latent_flow_loss(
    network: Network, config: Config, mean: Any, std: Any, metric: Any = None
) -> LossFn:
    """Rectified flow of the UniArt latents on the active voxels, ``part_share`` of the loss spread
    evenly over parts.

    ``metric`` [C, C]: of ``training.latent_metric``; None measures all channels alike.
    """
    for name in ("part_share", "readout_share"):
        if not 0 <= getattr(config.loss, name) <= 1:
            raise ValueError(f"config: loss.{name} is {getattr(config.loss, name)}; give 0 to 1")
    flow, share, parts = (
        config.model.latent_flow,
        config.loss.part_share,
        config.model.grid.max_parts,
    )

    def loss_fn(params, batch, key):
        coords, counts = batch.coords, batch.counts
        mask = valid_tokens(counts, coords.shape[1])[..., 0]
        x0 = jnp.where(mask[..., None], normalize(batch.latent, mean, std), 0)
        t, noise, seen = sample_noise_and_time(batch.seen, x0, key, config)
        x = interpolate(x0, noise, t)
        given = flow_arguments(batch, seen)
        v = network.apply(params, x, t, seen.tokens, seen.volume, **given)
        weights = part_weights(batch.voxel_part, mask.astype(jnp.float32), parts, share)
        error = flow_loss(v, x0, noise, weights, metric=metric)
        loss, metrics = summarize_flow(error, v, x, x0, t, mask, flow.prediction)
        metrics["padding"] = 1 - mask.mean()
        return loss, metrics

    return loss_fn


def sample_noise_and_time(seen: Condition, x0: jax.Array, key: jax.Array, config: Config):
    """Times [B n], noise like x0, and the condition with some items' dropped to zero for
    guidance."""
    weights = config.loss
    time_key, noise_key, drop_key = jax.random.split(key, 3)
    t = sample_times(
        time_key, x0.shape[:1], weights.time_mean, weights.time_std, weights.noise_share
    )
    noise = jax.random.normal(noise_key, x0.shape)
    keep = jax.random.uniform(drop_key, seen.tokens.shape[:1]) >= weights.condition_drop
    drop = lambda a: jnp.where(keep.reshape(-1, *[1] * (a.ndim - 1)), a, 0)  # noqa: E731
    return t, noise, jax.tree.map(drop, seen)


def summarize_flow(error, v, x, x0, t, mask, prediction):
    """Loss and metrics. A network that predicts the clean sample is judged on it: the velocity's
    error times t^2."""
    loss = jnp.mean(error * t**2 if prediction == "data" else error)
    miss = jnp.square(predicted_sample(x, v, t) - x0).mean(-1)
    miss = miss if mask is None else jnp.where(mask, miss, 0)
    axes = tuple(range(1, miss.ndim))
    miss = miss.mean(axes) if mask is None else miss.sum(axes) / jnp.maximum(mask.sum(axes), 1)
    late = t > 0.95
    # of a variance of 1: near 1 means that the image is ignored, whatever the loss says
    at_noise = (
        jnp.where(late, miss, 0).sum() / late.sum()
    )  # NaN without such a draw: left out of means
    return loss, {"velocity": error.mean(), "x0_error": miss.mean(), "x0_error_at_noise": at_noise}
