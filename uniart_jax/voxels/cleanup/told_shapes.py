"""Parts that are what a layout tells, whatever is drawn of them: boards of parts that do not move,
as feet and bars, or that are told at rest and shown turned, as lids; and tubes, as spouts, handles
and slanted legs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.cleanup.layout_panels import BESIDE, FARTHEST, distance_to
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.tube_table import Tube

THINNEST = 2.0  # cells of a board, and of a tube


def with_told_shapes(
    field: DenseField,
    body: Sequence[int],
    boards: Mapping[int, Panels],
    tubes: Mapping[int, Tube],
) -> DenseField:
    """A field in which some parts are their boards, or their tubes, and nothing else.

    Args:
      body: owners that do not move. boards, tubes: of some owners, object units.

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
    distances = {k: _of_boards(own, sdf.shape) for k, own in boards.items()}
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


def _of_boards(own: Panels, shape: tuple[int, ...]) -> np.ndarray:
    """[X, Y, Z] cells from boards, ``BESIDE`` at most."""
    cells = to_cells(own.boxes, shape[0] - 2)
    middle, half = (cells[:, :3] + cells[:, 3:]) / 2, (cells[:, 3:] - cells[:, :3]) / 2
    half = np.maximum(half, THINNEST / 2)
    if own.motion is None:
        return distance_to(np.concatenate([middle - half, middle + half], 1), shape)
    turn, size, zero = own.motion[:3, :3], shape[0] - 2, to_cells(np.zeros(3), shape[0] - 2)
    shift = turn @ -zero + own.motion[:3, 3] * size + zero  # the motion, in cells
    middle, reach = middle @ turn.T + shift, half @ np.abs(turn.T)
    distance = np.full(shape, float(BESIDE), np.float32)
    for center, box, far in zip(middle, half, reach, strict=True):
        window, places = _window(center - far - BESIDE, center + far + BESIDE, shape)
        apart = (np.abs((places - center) @ turn) - box).max(-1)
        distance[window] = np.minimum(distance[window], apart)
    return distance


def _window(
    low: np.ndarray, high: np.ndarray, shape: tuple[int, ...]
) -> tuple[tuple[slice, ...], np.ndarray]:
    """Cells between two corners, and their places [..., 3]."""
    first, last = np.clip(np.floor(low), 0, shape), np.clip(np.ceil(high) + 1, 0, shape)
    window = tuple(slice(int(a), int(b)) for a, b in zip(first, last, strict=True))
    axes = (np.arange(s.start, s.stop, dtype=np.float32) for s in window)
    return window, np.stack(np.meshgrid(*axes, indexing="ij"), -1)


def _of_tube(tube: Tube, shape: tuple[int, ...]) -> np.ndarray:
    """[X, Y, Z] cells from a tube in cells, ``BESIDE`` at most."""
    tube = dataclasses.replace(tube, radius=max(tube.radius, THINNEST / 2))
    distance = np.full(shape, float(BESIDE), np.float32)
    middle, reach = tube.box[:3], tube.box[3:] / 2 + BESIDE
    window, places = _window(middle - reach, middle + reach, shape)
    distance[window] = np.minimum(tube.distance(places), BESIDE)
    return distance
