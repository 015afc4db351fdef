"""What each network minimises: ``make_*`` gives ``loss_fn(params, batch, key) -> (loss, scalar metrics)``.

Batches are those of ``data.batches``, a flow's with what an image encoder sees (``samplers.Condition``) in place of the picture; every loss is a mean per object, then over objects.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.config import Config
from uniart_jax.flow.rectified import flow_loss, interpolate, predicted_sample, sample_times
from uniart_jax.models.network import Network, build
from uniart_jax.models.structure_vae import sample_posterior
from uniart_jax.models.uniart_vae import (
    cell_color,
    cell_sdf,
    valid_tokens,
    voxel_boxes,
    voxel_codes,
)
from uniart_jax.samplers import (
    Condition,
    make_conditioner,
    make_latent_sampler,
    make_layout_finder,
    make_structure_sampler,
)
from uniart_jax.training.found_layouts import choose, show_found
from uniart_jax.training.layout_loss import make_layout_loss as make_layout_loss  # the stage's
from uniart_jax.training.losses import (
    articulation_losses,
    balanced_voxels,
    binary_cross_entropy,
    box_loss,
    dice_loss,
    draw_rows,
    geometry_losses,
    joint_code_loss,
    kl_loss,
    masked_mean,
    part_feature_loss,
)
from uniart_jax.voxels.part_table import PartTable

DECODED_VOXELS = 1024  # of an item that the decoded loss looks at
COLOR_WEIGHT, SIGN_SLOPE = 3.0, 3.0
OCCUPANCY_WEIGHT = 10.0  # of the image encoder's occupancy against boxes and joints
CAMERA_WEIGHT = 3.0

LossFn = Callable[[Any, dict[str, Any], jax.Array], tuple[jax.Array, dict[str, jax.Array]]]
GivenLossFn = Callable[
    [Any, dict[str, Any], jax.Array, Any], tuple[jax.Array, dict[str, jax.Array]]
]


def part_weights(
    parts: jax.Array, mask: jax.Array, max_parts: int, share: float = 0.5
) -> jax.Array:
    """[B, n] weights of sum 1, a ``share`` of them uniform over parts and the rest over rows, so that small parts are heard.

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


def make_image_encoder_loss(network: Network, config: Config) -> LossFn:
    """Regression of coarse structure from the image: camera, occupancy [R^3], joint codes and boxes at the target resolution.

    Half of the items are lifted through their true camera, so that the lifting learns while the estimate is still poor; the
    "iou" logged here is over both halves.
    """
    delta = config.loss.huber_delta

    def loss_fn(params, batch, key):
        known_key, draw_key = jax.random.split(key)
        known = jax.random.bernoulli(known_key, 0.5, batch["image"].shape[:1])
        out = network.apply(params, batch["image"], batch["camera"], known)
        occupancy = batch["occupancy"].astype(jnp.float32)
        items = occupancy.shape[0]
        entropy = binary_cross_entropy(out["occupancy"], occupancy).mean()
        codes = out["codes"].reshape(items, -1, out["codes"].shape[-1])
        part = batch["cell_part"].reshape(items, -1)
        mask = (part >= 0).astype(jnp.float32)
        part = jnp.maximum(part, 0)
        weights = part_weights(part, mask, config.model.grid.max_parts)
        gather = jax.vmap(lambda table, index: table[index])
        if 0 < config.loss.voxels_per_object < part.shape[1]:
            rows = draw_rows(draw_key, weights, config.loss.voxels_per_object)
            codes, part = gather(codes, rows), gather(part, rows)
            weights = gather(mask, rows)  # an object without a cell counts as 0
        own = gather(batch["boxes"], part)
        parent = gather(batch["boxes"], gather(batch["parents"], part))
        joint = gather(batch["codes"], part)
        terms = {
            "joint_code": masked_mean(joint_code_loss(codes[..., :9], joint, delta), weights),
            "own_box": masked_mean(box_loss(codes[..., 9:15], own, delta), weights),
            "parent_box": masked_mean(box_loss(codes[..., 15:21], parent, delta), weights),
        }
        camera = jnp.abs(out["camera"] - batch["camera"]).mean()
        # boxes and joints learn early and, weighted like occupancy, keep it from being learnt at all; Dice does too
        loss = OCCUPANCY_WEIGHT * entropy + CAMERA_WEIGHT * camera + sum(terms.values())
        iou = occupancy_iou(out["occupancy"], occupancy)
        return loss, {"entropy": entropy, "camera": camera, "iou": iou, **terms}

    return loss_fn


def make_structure_vae_loss(network: Network, config: Config) -> LossFn:
    """Occupancy through the dense VAE: cross-entropy + Dice + KL. Upstream: TRELLIS ``trainers/vae/sparse_structure_vae.py``."""

    def loss_fn(params, batch, key):
        occupancy = batch["occupancy"].astype(jnp.float32)
        out = network.apply(params, occupancy, key)
        entropy = binary_cross_entropy(out["logits"], occupancy).mean()
        overlap = dice_loss(out["logits"], occupancy)
        mean, logvar = (
            out[k].reshape(occupancy.shape[0], -1, out[k].shape[-1]) for k in ("mean", "logvar")
        )
        kl = kl_loss(mean, logvar, jnp.ones(mean.shape[:2]))
        loss = entropy + overlap + config.loss.structure_kl * kl
        iou = occupancy_iou(out["logits"], occupancy)
        return loss, {"entropy": entropy, "dice": overlap, "kl": kl, "iou": iou}

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

    def loss_fn(params, batch, key, frozen=None):
        draw_key, noise_key = jax.random.split(key)
        if find is not None:
            *frozen, finder = frozen
            found = find(finder, batch["image"])
            batch = show_found(batch, found, weights.found, jax.random.fold_in(key, 2))
        valid = valid_tokens(batch["counts"], batch["coords"].shape[1])[..., 0].astype(jnp.float32)
        voxels, mask = None, valid
        if weights.voxels_per_object:
            voxels = balanced_voxels(
                draw_key, batch["voxel_part"], batch["counts"], weights.voxels_per_object, max_parts
            )
            mask = jnp.ones(voxels.shape)
        out = network.apply(params, batch, method="encode")
        latent = sample_posterior(out["mean"], out["logvar"], noise_key)
        if sample is not None:
            choice_key, flow_key = jax.random.split(jax.random.fold_in(key, 1))
            chosen = jax.random.uniform(choice_key, latent.shape[:1]) < weights.sampled
            latent = jnp.where(chosen[:, None, None], sample(frozen, batch, flow_key), latent)
        out |= network.apply(params, latent, batch, voxels, method="decode")

        def at(values: jax.Array) -> jax.Array:
            if voxels is None:
                return values
            index = voxels.reshape(*voxels.shape, *[1] * (values.ndim - 2))
            return jnp.take_along_axis(values, index, axis=1)

        codes = at(voxel_codes(batch))
        sdf, color = cell_sdf(at(batch["sdf"])), cell_color(at(batch["color"]))
        geometry = geometry_losses(out, sdf, color, mask)
        articulation = articulation_losses(
            out,
            voxel_boxes(batch, voxels),
            codes[..., :9],
            codes[..., 15:21],
            mask,
            weights.huber_delta,
        )
        if "pointer" in out:
            geometry["pointer"] = pointer_loss(
                out, at(batch["owner"]), batch["layout_rows"], sdf, mask
            )
        kl = kl_loss(out["mean"], out["logvar"], valid)
        loss = geometry["occupancy"] + geometry["sdf"] + weights.color * geometry["color"]
        loss = loss + geometry.get("pointer", 0.0)
        metrics = {**geometry, **articulation, "kl": kl, "padding": 1 - valid.mean()}
        loss = loss + articulation.pop("foreign")
        loss = loss + weights.articulation * sum(articulation.values()) + weights.kl * kl
        if "part_feature" in out:
            true = at(batch["part_feature"])
            restored = part_feature_loss(out["part_feature"], true, mask, weights.huber_delta)
            metrics["part_feature"] = restored
            loss = loss + weights.articulation * weights.part_feature * restored
        if weights.alignment:
            metrics["alignment"] = alignment_loss(out["geometry"], out["articulation"], valid)
            loss = loss + weights.alignment * metrics["alignment"]
        return loss, metrics

    return loss_fn


def make_sampled_latents(config: Config, mean: Any, std: Any) -> Callable[..., jax.Array]:
    """(parameters of image encoder and latent flow, voxel batch, key) -> latents [B, V, C] that the
    flow samples in one step; not differentiated."""
    model = config.model
    condition = make_conditioner(model)
    run = make_latent_sampler(model, dataclasses.replace(config.sample_latent, steps=1))

    def sample(frozen, batch, key):
        encoder, flow = frozen
        seen = condition(encoder, batch["image"])._replace(layout=batch.get("layout"))
        voxels = {"coords": batch["coords"], "counts": batch["counts"]}
        voxels["plan"] = batch["plans"]["flow"]
        return jax.lax.stop_gradient(run(flow, (mean, std), seen, key, voxels).x)

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
    """The supplement's "structure alignment" between the two embeddings, of which it gives no formula: 1 - CKA.

    Linear centred kernel alignment compares two sets of vectors of different widths without another layer; 0 where each is a rotation
    and scaling of the other. Arrays [B, V, C1], [B, V, C2], valid [B, V].
    """

    def one(a, b, mask):
        mask = mask[:, None]
        count = jnp.maximum(mask.sum(), 1.0)
        a, b = (jnp.where(mask > 0, x, 0) for x in (a, b))
        a, b = ((x - x.sum(0) / count) * mask for x in (a, b))
        cross = jnp.sum((a.T @ b) ** 2)
        return 1 - cross / jnp.maximum(jnp.linalg.norm(a.T @ a) * jnp.linalg.norm(b.T @ b), 1e-9)

    return jax.vmap(one)(geometry, articulation, valid).mean()


def normalize(latent: jax.Array, mean: Any, std: Any) -> jax.Array:
    """Channels of a latent [..., C] to mean 0 and deviation 1."""
    return (latent - jnp.asarray(mean)) / jnp.asarray(std)


def of_pictures(
    loss_fn: LossFn,
    condition: Callable[..., Condition],
    find: Callable[..., PartTable] | None = None,
    share: float = 0.0,
) -> GivenLossFn:
    """A flow's loss of batches with ``image`` [B, H, W, 3] in place of what an image encoder sees
    in them: (params, batch, key, frozen) -> as ``loss_fn``.

    ``frozen``: parameters of the image encoder, of what else ``loss_fn`` is given after its key
    and, with ``find``, of the layout network. Nothing is differentiated by them.

    Args:
      condition: (encoder's parameters, images) -> what the flow sees
        (``samplers.make_conditioner``).
      find: (layout network's parameters, images) -> part tables (``samplers.make_layout_finder``),
        shown in place of the batch's own to a ``share`` of the items.
    """

    def seeing(params, batch, key, frozen):
        encoder, *more = frozen
        rest = dict(batch)
        image = rest.pop("image")
        seen = condition(encoder, image)
        if find is not None:
            found = find(more.pop(), image)
            chosen = jax.random.bernoulli(jax.random.fold_in(key, 2), share, found.counts.shape)
            rest["layout"] = choose(chosen, found, rest["layout"])
        return loss_fn(params, {**seen._asdict(), **rest}, key, *more)

    return seeing


def make_structure_flow_loss(network: Network, config: Config, mean: Any, std: Any) -> Any:
    """Rectified flow of the dense structure latent; ``draws_per_image`` noise draws share one
    image's condition.

    With ``loss.refined``, a share of it is ``make_refiner_loss``; the function then takes the
    structure VAE's parameters after the key, and batches hold ``occupancy`` [B, R, R, R].
    """
    flow, weights = config.model.structure_flow, config.loss
    share = weights.refined
    if not 0 <= share <= 1 or (share and not flow.refine_channels):
        raise ValueError(f"config: loss.refined is {share}; give 0 to 1, and model.structure_flow.refine_channels where it is above 0")  # fmt: skip
    refine = make_refiner_loss(network, config, mean, std) if share else None

    def loss_fn(params, batch, key, vae=None):
        if refine is None:
            return velocity_loss(params, batch, key)
        loss, metrics = refine(params, batch, jax.random.fold_in(key, 1), vae)
        if share == 1:
            return loss, metrics
        other, more = velocity_loss(params, batch, key)
        return share * loss + (1 - share) * other, metrics | more

    def velocity_loss(params, batch, key):
        x0 = jnp.repeat(normalize(batch["structure"], mean, std), weights.draws_per_image, axis=0)
        t, noise, seen = draw(batch, x0, key, config)
        x = interpolate(x0, noise, t)
        v = network.apply(params, x, t, seen.tokens, seen.volume, layout=seen.layout)
        error = flow_loss(v, x0, noise)
        return summarize_flow(error, v, x, x0, t, None, flow.prediction)

    return loss_fn


def make_refiner_loss(network: Network, config: Config, mean: Any, std: Any) -> GivenLossFn:
    """Cross-entropy and Dice of the refiner's logits on what the structure flow samples in one step
    and the structure VAE decodes; only the refiner is differentiated. Takes the structure VAE's
    parameters after the key."""
    model, once = config.model, {"steps": 1, "solver": "euler", "adaptive": False}
    options = dataclasses.replace(config.sample_structure, **once)
    sample, vae = make_structure_sampler(model, options), build("structure_vae", model)

    def loss_fn(params, batch, key, vae_params):
        seen = Condition(*(batch.get(name) for name in Condition._fields))
        frozen = jax.lax.stop_gradient(params)
        latent = sample(frozen, (mean, std), seen, key).x
        logits = jax.lax.stop_gradient(vae.apply(vae_params, latent, method="decode"))
        given = (seen.pixels, seen.cameras, seen.layout)
        refined = network.apply(params, logits, *given, method="refine")
        occupancy = batch["occupancy"].astype(jnp.float32)
        entropy = binary_cross_entropy(refined, occupancy).mean()
        overlap = dice_loss(refined, occupancy)
        metrics = {"entropy": entropy, "dice": overlap, "iou": occupancy_iou(refined, occupancy)}
        metrics["iou_before"] = occupancy_iou(logits, occupancy)
        return entropy + overlap, metrics

    return loss_fn


def occupancy_iou(logits: jax.Array, occupancy: jax.Array) -> jax.Array:
    """Mean intersection over union of logits [B, R, R, R] above 0 and occupancy 0 or 1."""
    predicted, truth, axes = logits > 0, occupancy > 0.5, (1, 2, 3)
    union = jnp.maximum((predicted | truth).sum(axes), 1)
    return ((predicted & truth).sum(axes) / union).mean()


def make_latent_flow_loss(
    network: Network, config: Config, mean: Any, std: Any, metric: Any = None
) -> LossFn:
    """Rectified flow of the UniArt latents on the active voxels, ``part_share`` of the loss spread evenly over parts.

    ``metric`` [C, C]: of ``training.readout``; None measures all channels alike. With ``loss.decoded`` the function takes the UniArt VAE's
    parameters after the key, and its batches hold the plans of a decoder.
    """
    vae = build("uniart_vae", config.model) if config.loss.decoded > 0 else None
    for name in ("part_share", "readout_share"):
        if not 0 <= getattr(config.loss, name) <= 1:
            raise ValueError(f"config: loss.{name} is {getattr(config.loss, name)}; give 0 to 1")
    flow, share, parts = (
        config.model.latent_flow,
        config.loss.part_share,
        config.model.grid.max_parts,
    )

    def loss_fn(params, batch, key, decoder=None):
        coords, counts = batch["coords"], batch["counts"]
        mask = valid_tokens(counts, coords.shape[1])[..., 0]
        x0 = jnp.where(mask[..., None], normalize(batch["latent"], mean, std), 0)
        t, noise, seen = draw(batch, x0, key, config)
        x = interpolate(x0, noise, t)
        voxels = {"coords": coords, "counts": counts, "plan": batch["plans"]["flow"]}
        views = (seen.pixels, seen.cameras)
        given = {"views": views, "layout": seen.layout, **voxels}
        v = network.apply(params, x, t, seen.tokens, seen.volume, **given)
        weights = part_weights(batch["voxel_part"], mask.astype(jnp.float32), parts, share)
        error = flow_loss(v, x0, noise, weights, metric=metric)
        loss, metrics = summarize_flow(error, v, x, x0, t, mask, flow.prediction)
        metrics["padding"] = 1 - mask.mean()
        if vae is None:
            return loss, metrics
        rows = draw_rows(jax.random.fold_in(key, 1), weights, DECODED_VOXELS)
        guess, truth = (z * jnp.asarray(std) + jnp.asarray(mean) for z in (predicted_sample(x, v, t), x0))  # fmt: skip
        terms = decoded_losses(vae, decoder, guess, truth, batch, rows)
        loss = loss + config.loss.decoded * (
            terms["sdf"] + terms["sign"] + COLOR_WEIGHT * terms["color"]
        )
        return loss, metrics | {f"decoded_{name}": term for name, term in terms.items()}

    return loss_fn


def decoded_losses(
    vae: Network, params: Any, guess: jax.Array, truth: jax.Array, batch: Any, rows: jax.Array
) -> dict[str, jax.Array]:
    """What a frozen UniArt VAE makes of latents ``guess`` [B, V, C] against what it makes of ``truth``, at voxels ``rows`` [B, Q].

    Means over sub-cells with weight exp(-|distance|) + .2, so that the surface counts most: "sdf" of the distance's error, "sign" of the cross-entropy
    of its sign, "color" of the colour's error.
    """
    decode = lambda z: vae.apply(params, z, batch, rows, method="decode")  # noqa: E731
    found, true = decode(guess), jax.lax.stop_gradient(decode(truth))
    near = jnp.exp(-jnp.abs(true["sdf"])) + 0.2
    sign = jnp.where(true["sdf"] < 0, -1.0, 1.0)
    return {
        "sdf": (near * jnp.abs(found["sdf"] - true["sdf"])).mean(),
        "sign": (near * jax.nn.softplus(-SIGN_SLOPE * found["sdf"] * sign)).mean(),
        "color": (near[..., None] * jnp.abs(found["color"] - true["color"])).mean(),
    }


def draw(batch, x0: jax.Array, key: jax.Array, config: Config):
    """Times [B n], noise like x0, and the condition (``samplers.Condition``) with some items' dropped to zero for guidance."""
    weights = config.loss
    time_key, noise_key, drop_key = jax.random.split(key, 3)
    t = sample_times(
        time_key, x0.shape[:1], weights.time_mean, weights.time_std, weights.noise_share
    )
    noise = jax.random.normal(noise_key, x0.shape)
    keep = jax.random.uniform(drop_key, batch["tokens"].shape[:1]) >= weights.condition_drop
    seen = Condition(*(batch.get(name) for name in Condition._fields))
    drop = lambda a: jnp.where(keep.reshape(-1, *[1] * (a.ndim - 1)), a, 0)  # noqa: E731
    return t, noise, jax.tree.map(drop, seen)


def summarize_flow(error, v, x, x0, t, mask, prediction):
    """Loss and metrics. A network that predicts the clean sample is judged on it: the velocity's error times t^2."""
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
