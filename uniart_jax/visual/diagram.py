"""Joints drawn over pictures: where axes lie, which way parts go. For people who check data and
results at a glance."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from uniart_jax.objects.kinematics import Joint, rotation
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.render import PART_COLORS, Camera, render


def picture(
    obj: ArticulatedObject,
    camera: Camera,
    size: int,
    q: np.ndarray | None = None,
    *,
    parts: bool = False,
    axes: bool = False,
    background: tuple[int, int, int] = (255, 255, 255),
) -> Image.Image:
    """The object at state ``q`` over a plain colour.

    Args:
      parts: in the colours of its parts.
      axes: with its joints' axes.
    """
    rgba = render(obj, camera, size=size, q=q, part_colors=parts)
    image = over(rgba, background)
    if axes:
        state = obj.coordinates(q)
        draw_axes(image, obj.shown_at(state), state - obj.rest(), camera)
    return image


def over(rgba: np.ndarray, background: tuple[int, int, int] = (255, 255, 255)) -> Image.Image:
    """A straight-alpha picture [n, n, 4] in [0, 1] over a plain sRGB colour, mixed in sRGB as image
    viewers do."""
    alpha = rgba[..., 3:]
    color = rgba[..., :3] * alpha + np.array(background) / 255 * (1 - alpha)
    return Image.fromarray((color * 255 + 0.5).astype(np.uint8))


def draw_axes(
    image: Image.Image, shown: ArticulatedObject, moved: np.ndarray, camera: Camera
) -> None:
    """Draw every joint's axis over a square picture: an arrow along its opening travel, a ring
    about rotation, in the part's colour.

    Args:
      shown: the object at the state that the picture shows.
      moved: [K] how far each joint went from rest.
    """
    draw = ImageDraw.Draw(image)
    thin = max(1, round(image.width / 160))
    for k, part in enumerate(shown.parts):
        if k == 0 or part.joint.type == "fixed":
            continue
        color = tuple(int(c * 165) for c in PART_COLORS[k % len(PART_COLORS)])
        for line in _axis_lines(part.joint, part.box, moved[k]):
            pixels = camera.project(line, image.width)
            if np.isfinite(pixels).all():
                points = [tuple(p) for p in pixels]
                draw.line(points, fill="white", width=thin + 3, joint="curve")
                draw.line(points, fill=color, width=thin, joint="curve")


def _axis_lines(joint: Joint, box: np.ndarray, moved: float) -> list[np.ndarray]:
    """[n, 3] polylines of the symbol, beside its part, of a joint that went through ``moved`` from
    rest to open."""
    d = joint.direction
    middle = joint.origin + d * float(d @ (box[:3] - joint.origin)) if joint.rotates else box[:3]
    half = 0.5 * float(np.abs(d) @ box[3:]) + 0.06
    ends = [middle - half * d, middle + half * d]
    side = np.cross(d, [0.0, 0.0, 1.0] if abs(d[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    lines = [np.stack(ends)]
    if joint.rotates:
        spokes = [rotation(d, a) @ side * 0.045 for a in np.linspace(0, 2 * np.pi, 25)]
        lines.append(ends[1] - 0.03 * d + np.stack(spokes))
    if joint.travels:  # the head points to where the part went
        sign = 1.0 if joint.pitch * moved >= 0 else -1.0
        tip = middle + sign * half * d
        barbs = [tip - sign * 0.05 * d + 0.03 * side, tip, tip - sign * 0.05 * d - 0.03 * side]
        lines.append(np.stack(barbs))
    return lines
