"""Occupancy at full resolution: what a structure latent leaves blurred, by picture and layout.

    candidates      the least certain of the voxels, one in ``SHARE``, by the structure VAE's logits
    of a candidate  the logits around it, its place, what the picture shows where the camera sees it
                    and how far it lies behind what is likely there (``nn.lifting``), what it sees
                    of the layout (``models.layout_features``)
    MLP             -> added, at candidates, to what every voxel has of the logits around it
                    -> a 3^3 convolution of blocks -> added to all logits

Convolutions are of ``BLOCK``^3 voxels folded into channels, as in the structure VAE: a CPU never
convolves at full resolution. The last layer begins at zero, so that the refiner begins with the
logits that it is given. TRELLIS decodes the latent alone.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.flow_trunk import check_camera
from uniart_jax.models.image_encoder import pixel_width
from uniart_jax.models.layout_features import LayoutFeatures
from uniart_jax.nn.blocks import linear, zeros
from uniart_jax.nn.convolution import Conv3d, depth_to_space, space_to_depth
from uniart_jax.nn.embeddings import grid_coords
from uniart_jax.nn.lifting import hidden_depth, project, read_map
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.voxels.part_table import PartTable

BLOCK = 2  # voxels a side that are convolved as one
SHARE = 4  # of all voxels, one in so many is a candidate
LIKELY = -1.0  # logit from which a voxel hides what is behind it
LARGEST = 8.0  # logits are shown within +- this
CHILDREN = 2  # of a voxel, a side, whose depth in the boxes is seen


class OccupancyRefiner(nnx.Module):
    """Logits [B, R, R, R] of a decoded structure latent -> logits of the same shape."""

    def __init__(self, channels: int, config: ModelConfig, rngs: nnx.Rngs):
        check_camera(config, "structure_flow: refine_channels")
        c, dtype = channels, compute_dtype(config)
        self.around = Conv3d(BLOCK**3, BLOCK**3 * c, rngs, dtype=dtype)
        self.place = linear(3, 2 * c, rngs, dtype=dtype)
        self.pixel = linear(pixel_width(config.image_encoder) + 1, 4 * c, rngs, dtype=dtype)
        self.follows = config.structure_flow.layout_channels > 0
        if self.follows:
            self.layout = LayoutFeatures(CHILDREN, rngs, dtype)
            self.layout_in = linear(self.layout.width, 4 * c, rngs, dtype=dtype)
        self.joined = linear((11 if self.follows else 7) * c, 8 * c, rngs, dtype=dtype)
        self.hidden = linear(8 * c, c, rngs, dtype=dtype)
        self.mix = Conv3d(BLOCK**3 * c, BLOCK**3 * c, rngs, dtype=dtype)
        self.out = linear(BLOCK**3 * c, BLOCK**3, rngs, init=zeros)

    def __call__(
        self, logits: jax.Array, pixels: jax.Array, cameras: jax.Array, layout: PartTable | None
    ) -> jax.Array:
        """Refined logits [B, R, R, R], float32; ``StructureFlow.refine`` says of what."""
        items, side = logits.shape[:2]
        _, index = jax.lax.top_k(-jnp.abs(logits.reshape(items, -1)), side**3 // SHARE)
        index = jnp.sort(index, -1)  # neighbours in space stay neighbours in memory
        coords = jnp.stack(jnp.unravel_index(index, (side,) * 3), -1)
        shown = jnp.clip(logits, -LARGEST, LARGEST)[..., None] / LARGEST
        around = depth_to_space(self.around(space_to_depth(shown, BLOCK)), BLOCK)
        flat = around.reshape(items, side**3, -1)
        seen = [
            jnp.take_along_axis(flat, index[..., None], 1),
            self.place((coords + 0.5) / side - 0.5),
            self._read(pixels, cameras, logits, index),
        ]
        if self.follows:
            assert layout is not None  # ``StructureFlow.refine`` asks for it
            seen.append(self.layout_in(self.layout(layout, coords, side)))
        h = self.joined(jax.nn.gelu(jnp.concatenate(seen, -1)))
        h = self.hidden(jax.nn.gelu(h))
        dense = (around + _spread(h, index, side)).astype(h.dtype)
        mixed = self.mix(jax.nn.gelu(space_to_depth(dense, BLOCK)))
        added = self.out(jax.nn.gelu(mixed.astype(jnp.float32)))
        return logits + depth_to_space(added, BLOCK)[..., 0]

    def _read(self, pixels, cameras, logits, index) -> Any:
        """[B, Q, 4 C] of what candidates read in the pictures, on average over views."""
        side, size = logits.shape[1], pixels.shape[2]
        centres = (grid_coords(side) + 0.5) / side - 0.5

        def of_view(features, camera, likely, index):
            (places,), (depth,) = project(camera[None], centres)
            behind = hidden_depth(places, depth, jnp.ones(side**3, bool), size, likely)[index]
            behind = jnp.tanh(behind * (side / 4)).astype(features.dtype)
            read = read_map(features, places[index])
            return jnp.concatenate([read, behind[:, None]], -1) * (camera != 0).any()

        pixels, cameras = jax.lax.stop_gradient((pixels, cameras))
        likely = logits.reshape(len(logits), -1) > LIKELY
        over_views = jax.vmap(of_view, (0, 0, None, None))
        return self.pixel(jax.vmap(over_views)(pixels, cameras, likely, index)).mean(1)


def _spread(rows: jax.Array, index: jax.Array, side: int) -> jax.Array:
    """Rows [B, Q, C] at their places ``index`` [B, Q], ascending, of a grid [B, side, side, side,
    C]; 0 elsewhere."""

    def of_item(rows, index):
        empty = jnp.zeros((side**3, rows.shape[-1]), rows.dtype)
        return empty.at[index].set(rows, unique_indices=True, indices_are_sorted=True)

    return jax.vmap(of_item)(rows, index).reshape(len(rows), side, side, side, -1)
