"""Tubes: parts that are bent or slanted bars, as spouts, handles and legs, told by hand or by a
language model; as JSON."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np

from uniart_jax.voxels.json_rows import LIMIT, check_names, plain

ENTRIES = ("points", "radius")
MOST_POINTS = 64  # of JSON


@dataclasses.dataclass(frozen=True)
class Tube:
    """A solid of all places within ``radius`` of a path of straight pieces.

    Attributes:
      points: [N, 3] corners of the path, two or more. radius: in their units.
    """

    points: np.ndarray
    radius: float

    @property
    def box(self) -> np.ndarray:
        """[6] centre and size of the box around it."""
        low, high = self.points.min(0) - self.radius, self.points.max(0) + self.radius
        return np.concatenate([(low + high) / 2, high - low])

    def moved(self, motion: np.ndarray) -> Tube:
        """After a rigid motion [4, 4]."""
        points = self.points @ motion[:3, :3].T + motion[:3, 3]
        return dataclasses.replace(self, points=points)

    def scaled(self, middle: np.ndarray, side: float) -> Tube:
        """In units of ``side``, from ``middle`` [3]."""
        return Tube((self.points - middle) / side, self.radius / side)

    def distance(self, places: np.ndarray) -> np.ndarray:
        """[...] of places [..., 3] from its surface, below 0 inside."""
        nearest = np.full(places.shape[:-1], np.inf, np.float32)
        for start, end in itertools.pairwise(self.points):
            along = end - start
            length = max(float(along @ along), 1e-12)
            share = np.clip((places - start) @ along / length, 0, 1)[..., None]
            apart = np.linalg.norm(places - start - share * along, axis=-1)
            nearest = np.minimum(nearest, apart)
        return nearest - np.float32(self.radius)


def tube_to_json(tube: Tube) -> dict[str, Any]:
    """``tube`` of a part in a layout's JSON (``voxels.layout``)."""
    return {"points": [plain(p) for p in tube.points], "radius": round(tube.radius, 9)}


def tube_from_json(data: Any, where: str, far: float = LIMIT) -> Tube | None:
    """Read ``tube_to_json``'s value; None is None. ``where``: of the part, in errors. ``far``: that
    coordinates may have.

    Raises:
      ValueError: one line that names the part and the field.
    """
    if data is None:
        return None
    if not isinstance(data, dict):
        raise ValueError(f'{where}: tube: give an object with "points" and "radius"')
    check_names(data, ENTRIES, f"{where}: tube")
    points: Any = data.get("points")
    sound = isinstance(points, list) and 2 <= len(points) <= MOST_POINTS
    if not sound or not all(_is_point(p, far) for p in points):
        raise ValueError(
            f"{where}: tube: points must be 2 to {MOST_POINTS} of 3 numbers in {-far:g}..{far:g}"
        )
    radius: Any = data.get("radius")
    if type(radius) not in (int, float) or not 0 < radius <= far:
        raise ValueError(f"{where}: tube: radius must be a number above 0, up to {far:g}")
    return Tube(np.array(points, np.float64), float(radius))


def _is_point(values: Any, far: float) -> bool:
    listed = values if isinstance(values, list) else []
    return len(listed) == 3 and all(type(v) in (int, float) and abs(v) <= far for v in listed)
