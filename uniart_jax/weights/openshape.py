"""OpenShape's point cloud encoder (OpenShape/openshape-pointbert-vitg14-rgb ``model.pt``) as
``models.openshape`` has it.

The file is a training checkpoint: the state dict is under ``state_dict``, its names under
``module.``. Converted, it lies in one folder with the image tower that it was trained towards
(``weights.openclip``), a file a block, so that neither making nor reading takes much memory:

    openshape.json, point_encoder.safetensors, image_tower.safetensors,
    image_tower-<block>.safetensors
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from uniart_jax.config import from_json
from uniart_jax.models import openclip
from uniart_jax.models.openshape import Params, PointEncoderConfig, abstract
from uniart_jax.weights.mapping import (
    LINEAR,
    Layout,
    Rule,
    convert,
    flatten,
    nest,
    norm,
    weight_and_bias,
)
from uniart_jax.weights.read import read_tensors

CARD = "openshape.json"


@dataclasses.dataclass(frozen=True)
class OpenShapeConfig:
    """Both encoders' sizes."""

    point_encoder: PointEncoderConfig = dataclasses.field(default_factory=PointEncoderConfig)
    image_tower: openclip.ImageTowerConfig = dataclasses.field(
        default_factory=openclip.ImageTowerConfig
    )


PREFIX = "module."  # of what was trained on several devices
COUNTERS = ".num_batches_tracked"  # of batch norms; evaluation has no use for them


def _pointwise(weight: np.ndarray) -> np.ndarray:
    """[O, I, 1, ...] -> [I, O]; a wider kernel is left as it is, whose shape then does not fit."""
    return weight if np.prod(weight.shape[2:]) != 1 else weight.reshape(weight.shape[:2]).T


POINTWISE_1D = Layout("1D convolution of width 1", 3, _pointwise)
POINTWISE_2D = Layout("2D convolution of width 1", 4, _pointwise)
LAYER = "ppat.transformer.layers.{i}"
TABLE = (
    *weight_and_bias("ppat.sa.mlp_convs.{i}", POINTWISE_2D),
    *norm("ppat.sa.mlp_bns.{i}"),
    Rule("ppat.sa.mlp_bns.{i}.running_mean", "ppat.sa.mlp_bns.{i}.mean"),
    Rule("ppat.sa.mlp_bns.{i}.running_var", "ppat.sa.mlp_bns.{i}.var"),
    *weight_and_bias("ppat.lift.0", POINTWISE_1D),
    *norm("ppat.lift.2"),
    Rule("ppat.cls_token", "ppat.cls_token"),
    *norm(f"{LAYER}.0.norm"),
    Rule(f"{LAYER}.0.fn.to_qkv.weight", f"{LAYER}.0.fn.to_qkv.kernel", LINEAR),
    *weight_and_bias(f"{LAYER}.0.fn.to_out.0", LINEAR),
    *norm(f"{LAYER}.1.norm"),
    *weight_and_bias(f"{LAYER}.1.fn.net.0", LINEAR),
    *weight_and_bias(f"{LAYER}.1.fn.net.3", LINEAR),
    *weight_and_bias("proj", LINEAR),
)


def convert_point_encoder(
    tensors: Mapping[str, np.ndarray], config: PointEncoderConfig | None = None
) -> Params:
    """Parameters of the point cloud encoder.

    Args:
      tensors: the state dict.
      config: None = ``openshape-pointbert-vitg14-rgb``'s; what no shape tells (radius, neighbours,
        patches, heads) is taken from it.

    Raises:
      ValueError: not this encoder; all names and shapes that do not fit are listed.
    """
    kept = {k.removeprefix(PREFIX): v for k, v in tensors.items() if not k.endswith(COUNTERS)}
    expected = abstract(config or PointEncoderConfig())
    return convert(TABLE, kept, expected, "OpenShape's point encoder")


def files_of(points: Params, tower: Params) -> dict[str, Params]:
    """Both encoders' parameters by the stem of the file that they belong into."""
    blocks = tower["transformer"]["resblocks"]
    front = {name: value for name, value in tower.items() if name != "transformer"}
    pieces = {f"image_tower-{int(i):02d}": block for i, block in blocks.items()}
    return {"point_encoder": points, "image_tower": front, **pieces}


def read_encoders(folder: Path) -> tuple[OpenShapeConfig, Params, Params]:
    """What ``uniart convert openshape`` wrote: sizes, point encoder, image tower; arrays are memory
    maps.

    Raises:
      FileNotFoundError: no such folder, or a file is missing.
      ValueError: damaged, or not of the sizes that its card says.
    """
    card = folder / CARD
    if not card.is_file():
        raise FileNotFoundError(
            f"OpenShape weights '{folder}': no {CARD} in it; make them with: uniart convert "
            "openshape FOLDER --out DIR"
        )
    try:
        config = from_json(OpenShapeConfig, card.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"'{card}': {error}") from None
    expected = files_of(abstract(config.point_encoder), openclip.abstract(config.image_tower))
    read: dict[str, Params] = {}
    for stem, tree in expected.items():
        path = folder / f"{stem}.safetensors"
        tensors, wanted = read_tensors(path), flatten(tree)
        wrong = sorted(tensors.keys() ^ wanted.keys())
        wrong += [n for n, v in wanted.items() if n in tensors and tensors[n].shape != v.shape]
        if wrong:
            raise ValueError(
                f"'{path}': not as {CARD} says: {', '.join(wrong)}; convert the weights again"
            )
        read[stem] = nest(tensors)
    blocks = {str(i): read[f"image_tower-{i:02d}"] for i in range(config.image_tower.num_blocks)}
    tower = {**read["image_tower"], "transformer": {"resblocks": blocks}}
    return config, read["point_encoder"], tower
