"""What the cells of a dense grid read in pictures of their object, where its cameras see them:
pixel-aligned features as PIFu's, for a network that does not yet know which voxels there are.

    points of a cell, ``POINTS`` a side -> the maps there (``nn.lifting``), the place in the picture
    and in the map's cell, the depth -> MLP, averaged over views -> side by side
    its voxels -> the silhouette there, averaged over views -> side by side
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.flow_trunk import check_camera
from uniart_jax.models.image_encoder import pixel_width, silhouette
from uniart_jax.nn.blocks import linear
from uniart_jax.nn.embeddings import grid_coords
from uniart_jax.nn.lifting import project, read_map

POINTS = 2  # of a cell, a side
_PLACE_CHANNELS = 7  # x, y, depth and the phases of x and y within a map cell


class GridPixels(nnx.Module):
    """Maps and cameras of pictures -> features of the cells of a grid, ``side`` a side; ``width``
    channels a cell."""

    def __init__(self, channels: int, side: int, config: ModelConfig, rngs: nnx.Rngs, dtype):
        encoder = config.image_encoder
        check_camera(config, "structure_flow: pixel_channels")
        self.side, self.stride = side, encoder.stem_stride
        self.voxels = config.grid.resolution // side  # of a cell, a side
        self.width = POINTS**3 * channels + self.voxels**3
        inputs = pixel_width(encoder) + _PLACE_CHANNELS
        self.read = linear(inputs, 2 * channels, rngs, dtype=dtype)
        self.hidden = linear(2 * channels, channels, rngs, dtype=dtype)

    def __call__(self, pixels: jax.Array, cameras: jax.Array) -> jax.Array:
        """[B, N, S, S, C] and [B, N, 7] of N pictures -> [B, side, side, side, width]. Zeros are
        read of a view whose camera is all zeros (no condition); no gradient goes through."""
        pixels, cameras = jax.lax.stop_gradient((pixels, cameras))
        points, voxels = (_centres(n * self.side) for n in (POINTS, self.voxels))

        def of_view(features, camera):
            (places,), (depth,) = project(camera[None], points)
            phase = (places + 1) * (jnp.pi * len(features))
            place = [places, depth[:, None], jnp.sin(phase), jnp.cos(phase)]
            read = jnp.concatenate([read_map(features, places), *place], -1)
            shown = read_map(silhouette(features, self.stride), project(camera[None], voxels)[0][0])
            seen = (camera != 0).any()
            return read * seen, shown * seen

        read, shown = jax.vmap(jax.vmap(of_view))(pixels, cameras)
        h = jax.nn.gelu(self.hidden(jax.nn.gelu(self.read(read))).mean(1))
        cells = [self._of_cells(h, POINTS), self._of_cells(shown.mean(1), self.voxels)]
        return jnp.concatenate([c.astype(h.dtype) for c in cells], -1)

    def _of_cells(self, values: jax.Array, inner: int) -> jax.Array:
        """[B, (side inner)^3, C] -> [B, side, side, side, inner^3 C]."""
        s, items = self.side, len(values)
        grid = values.reshape(items, s, inner, s, inner, s, inner, -1)
        return grid.transpose(0, 1, 3, 5, 2, 4, 6, 7).reshape(items, s, s, s, -1)


def _centres(side: int) -> jax.Array:
    """[side^3, 3] of the cells of a grid."""
    return (grid_coords(side) + 0.5) / side - 0.5
