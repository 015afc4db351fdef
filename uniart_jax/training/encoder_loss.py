"""What the image encoder minimises: ``make_image_encoder_loss`` gives ``loss_fn(params, batch, key)
-> (loss, scalar metrics)``. Batches are ``voxels.typed_batches.PictureBatch``."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from uniart_jax.config import Config
from uniart_jax.models.network import Network
from uniart_jax.training.losses import (
    LossFn,
    binary_cross_entropy,
    box_loss,
    draw_rows,
    joint_code_loss,
    masked_mean,
    occupancy_iou,
    part_weights,
)
from uniart_jax.voxels.joint_code import JOINT_CODE, OWN_BOX, PARENT_BOX

OCCUPANCY_WEIGHT = 10.0  # of the image encoder's occupancy against boxes and joints
CAMERA_WEIGHT = 3.0


def make_image_encoder_loss(network: Network, config: Config) -> LossFn:
    """Regression of coarse structure from the image: camera, occupancy [R^3], joint codes and boxes
    at the target resolution.

    Half of the items are lifted through their true camera, so that the lifting learns while the
    estimate is still poor; the "iou" logged here is over both halves.
    """
    delta = config.loss.huber_delta

    def loss_fn(params, batch, key):
        camera_key, draw_key = jax.random.split(key)
        use_true_camera = jax.random.bernoulli(camera_key, 0.5, batch.image.shape[:1])
        out = network.apply(params, batch.image, batch.camera, use_true_camera)
        occupancy = batch.occupancy.astype(jnp.float32)
        items = occupancy.shape[0]
        entropy = binary_cross_entropy(out["occupancy"], occupancy).mean()
        codes = out["codes"].reshape(items, -1, out["codes"].shape[-1])
        part = batch.cell_part.reshape(items, -1)
        mask = (part >= 0).astype(jnp.float32)
        part = jnp.maximum(part, 0)
        weights = part_weights(part, mask, config.model.grid.max_parts)
        gather = jax.vmap(lambda table, index: table[index])
        if 0 < config.loss.voxels_per_object < part.shape[1]:
            rows = draw_rows(draw_key, weights, config.loss.voxels_per_object)
            codes, part = gather(codes, rows), gather(part, rows)
            weights = gather(mask, rows)  # an object without a cell counts as 0
        own = gather(batch.boxes, part)
        parent = gather(batch.boxes, gather(batch.parents, part))
        joint = gather(batch.codes, part)
        terms = {
            "joint_code": masked_mean(
                joint_code_loss(codes[..., JOINT_CODE], joint, delta), weights
            ),
            "own_box": masked_mean(box_loss(codes[..., OWN_BOX], own, delta), weights),
            "parent_box": masked_mean(box_loss(codes[..., PARENT_BOX], parent, delta), weights),
        }
        camera = jnp.abs(out["camera"] - batch.camera).mean()
        # boxes and joints learn early and, weighted like occupancy, keep it from being learnt at
        # all; Dice does too
        loss = OCCUPANCY_WEIGHT * entropy + CAMERA_WEIGHT * camera + sum(terms.values())
        iou = occupancy_iou(out["occupancy"], occupancy)
        return loss, {"entropy": entropy, "camera": camera, "iou": iou, **terms}

    return loss_fn
