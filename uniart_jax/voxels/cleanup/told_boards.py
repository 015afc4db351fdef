"""Parts that do not move built of the boards that they are told to have: handles, spouts, feet that
a layout has rows for."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.cleanup.layout_panels import BESIDE, FARTHEST, distance_to
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells

THINNEST = 2.0  # cells of a board


def with_told_boards(
    field: DenseField, body: Sequence[int], boards: Mapping[int, np.ndarray]
) -> DenseField:
    """A field in which some of the parts that do not move are their boards and nothing else; what
    is drawn of others stays.

    Args:
      body: owners that do not move. boards: [N, 6] lower and upper corners, object units, of some
        of them.
    """
    if not boards:
        return field
    sdf, owner = field.sdf.copy(), field.owner.copy()
    mine = np.isin(owner, list(boards)) & (sdf < 0)
    sdf[mine] = FARTHEST
    moving = (sdf < 0) & ~np.isin(owner, list(body))
    stays = np.asarray(ndimage.binary_dilation(moving), bool)
    for axis in range(3):  # the layer around the grid stays outside
        np.moveaxis(stays, axis, 0)[[0, -1]] = True
    nearest = np.full(sdf.shape, float(BESIDE), np.float32)
    whose = np.full(sdf.shape, -1, owner.dtype)
    for k, rows in boards.items():
        cells = to_cells(rows, sdf.shape[0] - 2)
        middle, half = (cells[:, :3] + cells[:, 3:]) / 2, (cells[:, 3:] - cells[:, :3]) / 2
        half = np.maximum(half, THINNEST / 2)
        distance = distance_to(np.concatenate([middle - half, middle + half], 1), sdf.shape)
        nearer = distance < nearest
        nearest[nearer], whose[nearer] = distance[nearer], k
    value = np.clip(nearest, -FARTHEST, FARTHEST)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    where = ~stays & (whose >= 0)
    taken = where & ((value < sdf) | mine)
    sdf[where] = np.minimum(value, sdf)[where]
    owner[taken] = whose[taken]
    return dataclasses.replace(field, sdf=sdf, owner=owner)
