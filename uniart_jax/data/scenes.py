"""Pictures as people take them: an object's crop in front of a random background, and what of the
picture is the object. No jax.

    crop over black, its mask -> size, place, roll, grain -> in front of a wall, a floor, a texture,
    other objects -> shadow, light, things in front -> blur, noise, exposure, JPEG -> a plain margin

What they train is the mask network (``models.mask``) and, cut out again (``data.photographs``), the
layout network; a picture is a pure function of its random numbers.
"""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from uniart_jax.data.backdrops import backdrop
from uniart_jax.data.textures import (
    Array,
    gradient,
    noise,
    noise_field,
    pixel_grid,
    surface,
    to_bytes,
    to_floats,
)

SCALES = (0.4, 1.05)  # the crop's side over the picture's
CLOSE = (1.0, 1.6)  # so of an object that fills the picture, or more than that
CLOSE_UP = 0.3  # share of the pictures that are so
WHOLE = (0.6, 0.95)  # so of an object of which nothing is hidden or cut off
BEHIND = (0.12, 0.42)  # so of objects behind it
SQUASH = 0.3  # most log of width over height: pictures of any shape are looked at as squares
ROLL = 8.0  # degrees, of a third of the objects
OTHERS = 3  # objects that may stand behind another
BEYOND = 0.1  # share of the crop that may lie outside the picture
GRAINED = 0.5  # share of the objects that have a grain or a pattern, where any may
GRAIN, FAINT = 0.35, 0.18  # how strong for the mask network, and for the layout network, which
# must see the seams between doors
FRAMED = 0.15  # share of the pictures with a plain margin around them (``framed``)
FRAME = (0.05, 0.25)  # how wide it is, shares of the picture's side
Crop = tuple[Array, Array]


def scene(
    rng: np.random.Generator,
    crop: Crop,
    others: Sequence[Crop],
    size: int,
    *,
    whole: bool = False,
    back: Array | None = None,
    grain: float = 0.0,
    scales: tuple[float, float] | None = None,
) -> Crop:
    """A picture [S, S, 3] uint8 of an object somewhere, and its mask [S, S] uint8.

    Args:
      crop: [s, s, 3] uint8 of the object over black (colour times alpha), and alpha [s, s] uint8.
      others: crops of other objects that may stand behind it.
      size: S.
      whole: the object is fairly large, upright, and nothing of it is hidden or cut off.
      back: [S, S, 3] in [0, 1] that it stands in front of; None: any (``data.backdrops``).
      grain: how strong a grain or a pattern may be that ``GRAINED`` of the objects have besides
        their colours, a share of the brightness.
      scales: from and to, of the crop's side over the picture's; None: ``WHOLE``, or ``SCALES`` and
        ``CLOSE``.
    """
    back = backdrop(rng, size) if back is None else back
    if others and rng.random() < 0.35:
        for other in others[: int(rng.integers(1, len(others) + 1))]:
            back = _paste(back, *_placed(rng, other, size, BEHIND, beyond=0.6))
    usual, beyond = (WHOLE, 0.0) if whole else (SCALES, BEYOND)
    if not whole and rng.random() < CLOSE_UP:
        usual = CLOSE
    color, alpha = _placed(rng, crop, size, scales or usual, beyond, still=whole)
    if grain and rng.random() < GRAINED:
        color = _grained(rng, color, alpha, grain)
    if rng.random() < 0.6:
        back = back * (1 - _shadow(rng, alpha))[..., None]
    picture = _paste(back, _lit(rng, color), alpha)
    if not whole and rng.random() < 0.12:
        picture, alpha = _hidden_in_part(rng, picture, alpha)
    taken, mask = _taken(rng, picture), np.round(alpha * 255).astype(np.uint8)
    if whole or rng.random() >= FRAMED:
        return taken, mask
    width, value = round(size * rng.uniform(*FRAME)), int(rng.integers(256))
    margins = framed(taken, width, value), framed(mask, width, 0)
    picture, mask = (Image.fromarray(m).resize((size, size), Image.Resampling.BOX) for m in margins)
    return np.array(picture), np.array(mask)


def framed(picture: Array, width: int, value: int) -> Array:
    """A picture or mask [H, W, ...] uint8 with a margin of ``width`` pixels of one gray value."""
    around = [(width, width), (width, width), *[(0, 0)] * (picture.ndim - 2)]
    return np.pad(picture, around, constant_values=value)


def _placed(
    rng: np.random.Generator,
    crop: Crop,
    size: int,
    scales: tuple[float, float],
    beyond: float,
    still: bool = False,
) -> Crop:
    """A crop at a random size and place in a picture, also rolled, squeezed and mirrored unless
    ``still``: its colour times alpha [S, S, 3] and its alpha [S, S], both float32 in [0, 1]."""
    rgba = np.dstack(crop)
    image = Image.fromarray(rgba, "RGBA")
    bands = [image.getchannel(c) for c in "RGBA"]  # apart: Pillow would divide by alpha
    if not still and rng.random() < 1 / 3:
        angle = rng.uniform(-ROLL, ROLL)
        bands = [b.rotate(angle, Image.Resampling.BICUBIC) for b in bands]
    squash = 1.0 if still else np.exp(rng.uniform(-SQUASH, SQUASH) / 2)
    side = size * rng.uniform(*scales)
    wide, high = (max(round(side * f), 8) for f in (squash, 1 / squash))
    bands = [b.resize((wide, high), Image.Resampling.BOX) for b in bands]
    if not still and rng.random() < 0.5:
        bands = [b.transpose(Image.Transpose.FLIP_LEFT_RIGHT) for b in bands]
    left, top = (_offset(rng, size, extent, beyond) for extent in (wide, high))
    canvas = Image.new("RGBA", (size, size))
    canvas.paste(Image.merge("RGBA", bands), (left, top))
    out = to_floats(canvas)
    return out[..., :3], out[..., 3]


def _offset(rng: np.random.Generator, size: int, extent: int, beyond: float) -> int:
    """Where along a side of ``size`` pixels something of ``extent`` begins."""
    over = round(extent * beyond) if rng.random() < 0.3 else 0
    low, high = sorted((-over, size - extent + over))
    middle = (size - extent) / 2
    at = middle + rng.normal() * 0.25 * size
    return int(np.clip(at, low, high))


def _paste(back: Array, color: Array, alpha: Array) -> Array:
    """``color`` (times alpha) over a picture."""
    return back * (1 - alpha)[..., None] + color


def _shadow(rng: np.random.Generator, alpha: Array) -> Array:
    """[S, S] how much darker it is beside and below an object."""
    size = len(alpha)
    image = Image.fromarray(to_bytes(alpha))
    lean, low = rng.uniform(-0.4, 0.4), rng.uniform(0.7, 1.0)
    rows = np.flatnonzero(alpha.max(1) > 0.5)
    foot = rows[-1] if len(rows) else size
    # squeezed towards the foot of the object and sheared: x' = x + lean (foot - y), y' = ...
    flat = rng.uniform(0.1, 1.2)
    matrix = (1, lean, -lean * foot, 0, 1 / flat, foot * low * (1 - 1 / flat) + foot * (1 - low))
    image = image.transform((size, size), Image.Transform.AFFINE, matrix)
    image = image.filter(ImageFilter.GaussianBlur(rng.uniform(1, 14)))
    return rng.uniform(0.1, 0.7) * to_floats(image)


def _lit(rng: np.random.Generator, color: Array) -> Array:
    """An object in another light, as bright as its background or not."""
    if rng.random() < 0.4:
        return color
    gain = np.exp(0.2 * rng.normal() + 0.05 * rng.normal(size=3)).astype(np.float32)
    return np.clip(color ** np.float32(np.exp(0.15 * rng.normal())) * gain, 0, 1)


def _grained(rng: np.random.Generator, color: Array, alpha: Array, strength: float) -> Array:
    """An object (its colour times alpha [S, S, 3]) with a grain, as wood has, or a pattern."""
    size = len(alpha)
    light = 1 + strength * rng.uniform(0.1, 1) * noise_field(rng, size, rng.uniform(0.5, 1.8))
    color = color * np.clip(light, 0.2, 2)[..., None].astype(np.float32)
    if rng.random() < 0.4:
        share = np.float32(strength * rng.uniform(0.3, 1.7))
        pattern = surface(rng, size, *pixel_grid(size)) * alpha[..., None]
        color = color + share * (pattern - color)
    return np.clip(color, 0, alpha[..., None])


def _hidden_in_part(rng: np.random.Generator, picture: Array, alpha: Array) -> Crop:
    """Something in front of the object, over an edge of it."""
    size, places = len(alpha), np.argwhere(alpha > 0.5)
    if not len(places):
        return picture, alpha
    cy, cx = places[rng.integers(len(places))] / size
    edge = np.array([cx - 0.5, cy - 0.5]) * rng.uniform(0.5, 1.5) + 0.5
    w, h = rng.uniform(0.04, 0.15, 2)
    box = [size * float(v) for v in (edge[0] - w, edge[1] - h, edge[0] + w, edge[1] + h)]
    stencil = Image.new("L", (size, size))
    draw = ImageDraw.Draw(stencil)
    (draw.ellipse if rng.random() < 0.5 else draw.rectangle)(box, 255)
    cover = to_floats(stencil)
    fill = noise(rng, size, 1.2) if rng.random() < 0.5 else gradient(rng, size, 0.3)
    return _paste(picture, fill * cover[..., None], cover), alpha * (1 - cover)


def _taken(rng: np.random.Generator, picture: Array) -> Array:
    """[S, S, 3] uint8 as a camera gives it: exposure, vignette, focus, noise, JPEG."""
    size = len(picture)
    gain = np.exp(0.15 * rng.normal() + 0.03 * rng.normal(size=3))
    picture = np.asarray(picture, np.float32) * gain.astype(np.float32)
    if rng.random() < 0.3:
        x, y = (v - 0.5 for v in pixel_grid(size))
        picture = picture * (1 - rng.uniform(0, 0.8) * (x**2 + y**2))[..., None]
    if rng.random() < 0.5:
        picture = picture + np.float32(rng.uniform(0, 0.04)) * rng.standard_normal(
            picture.shape, np.float32
        )
    image = Image.fromarray(to_bytes(picture))
    if rng.random() < 0.4:
        image = image.filter(ImageFilter.GaussianBlur(rng.uniform(0.2, 1.3)))
    if rng.random() < 0.6:
        held = io.BytesIO()
        image.save(held, "JPEG", quality=int(rng.integers(35, 96)))
        image = Image.open(held)
    return np.array(image.convert("RGB"))
