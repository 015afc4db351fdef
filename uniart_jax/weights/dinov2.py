"""DINOv2 with registers (facebookresearch/dinov2, ``dinov2_vit{s,b,l}14_reg``) as our image
encoder.

The file holds a state dict and no config: what the tensors' shapes say is all there is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from uniart_jax.config import ImageEncoderConfig, ModelConfig
from uniart_jax.models.network import Params, build
from uniart_jax.weights.mapping import CONV2D, LINEAR, Rule, convert, norm, weight_and_bias

HEAD_WIDTH = 64  # of all published sizes
TABLE = (
    Rule("cls_token", "cls_token"),
    Rule("pos_embed", "pos_embed"),
    Rule("register_tokens", "register_tokens"),
    Rule("mask_token", "mask_token"),
    *weight_and_bias("patch_embed.proj", CONV2D),
    *norm("blocks.{i}.norm1"),
    *weight_and_bias("blocks.{i}.attn.qkv", LINEAR),
    *weight_and_bias("blocks.{i}.attn.proj", LINEAR),
    Rule("blocks.{i}.ls1.gamma", "blocks.{i}.ls1.gamma"),
    *norm("blocks.{i}.norm2"),
    *weight_and_bias("blocks.{i}.mlp.fc1", LINEAR),
    *weight_and_bias("blocks.{i}.mlp.fc2", LINEAR),
    Rule("blocks.{i}.ls2.gamma", "blocks.{i}.ls2.gamma"),
    *norm("norm"),
)


def convert_dinov2(
    tensors: Mapping[str, np.ndarray], num_heads: int | None = None
) -> tuple[ImageEncoderConfig, Params]:
    """Config and parameters of the image encoder.

    Args:
      tensors: the state dict.
      num_heads: None = width / 64, as in all published sizes.

    Raises:
      ValueError: not DINOv2 with registers; all names and shapes that do not fit are listed.
    """
    config = _config(tensors, num_heads)
    expected = build("image_encoder", ModelConfig(image_encoder=config)).abstract()
    return config, convert(TABLE, tensors, expected, "DINOv2")


def converted_config(shapes: Mapping[str, tuple[int, ...]]) -> ImageEncoderConfig:
    """The config that converted parameters, by their dotted names, have the shapes of.

    Raises:
      ValueError: they are not DINOv2's.
    """
    names = ("pos_embed", "register_tokens", "patch_embed.proj.kernel", "blocks.0.mlp.fc1.kernel")
    axes = dict(zip(names, (3, 3, 4, 2), strict=True))
    if wrong := [name for name in names if len(shapes.get(name, ())) != axes[name]]:
        raise ValueError(
            f"not a converted DINOv2: it lacks {', '.join(wrong)}; make one with: uniart convert "
            "dinov2 FILE --out image_encoder.safetensors"
        )
    (_, places, width), patch = shapes["pos_embed"], shapes["patch_embed.proj.kernel"][0]
    blocks = {name.split(".")[1] for name in shapes if name.startswith("blocks.")}
    return ImageEncoderConfig(
        architecture="dinov2",
        image_size=math.isqrt(places - 1) * patch,
        patch_size=patch,
        registers=shapes["register_tokens"][1],
        width=width,
        num_blocks=len(blocks),
        num_heads=max(1, width // HEAD_WIDTH),
        mlp_ratio=shapes["blocks.0.mlp.fc1.kernel"][1] / width,
    )


def _config(tensors: Mapping[str, np.ndarray], num_heads: int | None) -> ImageEncoderConfig:
    """The config that the tensors have the shapes of."""
    axes = {
        "pos_embed": 3,
        "register_tokens": 3,
        "patch_embed.proj.weight": 4,
        "blocks.0.mlp.fc1.weight": 2,
    }
    wrong = [name for name, n in axes.items() if name not in tensors or tensors[name].ndim != n]
    if wrong:
        hint = (
            "; take a model with registers, dinov2_vit{s,b,l}14_reg"
            if "register_tokens" in wrong
            else ""
        )
        raise ValueError(
            f"DINOv2: it lacks {', '.join(wrong)}, or they have another number of axes{hint}"
        )
    _, places, width = tensors["pos_embed"].shape
    patch = tensors["patch_embed.proj.weight"].shape[-1]
    side = math.isqrt(max(places - 1, 0))
    if side < 1 or side**2 != places - 1 or width < 1 or patch < 1:
        raise ValueError(
            f"DINOv2: pos_embed {list(tensors['pos_embed'].shape)} is not a class token and a "
            "square of patches"
        )
    heads = num_heads or max(1, width // HEAD_WIDTH)
    if width % heads:
        raise ValueError(
            f"DINOv2: width {width} does not divide into {heads} heads of {HEAD_WIDTH}"
        )
    blocks = [name.split(".")[1] for name in tensors if name.startswith("blocks.")]
    return ImageEncoderConfig(
        architecture="dinov2",
        image_size=side * patch,
        patch_size=patch,
        registers=tensors["register_tokens"].shape[1],
        width=width,
        num_blocks=len(set(blocks)),
        num_heads=heads,
        mlp_ratio=tensors["blocks.0.mlp.fc1.weight"].shape[0] / width,
    )
