"""An object's parts as padded arrays: what networks see of a layout (``voxels.layout``). numpy
only."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from uniart_jax.nn.shapes import Array
from uniart_jax.voxels.joint_code import BOX_SIZE, CODE_SIZE


class PartTable(NamedTuple):
    """B objects of at most K parts; rows beyond ``counts`` are zero. An object with count 0 has no
    layout.

    Attributes:
      boxes: [B, K, 6] own boxes, centre and size. codes: [B, K, 9] joint codes. parents: [B, K]
        int, the root its own.
      colors: [B, K, 3] linear RGB in 0..1. counts: [B] int.
    """

    boxes: Annotated[Array, "B K 6", "float"]
    codes: Annotated[Array, "B K 9", "float"]
    parents: Annotated[Array, "B K", "int"]
    colors: Annotated[Array, "B K 3", "float"]
    counts: Annotated[Array, "B", "int"]


MOST_LEGS, MOST_PANELS = 8, 24  # of an object that is trained on
MOST_BOARDS = 12  # of a part that is trained on
THRESHOLD = 0.4  # of the probability that a part is there (docs/training_history.md)
SMALLEST_SIDE = 0.004  # object units, of a box that a mesh is made of
ROWS = ("boxes", "codes", "parents", "colors")
EMPTY = {
    "boxes": np.zeros((0, BOX_SIZE)),
    "codes": np.zeros((0, CODE_SIZE)),
    "parents": np.zeros(0, np.int32),
    "colors": np.zeros((0, 3)),
}


def part_table(items: list[dict[str, np.ndarray]], most: int) -> PartTable:
    """Tables of single objects (``ROWS``, n <= ``most`` parts each) as one padded table.

    Raises:
      ValueError: an object has more parts than ``most``.
    """
    table = PartTable(
        np.zeros((len(items), most, BOX_SIZE), np.float32),
        np.zeros((len(items), most, CODE_SIZE), np.float32),
        np.zeros((len(items), most), np.int32),
        np.zeros((len(items), most, 3), np.float32),
        np.array([len(item["boxes"]) for item in items], np.int32),
    )
    if len(items) and (parts := table.counts.max()) > most:
        raise ValueError(f"layout: {parts} parts, the model holds {most}")
    for b, item in enumerate(items):
        for name in ROWS:
            getattr(table, name)[b, : table.counts[b]] = item[name]
    return table


def surface_colors(
    sdf: np.ndarray, color: np.ndarray, owner: np.ndarray, parts: int, thickness: float = 1.0
) -> np.ndarray:
    """[K, 3] mean colour of the sub-cells within ``thickness`` of each part's surface; the object's
    mean where it has none.

    Args:
      sdf: [...] distances. color: [..., 3]. owner: [...] part ids.
    """
    near = np.abs(sdf) < thickness
    owner, color = owner[near].astype(np.int64), color[near]
    sizes = np.bincount(owner, minlength=parts)
    total = np.stack([np.bincount(owner, color[:, c], parts) for c in range(3)], -1)
    mean = total / np.maximum(sizes, 1)[:, None]
    whole = total.sum(0) / max(sizes.sum(), 1)
    return np.where(sizes[:, None] > 0, mean, whole).astype(np.float32)
