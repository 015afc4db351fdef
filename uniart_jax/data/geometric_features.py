"""Part features that need no weights: how the surface around a voxel is shaped, at three scales.

PartField's features (``data.part_features``) need CUDA and non-commercial weights. These stand in
for them where the question is what a network does with features that differ within a part:

    of each scale, Gaussian neighbourhoods of 1, 2, 4 voxels
        mean normal (3)              its length falls where the surface bends
        linearity, planarity, scattering (3)      of the surface points' covariance
        density (1)                  surface points, over those of a plane
    height (1)                       of the voxel in the object, 0..1
    thickness (1)                    of the matter behind the voxel's surface, in units of 16 sub-cells

Eigenvalue features: Demantké et al. 2011, "Dimensionality based scale selection in 3D lidar point
clouds": with singular values s1 >= s2 >= s3, (s1 - s2) / s1, (s2 - s3) / s1, s3 / s1.
"""  # noqa: E501

from __future__ import annotations

import numpy as np
from scipy import ndimage

from uniart_jax.data.columns import half
from uniart_jax.data.records import Record, decode_sdf
from uniart_jax.voxels.grid import SDF_CLIP, subcell_indices
from uniart_jax.voxels.isosurface import unknown_regions

SCALES = (1.0, 2.0, 4.0)  # voxels, deviations of the neighbourhoods' Gaussians
OF_SCALE = 7
CHANNELS = OF_SCALE * len(SCALES) + 2
ON_SURFACE = 0.87  # sub-cells: half the diagonal; a cell nearer than this may hold surface
DEEPEST = 16  # sub-cells of matter that are told apart
LEAST = 1e-6  # of a neighbourhood's weight


def geometric_features(record: Record) -> np.ndarray:
    """[V, 23] float16 of a record's voxels, in their order, each within -1..2.

    They follow from the shown shape alone: neither parts nor joints are looked at. A mirrored
    object (y -> -y) has the same, but for the sign of the normals' y.
    """
    side, cells = record.resolution, record.subdivisions
    index = subcell_indices(record.coords.astype(np.int32), cells)  # [V, r^3, 3]
    sdf = decode_sdf(record.sdf)
    dense = _dense(record, index, sdf)
    voxel, cell = np.nonzero(np.abs(sdf) <= ON_SURFACE)
    at = index[voxel, cell]
    normals = _normals(dense, at)
    moments = _moments(record.coords[voxel], (at + 0.5) / cells, normals, side)
    found = [_of_scale(moments, record.coords, scale, cells) for scale in SCALES]
    low, high = record.coords[:, 2].min(), record.coords[:, 2].max()
    height = (record.coords[:, 2] - low) / max(high - low, 1)
    thickness = np.zeros(len(record.coords))
    np.maximum.at(thickness, voxel, _thickness(dense, at, normals))
    values = np.concatenate([*found, height[:, None], thickness[:, None]], 1)
    return half(values, str(record.meta.get("id")), "part_feature")


def _dense(record: Record, index: np.ndarray, sdf: np.ndarray) -> np.ndarray:
    """[n, n, n] distances of all sub-cells; what lies between the active voxels is inside or
    outside as in ``voxels.isosurface``."""
    side, cells = record.resolution, record.subdivisions
    coords = record.coords.astype(np.int32)
    nobody = np.zeros((len(coords), cells**3), np.int16)
    regions, inside, _ = unknown_regions(coords, side, sdf, nobody, cells)
    far = np.where(inside, -SDF_CLIP, SDF_CLIP).astype(np.float32)[regions]
    dense = far.repeat(cells, 0).repeat(cells, 1).repeat(cells, 2)
    dense[tuple(index.reshape(-1, 3).T)] = sdf.reshape(-1)
    return dense


def _normals(dense: np.ndarray, at: np.ndarray) -> np.ndarray:
    """[n, 3] unit normals, outwards, at sub-cells [n, 3]; 0 where distances are level."""
    last = np.array(dense.shape) - 1
    slope = np.empty((len(at), 3))
    for axis in range(3):
        step = np.eye(3, dtype=int)[axis]
        above, below = np.minimum(at + step, last), np.maximum(at - step, 0)
        slope[:, axis] = dense[tuple(above.T)] - dense[tuple(below.T)]
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    return slope / np.where(length > LEAST, length, 1)


def _moments(coords: np.ndarray, points: np.ndarray, normals: np.ndarray, side: int) -> np.ndarray:
    """[13, R, R, R] sums over the surface points [n, 3] of each voxel: 1, p, the six of p p^T,
    normals. Points in units of voxels, about the grid's centre."""
    p = points - side / 2
    products = [p[:, i] * p[:, j] for i in range(3) for j in range(i, 3)]
    columns = [np.ones(len(p)), *p.T, *products, *normals.T]
    flat = np.ravel_multi_index(tuple(coords.astype(int).T), (side,) * 3)
    sums = [np.bincount(flat, column, side**3) for column in columns]
    return np.stack(sums).reshape(-1, side, side, side)


def _of_scale(moments: np.ndarray, coords: np.ndarray, scale: float, cells: int) -> np.ndarray:
    """[V, 7] of one Gaussian neighbourhood around the voxels [V, 3]."""
    blurred = ndimage.gaussian_filter(moments, (0, scale, scale, scale), mode="constant")
    blurred = blurred[:, *coords.T].T
    weight = np.maximum(blurred[..., :1], LEAST)
    mean, square, normal = np.split(blurred[..., 1:] / weight, [3, 9], axis=-1)
    covariance = np.empty((*mean.shape, 3))
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    for k, (i, j) in enumerate(pairs):
        entry = square[..., k] - mean[..., i] * mean[..., j]
        covariance[..., i, j] = covariance[..., j, i] = entry
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[..., ::-1], 0))
    largest = np.maximum(spread[..., 0], LEAST)
    steps = np.concatenate([spread[..., :2] - spread[..., 1:], spread[..., 2:]], -1)
    # a plane through the centre: 2 cells^2 points a voxel, as a sheet is about two sub-cells thick
    plane = 2 * cells**2 / (np.sqrt(2 * np.pi) * scale)
    density = np.minimum(blurred[..., :1] / plane, 2)
    return np.concatenate([normal, steps / largest[..., None], density], -1)


def _thickness(dense: np.ndarray, at: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """[n] in 0..1: how far matter reaches inwards from surface cells [n, 3], over ``DEEPEST``."""
    last = np.array(dense.shape) - 1
    depth, inside = np.zeros(len(at)), np.ones(len(at), bool)
    for step in range(1, DEEPEST + 1):
        place = np.clip(np.rint(at - step * normals).astype(int), 0, last)
        inside &= dense[tuple(place.T)] < 0
        depth += inside
    return depth / DEEPEST
