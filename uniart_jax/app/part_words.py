"""The parts of a layout in words: what each is, how it moves, how sure the network is."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.export.naming import is_made_up
from uniart_jax.export.page import part_color
from uniart_jax.export.part_kinds import part_kinds
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.names import clean
from uniart_jax.voxels.kind import joint_kinds
from uniart_jax.voxels.layout import Layout


@dataclasses.dataclass(frozen=True)
class ReadPart:
    """A row. ``color``: "#rrggbb", as it is drawn (``layout_picture``); ``name``: what somebody
    called it, else its kind."""

    color: str
    kind: str
    name: str
    motion: str
    confidence: float
    moves: bool


def read_parts(layout: Layout) -> list[ReadPart]:
    """[K], in the order of ``root_first``."""
    rows, layout = [], root_first(layout)
    for k, (joint, kind) in enumerate(zip(layout.joints, part_kinds_of(layout), strict=True)):
        sure = float(layout.confidence[k])
        own = clean(layout.name(k))
        name = kind if is_made_up(own) else own
        moves = joint.type != "fixed"
        rows.append(ReadPart(part_color(k), kind, name, motion(joint), sure, moves))
    return rows


def part_kinds_of(layout: Layout) -> list[str]:
    """[K] what each row is, the root first (``export.part_kinds``). Knobs are told by their
    boxes, which are never round (``voxels.kind``)."""
    by_box = joint_kinds(layout)
    named = part_kinds(layout.to_object())
    return ["knob" if box == "knob" else kind for box, kind in zip(by_box, named, strict=True)]


def root_first(layout: Layout) -> Layout:
    """The same parts, the root before all others: as an object has them, so that colours agree."""
    return layout.taken(sorted(range(len(layout)), key=lambda k: layout.parents[k] >= 0))


def motion(joint: Joint) -> str:
    """How far a joint goes: "turns by 90°", "slides by 31 % of the object's size"."""
    turn = np.degrees(joint.angle[1] - joint.angle[0])
    slide = abs(joint.travel[1] - joint.travel[0])
    if joint.type == "fixed":
        return "does not move"
    if joint.type == "continuous":
        return "turns all round"
    ways = [f"turns by {turn:.0f}°"] if joint.rotates else []
    ways += [f"slides by {slide:.0%} of the object's size"] if slide else []
    return " and ".join(ways)
