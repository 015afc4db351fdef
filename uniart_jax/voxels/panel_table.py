"""The boards that a body, or a part, is built of as a table, read off a network's output, and as
JSON."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scipy.special import expit

from uniart_jax.voxels.json_rows import LIMIT, json_numbers, json_rows, json_share, plain

THRESHOLD = 0.5  # of the probability of a panel
TRUSTED = 0.8  # share of the body from which on panels stand for it
THINNEST = 0.004  # object units
NARROW = 0.05  # of a part whose second longest side is shorter boards are not read
FLAT = 0.06  # metres, thickness of a plate at most
PLATE = 0.25  # and as a share of its next longer side
MOST_ROWS = 256  # of JSON


def is_plate(size: np.ndarray, thickest: float) -> bool:
    """Whether a part with a box of this size [3] is one flat plate, ``thickest`` at most."""
    short, middle = np.sort(size)[:2]
    return bool(short < min(thickest, PLATE * middle))


@dataclasses.dataclass(frozen=True)
class Panels:
    """N boxes that a body, or a part, is built of, at the shown state, object units.

    Attributes:
      boxes: [N, 6] lower and upper corners. share: of the volume that they, and a body's legs,
        explain, less what they have beyond it.
      estimate: a network's, which voxels may correct; else boards of a part are followed as they
        are (panels of a body, and those of a door that stands ajar without ``motion``, may always
        be corrected).
      motion: [4, 4] rigid motion from where the boards are told to where the picture shows them, of
        a part that is told at rest and shown turned; None: as ``voxels.closed_pose`` finds it.
    """

    boxes: np.ndarray
    share: float
    estimate: bool = True
    motion: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.boxes)

    def scaled(self, middle: np.ndarray, side: float) -> Panels:
        """In units of ``side``, from ``middle`` [3]."""
        motion = self.motion
        if motion is not None:
            motion = motion.copy()
            motion[:3, 3] = (motion[:3, :3] @ middle + motion[:3, 3] - middle) / side
        boxes = (self.boxes - np.tile(middle, 2)) / side
        return dataclasses.replace(self, boxes=boxes, motion=motion)

    def table(self, count: int) -> np.ndarray:
        """[count, 6] float32, zero beyond N."""
        rows = np.zeros((count, 6), np.float32)
        rows[: len(self)] = self.boxes
        return rows


def read_panels(outputs: dict[str, np.ndarray], threshold: float = THRESHOLD) -> Panels | None:
    """What a layout network says of one picture; None where it finds no panels, or where they are
    less than ``TRUSTED`` of the body.

    Args:
      outputs: panel_rows [N, 6] corners, panel_exists [N] logits, panel_share.
      threshold: of the probability that a panel exists.
    """
    probability = expit(np.asarray(outputs["panel_exists"], np.float64))
    share = float(np.clip(outputs["panel_share"], 0, 1))
    rows = np.asarray(outputs["panel_rows"], np.float64)
    kept = (probability > threshold) & np.isfinite(rows).all(1)
    if not share >= TRUSTED or not kept.any():
        return None
    rows = np.clip(rows[kept], -LIMIT, LIMIT)
    middle = np.clip((rows[:, :3] + rows[:, 3:]) / 2, THINNEST - LIMIT, LIMIT - THINNEST)
    half = np.maximum(np.abs(rows[:, 3:] - rows[:, :3]), THINNEST) / 2
    return Panels(np.concatenate([middle - half, middle + half], 1), share)


def read_boards(
    outputs: dict[str, np.ndarray], row: int, box: np.ndarray, threshold: float = THRESHOLD
) -> Panels | None:
    """What a layout network says of the boards of a part; None as in ``read_panels``, and where the
    part is narrow.

    Args:
      outputs: board_rows [Q, N, 6] corners, board_exists [Q, N] logits, board_share [Q].
      row: of the part in them. box: [6] its centre and size.
    """
    if np.sort(box[3:])[1] < NARROW:
        return None
    own = {f"panel_{name}": outputs[f"board_{name}"][row] for name in ("rows", "exists", "share")}
    return read_panels(own, threshold)


def panels_to_json(panels: Panels) -> dict[str, Any]:
    """``panels`` of a layout's JSON (``voxels.layout``)."""
    rows = [{"lower": plain(box[:3]), "upper": plain(box[3:])} for box in panels.boxes]
    moved = {} if panels.motion is None else {"motion": plain(panels.motion[:3], 9)}
    return {"share": round(panels.share, 4), "estimate": panels.estimate, **moved, "rows": rows}


def panels_from_json(data: Any, name: str = "panel", far: float = LIMIT) -> Panels | None:
    """Read ``panels_to_json``'s value; None, or one without rows, is None. ``name``: of a row, in
    errors. ``far``: that coordinates may have.

    Raises:
      ValueError: one line that names the row and the field.
    """
    if data is None:
        return None
    rows = json_rows(data, name, MOST_ROWS)
    share = json_share(data.get("share", 1.0), f"layout: {name}s: share")
    if not isinstance(estimate := data.get("estimate", False), bool):
        raise ValueError(f"layout: {name}s: estimate {estimate!r} is neither true nor false")
    motion = None
    if data.get("motion") is not None:
        where = f"layout: {name}s"
        motion = np.vstack([json_numbers(data, "motion", 12, where).reshape(3, 4), [0, 0, 0, 1]])
        if np.abs(motion[:3, :3] @ motion[:3, :3].T - np.eye(3)).max() > 1e-3:
            raise ValueError(f"{where}: motion is no rigid one: 3 rows of a rotation and a shift")
    boxes = []
    for k, row in enumerate(rows):
        lower, upper = (_corner(row, end, f"{name} {k}", far) for end in ("lower", "upper"))
        if (lower >= upper).any():
            raise ValueError(f"layout: {name} {k}: lower {lower.tolist()} must be below upper")
        boxes.append(np.concatenate([lower, upper]))
    return Panels(np.stack(boxes), share, estimate, motion) if boxes else None


def _corner(row: dict, end: str, where: str, far: float) -> np.ndarray:
    values = row.get(end)
    listed = values if isinstance(values, list) else []
    sound = [type(v) in (int, float) and -far <= v <= far for v in listed]
    if len(sound) != 3 or not all(sound):
        raise ValueError(f"layout: {where}: {end} must be 3 numbers in {-far:g}..{far:g}")
    return np.array(values, np.float64)
