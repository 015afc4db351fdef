"""One part's entries in a layout's JSON: its name, its box, its joint, and the tree of all."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.names import clean
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.json_rows import FARTHEST, check_names, json_numbers, json_object
from uniart_jax.voxels.panel_table import Panels, panels_from_json
from uniart_jax.voxels.tube_table import Tube

ENTRIES = (
    "name", "parent", "box", "color", "confidence", "joint", "shape", "boards", "revolution", "tube"
)  # fmt: skip
SHAPES = ("boards", "revolution", "tube")
OF_JOINTS = ("type", "origin", "direction", "angle", "travel", "shown")
MADE_UP = re.compile(r"part_\d+")  # names that ``Layout.to_json`` counts out
ROUNDED = 5e-4  # that a screw's travel may be off, of its angle's
WRITTEN = 0.02  # radians that a whole turn may be off
MOST_TURNS = 4 * np.pi + 0.1, 16 * np.pi  # radians of a hinge, and of a screw


def part_name(name: Any, before: list[str | None], where: str) -> str | None:
    """A part's name, made printable; None of one that nobody gave."""
    if name is None or (isinstance(name, str) and MADE_UP.fullmatch(name)):
        return None
    if not isinstance(name, str) or not clean(name) or clean(name) in before:
        raise ValueError(f"{where}: name {str(name)[:80]!r} is no text, or is that of another part")
    return clean(name)


def part_box(row: dict, tube: Tube | None, units: str, where: str) -> np.ndarray:
    """[6] centre and size; of a tube, the box around it."""
    if tube is not None:
        return tube.box
    box = json_object(row, "box", where)
    check_names(box, ("center", "size"), f"{where}: box")
    center, size = (json_numbers(box, name, 3, where) for name in ("center", "size"))
    if size.min() <= 0:
        raise ValueError(f"{where}: size {size.tolist()} must be above 0")
    if (np.abs(center) + size / 2).max() > FARTHEST:
        words = "metres" if units == "m" else "object units"
        raise ValueError(f"{where}: its box lies beyond {FARTHEST:g}; lengths are {words}")
    return np.concatenate([center, size])


def part_boards(row: dict, box: np.ndarray, where: str, far: float) -> Panels | None:
    """The boards of a part, which fills its box [6] where its shape is "box"."""
    if (shape := row.get("shape")) is not None:
        if shape != "box":
            raise ValueError(f'{where}: shape {shape!r}; give "box", or leave it out')
        if any(row.get(name) is not None for name in SHAPES):
            raise ValueError(f'{where}: shape "box" goes without {", ".join(SHAPES)}')
        return Panels(box_corners(box)[None], 1.0, estimate=False)
    if row.get("tube") is not None and any(
        row.get(n) is not None for n in ("boards", "revolution")
    ):
        raise ValueError(f"{where}: a tube goes without boards and revolution")
    return panels_from_json(row.get("boards"), f"{where.removeprefix('layout: ')}: board", far)


def part_joint(row: dict, parent: int | None, middle: np.ndarray, where: str) -> Joint:
    if parent is None or row.get("joint") is None:
        return Joint.fixed()
    data = json_object(row, "joint", where)
    check_names(data, OF_JOINTS, f"{where}: joint")
    angle, travel = (
        json_numbers(data, name, 2, where) if name in data else np.zeros(2)
        for name in ("angle", "travel")
    )
    if not angle.any() and not travel.any():
        if data.get("type", "fixed") != "fixed" and not {"angle", "travel"} & set(data):
            raise ValueError(f"{where}: joint has no range; give angle or travel")
        return Joint.fixed()
    if angle.any() and travel.any():  # a screw, whose numbers may have been rounded
        pitch = float(angle @ travel / (angle @ angle))
        rounded = np.abs(travel - pitch * angle).max() <= ROUNDED
        travel = pitch * angle if rounded else travel
    if abs(abs(angle[1] - angle[0]) - 2 * np.pi) < WRITTEN and not travel.any():
        angle[1] = angle[0] + np.copysign(2 * np.pi, angle[1] - angle[0])  # 6.28 was written
    if np.abs(angle).max() > MOST_TURNS[int(travel.any())]:
        raise ValueError(f"{where}: angle {angle.tolist()} turns too far; give radians")
    direction = json_numbers(data, "direction", 3, where)
    length = float(np.linalg.norm(direction))
    if length < 1e-6:
        raise ValueError(f"{where}: direction has no length")
    origin = json_numbers(data, "origin", 3, where) if "origin" in data else middle
    try:
        return Joint(
            origin,
            direction / length,
            angle=(float(angle[0]), float(angle[1])),
            travel=(float(travel[0]), float(travel[1])),
        )
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def part_shown(row: dict, joint: Joint, where: str) -> float:
    """Where the joint stands in the picture: 0, or what its entry "shown" says."""
    told = row.get("joint") or {}
    if joint.type == "fixed" or "shown" not in told:
        return 0.0
    (shown,) = json_numbers({"shown": [told["shown"]]}, "shown", 1, f"{where}: joint")
    low, high = joint.limits
    if joint.type == "continuous":
        return float(np.remainder(shown + np.pi, 2 * np.pi) - np.pi)
    if not low - 1e-6 <= shown <= high + 1e-6:
        name = "angle" if joint.rotates else "travel"
        raise ValueError(f"{where}: joint: shown {shown:g} is not within {name} {[low, high]}")
    return float(np.clip(shown, low, high))


def check_tree(parents: list[int]) -> None:
    roots = [k for k, parent in enumerate(parents) if parent < 0]
    if len(roots) != 1:
        raise ValueError(f"layout: {len(roots)} parts without a parent; give exactly one root")
    for k in range(len(parents)):
        seen, at = set(), k
        while at >= 0:
            if at in seen:
                raise ValueError(f"layout: part {k}: its parents go in a circle")
            seen.add(at)
            at = parents[at]
