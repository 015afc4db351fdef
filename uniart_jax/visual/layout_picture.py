"""A layout drawn over the picture that it was found in: boxes, axes, and how far each part travels
or turns."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from uniart_jax.visual.render import PART_COLORS
from uniart_jax.voxels.camera_code import project
from uniart_jax.voxels.closed_pose import closing_of, moved, undone
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.revolution_table import Revolution

SIDE = 384  # pixels of the drawing
STEPS = 16  # of a path
CIRCLES = 5  # of a part that is round
AXIS = 0.12  # half length of a drawn axis, object units
EDGES = [
    (a, b) for a, b in itertools.combinations(range(8), 2) if bin(a ^ b).count("1") == 1
]  # corners whose indices differ in one bit


def draw_layout(crop: np.ndarray, layout: Layout, side: int = SIDE) -> Image.Image:
    """A picture of ``side`` pixels.

    Args:
      crop: [S, S, 3] uint8, what the network saw. layout: with its camera.

    Each part has a colour: its box, the confidence at its centre, its axis (white) and the path of
    its centre or, where it turns, of the corner farthest from the axis. What the object stands on,
    the panels of its body, the boards of its parts and circles of those that are round are gray.
    """
    image = Image.fromarray(crop).resize((side, side), Image.Resampling.BICUBIC)
    image = Image.blend(image, Image.new("RGB", image.size, (40, 40, 40)), 0.25)
    camera = layout.camera
    if camera is None:
        return image
    pen = ImageDraw.Draw(image)
    see = lambda p: [tuple(v) for v in (project(camera, p) + 1) * side / 2]  # noqa: E731
    panels = [] if layout.panels is None else _box_corners(layout.panels.boxes)
    legs = [] if layout.legs is None else _leg_corners(layout.legs)
    shown = undone(closing_of(layout.joints, layout.boxes, layout.parents))
    boards = [
        moved(shown[k] if own.motion is None else own.motion[:3], corners)
        for k, own in enumerate(layout.boards)
        if own is not None
        for corners in _box_corners(own.boxes)
    ]
    for corners in [*panels, *legs, *boards]:
        spots = see(corners)
        for a, b in EDGES:
            pen.line([spots[a], spots[b]], fill=(200, 200, 200), width=1)
    for k, own in enumerate(layout.revolutions):
        for circle in [] if own is None else _circles(own, layout.boxes[k]):
            pen.line(see(circle), fill=(200, 200, 200), width=1)
    for k, (box, joint) in enumerate(zip(layout.boxes, layout.joints, strict=True)):
        color = tuple(int(255 * c) for c in PART_COLORS[k % len(PART_COLORS)])
        signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
        corners = box[:3] + signs * box[3:]
        spots = see(corners)
        for a, b in EDGES:
            pen.line([spots[a], spots[b]], fill=color, width=2)
        pen.text(see(box[None, :3])[0], f"{layout.confidence[k]:.2f}", fill=color)
        if joint.type == "fixed":
            continue
        line = joint.origin + np.outer([-AXIS, AXIS], joint.direction)
        pen.line(see(line), fill=(255, 255, 255), width=2)
        pen.line(see(_path(joint, box, corners)), fill=color, width=3)
    return image


def _box_corners(boxes: np.ndarray) -> np.ndarray:
    """[N, 8, 3] corners of boxes [N, 6] (lower, upper), in the order of ``EDGES``."""
    choice = np.array(list(itertools.product((0, 1), repeat=3)))
    return boxes.reshape(-1, 2, 3)[:, choice, np.arange(3)]


def _leg_corners(legs: Legs) -> np.ndarray:
    """[N, 8, 3] corners of legs, in the order of ``EDGES``."""
    ends = np.stack([legs.lower, legs.upper], 1)  # [N, 2, 4]
    rows = [
        np.stack([ends[:, c, 2 * a], ends[:, c, 2 * b + 1], legs.heights[:, c]], -1)
        for a, b, c in itertools.product((0, 1), repeat=3)
    ]
    return np.stack(rows, 1)


def _circles(revolution: Revolution, box: np.ndarray) -> np.ndarray:
    """[CIRCLES, 4 STEPS + 1, 3] circles of a part's outline between the ends of its box [6]."""
    axis, across = revolution.axis, np.delete(np.arange(3), revolution.axis)
    share = np.linspace(0, 1, CIRCLES)
    turn = np.linspace(0, 2 * np.pi, 4 * STEPS + 1)
    rims = revolution.radius(share)[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
    circles = np.empty((*rims.shape[:2], 3))
    circles[..., across] = revolution.center + rims
    circles[..., axis] = (box[axis] + (share - 0.5) * box[3 + axis])[:, None]
    return circles


def _path(joint, box: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """[STEPS, 3] where a point of the part goes between the ends of its joint."""
    point = box[:3]
    if joint.rotates:
        away = np.cross(corners - joint.origin, joint.direction)
        point = corners[int(np.linalg.norm(away, axis=1).argmax())]
    ends = np.linspace(0, 1, STEPS)
    angle = joint.angle[0] + ends * (joint.angle[1] - joint.angle[0])
    travel = joint.travel[0] + ends * (joint.travel[1] - joint.travel[0])
    arm, axis = point - joint.origin, joint.direction
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turned = arm * cos + np.cross(axis, arm) * sin + axis * (axis @ arm) * (1 - cos)
    return joint.origin + turned + travel[:, None] * axis


def contact_sheet(pictures: Sequence[Image.Image], columns: int = 4) -> Image.Image:
    """Equal pictures in rows."""
    side = pictures[0].width
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (side * min(columns, len(pictures)), side * rows))
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (side * (i % columns), side * (i // columns)))
    return sheet
