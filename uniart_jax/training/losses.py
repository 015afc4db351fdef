"""Losses of the five networks as functions of arrays.

    L_vae  = L_geo + lambda_1 L_art + L_own + lambda_2 L_kl        (the paper, section 4.2 and supplement)
    L_geo  = occupancy (cross-entropy on the sign) + truncated distance + colour, per sub-cell
    L_art  = Huber on joint codes modulo their gauges, on own boxes, on parent boxes and on part features, where there are any
    L_own  = cross-entropy on who owns a sub-cell (ours; not weighted by lambda_1)
    L_kl   = mean over elements of KL(q || N(0, 1))

Means are taken per object first and then over objects, so that large objects do not outweigh small
ones.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.voxels.joint_code import box_corners, gauge_variants

# of parameters, a batch (``voxels.typed_batches``) and a key
LossFn = Callable[[Any, Any, jax.Array], tuple[jax.Array, dict[str, jax.Array]]]
LossFnWithFrozen = Callable[[Any, Any, jax.Array, Any], tuple[jax.Array, dict[str, jax.Array]]]


def masked_mean(values: jax.Array, weights: jax.Array) -> jax.Array:
    """Weighted mean per item, then mean over items.

    Args:
      values: [B, ...] and weights: [B, ...] of the same shape; an item whose weights are all 0
        counts as 0.
    """
    axes = tuple(range(1, values.ndim))
    safe = jnp.where(weights > 0, values, 0.0)  # garbage at weight 0 must not turn into NaN
    return jnp.mean((safe * weights).sum(axes) / jnp.maximum(weights.sum(axes), 1e-6))


def huber(error: jax.Array, delta: float) -> jax.Array:
    """Huber loss of an error, slope 1 beyond ``delta``: e^2 / (2 delta) inside, |e| - delta/2
    outside."""
    size = jnp.abs(error)
    return jnp.where(size < delta, 0.5 * size**2 / delta, size - 0.5 * delta)


def joint_code_loss(predicted: jax.Array, target: jax.Array, delta: float) -> jax.Array:
    """[...] mean Huber over the nine entries of a joint code [..., 9], least over the target's
    gauges."""
    variants = gauge_variants(target, xp=jnp)  # [..., G, 9]
    return huber(predicted[..., None, :] - variants, delta).mean(-1).min(-1)


def box_loss(predicted: jax.Array, target: jax.Array, delta: float) -> jax.Array:
    """[...] mean Huber over a box [..., 6] (centre, size), measured on its lower and upper
    corners."""
    return huber(box_corners(predicted, jnp) - box_corners(target, jnp), delta).mean(-1)


def part_feature_loss(
    predicted: jax.Array, target: jax.Array, weights: jax.Array, delta: float
) -> jax.Array:
    """Huber on restored part features [B, V, P], the paper's V_art-hat; weights [B, V]."""
    error = predicted - target.astype(jnp.float32)
    return masked_mean(huber(error, delta).mean(-1), weights)


def kl_loss(mean: jax.Array, logvar: jax.Array, mask: jax.Array) -> jax.Array:
    """Mean per element of KL(N(mean, exp(logvar)) || N(0, 1)); arrays [B, V, C], mask [B, V]."""
    divergence = 0.5 * (mean**2 + jnp.exp(logvar) - 1.0 - logvar)
    return masked_mean(divergence.mean(-1), mask)


def geometry_losses(
    predicted: dict[str, jax.Array], sdf: jax.Array, color: jax.Array, weights: jax.Array
) -> dict[str, jax.Array]:
    """L_geo's three terms.

    Args:
      predicted: "sdf" [B, V, r^3] in sub-cells and "color" [B, V, r^3, 3] linear.
      sdf, color: the truth, same shapes. weights: [B, V].

    The sign's logit is -2 sdf: a cross-entropy that the distance itself answers for, so that head
    and surface agree. Colour counts only within two sub-cells of the surface, where it is seen.
    """
    inside = (sdf < 0).astype(jnp.float32)
    occupancy = binary_cross_entropy(-2.0 * predicted["sdf"], inside)
    near = (jnp.abs(sdf) < 2.0).astype(jnp.float32)
    color_error = jnp.abs(predicted["color"] - color).mean(-1)
    return {
        "occupancy": masked_mean(occupancy.mean(-1), weights),
        "sdf": masked_mean(huber(predicted["sdf"] - sdf, 0.5).mean(-1), weights),
        "color": masked_mean(
            (color_error * near).sum(-1) / jnp.maximum(near.sum(-1), 1.0), weights
        ),
    }


def articulation_losses(
    predicted: dict[str, jax.Array],
    boxes: dict[str, jax.Array],
    joint_code: jax.Array,
    parent_box: jax.Array,
    weights: jax.Array,
    delta: float,
) -> tuple[dict[str, jax.Array], jax.Array]:
    """L_art's terms, Huber on "own_box", "other_box" (shared voxels), "joint_code", "parent_box";
    and, apart from them, L_own, the cross-entropy of "other_part".

    Args:
      predicted: "part_boxes" [B, V, 2, 6], "other_part" [B, V, r^3] logits, "joint_code" [B, V, 9],
        "parent_box" [B, V, 6].
      boxes: the truth, of ``models.voxel_batch.voxel_boxes``. joint_code, parent_box: the truth,
        shapes as predicted. weights: [B, V].

    Two boxes told apart by name, not a mixture: fitted as a mixture, a voxel's box is right only as
    a mean of two wrong ones.
    """
    pair = predicted["part_boxes"]
    is_other = boxes["other_part"].astype(jnp.float32)
    other_part = binary_cross_entropy(predicted["other_part"], is_other)
    articulation = {
        "own_box": masked_mean(box_loss(pair[..., 0, :], boxes["own"], delta), weights),
        "other_box": masked_mean(
            box_loss(pair[..., 1, :], boxes["other"], delta), weights * boxes["shared"]
        ),
        "joint_code": masked_mean(
            joint_code_loss(predicted["joint_code"], joint_code, delta), weights
        ),
        "parent_box": masked_mean(box_loss(predicted["parent_box"], parent_box, delta), weights),
    }
    return articulation, masked_mean(other_part.mean(-1), weights)


def binary_cross_entropy(logits: jax.Array, target: jax.Array) -> jax.Array:
    """Elementwise cross-entropy of logits against 0/1 targets."""
    return jnp.maximum(logits, 0) - logits * target + jnp.log1p(jnp.exp(-jnp.abs(logits)))


def dice_loss(logits: jax.Array, target: jax.Array) -> jax.Array:
    """1 - soft Dice overlap per item, averaged; [B, ...]. Upstream: TRELLIS
    trainers/vae/sparse_structure_vae.py."""
    probability = jax.nn.sigmoid(logits)
    axes = tuple(range(1, logits.ndim))
    overlap = 2 * (probability * target).sum(axes) + 1
    return jnp.mean(1 - overlap / (probability.sum(axes) + target.sum(axes) + 1))


def balanced_voxels(
    key: jax.Array, voxel_part: jax.Array, counts: jax.Array, number: int, max_parts: int
) -> jax.Array:
    """[B, number] voxel indices drawn so that every part of an object is drawn equally often (with
    replacement).

    Args:
      voxel_part: [B, V] part ids. counts: [B] valid voxels. max_parts: K.
    """
    valid = jnp.arange(voxel_part.shape[1])[None] < counts[:, None]

    def weigh(parts, valid):
        sizes = jnp.zeros(max_parts).at[parts].add(valid.astype(jnp.float32))
        return jnp.where(valid, 1.0 / jnp.maximum(sizes[parts], 1.0), 0.0)

    return draw_rows(key, jax.vmap(weigh)(voxel_part, valid), number)


def draw_rows(key: jax.Array, weights: jax.Array, number: int) -> jax.Array:
    """[B, number] indices of rows drawn with replacement, as likely as their ``weights`` [B, n] >=
    0; never one of weight 0."""

    def draw(key, weights):
        cumulative = jax.lax.cummax(jnp.cumsum(weights))  # XLA's float sums may step back
        points = jax.random.uniform(key, (number,)) * cumulative[-1]
        last = weights.shape[0] - 1 - jnp.argmax(weights[::-1] > 0)  # rounding may end beyond it
        return jnp.minimum(jnp.searchsorted(cumulative, points, side="right"), last)

    return jax.vmap(draw)(jax.random.split(key, weights.shape[0]), weights)


def part_weights(
    parts: jax.Array, mask: jax.Array, max_parts: int, share: float = 0.5
) -> jax.Array:
    """[B, n] weights of sum 1, a ``share`` of them uniform over parts and the rest over rows, so
    that small parts are heard.

    Args:
      parts: [B, n] part ids. mask: [B, n] 1 where the row counts.
    """

    def of_item(parts, mask):
        sizes = jnp.zeros(max_parts).at[parts].add(mask)
        present = jnp.maximum((sizes > 0).sum(), 1)
        uniform = mask / jnp.maximum(mask.sum(), 1.0)
        balanced = mask / jnp.maximum(sizes[parts], 1.0) / present
        return (1 - share) * uniform + share * balanced

    return jax.vmap(of_item)(parts, mask)


def occupancy_iou(logits: jax.Array, occupancy: jax.Array) -> jax.Array:
    """Mean intersection over union of logits [B, R, R, R] above 0 and occupancy 0 or 1."""
    predicted, truth, axes = logits > 0, occupancy > 0.5, (1, 2, 3)
    union = jnp.maximum((predicted | truth).sum(axes), 1)
    return ((predicted & truth).sum(axes) / union).mean()


def occupancy_terms(logits: jax.Array, occupancy: jax.Array) -> dict[str, jax.Array]:
    """ "entropy", "dice" and, to look at, "iou" of logits [B, R, R, R] against occupancy 0 or 1."""
    occupancy = occupancy.astype(jnp.float32)
    return {
        "entropy": binary_cross_entropy(logits, occupancy).mean(),
        "dice": dice_loss(logits, occupancy),
        "iou": occupancy_iou(logits, occupancy),
    }
