"""The default image encoder (``architecture`` 'volume'): a small convolutional network, image
tokens from it, and a volume aligned with the object's grid.

    image -> residual convolutions -> coarse map -> tokens (a few transformer blocks), for
    cross-attention
                                 |         |
                                 |    MLP on all of it -> camera, first coarse volume
                                 |         |
                             finer map, read where the camera sees each cell -> volume, blocks that
                             look at the tokens -> occupancy, codes

Pre-trained by regressing the camera, coarse occupancy, boxes and joints from the image
(docs/training.md), then frozen: trained jointly with a flow from scratch, an image encoder of
this size is ignored while the loss falls. The camera and the reading by projection (``nn.lifting``)
tell a cell where in the picture to look.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ImageEncoderConfig, ModelConfig
from uniart_jax.nn.blocks import CrossBlock, LayerNorm, TransformerBlock, layer_norm, linear, zeros
from uniart_jax.nn.embeddings import grid_coords, plane_embedding, position_embedding
from uniart_jax.nn.lifting import project, sample_map
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.nn.stem import StemStage
from uniart_jax.voxels.camera_code import CAMERA_CODE_SIZE, MEAN_CAMERA_CODE
from uniart_jax.voxels.joint_code import CODE_CHANNELS

_HEAD_WIDTH = 64
_SKETCH_CHANNELS = 64
_BLACK = -1 + 1 / 255  # of ``ImageEncoder.pixels``: half a step of 8 bits
_PLACE_CHANNELS = 7  # x, y, depth and the phases of x and y within a map cell


class ImageEncoder(nnx.Module):
    """image [B, H, W, 3] -> camera, tokens, volume, pixels, occupancy, codes."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.image_encoder, compute_dtype(config)
        strides = (c.stem_stride, *[2] * (len(c.stem_channels) - 1))
        side = c.image_size // math.prod(strides)
        fits = side * math.prod(strides) == c.image_size and c.stem_stride % 2 == 0
        if not fits or len(strides) < 2:
            raise ValueError(
                f"image_encoder: stem_stride {c.stem_stride} must be even and, halved once more "
                f"for each further of two or more stem_channels {c.stem_channels}, divide "
                f"image_size {c.image_size}"
            )
        self.config, self.resolution = c, config.grid.resolution
        channels = (3, *c.stem_channels)
        self.stem = nnx.List(
            [
                StemStage(a, b, stride, rngs, dtype)
                for (a, b), stride in zip(itertools.pairwise(channels), strides, strict=True)
            ]
        )
        self.to_tokens = linear(channels[-1], c.width, rngs, dtype=dtype)
        self.pos_embed = nnx.Param(jnp.asarray(plane_embedding(side, c.width)))
        block: dict[str, Any] = {"kernel": config.kernel, "dtype": dtype}
        self.blocks = nnx.List(
            [
                TransformerBlock(c.width, c.num_heads, c.mlp_ratio, rngs, **block)
                for _ in range(c.num_blocks)
            ]
        )
        self.norm = LayerNorm(c.width)
        self.queries = nnx.Param(position_embedding(grid_coords(c.volume_tokens), c.width))
        wide = c.sketch_width
        widths = (side**2 * channels[-1], wide, wide, c.volume_tokens**3 * _SKETCH_CHANNELS)
        pairs = [*itertools.pairwise(widths), (_SKETCH_CHANNELS, c.width)]
        self.sketch = nnx.List([linear(a, b, rngs, dtype=dtype) for a, b in pairs])
        self.to_camera = linear(wide, CAMERA_CODE_SIZE, rngs, init=zeros)
        lifted, cells = c.volume_channels, c.volume_resolution**3
        self.lift_fine = linear(channels[-2], lifted, rngs, dtype=dtype)
        self.lift_coarse = linear(channels[-1], lifted, rngs, dtype=dtype)
        self.lift_cell = nnx.Param(
            position_embedding(grid_coords(c.volume_resolution), lifted).reshape(cells, lifted)
        )
        self.lift_place = linear(_PLACE_CHANNELS + CAMERA_CODE_SIZE, lifted, rngs, dtype=dtype)
        self.lift_mix = linear(lifted, lifted, rngs, dtype=dtype)
        self.cells = c.volume_resolution // c.volume_tokens
        self.fold = linear(self.cells**3 * lifted, c.width, rngs, dtype=dtype)
        self.volume_blocks = nnx.List(
            [
                CrossBlock(c.width, c.num_heads, c.mlp_ratio, rngs, **block)
                for _ in range(c.volume_blocks)
            ]
        )
        self.to_volume = linear(c.width, self.cells**3 * c.volume_channels, rngs, dtype=dtype)
        self.cell_in = linear(2 * lifted, 2 * lifted, rngs, dtype=dtype)
        self.cell_out = linear(2 * lifted, lifted, rngs, dtype=dtype)
        self.head_in = linear(c.volume_channels, _HEAD_WIDTH, rngs, dtype=dtype)
        self.head_token = linear(c.width, _HEAD_WIDTH, rngs, dtype=dtype)
        self.fine = self.resolution // c.volume_resolution
        self.coarse = c.target_resolution // c.volume_resolution
        outputs = self.fine**3 + self.coarse**3 * CODE_CHANNELS
        self.head_out = linear(_HEAD_WIDTH, outputs, rngs, dtype=dtype)

    def __call__(
        self,
        image: jax.Array,
        camera: jax.Array | None = None,
        use_true_camera: jax.Array | None = None,
    ) -> dict[str, jax.Array]:
        """Encode images.

        Args:
          image: [B, H, W, 3] sRGB in [0, 1], the background black.
          camera: [B, 7] true camera codes (``voxels.camera_code``) to look through instead of the
            estimated ones, where ``use_true_camera`` [B] is true.

        Returns:
          camera [B, 7], the estimate; pixels [B, S, S, ``pixel_width``], maps for those who look
          closer; tokens [B, L, D]; volume [B, Rv, Rv, Rv, C + 3], features and the picture's
          colour; occupancy [B, R, R, R] logits; codes [B, Rt, Rt, Rt, 21] = joint code 9, own box
          6, parent box 6. Occupancy and codes are read off the features, so these hold what they
          need; of colours nothing is asked, hence they are added as the camera sees them.
        """
        items, c = image.shape[0], self.config
        maps = self.features(image)
        fine, coarse = maps[-2:]
        tokens = self.tokens(coarse)
        sketch, estimate = self.draw_sketch(coarse)
        used = jax.lax.stop_gradient(estimate)
        if camera is not None and use_true_camera is not None:
            used = jnp.where(use_true_camera[:, None], camera, used)
        places, depth = self.project_cells(used)
        lifted = self.lift(fine, coarse, used, places, depth)  # [B, Rv^3, C]
        side = c.volume_resolution
        folded = _fold(lifted.reshape(items, side, side, side, -1), self.cells)
        h = self.queries[...].astype(tokens.dtype) + sketch + self.fold(folded)
        for block in self.volume_blocks:
            h = block(h, tokens)
        h = layer_norm(h, 1e-6)
        cells = self.to_volume(h).reshape(items, -1, self.cells**3, c.volume_channels)
        seen = folded.reshape(cells.shape)
        mixed = self.cell_out(jax.nn.gelu(self.cell_in(jnp.concatenate([cells, seen], -1))))
        cells = cells + mixed
        hidden = jax.nn.gelu(self.head_in(cells) + self.head_token(h)[:, :, None, :])
        out = self.head_out(hidden).astype(jnp.float32)
        split = self.fine**3
        tokens_side = c.volume_tokens
        volume = _unfold(cells.astype(jnp.float32), tokens_side, self.cells)
        colors = sample_map(shrink(image, 2 * fine.shape[1]), places).reshape(items, *[side] * 3, 3)
        volume = jnp.concatenate([volume, colors.astype(jnp.float32) * 2 - 1], -1)
        out = _unfold(out, tokens_side, self.cells).reshape(items, side**3, -1)
        occupancy = _unfold(out[..., :split, None], side, self.fine)
        codes = _unfold(
            out[..., split:].reshape(items, side**3, self.coarse**3, CODE_CHANNELS),
            side,
            self.coarse,
        )
        return {
            "camera": estimate,
            "tokens": tokens,
            "volume": volume,
            "occupancy": occupancy[..., 0],
            "codes": codes,
            "pixels": self.pixels(image, maps),
        }

    def features(self, image: jax.Array) -> list[jax.Array]:
        """[B, H, W, 3] -> the stages' maps; the last two are [B, 2 side, 2 side, C] and [B, side,
        side, C']."""
        maps = [image * 2 - 1]
        for stage in self.stem:
            maps.append(stage(maps[-1]))
        return maps[1:]

    def pixels(self, image: jax.Array, maps: Sequence[jax.Array]) -> jax.Array:
        """What voxels and grids may read (``lifting.read_pixels``, ``models.grid_pixels``), [B, S,
        S, ``pixel_width``]: all stages' maps but the last, each normalised, and the picture itself,
        at the first stage's resolution."""
        stride, (items, side, *_) = self.config.stem_stride, maps[0].shape
        blocks = (image * 2 - 1).reshape(items, side, stride, side, stride, 3)
        read = [blocks.transpose(0, 1, 3, 2, 4, 5).reshape(items, side, side, -1)]
        for features in maps[:-1]:
            times = side // features.shape[1]
            scaled = layer_norm(features.astype(jnp.float32), 1e-5)
            read.append(jnp.repeat(jnp.repeat(scaled, times, axis=1), times, axis=2))
        return jnp.concatenate(read, -1)

    def project_cells(self, camera: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Where cameras [B, 7] see the cells' centres: ``lifting.project``."""
        side = self.config.volume_resolution
        centers = (grid_coords(side) + 0.5) / side - 0.5
        return project(camera, jnp.asarray(centers, jnp.float32))

    def lift(
        self,
        fine: jax.Array,
        coarse: jax.Array,
        camera: jax.Array,
        places: jax.Array,
        depth: jax.Array,
    ) -> jax.Array:
        """Each cell's features [B, Rv^3, C] of the maps, read where cameras [B, 7] see it
        (``project_cells``)."""
        twice = jnp.repeat(jnp.repeat(self.lift_coarse(coarse), 2, axis=1), 2, axis=2)
        read = sample_map(self.lift_fine(fine) + twice, places)
        index = (places + 1) * (fine.shape[1] / 2) - 0.5
        phase = 2 * jnp.pi * index  # where between the map's cells
        place = [places, depth[..., None], jnp.sin(phase), jnp.cos(phase)]
        view = jnp.broadcast_to(camera[:, None], (*depth.shape, CAMERA_CODE_SIZE))
        h = read + self.lift_place(jnp.concatenate([*place, view], -1)) + self.lift_cell[...]
        return self.lift_mix(jax.nn.gelu(h))

    def draw_sketch(self, features: jax.Array) -> tuple[jax.Array, jax.Array]:
        """[B, side, side, C] -> [B, volume tokens, D] and camera codes [B, 7] by an MLP on the
        whole map: where the object is, from any view."""
        first, second, out, lift = self.sketch
        h = jax.nn.gelu(first(features.reshape(features.shape[0], -1)))
        h = h + jax.nn.gelu(second(h))
        camera = self.to_camera(h).astype(jnp.float32) + jnp.asarray(MEAN_CAMERA_CODE)
        return lift(out(h).reshape(h.shape[0], -1, _SKETCH_CHANNELS)), camera

    def tokens(self, features: jax.Array) -> jax.Array:
        """[B, side, side, C] -> [B, side^2, D] normalised tokens, for cross-attention."""
        h = self.to_tokens(features).reshape(features.shape[0], -1, self.config.width)
        h = h + self.pos_embed[...].astype(h.dtype)
        for block in self.blocks:
            h = block(h)
        return self.norm(h)


def pixel_width(config: ImageEncoderConfig) -> int:
    """Channels of ``ImageEncoder.pixels``."""
    return 3 * config.stem_stride**2 + sum(config.stem_channels[:-1])


def silhouette(pixels: jax.Array, stride: int) -> jax.Array:
    """Where the picture of ``ImageEncoder.pixels`` [S, S, C] shows something, its background being
    black: [S stride, S stride, 1] of 0 and 1."""
    side = len(pixels)
    colors = pixels[..., : 3 * stride**2].reshape(side, side, stride, stride, 3)
    shown = (colors.max(-1) > _BLACK).astype(pixels.dtype)
    return shown.transpose(0, 2, 1, 3).reshape(side * stride, side * stride, 1)


def shrink(image: jax.Array, side: int) -> jax.Array:
    """[B, H, H, 3] averaged to [B, side, side, 3]."""
    times = image.shape[1] // side
    return image.reshape(-1, side, times, side, times, 3).mean((2, 4))


def _fold(grid: jax.Array, inner: int) -> jax.Array:
    """The inverse of ``_unfold`` with positions and channels joined: [B, G, G, G, C] -> [B, (G /
    inner)^3, inner^3 C]."""
    items, full, channels = grid.shape[0], grid.shape[1], grid.shape[-1]
    side = full // inner
    cells = grid.reshape(items, side, inner, side, inner, side, inner, channels)
    return cells.transpose(0, 1, 3, 5, 2, 4, 6, 7).reshape(items, side**3, -1)


def _unfold(cells: jax.Array, side: int, inner: int) -> jax.Array:
    """[B, side^3, inner^3, C] -> [B, (side inner), (side inner), (side inner), C]."""
    items, channels = cells.shape[0], cells.shape[-1]
    grid = cells.reshape(items, side, side, side, inner, inner, inner, channels)
    full = side * inner
    return grid.transpose(0, 1, 4, 2, 5, 3, 6, 7).reshape(items, full, full, full, channels)
