"""What an object stands on as the layout network finds it, and a field that is made to have it.

A leg is a prism that may lean and taper, or an ellipse in it: two rectangles and their heights. A
plinth is a prism as wide as what it carries, or a little narrower. At the resolution of the voxels
legs are a few cells thick, and a structure network draws them torn; a set of boxes is not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import ZERO, DenseField

THRESHOLD = 0.5  # of a leg's probability
ROUND = 0.89  # share of its rectangle that a round leg fills at most
SOLID = 0.65  # and any leg at least; with less it is a frame or a profile, and stays as drawn
THINNEST = 0.012  # object units
NEAR = 5  # sub-cells from a prism within which what else is drawn of the body is the leg's
FARTHEST = 3.0  # sub-cells, to which distances are cut off
SEARCH = 0.06  # object units to both sides of its height, within which a leg's upper end is sought
JUMP = 0.15  # share of the body's rectangle by which its cells grow there
REACH = 0.2  # object units above, within which the body covers a leg that goes on
COVERED = 0.6  # share of a leg that is the body's there
BLEND = 2  # layers below a leg's upper end, where what it carries is near


@dataclasses.dataclass(frozen=True)
class Legs:
    """N legs at the shown state, object units.

    Attributes:
      lower, upper: [N, 4] rectangles x0, y0, x1, y1 at both ends. heights: [N, 2] of the ends.
      fill: [N] share of the rectangles that a slice fills. plinth: [N] bool. alone: nothing else is
        as low.
    """

    lower: np.ndarray
    upper: np.ndarray
    heights: np.ndarray
    fill: np.ndarray
    plinth: np.ndarray
    alone: bool

    def __len__(self) -> int:
        return len(self.heights)

    def table(self, count: int) -> np.ndarray:
        """[count, 12] float32: rectangles and heights as ``models.leg_decoder`` has them, fill,
        plinth; zero beyond N."""
        columns = (self.lower, self.upper, self.heights, self.fill[:, None], self.plinth[:, None])
        rows = np.zeros((count, 12), np.float32)
        rows[: len(self)] = np.concatenate(columns, 1)
        return rows

    @property
    def round(self) -> np.ndarray:
        """[N] those that are ellipses in their rectangles."""
        return (self.fill < ROUND) & ~self.plinth


def read_legs(outputs: dict[str, np.ndarray], threshold: float = THRESHOLD) -> Legs | None:
    """What a layout network says of one picture; None where it finds no legs.

    Args:
      outputs: leg_rows [N, 10] (``models.leg_decoder``), logits leg_exists and leg_plinth [N],
        leg_fill [N], the logit leg_alone.
      threshold: of the probability that a leg exists.
    """
    probability = _probability(outputs["leg_exists"])
    kept = np.flatnonzero(probability > threshold)
    fill, plinth = outputs["leg_fill"][kept], _probability(outputs["leg_plinth"])[kept] > 0.5
    if plinth.any():
        chosen = kept == kept[plinth][probability[kept[plinth]].argmax()]
    else:
        chosen = fill > SOLID
    if not chosen.any():
        return None
    rows = np.asarray(outputs["leg_rows"], np.float64)[kept][chosen]
    alone = bool(_probability(outputs["leg_alone"]) > 0.5) and bool(chosen.all())
    lower, upper = _ordered(rows[:, :4]), _ordered(rows[:, 4:8])
    return Legs(lower, upper, np.sort(rows[:, 8:10], 1), fill[chosen], plinth[chosen], alone)


def legs_to_json(legs: Legs) -> dict[str, Any]:
    """``legs`` of a layout's JSON (``voxels.layout``)."""
    plain = lambda values: [round(float(v), 6) for v in values]  # noqa: E731
    rows = [
        {
            "lower": plain(legs.lower[k]),
            "upper": plain(legs.upper[k]),
            "heights": plain(legs.heights[k]),
            "fill": round(float(legs.fill[k]), 4),
            "plinth": bool(legs.plinth[k]),
        }
        for k in range(len(legs))
    ]
    return {"alone": legs.alone, "rows": rows}


def legs_from_json(data: Any) -> Legs | None:
    """Read ``legs_to_json``'s value; None, or one without rows, is None.

    Raises:
      ValueError: one line that names the row and the field.
    """
    if data is None:
        return None
    if not isinstance(data, dict) or not isinstance(data.get("rows"), list):
        raise ValueError('layout: "legs" must be null or have a list "rows"')
    alone = data.get("alone", False)
    if not isinstance(alone, bool):
        raise ValueError(f"layout: legs: alone {alone!r} is neither true nor false")
    numbers: dict[str, list[np.ndarray]] = {"lower": [], "upper": [], "heights": [], "fill": []}
    plinth = []
    for k, row in enumerate(data["rows"]):
        if not isinstance(row, dict):
            raise ValueError(f"layout: leg {k} is not an object")
        for name, count in (("lower", 4), ("upper", 4), ("heights", 2), ("fill", 1)):
            numbers[name].append(_numbers(row, name, count, k))
        plinth.append(row.get("plinth", False))
        if not isinstance(plinth[-1], bool):
            raise ValueError(f"layout: leg {k}: plinth {plinth[-1]!r} is neither true nor false")
    if not plinth:
        return None
    lower, upper, heights, fill = (np.stack(values) for values in numbers.values())
    return Legs(lower, upper, heights, fill[:, 0], np.array(plinth), alone)


def _numbers(row: dict, name: str, count: int, k: int) -> np.ndarray:
    """[count] finite numbers of a row, the ends of intervals in order."""
    values = row.get(name, 1.0 if name == "fill" else None)
    values = [values] if count == 1 else values
    sound = isinstance(values, list) and len(values) == count
    if not sound or not all(type(v) in (int, float) and np.isfinite(v) for v in values):
        raise ValueError(f"layout: leg {k}: {name} must be {count} finite numbers")
    found = np.array(values, np.float64)
    half = max(count // 2, 1)
    if count > 1 and (found[:half] >= found[half:]).any():
        raise ValueError(f"layout: leg {k}: {name} {found.tolist()} must rise")
    return found


def _probability(logits: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-np.asarray(logits, np.float64)))


def _ordered(rectangles: np.ndarray) -> np.ndarray:
    """Rectangles [N, 4] that are ``THINNEST`` wide at least."""
    middle = (rectangles[:, :2] + rectangles[:, 2:]) / 2
    half = np.maximum(np.abs(rectangles[:, 2:] - rectangles[:, :2]), THINNEST) / 2
    return np.concatenate([middle - half, middle + half], 1)


def with_legs(field: DenseField, body: Sequence[int], legs: Legs) -> DenseField:
    """A field whose body stands on these legs, and on nothing else where they stand ``alone``.

    Their upper ends are where the body begins; a leg beside which it begins goes on to it.

    Args:
      body: owners that do not move.

    Returns:
      A new field. Cells of other parts stay as they are.
    """
    mine = np.isin(field.owner, body)
    solid = (field.sdf < 0) & mine
    if not solid.any():
        return field
    size = field.sdf.shape[0] - 2
    foot, told = (_cells(float(np.median(ends)), size) for ends in legs.heights.T)
    top = _upper_end(solid, told, size)
    first, last = max(int(np.floor(foot)), 1), int(np.ceil(top))
    if last <= first:
        return field
    free = ~np.asarray(ndimage.binary_dilation((field.sdf < 0) & ~mine), bool)
    part = int(np.bincount(field.owner[solid]).argmax())
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    prisms = Prisms(legs, foot, top, size)
    for z in range(first, last):
        distance = prisms.at(z).min(0)
        near = free[:, :, z] & (mine[:, :, z] | (field.sdf[:, :, z] > 0))
        if not legs.alone:
            near &= distance < NEAR
        distance = np.maximum(distance, foot - z)  # the floor
        if last - z <= BLEND:  # what they carry is near
            old = field.sdf[:, :, z]
            distance = np.minimum(distance, np.where(near & (old < 0), distance, old))
        _draw(field, z, distance, near | (free[:, :, z] & (distance < 0)), part)
    if legs.alone:  # nothing of the body is below the floor
        below = field.sdf[:, :, :first]
        below[mine[:, :, :first] & (below < 0)] = 0.5
    for k in range(len(legs)):
        _go_on(field, k, prisms, last, free, solid, part)
    return field


class Prisms:
    """Legs in a field of ``size`` cells, from layer ``foot`` to ``top``."""

    def __init__(self, legs: Legs, foot: float, top: float, size: int):
        self._legs, self._foot, self._high = legs, foot, max(top - foot, 1.0)
        self.size = size
        self._xy = np.stack(np.meshgrid(*[np.arange(size + 2.0)] * 2, indexing="ij"), -1)

    def at(self, z: float) -> np.ndarray:
        """[N, X, Y] sub-cells to each leg in a layer, below 0 inside; beyond the ends their lines
        go on."""
        share = (z - self._foot) / self._high
        legs, distances = self._legs, []
        for k in range(len(legs)):
            edges = _cells((1 - share) * legs.lower[k] + share * legs.upper[k], self.size)
            middle, half = (edges[:2] + edges[2:]) / 2, np.maximum(edges[2:] - edges[:2], 1) / 2
            apart = np.abs(self._xy - middle)
            if legs.round[k]:
                distances.append((np.linalg.norm(apart / half, axis=-1) - 1) * half.min())
            else:
                distances.append((apart - half).max(-1))
        return np.stack(distances)


def _draw(field: DenseField, z: int, distance: np.ndarray, where: np.ndarray, part: int) -> None:
    """Make cells of a layer lie at a distance from the legs' surface, in place."""
    value = np.clip(distance, -FARTHEST, FARTHEST)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    old, owner = field.sdf[:, :, z], field.owner[:, :, z]
    gained = where & (old > 0) & ((value < 0) | (owner < 0))
    field.owner[:, :, z] = np.where(gained, part, owner)
    field.sdf[:, :, z] = np.where(where, value, old)


def _go_on(
    field: DenseField,
    leg: int,
    prisms: Prisms,
    last: int,
    free: np.ndarray,
    solid: np.ndarray,
    part: int,
) -> None:
    """Fill a leg from layer ``last`` up to where the body covers it, in place; not at all where it
    does not within ``REACH``."""
    layers = []
    for z in range(last, min(last + int(REACH * prisms.size), free.shape[2] - 1)):
        distance = prisms.at(z)[leg]
        inside = distance < 0
        if solid[:, :, z][inside].mean() >= COVERED:
            break
        layers.append((z, distance))
    else:
        return
    for z, distance in layers:
        distance = np.minimum(distance, field.sdf[:, :, z])
        _draw(field, z, distance, free[:, :, z] & (distance < 0), part)


def _cells(places: Any, size: int) -> Any:
    """Places in the object's frame as cells, with fractions."""
    return (places + 0.5) * size + 0.5


def _upper_end(solid: np.ndarray, top: float, size: int) -> float:
    """Where, about ``top``, the body begins: the layer at which its cells grow most."""
    count = solid.sum((0, 1)).astype(float)
    window = ndimage.find_objects(solid.astype(np.int8))[0]
    area = solid[window].shape[0] * solid[window].shape[1]
    at = np.arange(max(int(top - SEARCH * size), 3), min(int(top + SEARCH * size), len(count) - 3))
    if not len(at):
        return top
    grown = np.array([count[z : z + 2].mean() - count[z - 2 : z].mean() for z in at])
    best = int(grown.argmax())
    return at[best] - 0.5 if grown[best] > JUMP * area else top
