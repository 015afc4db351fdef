"""What an object stands on as a table: legs, or a plinth; read off a network's output, and as JSON.

A leg is a prism that may lean and taper, or an ellipse in it: two rectangles and their heights. A
plinth is a prism as wide as what it carries, or a little narrower.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scipy.special import expit

from uniart_jax.voxels.json_rows import LIMIT, json_rows, plain

THRESHOLD = 0.5  # of the probability of the surest leg
OTHERS = 0.25  # of those beside it: legs come in sets
ROUND = 0.89  # share of its rectangle that a round leg fills at most
SOLID = 0.65  # and any leg at least; with less it is a frame or a profile, and stays as drawn
THINNEST = 0.012  # object units
BOARD = 0.25  # object units; what is wider is a board, of which two or one carry an object
MOST_ROWS = 64  # of JSON


@dataclasses.dataclass(frozen=True)
class Legs:
    """N legs at the shown state, object units.

    Attributes:
      lower, upper: [N, 4] rectangles x0, y0, x1, y1 at both ends. heights: [N, 2] of the ends.
      fill: [N] share of the rectangles that a slice fills. plinth: [N] bool. alone: what does not
        move has nothing else below their upper ends.
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
        """[count, 12] float32: rectangles and heights as ``models.box_sets`` has them, fill,
        plinth; zero beyond N."""
        columns = (self.lower, self.upper, self.heights, self.fill[:, None], self.plinth[:, None])
        rows = np.zeros((count, 12), np.float32)
        rows[: len(self)] = np.concatenate(columns, 1)
        return rows

    @property
    def boxes(self) -> np.ndarray:
        """[N, 6] lower and upper corners of the boxes around them."""
        low = np.minimum(self.lower[:, :2], self.upper[:, :2])
        high = np.maximum(self.lower[:, 2:], self.upper[:, 2:])
        return np.concatenate([low, self.heights[:, :1], high, self.heights[:, 1:]], 1)

    @property
    def round(self) -> np.ndarray:
        """[N] those that are ellipses in their rectangles."""
        return (self.fill < ROUND) & ~self.plinth


def read_legs(outputs: dict[str, np.ndarray], threshold: float = THRESHOLD) -> Legs | None:
    """What a layout network says of one picture; None where it finds no legs.

    Args:
      outputs: leg_rows [N, 10] (``models.box_sets``), logits leg_exists and leg_plinth [N],
        leg_fill [N], the logit leg_alone.
      threshold: of the probability that the surest leg exists; others need ``OTHERS``.

    Returns:
      The plinth alone where the surest row is one, else the legs, unless they are one or two
      narrow ones. Frames and profiles, which fill little of their rectangles, are left out: they
      stay as they are drawn.
    """
    probability = _probability(outputs["leg_exists"])
    if probability.max() <= threshold:
        return None
    kept = np.flatnonzero(probability > min(OTHERS, threshold))
    fill, plinth = outputs["leg_fill"][kept], _probability(outputs["leg_plinth"])[kept] > 0.5
    surest = int(probability[kept].argmax())
    chosen = np.arange(len(kept)) == surest if plinth[surest] else (fill > SOLID) & ~plinth
    if not chosen.any():
        return None
    rows = np.asarray(outputs["leg_rows"], np.float64)[kept][chosen]
    alone = bool(_probability(outputs["leg_alone"]) > 0.5) and bool(chosen.all())
    lower, upper = _ordered(rows[:, :4]), _ordered(rows[:, 4:8])
    heights = np.sort(np.clip(rows[:, 8:10], -LIMIT, LIMIT - THINNEST), 1)
    heights[:, 1] = np.maximum(heights[:, 1], heights[:, 0] + THINNEST)
    if not plinth[chosen].any() and len(rows) < 3 and (lower[:, 2:] - lower[:, :2]).max() < BOARD:
        return None  # nothing stands on one or two legs: the others are not found
    fill = np.clip(fill[chosen], SOLID, 1)
    return Legs(lower, upper, heights, fill, plinth[chosen], alone)


def legs_to_json(legs: Legs) -> dict[str, Any]:
    """``legs`` of a layout's JSON (``voxels.layout``)."""
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


def legs_from_json(data: Any, far: float = LIMIT) -> Legs | None:
    """Read ``legs_to_json``'s value; None, or one without rows, is None. ``far``: that coordinates
    may have.

    Raises:
      ValueError: one line that names the row and the field.
    """
    if data is None:
        return None
    rows = json_rows(data, "leg", MOST_ROWS)
    alone = data.get("alone", False)
    if not isinstance(alone, bool):
        raise ValueError(f"layout: legs: alone {alone!r} is neither true nor false")
    numbers: dict[str, list[np.ndarray]] = {"lower": [], "upper": [], "heights": [], "fill": []}
    plinth = []
    for k, row in enumerate(rows):
        for name, count in (("lower", 4), ("upper", 4), ("heights", 2), ("fill", 1)):
            numbers[name].append(_numbers(row, name, count, k, far))
        plinth.append(row.get("plinth", False))
        if not isinstance(plinth[-1], bool):
            raise ValueError(f"layout: leg {k}: plinth {plinth[-1]!r} is neither true nor false")
    if not plinth:
        return None
    lower, upper, heights, fill = (np.stack(values) for values in numbers.values())
    return Legs(lower, upper, heights, fill[:, 0], np.array(plinth), alone)


def _numbers(row: dict, name: str, count: int, k: int, far: float) -> np.ndarray:
    """[count] numbers of a row, at most ``far``, the ends of intervals in order."""
    values = row.get(name, 1.0 if name == "fill" else None)
    values = [values] if count == 1 else values
    sound = isinstance(values, list) and len(values) == count
    if not sound or not all(type(v) in (int, float) and -far <= v <= far for v in values):
        what = "a number" if count == 1 else f"{count} numbers"
        raise ValueError(f"layout: leg {k}: {name} must be {what} in {-far:g}..{far:g}")
    found = np.array(values, np.float64)
    if count == 1 and not SOLID <= found[0] <= 1:
        raise ValueError(f"layout: leg {k}: {name} must be in {SOLID:g}..1, got {found[0]:g}")
    half = max(count // 2, 1)
    if count > 1 and (found[:half] >= found[half:]).any():
        raise ValueError(f"layout: leg {k}: {name} {found.tolist()} must rise")
    return found


def _probability(logits: np.ndarray) -> np.ndarray:
    return expit(np.asarray(logits, np.float64))


def _ordered(rectangles: np.ndarray) -> np.ndarray:
    """Rectangles [N, 4] that are ``THINNEST`` wide at least, within ``LIMIT``."""
    rectangles = np.clip(rectangles, THINNEST - LIMIT, LIMIT - THINNEST)
    middle = (rectangles[:, :2] + rectangles[:, 2:]) / 2
    half = np.maximum(np.abs(rectangles[:, 2:] - rectangles[:, :2]), THINNEST) / 2
    return np.concatenate([middle - half, middle + half], 1)
