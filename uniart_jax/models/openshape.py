"""OpenShape's point cloud encoder: 10,000 coloured points -> an embedding beside OpenCLIP's (Liu et
al. 2023, arXiv 2305.10764).

Upstream: Colin97/OpenShape_code ``models/ppat.py`` (a PointBERT) at ``model.scaling=4``, the size
of ``openshape-pointbert-vitg14-rgb``. Pure functions over a nested dict whose names are upstream's.

    384 centres, each the farthest from those before          a ball of .2 about each: the first 64 points in it
    (offset, x, y, z, r, g, b) of its points -> 1x1 convolutions, batch norms (running statistics),
    ReLU -> maximum over the ball LN(linear([centre, maximum])) -> [class, patches] -> blocks,
    pre-norm, exact GELU -> linear(class)

Upstream's first centre is a random point (DGL's default), by which, its authors say, embeddings of
one cloud differ (cosine .97 to .99); here it is the first point, so that nothing is random but the
order of the cloud.
"""  # noqa: E501

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp

from uniart_jax.models.openclip import EPSILON, Params, array, dense, linear, norm, pre_norm_block

CHANNELS = 6  # x, y, z, r, g, b


@dataclasses.dataclass(frozen=True)
class PointEncoderConfig:
    """Sizes; the defaults are ``openshape-pointbert-vitg14-rgb``'s.

    Attributes:
      patches: centres a cloud.
      radius: of the ball about each; clouds reach 1.
      neighbors: points that are taken of a ball, at most.
      patch_channels: of the convolutions.
      output: channels of the embedding.
    """

    patches: int = 384
    radius: float = 0.2
    neighbors: int = 64
    patch_channels: tuple[int, ...] = (64, 64, 256)
    width: int = 512
    num_blocks: int = 12
    num_heads: int = 8
    head_width: int = 64
    mlp_width: int = 1536
    output: int = 1280


def abstract(config: PointEncoderConfig) -> Params:
    """The parameters as ``jax.ShapeDtypeStruct``, float32; kernels are [inputs, outputs]."""
    c, width, inner = config, config.width, config.num_heads * config.head_width
    widths = (3 + CHANNELS, *c.patch_channels)
    convs = {str(i): linear(widths[i], out) for i, out in enumerate(c.patch_channels)}
    statistics = ("scale", "bias", "mean", "var")
    norms = {str(i): {k: array(out) for k in statistics} for i, out in enumerate(c.patch_channels)}
    affine = {"scale": array(width), "bias": array(width)}
    attention = {
        "to_qkv": linear(width, 3 * inner, bias=False),
        "to_out": {"0": linear(inner, width)},
    }
    mlp = {"net": {"0": linear(width, c.mlp_width), "3": linear(c.mlp_width, width)}}
    layer = {"0": {"norm": affine, "fn": attention}, "1": {"norm": affine, "fn": mlp}}
    return {
        "ppat": {
            "sa": {"mlp_convs": convs, "mlp_bns": norms},
            "lift": {"0": linear(3 + widths[-1], width), "2": affine},
            "cls_token": array(width),
            "transformer": {"layers": {str(i): layer for i in range(c.num_blocks)}},
        },
        "proj": linear(width, c.output),
    }


def embed(params: Params, points: jax.Array, config: PointEncoderConfig) -> jax.Array:
    """Embeddings of point clouds.

    Args:
      params: of ``abstract``'s shapes.
      points: [B, N, 6] positions, centred at their mean, the farthest at distance 1, gravity along
        -z, and sRGB in [0, 1]; in random order.

    Returns:
      [B, output], not normalised.

    Raises:
      ValueError: fewer points than patches or neighbours.
    """
    if points.shape[1] < max(config.patches, config.neighbors):
        raise ValueError(
            f"OpenShape: a cloud of {points.shape[1]} points; give at least "
            f"{max(config.patches, config.neighbors)}"
        )
    ppat = params["ppat"]
    centers, features = jax.vmap(lambda cloud: patches(ppat["sa"], cloud, config))(points)
    lifted = dense(ppat["lift"]["0"], jnp.concatenate([centers, features], -1))
    x = norm(ppat["lift"]["2"], lifted)
    first = jnp.broadcast_to(jnp.asarray(ppat["cls_token"]), (len(x), 1, config.width))
    x = jnp.concatenate([first, x], 1)
    for i in range(config.num_blocks):
        attention, mlp = (ppat["transformer"]["layers"][str(i)][k] for k in ("0", "1"))
        to_out, net = attention["fn"]["to_out"]["0"], mlp["fn"]["net"]
        x = pre_norm_block(
            x,
            (attention["norm"], attention["fn"]["to_qkv"], to_out),
            (mlp["norm"], net["0"], net["3"]),
            config.num_heads,
        )
    return dense(params["proj"], x[:, 0])


def patches(
    params: Params, cloud: jax.Array, config: PointEncoderConfig
) -> tuple[jax.Array, jax.Array]:
    """Centres [P, 3] of one cloud [N, 6] and what lies around them [P, C]."""
    xyz = cloud[:, :3]
    centers = xyz[farthest_points(xyz, config.patches)]
    index = ball_points(xyz, centers, config.radius, config.neighbors)
    x = jnp.concatenate([xyz[index] - centers[:, None], cloud[index]], -1)
    for i in range(len(config.patch_channels)):
        x = dense(params["mlp_convs"][str(i)], x)
        statistics = params["mlp_bns"][str(i)]
        gain = statistics["scale"] * jax.lax.rsqrt(jnp.asarray(statistics["var"]) + EPSILON)
        x = jax.nn.relu((x - statistics["mean"]) * gain + statistics["bias"])
    return centers, x.max(1)


def farthest_points(xyz: jax.Array, count: int) -> jax.Array:
    """[count] indices into points [N, 3]: the first, then always the one farthest from those taken
    (the first of equals)."""
    xyz = jnp.asarray(xyz)

    def take(nearest: jax.Array, newest: jax.Array):
        nearest = jnp.minimum(nearest, jnp.square(xyz - xyz[newest]).sum(-1))
        return (nearest, jnp.argmax(nearest).astype(jnp.int32)), newest

    start = (jnp.full(len(xyz), jnp.inf, xyz.dtype), jnp.int32(0))
    return jax.lax.scan(lambda carry, _: take(*carry), start, length=count)[1]


def ball_points(xyz: jax.Array, centers: jax.Array, radius: float, count: int) -> jax.Array:
    """[P, count] indices of the first ``count`` of points [N, 3] within ``radius`` of centres [P,
    3]; the first again where there are fewer."""
    inside = jnp.square(centers[:, None] - xyz).sum(-1) <= radius**2
    found = jax.vmap(lambda row: jnp.nonzero(row, size=count, fill_value=-1)[0])(inside)
    return jnp.where(found < 0, found[:, :1], found)  # a centre is in its own ball
