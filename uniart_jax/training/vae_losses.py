"""What the two VAEs minimise: ``make_*`` gives ``loss_fn(params, batch, key) -> (loss, scalar
metrics)``. Batches are ``PictureBatch`` and ``VoxelBatch`` of ``voxels.typed_batches``; every loss
is a mean per object, then over objects."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.config import Config
from uniart_jax.inference.samplers import (
    make_conditioner,
    make_latent_sampler,
    make_layout_finder,
    reads_layout_cameras,
    with_layout_cameras,
)
from uniart_jax.models.network import Network
from uniart_jax.models.structure_vae import sample_posterior
from uniart_jax.models.voxel_batch import (
    cell_color,
    cell_sdf,
    valid_tokens,
    voxel_boxes,
    voxel_codes,
)
from uniart_jax.training.found_layouts import show_found
from uniart_jax.training.losses import (
    LossFn,
    articulation_losses,
    balanced_voxels,
    geometry_losses,
    kl_loss,
    masked_mean,
    occupancy_terms,
    part_feature_loss,
)
from uniart_jax.voxels.joint_code import JOINT_CODE, PARENT_BOX


def make_structure_vae_loss(network: Network, config: Config) -> LossFn:
    """Occupancy through the dense VAE: cross-entropy + Dice + KL. Upstream: TRELLIS
    ``trainers/vae/sparse_structure_vae.py``."""

    def loss_fn(params, batch, key):
        occupancy = batch.occupancy.astype(jnp.float32)
        out = network.apply(params, occupancy, key)
        terms = occupancy_terms(out["logits"], occupancy)
        mean, logvar = (
            out[k].reshape(occupancy.shape[0], -1, out[k].shape[-1]) for k in ("mean", "logvar")
        )
        kl = kl_loss(mean, logvar, jnp.ones(mean.shape[:2]))
        loss = terms["entropy"] + terms["dice"] + config.loss.structure_kl * kl
        return loss, {**terms, "kl": kl}

    return loss_fn


def make_uniart_vae_loss(
    network: Network, config: Config, mean: Any = None, std: Any = None
) -> Any:
    """L_geo + lambda_1 L_art + lambda_2 L_kl (+ the supplement's alignment), on all voxels or on
    some drawn equally from all parts.

    With ``loss.sampled`` the function takes the parameters of the image encoder and of the latent
    flow after the key, with ``loss.found`` those of the layout network too, ``mean`` and ``std`` of
    the flow's latents are to be given, and batches hold ``image`` and ``plans["flow"]``.
    """
    weights, max_parts = config.loss, config.model.grid.max_parts
    sample = make_sampled_latents(config, mean, std) if weights.sampled > 0 else None
    shown = sample is not None and weights.found > 0
    find = make_layout_finder(config.model) if shown else None

    def loss_fn(params, batch, key, frozen: Any = None):
        draw_key, noise_key = jax.random.split(key)
        cameras = None
        if find is not None:
            *frozen, finder = frozen
            found, cameras = find(finder, batch.image)
            batch = show_found(batch, found, weights.found, jax.random.fold_in(key, 2))
        valid = valid_tokens(batch.counts, batch.coords.shape[1])[..., 0].astype(jnp.float32)
        voxels, mask = None, valid
        if weights.voxels_per_object:
            voxels = balanced_voxels(
                draw_key, batch.voxel_part, batch.counts, weights.voxels_per_object, max_parts
            )
            mask = jnp.ones(voxels.shape)
        out = network.apply(params, batch, method="encode")
        latent = sample_posterior(out["mean"], out["logvar"], noise_key)
        if sample is not None:
            choice_key, flow_key = jax.random.split(jax.random.fold_in(key, 1))
            chosen = jax.random.uniform(choice_key, latent.shape[:1]) < weights.sampled
            sampled = sample(frozen, batch, flow_key, cameras)
            latent = jnp.where(chosen[:, None, None], sampled, latent)
        out |= network.apply(params, latent, batch, voxels, method="decode")

        def at(values: jax.Array) -> jax.Array:
            if voxels is None:
                return values
            index = voxels.reshape(*voxels.shape, *[1] * (values.ndim - 2))
            return jnp.take_along_axis(values, index, axis=1)

        codes = at(voxel_codes(batch))
        sdf, color = cell_sdf(at(batch.sdf)), cell_color(at(batch.color))
        geometry = geometry_losses(out, sdf, color, mask)
        articulation, ownership = articulation_losses(
            out,
            voxel_boxes(batch, voxels),
            codes[..., JOINT_CODE],
            codes[..., PARENT_BOX],
            mask,
            weights.huber_delta,
        )
        if "pointer" in out:
            geometry["pointer"] = pointer_loss(out, at(batch.owner), batch.layout_rows, sdf, mask)
        kl = kl_loss(out["mean"], out["logvar"], valid)
        loss = geometry["occupancy"] + geometry["sdf"] + weights.color * geometry["color"]
        loss = loss + geometry.get("pointer", 0.0)
        metrics = {**geometry, **articulation, "foreign": ownership, "kl": kl}
        metrics["padding"] = 1 - valid.mean()
        loss = loss + ownership
        loss = loss + weights.articulation * sum(articulation.values()) + weights.kl * kl
        if "part_feature" in out:
            true = at(batch.part_feature)
            restored = part_feature_loss(out["part_feature"], true, mask, weights.huber_delta)
            metrics["part_feature"] = restored
            loss = loss + weights.articulation * weights.part_feature * restored
        if weights.alignment:
            metrics["alignment"] = alignment_loss(out["geometry"], out["articulation"], valid)
            loss = loss + weights.alignment * metrics["alignment"]
        return loss, metrics

    return loss_fn


def make_sampled_latents(config: Config, mean: Any, std: Any) -> Callable[..., jax.Array]:
    """(parameters of image encoder and latent flow, voxel batch, key, camera codes [B, 7] found
    with layouts or None) -> latents [B, V, C] that the flow samples in one step; not
    differentiated."""
    model = config.model
    condition = make_conditioner(model)
    run = make_latent_sampler(model, dataclasses.replace(config.sample_latent, steps=1))
    through = reads_layout_cameras(model)

    def sample(frozen, batch, key, cameras):
        encoder, flow = frozen
        seen = condition(encoder, batch.image)._replace(layout=batch.layout)
        if through and cameras is not None:
            seen = with_layout_cameras(seen, cameras)
        return jax.lax.stop_gradient(run(flow, (mean, std), seen, key, batch).x)

    return sample


def pointer_loss(
    out: Any, owner: jax.Array, rows: jax.Array, sdf: jax.Array, mask: jax.Array
) -> jax.Array:
    """Cross-entropy of the sub-cells' pointers, most of it near the surface (exp(-|distance|) +
    .2).

    Args:
      out: "pointer" [B, Q, r^3, N + 1] and "rows" [B, Q, N] of the decoder. owner, sdf: [B, Q, r^3]
        true part and distance.
      rows: [B, K] the layout's row of each true part, -1 where it has none: its sub-cells are to
        point at none. mask: [B, Q].

    Sub-cells whose row is none of their voxel's candidates do not count.
    """
    wanted = jax.vmap(lambda table, part: table[part])(rows, owner.astype(jnp.int32))
    hit = (out["rows"][:, :, None] == wanted[..., None]) & (wanted >= 0)[..., None]
    target = jnp.concatenate([hit, (wanted < 0)[..., None]], -1).astype(jnp.float32)
    entropy = -(jax.nn.log_softmax(out["pointer"], -1) * target).sum(-1)
    near = (jnp.exp(-jnp.abs(sdf)) + 0.2) * target.sum(-1)
    each = (entropy * near).sum(-1) / jnp.maximum(near.sum(-1), 1e-6)
    return masked_mean(each, mask)


def alignment_loss(geometry: jax.Array, articulation: jax.Array, valid: jax.Array) -> jax.Array:
    """The supplement's "structure alignment" between the two embeddings, of which it gives no
    formula: 1 - CKA.

    Linear centred kernel alignment compares two sets of vectors of different widths without another
    layer; 0 where each is a rotation and scaling of the other. Arrays [B, V, C1], [B, V, C2], valid
    [B, V].
    """

    def one(a, b, mask):
        mask = mask[:, None]
        count = jnp.maximum(mask.sum(), 1.0)
        a, b = (jnp.where(mask > 0, x, 0) for x in (a, b))
        a, b = ((x - x.sum(0) / count) * mask for x in (a, b))
        cross = jnp.sum((a.T @ b) ** 2)
        return 1 - cross / jnp.maximum(jnp.linalg.norm(a.T @ a) * jnp.linalg.norm(b.T @ b), 1e-9)

    return jax.vmap(one)(geometry, articulation, valid).mean()
