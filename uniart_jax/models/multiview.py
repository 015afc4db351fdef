"""Image features on voxels: what a voxel's centre reads in every view, averaged (paper: V_geo's
visual part; TRELLIS ``dataset_toolkits/extract_feature.py``).

    p' = K E p        uv = 2 p'_xy / p'_z - 1        feature(p) = mean over views of the patch map at uv

The map is read bilinearly, with zeros beyond the picture; no view is left out, whether it sees the
voxel or not (TRELLIS). One view is read at a time and only a running sum is kept, so memory does
not grow with the number of views.
"""  # noqa: E501

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from uniart_jax.models.network import Network, Params


def intrinsic_matrices(fov: Any) -> np.ndarray:
    """[M, 3, 3] float32 K of square pictures of width 1 that see ``fov`` [M] radians across, their
    centre in the middle."""
    focal = 0.5 / np.tan(np.asarray(fov, np.float64) / 2)
    intrinsics = np.zeros((len(focal), 3, 3))
    intrinsics[:, 0, 0] = intrinsics[:, 1, 1] = focal
    intrinsics[:, :2, 2], intrinsics[:, 2, 2] = 0.5, 1
    return intrinsics.astype(np.float32)


def project(points: jax.Array, extrinsics: jax.Array, intrinsics: jax.Array) -> jax.Array:
    """Where a camera (E [4, 4], K [3, 3]) sees points [V, 3]: [V, 2] (x right, y down), in [-1,
    1]^2 across the picture.

    Points beside or behind the camera are seen nowhere: they get a place far outside.
    """
    inside = points @ extrinsics[:3, :3].T + extrinsics[:3, 3]
    x, y, depth = (inside @ intrinsics.T).T
    ahead = depth > 1e-6
    uv = jnp.stack([x, y], -1) / jnp.where(ahead, depth, 1)[:, None]
    return jnp.where(ahead[:, None], uv * 2 - 1, 1e3)


def sample_patches(patches: jax.Array, uv: jax.Array) -> jax.Array:
    """Bilinear samples [V, C] of a map [h, w, C] at uv [V, 2] in [-1, 1]^2; zeros beyond the map
    (PyTorch's grid_sample, corners not aligned).

    Gathers of four corners: interpolation weights over all patches of 20,000 voxels would be larger
    than the result, and nothing is differentiated.
    """
    size = np.array(patches.shape[1::-1])  # width, height
    place = (uv + 1) * (size / 2) - 0.5
    low = jnp.floor(place)
    share = place - low
    flat, total = patches.reshape(-1, patches.shape[-1]), 0
    for corner in itertools.product((0, 1), (0, 1)):
        at = low.astype(jnp.int32) + np.array(corner)
        weight = jnp.where(np.array(corner) == 1, share, 1 - share).prod(-1)
        known = ((at >= 0) & (at < size)).all(-1)
        row = jnp.where(known, at[:, 1] * size[0] + at[:, 0], 0)
        total = total + flat[row] * jnp.where(known, weight, 0)[:, None]
    return total


@jax.jit
def add_views(
    total: jax.Array,
    patches: jax.Array,
    extrinsics: jax.Array,
    intrinsics: jax.Array,
    positions: jax.Array,
    weights: jax.Array | None = None,
) -> jax.Array:
    """total [V, C] plus what positions [V, 3] read in patches [M, h, w, C] through cameras [M, 4,
    4], [M, 3, 3]; view m counts weights[m] times."""
    weights = jnp.ones(len(patches)) if weights is None else weights

    def step(total, view):
        patch_map, extrinsic, intrinsic, weight = view
        read = sample_patches(patch_map, project(positions, extrinsic, intrinsic))
        return total + weight * read.astype(total.dtype), None

    return jax.lax.scan(step, total, (patches, extrinsics, intrinsics, weights))[0]


def multiview_features(
    network: Network,
    params: Params,
    images: Iterable[Any],
    extrinsics: np.ndarray,
    intrinsics: np.ndarray,
    positions: Any,
    count: int | None = None,
    *,
    chunk: int = 4,
) -> jax.Array:
    """Mean over views of what voxels read in their patch maps, which are computed on the way,
    ``chunk`` views at a time.

    Args:
      network, params: the image encoder of 'dinov2'.
      images: array [M, S, S, 3] or any iterable of M pictures [S, S, 3], sRGB in [0, 1] on black,
        or [S, S, 4] uint8, straight alpha; read once, a chunk at a time.
      extrinsics: [M, 4, 4] world to camera, x right, y down, looking along +z. intrinsics: [M, 3,
        3] for a picture of width 1.
      positions: [V, 3] voxel centres in the object frame, (coords + 1/2) / R - 1/2.
      count: valid positions, first; None = all.

    Returns:
      [V, C] float32; padding zero.

    Raises:
      ValueError: no picture, or not as many as cameras.
    """
    total = jnp.zeros((len(positions), network.config.image_encoder.width), jnp.float32)
    seen, source = 0, iter(images)
    while group := list(itertools.islice(source, chunk)):
        stop = seen + len(group)
        if stop > len(extrinsics):
            raise ValueError(f"multi-view features: more pictures than {len(extrinsics)} cameras")
        # a last chunk that is not full repeats its pictures with weight 0, so that one shape is
        # compiled
        index = np.arange(chunk) % len(group)
        pictures = np.stack([np.asarray(group[i]) for i in index])
        weights = (np.arange(chunk) < len(group)).astype(np.float32)
        cameras = extrinsics[seen:stop][index], intrinsics[seen:stop][index]
        patches = _encode(network, params, pictures)  # by itself: it does not depend on V
        total = add_views(total, patches, *cameras, positions, weights)
        seen = stop
    if not seen or seen != len(extrinsics):
        raise ValueError(f"multi-view features: {seen} pictures but {len(extrinsics)} cameras")
    return _valid(total / seen, count)


@functools.partial(jax.jit, static_argnums=0)
def _encode(network: Network, params: Params, images: jax.Array) -> jax.Array:
    if images.dtype == jnp.uint8:
        images = images.astype(jnp.float32) / 255
    if images.shape[-1] == 4:
        images = images[..., :3] * images[..., 3:]
    return network.apply(params, images)["patches"]


def _valid(values: jax.Array, count: int | jax.Array | None) -> jax.Array:
    if count is None:
        return values
    return jnp.where((jnp.arange(len(values)) < count)[:, None], values, 0)
