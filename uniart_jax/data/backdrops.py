"""Backgrounds that pictures of objects are put in front of: plain and graded walls, rooms with a
floor, noise, clutter, dead leaves. Each is a pure function of its random numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from uniart_jax.data.backdrop_pictures import SHARE, picture_backdrop
from uniart_jax.data.textures import (
    Array,
    gradient,
    noise,
    noise_field,
    pixel_grid,
    random_color,
    surface,
    to_bytes,
    to_floats,
)

LEAVES = 400  # most things of a picture of dead leaves
AMONG_LEAVES = 0.4  # share of the pictures to train on that are taken before them
EXPONENTS = (0.4, 1.0, 1.8)  # of the spectra of their textures


def backdrop(rng: np.random.Generator, size: int) -> Array:
    """[S, S, 3] float32 sRGB in [0, 1]: what a picture shows behind its object."""
    kind = rng.choice(4, p=(0.25, 0.4, 0.15, 0.2))
    if kind == 0:
        picture = gradient(rng, size, rng.choice((0.02, 0.3)))
    elif kind == 1:
        picture = _room(rng, size)
    elif kind == 2:
        picture = noise(rng, size, rng.uniform(0.6, 1.8))
    else:
        picture = _clutter(rng, size)
    if rng.random() < 0.4:  # as where the object alone is in focus
        image = Image.fromarray(to_bytes(picture))
        picture = to_floats(image.filter(ImageFilter.GaussianBlur(rng.uniform(0.5, 6))))
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
    bases = np.stack([random_color(rng) for _ in range(int(rng.integers(2, 7)))])
    spread = rng.uniform(0.02, 0.15)
    colors = bases[rng.integers(len(bases), size=256)] + spread * rng.normal(size=(256, 3))
    slopes = rng.normal(size=(256, 2)) * rng.uniform(0, 0.8)
    x, y = pixel_grid(size)
    shade = slopes[labels, 0] * (x - 0.5) + slopes[labels, 1] * (y - 0.5)
    kinds = rng.integers(len(EXPONENTS) + 1, size=256)  # the last: none
    depths = rng.uniform(0, 0.5, 256)
    fields = [noise_field(rng, size, exponent) for exponent in EXPONENTS] + [np.zeros_like(x)]
    texture = np.choose(kinds[labels], fields) * depths[labels]
    gray = colors.mean(-1, keepdims=True)
    colors = gray + rng.uniform(0.2, 1) * (colors - gray)
    picture = colors[labels] * (1 + shade + 0.5 * texture)[..., None]
    if rng.random() < 0.5:
        blurred = Image.fromarray(to_bytes(picture)).filter(
            ImageFilter.GaussianBlur(rng.uniform(0.3, 3))
        )
        picture = to_floats(blurred)
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


def _room(rng: np.random.Generator, size: int) -> Array:
    """A wall or two and a floor, seen from the front; often a skirting board."""
    x, y = pixel_grid(size)
    tilt = rng.normal() * 0.03
    edge = rng.uniform(0.3, 0.95) + tilt * (x - 0.5)
    wall = surface(rng, size, x, y)
    if rng.random() < 0.3:
        corner = rng.uniform(0.1, 0.9)
        wall = np.where((x < corner)[..., None], wall * rng.uniform(0.7, 1), wall)
    depth = 1 / np.maximum(y - edge + rng.uniform(0.05, 0.4), 0.02)
    floor = surface(rng, size, (x - 0.5) * depth * 0.4, depth * 0.6)
    picture = np.where((y < edge)[..., None], wall, floor)
    if rng.random() < 0.4:
        board = (y < edge) & (y > edge - rng.uniform(0.01, 0.06))
        picture = np.where(board[..., None], random_color(rng), picture)
    if rng.random() < 0.4:  # windows, pictures, shelves on the wall
        picture = _drawn(rng, picture, int(rng.integers(1, 5)), below=edge.mean())
    return np.clip(picture, 0, 1)


def _clutter(rng: np.random.Generator, size: int) -> Array:
    """Many things of any shape."""
    plain = gradient(rng, size, 0.4) if rng.random() < 0.6 else noise(rng, size, 1.2)
    return _drawn(rng, plain, int(rng.integers(4, 24)), below=1.0)


def _drawn(rng: np.random.Generator, picture: Array, count: int, below: float) -> Array:
    """Rectangles, ellipses, polygons and lines over a picture, with their middles above
    ``below``."""
    size = len(picture)
    image = Image.fromarray(to_bytes(picture))
    draw = ImageDraw.Draw(image)
    for _ in range(count):
        fill = tuple(to_bytes(random_color(rng)).tolist())
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
    drawn = to_floats(image)
    if rng.random() < 0.5:  # their surfaces are not all of one colour
        drawn = drawn * (0.5 + noise(rng, size, 1.2).mean(-1, keepdims=True))
    return np.clip(drawn, 0, 1)
