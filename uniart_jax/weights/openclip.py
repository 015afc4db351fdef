"""OpenCLIP's image tower (mlfoundations/open_clip, ViT-bigG-14) as ``models.openclip`` has it; the
text tower is left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from uniart_jax.models.openclip import ImageTowerConfig, Params, abstract
from uniart_jax.weights.mapping import CONV2D, LINEAR, Rule, convert, norm, weight_and_bias

PREFIX = "visual."
BLOCK = "transformer.resblocks.{i}"
TABLE = (
    Rule("conv1.weight", "conv1.kernel", CONV2D),
    Rule("class_embedding", "class_embedding"),
    Rule("positional_embedding", "positional_embedding"),
    *norm("ln_pre"),
    *norm(f"{BLOCK}.ln_1"),
    Rule(f"{BLOCK}.attn.in_proj_weight", f"{BLOCK}.attn.in_proj.kernel", LINEAR),
    Rule(f"{BLOCK}.attn.in_proj_bias", f"{BLOCK}.attn.in_proj.bias"),
    *weight_and_bias(f"{BLOCK}.attn.out_proj", LINEAR),
    *norm(f"{BLOCK}.ln_2"),
    *weight_and_bias(f"{BLOCK}.mlp.c_fc", LINEAR),
    *weight_and_bias(f"{BLOCK}.mlp.c_proj", LINEAR),
    *norm("ln_post"),
    Rule("proj", "proj"),  # [width, output] there too
)


def convert_image_tower(
    tensors: Mapping[str, np.ndarray], config: ImageTowerConfig | None = None
) -> Params:
    """Parameters of the image tower, as views of the tensors.

    Args:
      tensors: the state dict of a whole CLIP of OpenCLIP's.
      config: None = ViT-bigG-14's.

    Raises:
      ValueError: not this tower; all names and shapes that do not fit are listed.
    """
    tower = {k.removeprefix(PREFIX): v for k, v in tensors.items() if k.startswith(PREFIX)}
    if not tower:
        raise ValueError(
            f"OpenCLIP: no tensor is called {PREFIX}…; take the weights in open_clip's own layout, "
            "open_clip_model.safetensors or open_clip_pytorch_model.*"
        )
    expected = abstract(config or ImageTowerConfig())
    return convert(TABLE, tower, expected, "OpenCLIP's image tower")
