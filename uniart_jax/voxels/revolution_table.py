"""Solids of revolution: parts that are round about an axis, as pots, jars and lids, read off a
network's output, and as JSON."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from uniart_jax.voxels.json_rows import LIMIT, check_names, plain

RADII = 8  # of a part that is trained on, at the middles of as many equal layers
SURE = 0.6  # least probability that a part is a solid of revolution
SMALLEST = 0.002  # object units, of a network's radius
LEAST = 1e-9  # of a radius that is told, in any units
WIDER = 1.1  # that it may be beyond half of the box's wider side
MOST_RADII = 256  # of JSON
AXES = "xyz"
ENTRIES = ("axis", "center", "radii", "estimate")
ROW = 1 + 2 + RADII  # of ``revolution_rows``


@dataclasses.dataclass(frozen=True)
class Revolution:
    """The outline of a part that is round about an axis, at the shown state, object units.

    Attributes:
      axis: 0 to 2, the axis of the object's frame that it is round about.
      center: [2] where the axis is, coordinates of the other two axes in order.
      radii: [N] at the middles of N equal layers of the part's box, from its lower end on.
      estimate: a network's, which voxels may correct; else the outline is followed as it is.
    """

    axis: int
    center: np.ndarray
    radii: np.ndarray
    estimate: bool = False

    def radius(self, share: np.ndarray) -> np.ndarray:
        """Radii at places along the axis, 0 at the lower end of the part's box and 1 at its
        upper."""
        middles = (np.arange(len(self.radii)) + 0.5) / len(self.radii)
        return np.interp(share, middles, self.radii)

    def scaled(self, middle: np.ndarray, side: float) -> Revolution:
        """In units of ``side``, from ``middle`` [3]."""
        center = (self.center - np.delete(middle, self.axis)) / side
        return dataclasses.replace(self, center=center, radii=self.radii / side)


def revolution_rows(revolutions: Sequence[Revolution | None], count: int) -> np.ndarray:
    """[count, ``ROW``] float32 of parts with ``RADII`` radii: 1 + axis, centre and radii; zero of
    what is not round, and beyond the parts."""
    rows = np.zeros((count, ROW), np.float32)
    for k, one in enumerate(revolutions):
        if one is not None:
            rows[k] = [1 + one.axis, *one.center, *one.radii]
    return rows


def read_revolution(
    outputs: dict[str, np.ndarray], row: int, threshold: float = SURE
) -> Revolution | None:
    """What a layout network says of a part; None where it is hardly round.

    Args:
      outputs: round_axis [Q, 4] logits of none, x, y and z, round_centers [Q, 3, 2] and round_radii
        [Q, 3, N] for each axis. row: of the part in them.
      threshold: of the probability that a part is round.
    """
    logits = np.asarray(outputs["round_axis"][row], np.float64)
    share = np.exp(logits - logits.max())
    share /= share.sum()
    axis = int(share[1:].argmax())
    center, radii = (outputs[f"round_{name}"][row, axis] for name in ("centers", "radii"))
    known = np.isfinite(center).all() and np.isfinite(radii).all()
    if not (1 - share[0] > threshold and known):
        return None
    center = np.clip(np.asarray(center, np.float64), -LIMIT, LIMIT)
    radii = np.clip(np.asarray(radii, np.float64), SMALLEST, LIMIT)
    return Revolution(axis, center, radii, estimate=True)


def revolution_to_json(revolution: Revolution) -> dict[str, Any]:
    """``revolution`` of a part in a layout's JSON (``voxels.layout``)."""
    return {
        "axis": AXES[revolution.axis],
        "center": plain(revolution.center),
        "radii": plain(revolution.radii),
        **({"estimate": True} if revolution.estimate else {}),
    }


def revolution_from_json(
    data: Any, where: str, box: np.ndarray, far: float = LIMIT
) -> Revolution | None:
    """Read ``revolution_to_json``'s value; None is None. Without ``center`` the axis goes through
    the middle of the part's box [6], centre and size; without ``radii`` it is a cylinder as wide as
    that. ``where``: of the part, in errors. ``far``: that coordinates and radii may have.

    Raises:
      ValueError: one line that names the part and the field.
    """
    if data is None:
        return None
    if not isinstance(data, dict) or data.get("axis") not in tuple(AXES):
        raise ValueError(f'{where}: revolution: give an object with "axis": "x", "y" or "z"')
    check_names(data, ENTRIES, f"{where}: revolution")
    axis = AXES.index(data["axis"])
    middle, sides = np.delete(box[:3], axis), np.delete(box[3:], axis)
    center = _numbers(data.get("center", middle.tolist()), -far, far)
    if center is None or len(center) != 2:
        raise ValueError(f"{where}: revolution: center must be 2 numbers in {-far:g}..{far:g}")
    radii = _numbers(data.get("radii", [float(sides.min()) / 2]), 0, far)
    if radii is None or not 1 <= len(radii) <= MOST_RADII:
        raise ValueError(
            f"{where}: revolution: radii must be 1 to {MOST_RADII} numbers in 0..{far:g}"
        )
    if not data.get("estimate") and radii.max() > WIDER * sides.max() / 2:
        raise ValueError(
            f"{where}: revolution: a radius of {radii.max():g} does not fit into its box; "
            f"{sides.max() / 2:g} is half of the wider side"
        )
    if not isinstance(estimate := data.get("estimate", False), bool):
        raise ValueError(f"{where}: revolution: estimate must be true or false")
    return Revolution(axis, center, np.maximum(radii, LEAST), estimate)


def _numbers(values: Any, least: float, most: float) -> np.ndarray | None:
    listed: list[Any] = values if isinstance(values, list) else [None]
    sound = all(type(v) in (int, float) and least <= v <= most for v in listed)
    return np.array(listed, np.float64) if sound else None
