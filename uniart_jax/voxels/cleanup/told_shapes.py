"""Parts that are what a layout tells, whatever is drawn of them: boards of parts that do not move,
as feet and bars, and tubes, as spouts, handles and slanted legs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.cleanup.layout_panels import BESIDE, FARTHEST, distance_to
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells
from uniart_jax.voxels.tube_table import Tube

THINNEST = 2.0  # cells of a board, and of a tube


def with_told_shapes(
    field: DenseField,
    body: Sequence[int],
    boards: Mapping[int, np.ndarray],
    tubes: Mapping[int, Tube],
) -> DenseField:
    """A field in which some parts are their boards, or their tubes, and nothing else.

    Args:
      body: owners that do not move. boards: [N, 6] lower and upper corners, object units, of some
        of them. tubes: of any owners, object units.

    Returns:
      A new field. What is drawn of other parts that move stays as it is. Other parts that do not
      move lose the cells that one of these that moves takes.
    """
    if not boards and not tubes:
        return field
    size, sdf, owner = field.sdf.shape[0] - 2, field.sdf.copy(), field.owner.copy()
    told = [*boards, *tubes]
    mine = np.isin(owner, told) & (sdf < 0)
    sdf[mine] = FARTHEST
    moving = (sdf < 0) & ~np.isin(owner, list(body))
    stays = np.asarray(ndimage.binary_dilation(moving), bool)
    for axis in range(3):  # the layer around the grid stays outside
        np.moveaxis(stays, axis, 0)[[0, -1]] = True
    nearest = np.full(sdf.shape, float(BESIDE), np.float32)
    whose = np.full(sdf.shape, -1, owner.dtype)
    distances = {k: _of_boards(to_cells(rows, size), sdf.shape) for k, rows in boards.items()}
    distances |= {
        k: _of_tube(Tube(to_cells(tube.points, size), tube.radius * size), sdf.shape)
        for k, tube in tubes.items()
    }
    for k, distance in distances.items():
        nearer = distance < nearest
        nearest[nearer], whose[nearer] = distance[nearer], k
    value = np.clip(nearest, -FARTHEST, FARTHEST)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    where = ~stays & (whose >= 0)
    moves = (value < 0) & ~np.isin(whose, list(body))
    taken = where & ((value < sdf) | mine | moves)
    sdf[where] = np.minimum(value, sdf)[where]
    owner[taken] = whose[taken]
    return dataclasses.replace(field, sdf=sdf, owner=owner)


def _of_boards(cells: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    middle, half = (cells[:, :3] + cells[:, 3:]) / 2, (cells[:, 3:] - cells[:, :3]) / 2
    half = np.maximum(half, THINNEST / 2)
    return distance_to(np.concatenate([middle - half, middle + half], 1), shape)


def _of_tube(tube: Tube, shape: tuple[int, ...]) -> np.ndarray:
    """[X, Y, Z] cells from a tube in cells, ``BESIDE`` at most."""
    tube = dataclasses.replace(tube, radius=max(tube.radius, THINNEST / 2))
    distance = np.full(shape, float(BESIDE), np.float32)
    ends = tube.box[:3] - tube.box[3:] / 2 - BESIDE, tube.box[:3] + tube.box[3:] / 2 + BESIDE
    first, last = np.clip(np.floor(ends[0]), 0, shape), np.clip(np.ceil(ends[1]) + 1, 0, shape)
    window = tuple(slice(int(a), int(b)) for a, b in zip(first, last, strict=True))
    places = np.stack(np.meshgrid(*(np.arange(s.start, s.stop) for s in window), indexing="ij"), -1)
    if places.size:
        distance[window] = np.minimum(tube.distance(places.astype(np.float32)), BESIDE)
    return distance
