"""Voxel grids of analytic boxes, made without the voxeliser."""

import numpy as np

from uniart_jax.voxels.grid import SDF_CLIP, PartGrid, subcell_centers


def box_sdf(points: np.ndarray, low, high) -> np.ndarray:
    """Signed distance of points [..., 3] to a solid box, object units."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    middle, half = (low + high) / 2, (high - low) / 2
    # an axis at a time: NumPy takes several times as long for rows of three
    x, y, z = (np.abs(points[..., k] - middle[k]) - half[k] for k in range(3))
    squares = sum(np.maximum(side, 0) ** 2 for side in (x, y, z))
    return np.sqrt(squares) + np.minimum(np.maximum(np.maximum(x, y), z), 0)


def box_of(low, high) -> list[float]:
    """[6] centre and size."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    return [*(low + high) / 2, *(high - low)]


def grid_of(
    distances,
    boxes,
    *,
    codes=None,
    parents=None,
    colors=None,
    resolution=8,
    subdivisions=4,
    steep=1.0,
) -> PartGrid:
    """Part grid of solids.

    Args:
      distances: one function points -> signed distance per part.
      boxes: [K, 6].
      codes, parents, colors: per part; default fixed, children of part 0, gray.
      steep: how fast the distances change with the place, at most; voxels that the surface cannot
        reach are passed over.
    """
    every = np.argwhere(np.ones((resolution,) * 3, bool)).astype(np.int32)
    cell = 1 / (resolution * subdivisions)
    centers = (every + 0.5) / resolution - 0.5
    reach = 0.51 * cell + steep * 3**0.5 / 2 / resolution
    every = every[np.any([np.abs(d(centers)) <= reach for d in distances], axis=0)]
    each = np.stack([d(subcell_centers(every, resolution, subdivisions)) for d in distances]) / cell
    active = (np.abs(each) <= 0.5 + 1e-6).any(
        (0, 2)
    )  # the surface passes within half a sub-cell of a centre
    each = each[:, active]
    owner = each.argmin(0)
    surface = np.stack([(np.abs(d) <= 0.5 + 1e-6).sum(1) for d in each])
    voxel_part = surface.argmax(0)
    for k in set(range(len(distances))) - set(
        voxel_part
    ):  # a part that wins no voxel takes its best one
        voxel_part[surface[k].argmax()] = k
    count = len(distances)
    colors = np.full((count, 3), 0.5) if colors is None else np.asarray(colors, float)
    return PartGrid(
        resolution,
        subdivisions,
        every[active],
        np.clip(each.min(0), -SDF_CLIP, SDF_CLIP).astype(np.float32),
        colors[owner].astype(np.float32),
        owner.astype(np.uint8),
        voxel_part.astype(np.uint8),
        np.asarray(boxes, np.float32),
        (np.zeros((count, 9)) if codes is None else np.asarray(codes)).astype(np.float32),
        np.zeros(count, np.int32) if parents is None else np.asarray(parents, np.int32),
    )
