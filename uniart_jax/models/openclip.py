"""OpenCLIP's image tower: a picture -> the embedding that OpenShape's point clouds are trained
towards.

Upstream: mlfoundations/open_clip ``transformer.py`` (``VisionTransformer``), ViT-bigG-14 of
``laion2b_s39b_b160k`` at full size: 1.8 billion parameters. Pure functions over a nested dict whose
names are upstream's, without its ``visual.`` before them.

    x = ln_pre([class, patches] + positions);  x = blocks(x), pre-norm, exact GELU;  embedding = ln_post(x[class]) proj

LayerNorm eps 1e-5. Blocks are compiled once and run one by one, so that parameters may stay in a
memory map: 7 GB in a file, a few hundred megabytes at work.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.nn.attention import attend
from uniart_jax.nn.blocks import layer_norm

Params = dict[str, Any]
EPSILON = 1e-5  # of every LayerNorm

# of CLIP's training images, sRGB in [0, 1]
IMAGE_MEAN = (0.48145466, 0.4578275, 0.40821073)
IMAGE_STD = (0.26862954, 0.26130258, 0.27577711)


@dataclasses.dataclass(frozen=True)
class ImageTowerConfig:
    """Sizes; the defaults are ViT-bigG-14's.

    Attributes:
      image_size, patch_size: pixels a side.
      output: channels of the embedding.
    """

    image_size: int = 224
    patch_size: int = 14
    width: int = 1664
    num_blocks: int = 48
    num_heads: int = 16
    mlp_ratio: float = 4.9231
    output: int = 1280


def abstract(config: ImageTowerConfig) -> Params:
    """The parameters as ``jax.ShapeDtypeStruct``, float32; linear kernels are [inputs, outputs]."""
    c, width = config, config.width
    hidden = int(width * c.mlp_ratio)  # cut off, as upstream does
    norm = {"scale": array(width), "bias": array(width)}
    block = {
        "ln_1": norm,
        "attn": {"in_proj": linear(width, 3 * width), "out_proj": linear(width, width)},
        "ln_2": norm,
        "mlp": {"c_fc": linear(width, hidden), "c_proj": linear(hidden, width)},
    }
    return {
        "conv1": {"kernel": array(c.patch_size, c.patch_size, 3, width)},
        "class_embedding": array(width),
        "positional_embedding": array(1 + (c.image_size // c.patch_size) ** 2, width),
        "ln_pre": norm,
        "transformer": {"resblocks": {str(i): block for i in range(c.num_blocks)}},
        "ln_post": norm,
        "proj": array(width, c.output),
    }


def embed(params: Params, image: jax.Array, config: ImageTowerConfig) -> jax.Array:
    """Embeddings of pictures.

    Args:
      params: of ``abstract``'s shapes; numpy arrays and memory maps will do.
      image: [B, S, S, 3] sRGB minus ``IMAGE_MEAN`` over ``IMAGE_STD``.

    Returns:
      [B, output], not normalised.
    """
    blocks = params["transformer"]["resblocks"]
    x = _front(params, image, config.patch_size)
    for i in range(config.num_blocks):
        x = _block(blocks[str(i)], x, config.num_heads)
        if not isinstance(x, jax.core.Tracer):
            x.block_until_ready()  # else the next blocks' parameters pile up in memory
    return dense({"kernel": params["proj"]}, norm(params["ln_post"], x[:, 0]))


def dense(params: Params, x: jax.Array) -> jax.Array:
    """x kernel + bias, where there is one."""
    y = x @ jnp.asarray(params["kernel"], x.dtype)
    return y + params["bias"] if "bias" in params else y


def norm(params: Params, x: jax.Array) -> jax.Array:
    """LayerNorm with scale and bias."""
    return layer_norm(x, EPSILON) * params["scale"] + params["bias"]


def pre_norm_block(
    x: jax.Array, attention: tuple[Params, ...], mlp: tuple[Params, ...], num_heads: int
) -> jax.Array:
    """x += attention(LN(x)); x += mlp(LN(x)).

    Args:
      x: [B, L, D].
      attention: its LayerNorm, queries-keys-values, output.
      mlp: its LayerNorm, first and second layer.
    """
    before, in_proj, out_proj = attention
    qkv = dense(in_proj, norm(before, x)).reshape(*x.shape[:2], 3, num_heads, -1)
    q, k, v = (qkv[:, :, i] for i in range(3))
    x = x + dense(out_proj, attend(q, k, v).reshape(*x.shape[:2], -1))
    before, first, second = mlp
    return x + dense(second, jax.nn.gelu(dense(first, norm(before, x)), approximate=False))


@functools.partial(jax.jit, static_argnames="num_heads")
def _block(params: Params, x: jax.Array, num_heads: int) -> jax.Array:
    attention = (params["ln_1"], params["attn"]["in_proj"], params["attn"]["out_proj"])
    mlp = (params["ln_2"], params["mlp"]["c_fc"], params["mlp"]["c_proj"])
    return pre_norm_block(x, attention, mlp, num_heads)


def _front(params: Params, image: jax.Array, patch: int) -> jax.Array:
    """[B, S, S, 3] -> [B, 1 + (S / patch)^2, D]; the strided convolution as one matrix product."""
    items, side = image.shape[0], image.shape[1] // patch
    patches = image.reshape(items, side, patch, side, patch, 3).transpose(0, 1, 3, 2, 4, 5)
    kernel = jnp.asarray(params["conv1"]["kernel"]).reshape(3 * patch**2, -1)
    x = patches.reshape(items, side**2, -1) @ kernel
    first = jnp.broadcast_to(jnp.asarray(params["class_embedding"]), (items, 1, x.shape[-1]))
    x = jnp.concatenate([first, x], 1) + params["positional_embedding"]
    return norm(params["ln_pre"], x)


def array(*shape: int) -> jax.ShapeDtypeStruct:
    """A float32 array's description."""
    return jax.ShapeDtypeStruct(shape, jnp.float32)


def linear(inputs: int, outputs: int, bias: bool = True) -> Params:
    """A linear layer's description."""
    kernel = {"kernel": array(inputs, outputs)}
    return kernel | {"bias": array(outputs)} if bias else kernel
