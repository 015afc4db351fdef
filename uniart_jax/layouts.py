"""The layout network in use: its first weights, and pictures -> parts as numpy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data.layouts import load_block, settings_of
from uniart_jax.models.network import build
from uniart_jax.training.export import checkpoint_folder, load_network, read_config
from uniart_jax.voxels.joint_code import box_corners

BATCH = 8  # pictures at once, always padded to so many: one program


def first_layout_weights(config: Config) -> dict[str, Any]:
    """What a layout network begins with: typical boxes as its queries' anchors, and published weights of its backbone."""
    first: dict[str, Any] = {"anchors": typical_boxes(config)}
    if config.model.layout.backbone == "efficientnet_lite0":
        from uniart_jax.weights.efficientnet_lite import find_published, read_efficientnet_lite0

        first["backbone"] = read_efficientnet_lite0(find_published())
    return first


def check_backbone(model: ModelConfig) -> None:
    """FileNotFoundError, with what to install, where a backbone's published weights are missing."""
    if model.layout.backbone == "efficientnet_lite0":
        from uniart_jax.weights.efficientnet_lite import find_published

        find_published()


def typical_boxes(config: Config, rounds: int = 20) -> np.ndarray:
    """[queries, 6] corners that k-means finds among the parts of the first block of training objects."""
    table = load_block(config.data.layouts, 0, settings_of(config.data, config.model))
    known = np.arange(table["boxes"].shape[1]) < table["part_counts"][:, None]
    corners = box_corners(table["boxes"][known])
    rng, count = np.random.default_rng(config.seed), config.model.layout.queries
    centers = corners[rng.choice(len(corners), count, replace=len(corners) < count)]
    for _ in range(rounds):
        nearest = ((corners[:, None] - centers) ** 2).sum(-1).argmin(1)
        filled = np.unique(nearest)
        centers[filled] = np.stack([corners[nearest == k].mean(0) for k in filled])
    return centers.astype(np.float32)


class LayoutPredictor:
    """Pictures -> raw outputs of the layout network.

    Attributes:
      image_size: pixels a side. crop_margin: side of the crop over the object's longer side.
    """

    def __init__(self, model: ModelConfig, params: Any):
        self.image_size = model.image_encoder.image_size
        self.crop_margin = model.image_encoder.crop_margin
        self._params = jax.device_put(params)
        network = build("layout", model)

        def run(params, images):
            out = network.apply(params, images)
            return {**out["parts"][-1], "camera": out["camera"], "parents": out["parents"]}

        self._run = jax.jit(run)

    def __call__(self, images: Sequence[np.ndarray]) -> list[dict[str, np.ndarray]]:
        """Crops [S, S, 3] uint8 over black -> for each corners [Q, 6] (lower, upper), codes [Q, 9], exists [Q] logits, colors
        [Q, 3] linear RGB, parents [Q, Q] logits child -> parent (diagonal: root), camera [7]."""
        found: list[dict[str, np.ndarray]] = []
        for first in range(0, len(images), BATCH):
            held = np.stack(images[first : first + BATCH]).astype(np.float32) / 255
            padded = np.zeros((BATCH, *held.shape[1:]), np.float32)
            padded[: len(held)] = held
            out = jax.device_get(self._run(self._params, padded))
            found += [{name: v[b] for name, v in out.items()} for b in range(len(held))]
        return found


def load_layout_predictor(checkpoint: str) -> LayoutPredictor:
    """The layout network of a checkpoint: 'nano', a folder, or a training's WORKDIR.

    Raises:
      FileNotFoundError, ValueError: no such checkpoint, or one without a layout network.
    """
    folder = checkpoint_folder(checkpoint)
    model = read_config(folder).model
    if not model.layout.queries:
        raise ValueError(f"checkpoint '{checkpoint}': it has no layout network; train one with --stage layout")  # fmt: skip
    return LayoutPredictor(model, load_network(folder, "layout", build("layout", model).abstract()))
