"""From a feature map to points in the object's frame: each point reads the map where a camera sees
it.

What pixel-aligned networks do (PIFu, pixelNeRF; MVSNet before them), with the camera as one of the
network's own estimates.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp


def project(code: jax.Array, points: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Where camera codes [B, 7] (``voxels.camera_code``) see points [P, 3]: [B, P, 2] in [-1, 1]^2
    across the picture, and depth [B, P] about the origin's."""
    sine, cosine, elevation, focal, perspective, x, y = (code[:, i, None] for i in range(7))
    norm = jnp.sqrt(jnp.maximum(sine**2 + cosine**2, 1e-6))
    sa, ca = sine / norm, cosine / norm
    se, ce = jnp.sin(elevation), jnp.cos(elevation)
    px, py, pz = points.T
    right = sa * px - ca * py
    ahead = ca * px + sa * py
    forward = ce * ahead - se * pz
    down = -se * ahead - ce * pz
    scale = focal / jnp.maximum(1 + perspective * forward, 0.1)
    return jnp.stack([scale * right - x, scale * down - y], -1), forward


def sample_map(features: jax.Array, places: jax.Array) -> jax.Array:
    """Bilinear samples [B, P, C] of a map [B, S, S, C] (row, column) at places [B, P, 2] (x, y) in
    [-1, 1]^2; the border's value beyond it.

    On CPUs by gathers, with scatters as their gradient (docs/benchmarks.md). Elsewhere as a product
    with interpolation weights [P, S^2], since scatters are slow on TPUs and add in no fixed order
    on GPUs.
    """
    if jax.default_backend() == "cpu":
        return jax.vmap(read_map)(features, places)
    return sample_map_dense(features, places)


def sample_map_dense(features: jax.Array, places: jax.Array) -> jax.Array:
    """``sample_map`` as a product of the map with a dense matrix of weights."""
    side = features.shape[1]
    index = jnp.clip((places + 1) * (side / 2) - 0.5, 0, side - 1)
    weights = jnp.maximum(1 - jnp.abs(index[..., None] - jnp.arange(side)), 0)  # [B, P, 2, S]
    rows = weights[:, :, 1, :, None] * weights[:, :, 0, None, :]
    flat = features.reshape(features.shape[0], side * side, -1)
    return jnp.einsum(
        "bpq,bqc->bpc", rows.reshape(*rows.shape[:2], -1).astype(features.dtype), flat
    )


def read_map(features: jax.Array, places: jax.Array) -> jax.Array:
    """``sample_map`` of one picture by gathers: [S, S, C] at [P, 2] -> [P, C]."""
    side = features.shape[0]
    index = jnp.clip((places + 1) * (side / 2) - 0.5, 0, side - 1)
    low = jnp.minimum(index.astype(jnp.int32), max(side - 2, 0))
    share = index - low
    high = jnp.minimum(low + 1, side - 1)
    flat, total = features.reshape(side * side, -1), 0
    for column, across in ((low[:, 0], 1 - share[:, 0]), (high[:, 0], share[:, 0])):
        for row, down in ((low[:, 1], 1 - share[:, 1]), (high[:, 1], share[:, 1])):
            total = total + flat[row * side + column] * (across * down)[:, None]
    return total.astype(features.dtype)


def hidden_depth(
    places: jax.Array,
    depth: jax.Array,
    valid: jax.Array,
    side: int,
    hides: jax.Array | None = None,
) -> jax.Array:
    """How far behind the foremost point in the same cell of a ``side`` x ``side`` map each point
    lies [P], in depth's units; 0 at the front.

    Args:
      places [P, 2], depth [P]: of ``project``, one camera. valid: [P]; 0 for the others.
      hides: [P], the points that can hide others; None: the valid ones. A point before all of them
        is negative, -inf where none of them is in its cell.
    """
    cell = jnp.clip(((places + 1) * (side / 2)).astype(jnp.int32), 0, side - 1)
    index = cell[:, 1] * side + cell[:, 0]
    hides = valid if hides is None else hides
    front = jnp.full(side * side, jnp.inf).at[index].min(jnp.where(hides, depth, jnp.inf))
    return jnp.where(valid, depth - front[index], 0)


def read_pixels(
    pixels: jax.Array, cameras: jax.Array, coords: jax.Array, counts: jax.Array, resolution: int
) -> jax.Array:
    """What voxels read in pictures of their object, where its cameras see them: PIFu's
    pixel-aligned features, with the depth at which they lie behind others.

    Args:
      pixels: [B, N, S, S, C] maps of N views. cameras: [B, N, 7]; of a view that is all zeros (no
        condition) zeros are read.
      coords [B, V, 3], counts [B]: active voxels of a grid of ``resolution``.

    Returns:
      [B, N, V, C + 1]: the map's value, the border's beyond it, and tanh(d / 4), d voxel sides
        behind the foremost voxel of the same cell of the map; no gradient goes through.
    """
    pixels, cameras = jax.lax.stop_gradient((pixels, cameras))
    side = pixels.shape[2]

    def of_view(features, camera, points, valid):
        (places,), (depth,) = project(camera[None], points)
        behind = jnp.tanh(hidden_depth(places, depth, valid, side) * (resolution / 4))
        read = jnp.concatenate(
            [read_map(features, places), behind[:, None].astype(features.dtype)], -1
        )
        return read * (camera != 0).any()

    points = (coords + 0.5) / resolution - 0.5
    valid = jnp.arange(coords.shape[1]) < counts[:, None]
    over_views = jax.vmap(of_view, (0, 0, None, None))
    return jax.vmap(over_views)(pixels, cameras, points, valid)
