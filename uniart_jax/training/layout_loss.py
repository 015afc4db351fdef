"""Losses of the layout network: predicted parts are matched to true ones, then each pays for its
own (``training.set_loss``; DETR, Carion 2020).

    cost[q, k] = sum over layers of  5 L1(corners) - p + Huber(code, .05)
    loss       = 2 mean over layers (5 L1(corners) + 5 Huber(code) + BCE(exists) + .3 L1(colour))
                 + .3 CE(parent) + 2 L1(camera) + legs + panels + boards + revolutions

of ``training.leg_loss``, ``training.panel_loss`` and ``training.revolution_loss``.

One matching serves all layers. Part terms are means per object, then over objects; codes are
compared modulo both gauges. All these weights are constants here and in the heads' modules; those
of the VAEs' and the flows' losses are options (``config.LossConfig``).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.config import Config
from uniart_jax.models.network import Network
from uniart_jax.training.leg_loss import leg_losses
from uniart_jax.training.losses import joint_code_loss
from uniart_jax.training.panel_loss import board_losses, panel_losses
from uniart_jax.training.revolution_loss import revolution_losses
from uniart_jax.training.set_loss import Matching, match_rows
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.typed_batches import LayoutBatch, has_parts_alone

BOX, CODE, COLOR, PARENT, CAMERA = 5.0, 5.0, 0.3, 0.3, 2.0
LAYERS = 2.0
HUBER = 0.05
NOBODY = -1e4  # logit of a query that no part is matched to

# what each head beside the parts pays, of its output, the batch and the parts' matching: terms, of
# which the one of the head's name is all of its loss
HEAD_LOSSES: dict[str, Callable[[Any, LayoutBatch, Matching], dict[str, jax.Array]]] = {
    "legs": lambda out, batch, parts: leg_losses(out, batch),
    "panels": lambda out, batch, parts: panel_losses(out, batch),
    "boards": lambda out, batch, parts: board_losses(out, batch, parts.query),
    "revolutions": lambda out, batch, parts: revolution_losses(
        jax.tree.map(parts.take, out), batch, parts.weights
    ),
}


def match_cost(
    parts: list[dict[str, jax.Array]], corners: jax.Array, codes: jax.Array
) -> jax.Array:
    """[B, Q, K] what it costs to give true part k to query q; corners [B, K, 6], codes [B, K,
    9]."""
    total = jnp.zeros(())
    for out in parts:
        box = jnp.abs(out["corners"][:, :, None] - corners[:, None]).mean(-1)
        code = joint_code_loss(out["codes"][:, :, None], codes[:, None], HUBER)
        total = total + BOX * box + code - jax.nn.sigmoid(out["exists"])[..., None]
    return total


def layout_losses(out: dict[str, Any], batch: LayoutBatch) -> dict[str, jax.Array]:
    """The loss's terms of a prediction: "box", "code", "exists", "color" (means over layers),
    "parent", "camera", and "loss"; of the heads of ``HEAD_LOSSES`` that the network has, theirs
    too."""
    corners, codes, counts = box_corners(batch.boxes, jnp), batch.codes, batch.part_counts
    matched = match_rows(match_cost(out["parts"], corners, codes), counts)
    take, mean = matched.take, matched.mean
    terms = {name: jnp.zeros(()) for name in ("box", "code", "exists", "color")}
    for part in out["parts"]:
        terms["box"] += mean(jnp.abs(take(part["corners"]) - corners).mean(-1))
        terms["code"] += mean(joint_code_loss(take(part["codes"]), codes, HUBER))
        terms["exists"] += matched.existence(part["exists"])
        terms["color"] += mean(jnp.abs(take(part["colors"]) - batch.colors).mean(-1))
    terms = {name: value / len(out["parts"]) for name, value in terms.items()}
    pointer = jnp.where(matched.present[:, None] > 0, out["parents"], NOBODY)  # [B, child, parent]
    scores = jax.nn.log_softmax(take(pointer), -1)
    parent_query = jnp.take_along_axis(matched.query, batch.parents, 1)
    picked = jnp.take_along_axis(scores, parent_query[..., None], 2)[..., 0]
    terms["parent"] = -mean(picked)
    terms["camera"] = jnp.abs(out["camera"] - batch.camera).mean()
    layers = BOX * terms["box"] + CODE * terms["code"] + terms["exists"] + COLOR * terms["color"]
    loss = LAYERS * layers + PARENT * terms["parent"] + CAMERA * terms["camera"]
    for name, head_losses in HEAD_LOSSES.items():
        if name in out:
            terms |= head_losses(out[name], batch, matched)
            loss = loss + terms[name]
    return terms | {"loss": loss}


def make_layout_loss(network: Network, config: Config):
    """``loss_fn(params, batch, key)``: half of the boxes are read with the true camera, and the
    tokens' phase is drawn. Where ``data.box_sets_every`` is above 1, legs, panels and boards
    are neither found nor paid for in batches without them."""
    may_lack = config.data.box_sets_every > 1

    def loss_fn(params, batch, key):
        camera_key, phase_key = jax.random.split(key)
        use_true_camera = jax.random.bernoulli(camera_key, 0.5, batch.image.shape[:1])
        phase = jax.random.randint(phase_key, (2,), 0, 2)
        box_sets = not (may_lack and has_parts_alone(batch))
        given = batch.image, batch.camera, use_true_camera, phase
        out = network.apply(params, *given, box_sets=box_sets)
        terms = layout_losses(out, batch)
        return terms.pop("loss"), terms

    return loss_fn
