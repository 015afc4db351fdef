"""The left-right mirror y -> -y of a record: of its voxels, parts, joints, views and cameras. Exact
on stored types.

Codes (voxels.joint_code): a turn about p x d becomes the opposite turn about the mirrored line,
travel stays travel along the mirrored direction, and a moment p x d is a pseudovector. With M =
diag(1, -1, 1):

    (tau, d, m, lo, hi)  ->  canonical(-tau, M d, -M m, -hi, -lo)
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from uniart_jax.data.columns import FEATURES
from uniart_jax.data.records import Record
from uniart_jax.voxels.joint_code import canonical
from uniart_jax.voxels.part_table import PartTable

_CODE_SIGNS = np.array([-1, 1, -1, 1, -1, 1, -1, -1, -1], np.float32)
_CODE_ORDER = np.array([0, 1, 2, 3, 4, 5, 6, 8, 7])
_BOX_SIGNS = np.array([1, -1, 1, 1, 1, 1], np.float32)
_CORNER_ORDER = np.array([0, 4, 2, 3, 1, 5])
_CORNER_SIGNS = np.array([1, -1, 1, 1, -1, 1], np.float32)
_LEG_ORDER = np.array([0, 3, 2, 1, 4, 7, 6, 5, 8, 9, 10, 11])
_LEG_SIGNS = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1, 1, 1, 1], np.float32)

# of places on axes along x, y and z, coordinates of the other two in order
_CENTER_SIGNS = np.array([[-1, 1], [1, 1], [1, -1]], np.float32)


def mirror_boxes(boxes: np.ndarray) -> np.ndarray:
    """Mirrored boxes [..., 6]."""
    return boxes * _BOX_SIGNS


def mirror_codes(codes: Any, xp: Any = np) -> Any:
    """Mirrored joint codes [..., 9], canonical; a fixed joint stays exactly 0. ``xp``: array
    namespace of ``codes``."""
    return canonical(codes[..., _CODE_ORDER] * _CODE_SIGNS, xp) + np.float32(0)


def mirror_legs(legs: np.ndarray) -> np.ndarray:
    """Mirrored rows [..., 12] of ``voxels.leg_table.Legs.table``, or their first 10."""
    width = legs.shape[-1]
    return legs[..., _LEG_ORDER[:width]] * _LEG_SIGNS[:width]


def mirror_corners(corners: np.ndarray) -> np.ndarray:
    """Mirrored lower and upper corners [..., 6] of boxes."""
    return corners[..., _CORNER_ORDER] * _CORNER_SIGNS


def mirror_revolutions(rows: Any, xp: Any = np) -> Any:
    """Mirrored rows [..., 11] of ``voxels.revolution_table.revolution_rows``. ``xp``: array
    namespace."""
    axis, center, radii = rows[..., :1], rows[..., 1:3], rows[..., 3:]
    signs = np.concatenate([np.ones((1, 2), np.float32), _CENTER_SIGNS])
    center = center * xp.asarray(signs)[axis[..., 0].astype(int)]
    return xp.concatenate([axis, center, xp.where(axis == 2, radii[..., ::-1], radii)], -1)


def mirror_centers(centers: np.ndarray) -> np.ndarray:
    """Mirrored centres [..., 3, 2] of outlines about each axis."""
    return centers * _CENTER_SIGNS


def mirror_radii(radii: np.ndarray) -> np.ndarray:
    """Mirrored radii [..., 3, N] of outlines about each axis: those along y in reverse order."""
    along_y = np.arange(3)[:, None] == 1
    return np.where(along_y, radii[..., ::-1], radii)


def mirror_dense(grid: np.ndarray, first_axis: int = 0) -> np.ndarray:
    """A mirrored view of dense cells [..., R, R, R, ...] whose x axis is ``first_axis``."""
    return np.flip(grid, first_axis + 1)


def mirror_coords(coords: np.ndarray, resolution: int) -> np.ndarray:
    """Mirrored voxels [V, 3] of a grid with so many along its side, in the same order."""
    turned = coords.copy()
    turned[:, 1] = resolution - 1 - turned[:, 1]
    return turned


def mirror_subcells(values: np.ndarray, subdivisions: int) -> np.ndarray:
    """Values [V, r^3, ...] of voxels' sub-cells, mirrored within their voxels."""
    r, tail = subdivisions, values.shape[2:]
    return values.reshape(-1, r, r, r, *tail)[:, :, ::-1].reshape(-1, r**3, *tail)


def mirror_table(table: PartTable) -> PartTable:
    """The part tables of mirrored objects."""
    return table._replace(boxes=mirror_boxes(table.boxes), codes=mirror_codes(table.codes))


def mirror_images(images: np.ndarray) -> np.ndarray:
    """A flipped view of images [..., H, W, C]: what the mirrored camera sees of the mirrored
    object."""
    return images[..., ::-1, :]


def mirror_record(record: Record) -> Record:
    """The record of the mirrored object, voxels in lexicographic order again.

    Features of columns keep their voxels. They are not what their network would make of the
    mirrored object, so ``batches`` mirrors no record where a model reads them.
    """
    resolution, r = record.resolution, record.subdivisions
    coords = mirror_coords(record.coords, resolution)
    order = np.lexsort(coords.T[::-1])

    def cells(values: np.ndarray) -> np.ndarray:
        """Rows in the new order, their sub-cells mirrored."""
        return mirror_subcells(values[order], r)

    cameras = record.cameras * np.array([-1, 1, 1, 1], np.float32)
    features = {
        name: values[order] for name in FEATURES if (values := getattr(record, name)) is not None
    }
    return dataclasses.replace(
        record,
        coords=coords[order],
        sdf=cells(record.sdf),
        color=cells(record.color),
        owner=cells(record.owner),
        voxel_part=record.voxel_part[order],
        boxes=mirror_boxes(record.boxes),
        codes=mirror_codes(record.codes),
        images=mirror_images(record.images),
        cameras=cameras,
        **features,
    )
