"""Pictures as people take them: an object's crop in front of a random background, and what of the
picture is the object. NumPy, SciPy and Pillow alone.

    crop over black, its mask -> size, place, roll, grain -> in front of a wall, a floor, a texture,
    other objects -> shadow, light, things in front -> blur, noise, exposure, JPEG -> a plain margin

What they train is the mask network (``models.mask``) and, cut out again (``data.photographs``), the
layout network; a picture is a pure function of its random numbers.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft
from PIL import Image, ImageDraw, ImageFilter

from uniart_jax.data.backdrop_pictures import SHARE, picture_backdrop

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
LEAVES = 400  # most things of a picture of dead leaves
AMONG_LEAVES = 0.4  # share of the pictures to train on that are taken before them
EXPONENTS = (0.4, 1.0, 1.8)  # of the spectra of their textures
Array = np.ndarray
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
      back: [S, S, 3] in [0, 1] that it stands in front of; None: any (``backdrop``).
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


def backdrop(rng: np.random.Generator, size: int) -> Array:
    """[S, S, 3] float32 sRGB in [0, 1]: what a picture shows behind its object."""
    kind = rng.choice(4, p=(0.25, 0.4, 0.15, 0.2))
    if kind == 0:
        picture = _gradient(rng, size, rng.choice((0.02, 0.3)))
    elif kind == 1:
        picture = _room(rng, size)
    elif kind == 2:
        picture = _noise(rng, size, rng.uniform(0.6, 1.8))
    else:
        picture = _clutter(rng, size)
    if rng.random() < 0.4:  # as where the object alone is in focus
        image = Image.fromarray(_bytes(picture))
        picture = _floats(image.filter(ImageFilter.GaussianBlur(rng.uniform(0.5, 6))))
    return np.asarray(picture, np.float32)


def training_backdrop(
    rng: np.random.Generator, size: int, pictures: tuple[Path, ...] = ()
) -> Array:
    """What trainings put behind their objects: ``backdrop``, ``leaves`` or, where there are any,
    the user's own pictures (``data.backdrop_pictures``). Evaluations keep to ``backdrop``."""
    if pictures and rng.random() < SHARE:
        return picture_backdrop(rng, pictures, size)
    return (leaves if rng.random() < AMONG_LEAVES else backdrop)(rng, size)


def leaves(rng: np.random.Generator, size: int) -> Array:
    """[S, S, 3] float32 sRGB in [0, 1]: things of every size before each other, the *dead leaves*
    whose edges and sizes have the statistics of photographs (Lee, Mumford & Huang, "Occlusion
    models for natural images", IJCV 2001); each is shaded and of one of a few textures."""
    image = Image.new("L", (size, size))
    draw = ImageDraw.Draw(image)
    smallest = size * rng.uniform(0.006, 0.04)
    count = int(rng.integers(60, LEAVES))
    # density r^-3 between the smallest and half of the picture: as many edges at every scale
    ranks = rng.uniform(size=count)
    radii = 1 / np.sqrt(ranks / smallest**2 + (1 - ranks) / (0.5 * size) ** 2)
    for label, radius in enumerate(radii, 1):
        _leaf(rng, draw, rng.uniform(-0.1, 1.1, 2) * size, float(radius), label % 256)
    labels = np.asarray(image)
    bases = np.stack([_color(rng) for _ in range(int(rng.integers(2, 7)))])
    spread = rng.uniform(0.02, 0.15)
    colors = bases[rng.integers(len(bases), size=256)] + spread * rng.normal(size=(256, 3))
    slopes = rng.normal(size=(256, 2)) * rng.uniform(0, 0.8)
    x, y = _grid(size)
    shade = slopes[labels, 0] * (x - 0.5) + slopes[labels, 1] * (y - 0.5)
    kinds = rng.integers(len(EXPONENTS) + 1, size=256)  # the last: none
    depths = rng.uniform(0, 0.5, 256)
    fields = [_field(rng, size, exponent) for exponent in EXPONENTS] + [np.zeros_like(x)]
    texture = np.choose(kinds[labels], fields) * depths[labels]
    gray = colors.mean(-1, keepdims=True)
    colors = gray + rng.uniform(0.2, 1) * (colors - gray)
    picture = colors[labels] * (1 + shade + 0.5 * texture)[..., None]
    if rng.random() < 0.5:
        blurred = Image.fromarray(_bytes(picture)).filter(
            ImageFilter.GaussianBlur(rng.uniform(0.3, 3))
        )
        picture = _floats(blurred)
    return np.clip(picture, 0, 1).astype(np.float32)


def _leaf(
    rng: np.random.Generator, draw: ImageDraw.ImageDraw, at: Array, radius: float, label: int
) -> None:
    """One thing of a radius in pixels about a place (x, y)."""
    (x, y), kind = at, rng.integers(4)
    w, h = radius * np.exp(rng.normal(size=2) * 0.4)
    if kind == 0:
        draw.ellipse([float(v) for v in (x - w, y - h, x + w, y + h)], label)
    elif kind == 1:
        draw.rectangle([float(v) for v in (x - w, y - h, x + w, y + h)], label)
    else:
        angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
        reach = rng.uniform(0.6, 1.4, len(angles))
        points = np.stack([x + w * reach * np.cos(angles), y + h * reach * np.sin(angles)], -1)
        draw.polygon([tuple(p) for p in points.tolist()], label)


def _color(rng: np.random.Generator) -> Array:
    """[3] sRGB; walls and floors are rarely saturated, and often bright."""
    value = rng.beta(2.0, 1.2)
    tint = rng.normal(size=3) * rng.choice((0.02, 0.08, 0.3), p=(0.4, 0.4, 0.2))
    return np.clip(value + tint, 0, 1).astype(np.float32)


def _gradient(rng: np.random.Generator, size: int, contrast: float) -> Array:
    """One colour that grows lighter to a side, or towards a spot."""
    x, y = (v - 0.5 for v in _grid(size))
    if rng.random() < 0.5:
        angle = rng.uniform(0, 2 * np.pi)
        ramp = np.cos(angle) * x + np.sin(angle) * y
    else:
        cx, cy = rng.uniform(-0.5, 0.5, 2)
        ramp = -np.hypot(x - cx, y - cy)
    light = contrast * rng.uniform(0.3, 1) * ramp
    return np.clip(_color(rng) + light[..., None], 0, 1)


@functools.lru_cache(maxsize=2)
def _grid(size: int) -> tuple[Array, Array]:
    """x and y [S, S] of pixels, from 0 to 1; not to be written to."""
    y, x = np.mgrid[:size, :size].astype(np.float32) / np.float32(size)
    return x, y


def _noise(rng: np.random.Generator, size: int, exponent: float) -> Array:
    """Noise of spectrum 1/f^exponent, coloured by a palette: marble, wool, leaves, clouds."""
    field = _field(rng, size, exponent)
    palette = np.stack([_color(rng) for _ in range(3)])
    palette = palette[0] + rng.uniform(0.1, 1) * (palette - palette[0])
    return _of_palette(palette, 0.5 + 0.25 * field)


def _field(rng: np.random.Generator, size: int, exponent: float) -> Array:
    """[S, S] noise of spectrum 1/f^exponent, mean 0, deviation 1."""
    stretch = rng.uniform(0.3, 1) if rng.random() < 0.5 else 1  # grain of wood: to one side
    down, across = np.fft.fftfreq(size) * stretch, np.fft.rfftfreq(size) / stretch
    f = np.hypot(down[:, None], across[None]).astype(np.float32)
    f[0, 0] = 1
    waves: Any = scipy.fft.rfft2(rng.standard_normal((size, size), np.float32))
    field = scipy.fft.irfft2(waves * f ** np.float32(-exponent), (size, size))
    return (field - field.mean()) / (field.std() + 1e-9)


def _of_palette(palette: Array, field: Array) -> Array:
    """[S, S, 3] colours between the rows of ``palette`` [N, 3] at places [S, S] in [0, 1]."""
    at = np.clip(field, 0, 1)
    places = np.linspace(0, 255, len(palette))
    table = np.stack([np.interp(np.arange(256), places, c) for c in palette.T], -1)
    return table.astype(np.float32)[(at * 255).astype(np.uint8)]


def _tiles(rng: np.random.Generator, u: Array, v: Array) -> Array:
    """Planks, tiles, bricks or a checkered cloth over coordinates [S, S]; one unit is a picture's
    side."""
    across, along = rng.uniform(2, 12), rng.uniform(1, 12)
    if rng.random() < 0.4:
        u, v = v, u
    row = np.floor(v * along)
    shifted = u * across + (rng.random() < 0.6) * 0.37 * row
    cell = (np.floor(shifted).astype(np.int64) * 7 + row.astype(np.int64) * 13) % 64
    shades = _color(rng) + rng.uniform(0, 0.12) * rng.standard_normal((64, 1), np.float32)
    if rng.random() < 0.25:
        shades[1::2] = _color(rng)
    picture = shades[cell]
    width = rng.uniform(0, 0.08)
    gap = (shifted % 1 < width) | ((v * along) % 1 < width * along / across)
    return np.clip(np.where(gap[..., None], picture * rng.uniform(0.5, 1.2), picture), 0, 1)


def _surface(rng: np.random.Generator, size: int, u: Array, v: Array) -> Array:
    kind = rng.random()
    if kind < 0.4:
        return _gradient(rng, size, 0.15)
    if kind < 0.7:
        return _tiles(rng, u, v)
    return _noise(rng, size, rng.uniform(0.8, 1.6))


def _room(rng: np.random.Generator, size: int) -> Array:
    """A wall or two and a floor, seen from the front; often a skirting board."""
    x, y = _grid(size)
    tilt = rng.normal() * 0.03
    edge = rng.uniform(0.3, 0.95) + tilt * (x - 0.5)
    wall = _surface(rng, size, x, y)
    if rng.random() < 0.3:
        corner = rng.uniform(0.1, 0.9)
        wall = np.where((x < corner)[..., None], wall * rng.uniform(0.7, 1), wall)
    depth = 1 / np.maximum(y - edge + rng.uniform(0.05, 0.4), 0.02)
    floor = _surface(rng, size, (x - 0.5) * depth * 0.4, depth * 0.6)
    picture = np.where((y < edge)[..., None], wall, floor)
    if rng.random() < 0.4:
        board = (y < edge) & (y > edge - rng.uniform(0.01, 0.06))
        picture = np.where(board[..., None], _color(rng), picture)
    if rng.random() < 0.4:  # windows, pictures, shelves on the wall
        picture = _drawn(rng, picture, int(rng.integers(1, 5)), below=edge.mean())
    return np.clip(picture, 0, 1)


def _clutter(rng: np.random.Generator, size: int) -> Array:
    """Many things of any shape."""
    plain = _gradient(rng, size, 0.4) if rng.random() < 0.6 else _noise(rng, size, 1.2)
    return _drawn(rng, plain, int(rng.integers(4, 24)), below=1.0)


def _drawn(rng: np.random.Generator, picture: Array, count: int, below: float) -> Array:
    """Rectangles, ellipses, polygons and lines over a picture, with their middles above
    ``below``."""
    size = len(picture)
    image = Image.fromarray(_bytes(picture))
    draw = ImageDraw.Draw(image)
    for _ in range(count):
        fill = tuple(_bytes(_color(rng)).tolist())
        cx, cy = rng.uniform(0, 1), rng.uniform(0, below)
        w, h = rng.uniform(0.03, 0.3, 2)
        box = [size * float(v) for v in (cx - w, cy - h, cx + w, cy + h)]
        kind = rng.integers(4)
        if kind == 0:
            draw.rectangle(box, fill)
        elif kind == 1:
            draw.ellipse(box, fill)
        elif kind == 2:
            points = np.array([cx, cy]) + rng.uniform(-0.3, 0.3, (int(rng.integers(3, 7)), 2))
            draw.polygon([tuple(p) for p in (size * points).tolist()], fill)
        else:
            draw.line(box, fill, int(rng.integers(1, 12)))
    drawn = _floats(image)
    if rng.random() < 0.5:  # their surfaces are not all of one colour
        drawn = drawn * (0.5 + _noise(rng, size, 1.2).mean(-1, keepdims=True))
    return np.clip(drawn, 0, 1)


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
    out = _floats(canvas)
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
    image = Image.fromarray(_bytes(alpha))
    lean, low = rng.uniform(-0.4, 0.4), rng.uniform(0.7, 1.0)
    rows = np.flatnonzero(alpha.max(1) > 0.5)
    foot = rows[-1] if len(rows) else size
    # squeezed towards the foot of the object and sheared: x' = x + lean (foot - y), y' = ...
    flat = rng.uniform(0.1, 1.2)
    matrix = (1, lean, -lean * foot, 0, 1 / flat, foot * low * (1 - 1 / flat) + foot * (1 - low))
    image = image.transform((size, size), Image.Transform.AFFINE, matrix)
    image = image.filter(ImageFilter.GaussianBlur(rng.uniform(1, 14)))
    return rng.uniform(0.1, 0.7) * _floats(image)


def _lit(rng: np.random.Generator, color: Array) -> Array:
    """An object in another light, as bright as its background or not."""
    if rng.random() < 0.4:
        return color
    gain = np.exp(0.2 * rng.normal() + 0.05 * rng.normal(size=3)).astype(np.float32)
    return np.clip(color ** np.float32(np.exp(0.15 * rng.normal())) * gain, 0, 1)


def _grained(rng: np.random.Generator, color: Array, alpha: Array, strength: float) -> Array:
    """An object (its colour times alpha [S, S, 3]) with a grain, as wood has, or a pattern."""
    size = len(alpha)
    light = 1 + strength * rng.uniform(0.1, 1) * _field(rng, size, rng.uniform(0.5, 1.8))
    color = color * np.clip(light, 0.2, 2)[..., None].astype(np.float32)
    if rng.random() < 0.4:
        share = np.float32(strength * rng.uniform(0.3, 1.7))
        pattern = _surface(rng, size, *_grid(size)) * alpha[..., None]
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
    cover = _floats(stencil)
    fill = _noise(rng, size, 1.2) if rng.random() < 0.5 else _gradient(rng, size, 0.3)
    return _paste(picture, fill * cover[..., None], cover), alpha * (1 - cover)


def _taken(rng: np.random.Generator, picture: Array) -> Array:
    """[S, S, 3] uint8 as a camera gives it: exposure, vignette, focus, noise, JPEG."""
    size = len(picture)
    gain = np.exp(0.15 * rng.normal() + 0.03 * rng.normal(size=3))
    picture = np.asarray(picture, np.float32) * gain.astype(np.float32)
    if rng.random() < 0.3:
        x, y = (v - 0.5 for v in _grid(size))
        picture = picture * (1 - rng.uniform(0, 0.8) * (x**2 + y**2))[..., None]
    if rng.random() < 0.5:
        picture = picture + np.float32(rng.uniform(0, 0.04)) * rng.standard_normal(
            picture.shape, np.float32
        )
    image = Image.fromarray(_bytes(picture))
    if rng.random() < 0.4:
        image = image.filter(ImageFilter.GaussianBlur(rng.uniform(0.2, 1.3)))
    if rng.random() < 0.6:
        held = io.BytesIO()
        image.save(held, "JPEG", quality=int(rng.integers(35, 96)))
        image = Image.open(held)
    return np.array(image.convert("RGB"))


def _bytes(picture: Array) -> Array:
    return np.round(np.clip(picture, 0, 1) * 255).astype(np.uint8)


def _floats(image: Image.Image) -> Array:
    return np.asarray(image, np.float32) / 255
