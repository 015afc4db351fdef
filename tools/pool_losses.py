"""What ``tools/train_pool.py`` does with a batch on the accelerator: mirroring, light and choice of
pictures, layouts with errors, and the structure flow's loss."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.ndimage import map_coordinates

from uniart_jax.config import Config, load_config
from uniart_jax.data.cameras import mirror_camera_codes
from uniart_jax.data.layout_errors import COARSE, LOST, MISTAKEN, MOVED, TINTED
from uniart_jax.data.mirror import (
    mirror_boxes,
    mirror_codes,
    mirror_corners,
    mirror_images,
    mirror_legs,
    mirror_revolutions,
)
from uniart_jax.flow.rectified import flow_loss, interpolate, predicted_sample, sample_times
from uniart_jax.inference.samplers import found_table
from uniart_jax.models.image_encoder import shrink
from uniart_jax.models.network import Network
from uniart_jax.nn.shapes import Array
from uniart_jax.training.flow_losses import summarize_flow
from uniart_jax.training.losses import occupancy_terms
from uniart_jax.voxels.part_table import SMALLEST_SIDE, PartTable
from uniart_jax.voxels.typed_batches import LayoutBatch, MaskBatch

FOUND, ABSENT, EXACT = 0.4, 0.06, 0.35  # shares of the layouts that the structure flow is shown
ONCE = 0.8  # share of the draws at t = 1
# typical errors of the numbers of a camera code: about 1.5 times a layout network's median error
# on 192 objects of two worlds
CAMERA_ERRORS = (0.043, 0.016, 0.037, 0.065, 0.04, 0.019, 0.028)
PHOTOGRAPHS = load_config("nano").data.photographs


class PoolBatch(NamedTuple):
    """What both losses read.

    Attributes:
      layout: the layout network's batch. flow_image, flow_camera: the structure flow's pictures and
        their camera codes. occupancy: of the grid's voxels.
    """

    layout: LayoutBatch
    flow_image: Annotated[Array, "B H W 3", "float"]
    flow_camera: Annotated[Array, "B 7", "float"]
    occupancy: Annotated[Array, "B R R R", "bool"]


def prepared(rows: Mapping[str, jax.Array], key: jax.Array, train: bool) -> PoolBatch:
    """Drawn rows (``pool_objects.Pool.draw``) as both losses take them. To ``train`` on, half of
    the items are mirrored, and of half, drawn apart, the layout network sees the photograph; of the
    others half are shown in another light. The structure flow sees half of these photographs, and
    renders else, in their own light."""
    keys = jax.random.split(key, 3)
    items = len(rows["boxes"])
    flip = jax.random.bernoulli(keys[0], 0.5, (items,)) & train

    def either(mirrored, plain):
        return jnp.where(flip.reshape(-1, *[1] * (plain.ndim - 1)), mirrored, plain)

    def pictures(name):
        return either(mirror_images(rows[name]), rows[name]).astype(jnp.float32) / 255

    shown = jax.random.uniform(keys[2], (items,))
    taken = (shown < PHOTOGRAPHS) & train
    flow_sees = (shown < PHOTOGRAPHS / 2) & train
    of_picture = lambda chosen: chosen[:, None, None, None]  # noqa: E731
    image, photo = pictures("images"), pictures("photos")
    cameras = jnp.where(taken[:, None], rows["photo_cameras"], rows["cameras"])
    codes, boxes = rows["codes"], rows["boxes"]
    cells = jnp.unpackbits(rows["voxels"], axis=-1)
    side = round(cells.shape[1] ** (1 / 3))
    cells = cells.reshape(items, side, side, side) > 0
    lit = jnp.where(train, relit(image, keys[1]), image)
    layout = LayoutBatch(
        image=jnp.where(of_picture(taken), photo, lit),
        camera=either(mirror_camera_codes(cameras), cameras),
        boxes=either(mirror_boxes(boxes), boxes),
        codes=either(mirror_codes(codes, jnp), codes),
        parents=rows["parents"],
        colors=rows["colors"],
        part_counts=rows["part_counts"],
        legs=either(mirror_legs(rows["legs"]), rows["legs"]),
        leg_counts=rows["leg_counts"],
        legs_alone=rows["legs_alone"],
        panels=either(mirror_corners(rows["panels"]), rows["panels"]),
        panel_counts=rows["panel_counts"],
        panel_share=rows["panel_share"],
        boards=either(mirror_corners(rows["boards"]), rows["boards"]),
        board_counts=rows["board_counts"],
        board_share=rows["board_share"],
        revolutions=either(mirror_revolutions(rows["revolutions"], jnp), rows["revolutions"]),
    )
    flow_image = jnp.where(of_picture(flow_sees), photo, image)
    flow_camera = jnp.where(flow_sees[:, None], rows["photo_cameras"], rows["cameras"])
    flow_camera = either(mirror_camera_codes(flow_camera), flow_camera)
    return PoolBatch(layout, flow_image, flow_camera, either(cells[:, :, ::-1], cells))


def prepared_scenes(rows: Mapping[str, jax.Array], key: jax.Array) -> MaskBatch:
    """Drawn rows of scenes as the mask network's loss takes them, half of them mirrored."""
    image = rows["scenes"].astype(jnp.float32) / 255
    items, side = image.shape[:2]
    mask = jnp.unpackbits(rows["scene_masks"], axis=-1).reshape(items, side, side)
    mask = mask.astype(jnp.float32)
    flip = jax.random.bernoulli(key, 0.5, (items,))[:, None, None]
    mask = jnp.where(flip, mask[:, :, ::-1], mask)
    return MaskBatch(jnp.where(flip[..., None], mirror_images(image), image), mask)


def relit(image: jax.Array, key: jax.Array) -> jax.Array:
    """Images [B, S, S, 3] in another light: half of them brighter or darker, tinted, of another
    gamma."""
    keys = jax.random.split(key, 4)
    shape = (len(image), 1, 1)
    gain = jnp.exp(0.12 * jax.random.normal(keys[0], (*shape, 1)))
    tint = jnp.exp(0.04 * jax.random.normal(keys[1], (*shape, 3)))
    gamma = jnp.exp(0.12 * jax.random.normal(keys[2], (*shape, 1)))
    other = jnp.clip(jnp.maximum(image, 1e-4) ** gamma * gain * tint, 0, 1)
    other = jnp.where(image > 0, other, 0)
    return jnp.where(jax.random.bernoulli(keys[3], 0.5, (*shape, 1)), other, image)


def make_structure_loss(
    nets: dict[str, Network], config: Config, statistics: Any
) -> Callable[..., tuple[jax.Array, dict[str, jax.Array]]]:
    """``loss(params, batch, key, (image encoder's, structure VAE's, layout network's params))``."""
    flow, vae = nets["structure_flow"], nets["structure_vae"]
    mean, std = (jnp.asarray(s) for s in statistics)
    most, of_flow = config.model.grid.max_parts, config.model.structure_flow
    reads, refines = of_flow.pixel_channels > 0, of_flow.refine_channels > 0

    def loss_fn(params, batch, key, frozen):
        encoder, vae_params, finder = jax.lax.stop_gradient(frozen)
        keys = jax.random.split(key, 8)
        image, items = batch.flow_image, len(batch.flow_image)
        true = batch.layout
        table = PartTable(true.boxes, true.codes, true.parents, true.colors, true.part_counts)
        looked_at = max(1, round(FOUND * items))  # which objects these are is drawn with the batch
        out = nets["layout"].apply(finder, image[:looked_at], box_sets=False)
        found = found_table(out["parts"][-1], out["parents"], most)
        chosen = jnp.arange(items) < looked_at
        layout = tables_with_errors(table, keys[1])
        layout = jax.tree.map(lambda rows, own: rows.at[:looked_at].set(own), layout, found)
        small = shrink(image, config.model.image_encoder.image_size)
        # a flow that reads pixels must find pictures and voxels in agreement
        if not reads:
            warped = bent(small, config.data.image_warp, keys[2])
            small = jnp.where(chosen[:, None, None, None], small, warped)
        seen = nets["image_encoder"].apply(encoder, small)
        camera = seen["camera"]  # what sampling looks through where there is no layout
        if reads:
            other = cameras_with_errors(batch.flow_camera, keys[6])
            camera = jnp.where((layout.counts == 0)[:, None], camera, other)
            camera = camera.at[:looked_at].set(out["camera"])
        layout, camera = jax.lax.stop_gradient((layout, camera[:, None]))
        latent = vae.apply(vae_params, batch.occupancy, method="encode")[0]
        x0 = jax.lax.stop_gradient((latent - mean) / std)
        once = jax.random.bernoulli(keys[3], ONCE, (items,))
        times = sample_times(keys[4], (items,), config.loss.time_mean, config.loss.time_std)
        t = jnp.where(once, 1.0, times)
        noise = jax.random.normal(keys[5], x0.shape)
        x = interpolate(x0, noise, t)
        views = (seen["pixels"][:, None], camera)
        v = flow.apply(params, x, t, seen["tokens"], seen["volume"], views=views, layout=layout)
        loss, metrics = summarize_flow(
            flow_loss(v, x0, noise), v, x, x0, t, None, config.model.structure_flow.prediction
        )
        guess = predicted_sample(x, v, t) * std + mean
        logits = vae.apply(vae_params, guess, method="decode")
        terms = occupancy_terms(logits, batch.occupancy)
        loss += terms["entropy"] + terms["dice"]
        metrics["iou"] = terms["iou"]
        if refines:
            given = (jax.lax.stop_gradient(logits), *views, layout)
            logits = flow.apply(params, *given, method="refine")
            terms = occupancy_terms(logits, batch.occupancy)
            loss += terms["entropy"] + terms["dice"]
            metrics["refined"] = terms["iou"]
        return loss, {k: v for k, v in metrics.items() if k in ("iou", "refined", "x0_error")}

    return loss_fn


def bent(image: jax.Array, share: float, key: jax.Array) -> jax.Array:
    """``data.layout_errors.bend`` of images [B, S, S, 3]."""
    items, side = image.shape[:2]
    keys = jax.random.split(key, 2)
    strength = 0.5 * share * jax.random.uniform(keys[0], (items, 1, 1, 1)) * side
    shift = strength * jax.random.normal(keys[1], (items, 2, COARSE, COARSE))
    at = jnp.linspace(0, COARSE - 1, side)
    weights = jnp.maximum(1 - jnp.abs(at[:, None] - jnp.arange(COARSE)), 0)
    moved = jnp.einsum("si,bcij,tj->bcst", weights, shift, weights)
    places = moved + jnp.stack(jnp.meshgrid(jnp.arange(side), jnp.arange(side), indexing="ij"))
    one = lambda plane, place: map_coordinates(plane, list(place), order=1)  # noqa: E731
    return jax.vmap(jax.vmap(one, (-1, None), -1))(image, places)


def cameras_with_errors(codes: jax.Array, key: jax.Array) -> jax.Array:
    """Camera codes [B, 7] as a layout network might estimate them: most a little off, some more."""
    keys = jax.random.split(key)
    strength = jnp.exp(jax.random.normal(keys[0], (len(codes), 1)))
    return codes + strength * jnp.asarray(CAMERA_ERRORS) * jax.random.normal(keys[1], codes.shape)


def tables_with_errors(table: PartTable, key: jax.Array) -> PartTable:
    """``data.layout_errors.with_errors`` of true layouts."""
    keys = jax.random.split(key, 8)
    boxes, codes, parents, colors, known = table
    items, most = parents.shape
    exact = jax.random.bernoulli(keys[0], EXACT / (1 - FOUND), (items, 1))
    strength = jnp.where(exact, 0, jax.random.uniform(keys[1], (items, 1), minval=0.3, maxval=1.0))
    absent = jax.random.bernoulli(keys[2], ABSENT / (1 - FOUND), (items, 1))
    real = jnp.arange(most) < known[:, None]
    roots = parents == jnp.arange(most)
    lost = ~roots & (jax.random.uniform(keys[3], roots.shape) < LOST * strength)
    kept = real & ~lost & ~absent
    take = lambda rows, index: jnp.take_along_axis(rows, index, 1)  # noqa: E731
    for _ in range(6):  # a lost parent's children hang on its parent
        parents = jnp.where(take(lost, parents), take(parents, parents), parents)
    order = jnp.argsort(jnp.where(kept, jax.random.uniform(keys[4], kept.shape), 2), -1)
    place = jnp.argsort(order, -1)
    counts = kept.sum(-1)
    there = (jnp.arange(most) < counts[:, None])[..., None]
    lower, upper = boxes[..., :3] - boxes[..., 3:] / 2, boxes[..., :3] + boxes[..., 3:] / 2
    corners = jnp.concatenate([lower, upper], -1)
    moved = MOVED * strength[..., None] * jax.random.normal(keys[5], corners.shape)
    lower, upper = jnp.split(corners + moved, 2, -1)
    boxes = jnp.concatenate([(lower + upper) / 2, jnp.maximum(upper - lower, SMALLEST_SIDE)], -1)
    wrong = ~roots & (jax.random.uniform(keys[6], roots.shape) < MISTAKEN * strength)
    other = jnp.concatenate([codes[..., :7], -codes[..., 8:9], -codes[..., 7:8]], -1)
    codes = jnp.where(wrong[..., None], other, codes)
    tinted = colors + TINTED * strength[..., None] * jax.random.normal(keys[7], colors.shape)
    pick = lambda rows: jnp.where(there, take(rows, order[..., None]), 0)  # noqa: E731
    parents = jnp.where(there[..., 0], take(place, take(parents, order)), 0)
    return PartTable(
        pick(boxes), pick(codes), parents.astype(jnp.int32),
        pick(jnp.clip(tinted, 0, 1)), counts.astype(jnp.int32),
    )  # fmt: skip
