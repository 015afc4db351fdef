"""A prediction under its truth, at rest and open, for the report: so that a person sees why a
number is what it is."""

from __future__ import annotations

import base64
import dataclasses
import io

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from uniart_jax.evaluation.materials import painted
from uniart_jax.evaluation.parts import match_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.visual.diagram import draw_axes, picture
from uniart_jax.visual.render import PART_COLORS, Camera, fit

VIEW = Camera(azimuth=np.deg2rad(-30), elevation=np.deg2rad(20), fov_degrees=35)
LINE = 18  # pixels of a line of text
GAP = 4
INK = (40, 42, 50)
QUALITY = 82  # JPEG


def draw_pair(pred: ArticulatedObject, ref: ArticulatedObject, size: int = 200) -> Image.Image:
    """RGB, 4 * size wide: truth above, prediction below; at rest and open as they look, then by
    part with their axes.

    Parts that belong together (``parts.match_parts``, at rest) have the same colour on both sides;
    missing and surplus ones have one of their own. All pictures are by the same camera, which sees
    both objects at rest and open; arrows point where sliding parts go when they open.

    Args:
      pred, ref: from ``metric.at_rest``. size: pixels of a picture's side, before rows that are
        empty everywhere are cut off.
    """
    match, _ = match_parts(pred.boxes, ref.boxes)
    slots = np.empty(len(pred.parts), int)
    slots[match[match >= 0]] = np.flatnonzero(match >= 0)
    surplus = np.setdiff1d(np.arange(len(pred.parts)), match)
    slots[surplus] = len(ref.parts) + np.arange(len(surplus))
    bounds = np.stack([o.mesh(q).bounds for o in (pred, ref) for q in (o.open(0), o.open(1))])
    camera = fit(np.stack([bounds[:, 0].min(0), bounds[:, 1].max(0)]), VIEW, margin=1.08)
    rows = (("truth", ref, np.arange(len(ref.parts))), ("prediction", pred, slots))
    tiles = []
    for name, obj, slot in rows:
        states = (("rest", obj.open(0)), ("open", obj.open(1)))
        tiles += [(f"{name}, {s}", picture(obj, camera, size, q)) for s, q in states]
        tiles += [(f"{name}, {s}", _by_part(obj, camera, size, q, slot)) for s, q in states]
    drawn = np.any([np.asarray(tile).min((1, 2)) < 255 for _, tile in tiles], axis=0)
    top, bottom = np.flatnonzero(drawn)[[0, -1]] + [0, 1]
    height = bottom - top + LINE + 2 * GAP
    sheet = Image.new("RGB", (4 * size, 2 * height), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=12)
    for i, (text, tile) in enumerate(tiles):
        x, y = i % 4 * size, i // 4 * height
        sheet.paste(tile.crop((0, top, size, bottom)), (x, y + LINE + GAP))
        draw.text((x + 5, y + 2), text, fill=INK, font=font)
    return sheet


def data_uri(image: Image.Image) -> str:
    """The picture as text that stands where an address would: nothing has to be fetched."""
    file = io.BytesIO()
    image.save(file, format="JPEG", quality=QUALITY, optimize=True)
    return f"data:image/jpeg;base64,{base64.b64encode(file.getvalue()).decode('ascii')}"


def _by_part(
    obj: ArticulatedObject, camera: Camera, size: int, q: np.ndarray, slots: np.ndarray
) -> Image.Image:
    """The object with part k and its axis in the colour of number ``slots[k]``."""
    colors = np.round(PART_COLORS[slots % len(PART_COLORS)] * 255).astype(np.uint8)
    image = picture(painted(obj, colors), camera, size, q)
    # draw_axes takes a part's colour from its place and skips the root's: every moving part goes to
    # a place of its colour behind it
    shown, moved = obj.shown_at(q), obj.open() - obj.rest()
    places = np.where(slots == 0, len(PART_COLORS), slots)
    blank = dataclasses.replace(shown.parts[0], joint=Joint.fixed())
    parts = [_renamed(blank, i) for i in range(int(places.max()) + 1)]
    ways = np.zeros(len(parts))
    for part, place, way in zip(shown.parts, places, moved, strict=True):
        if part.parent >= 0:
            parts[place], ways[place] = _renamed(part, int(place)), way
    draw_axes(image, ArticulatedObject(tuple(parts)), ways, camera)
    return image


def _renamed(part: Part, place: int) -> Part:
    return dataclasses.replace(part, name=str(place), parent=0 if place else -1)
