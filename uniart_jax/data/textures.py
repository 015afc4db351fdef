"""Random colours and textures: gradients, noise, tiles. What backgrounds are made of
(``data.backdrops``), and what grained objects are covered with (``data.scenes``). NumPy, SciPy and
Pillow alone."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import scipy.fft
from PIL import Image

Array = np.ndarray


def random_color(rng: np.random.Generator) -> Array:
    """[3] sRGB; walls and floors are rarely saturated, and often bright."""
    value = rng.beta(2.0, 1.2)
    tint = rng.normal(size=3) * rng.choice((0.02, 0.08, 0.3), p=(0.4, 0.4, 0.2))
    return np.clip(value + tint, 0, 1).astype(np.float32)


def gradient(rng: np.random.Generator, size: int, contrast: float) -> Array:
    """One colour that grows lighter to a side, or towards a spot."""
    x, y = (v - 0.5 for v in pixel_grid(size))
    if rng.random() < 0.5:
        angle = rng.uniform(0, 2 * np.pi)
        ramp = np.cos(angle) * x + np.sin(angle) * y
    else:
        cx, cy = rng.uniform(-0.5, 0.5, 2)
        ramp = -np.hypot(x - cx, y - cy)
    light = contrast * rng.uniform(0.3, 1) * ramp
    return np.clip(random_color(rng) + light[..., None], 0, 1)


@functools.lru_cache(maxsize=2)
def pixel_grid(size: int) -> tuple[Array, Array]:
    """x and y [S, S] of pixels, from 0 to 1; not to be written to."""
    y, x = np.mgrid[:size, :size].astype(np.float32) / np.float32(size)
    return x, y


def noise(rng: np.random.Generator, size: int, exponent: float) -> Array:
    """Noise of spectrum 1/f^exponent, coloured by a palette: marble, wool, leaves, clouds."""
    field = noise_field(rng, size, exponent)
    palette = np.stack([random_color(rng) for _ in range(3)])
    palette = palette[0] + rng.uniform(0.1, 1) * (palette - palette[0])
    return _of_palette(palette, 0.5 + 0.25 * field)


def noise_field(rng: np.random.Generator, size: int, exponent: float) -> Array:
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
    shades = random_color(rng) + rng.uniform(0, 0.12) * rng.standard_normal((64, 1), np.float32)
    if rng.random() < 0.25:
        shades[1::2] = random_color(rng)
    picture = shades[cell]
    width = rng.uniform(0, 0.08)
    gap = (shifted % 1 < width) | ((v * along) % 1 < width * along / across)
    return np.clip(np.where(gap[..., None], picture * rng.uniform(0.5, 1.2), picture), 0, 1)


def surface(rng: np.random.Generator, size: int, u: Array, v: Array) -> Array:
    """[S, S, 3] sRGB of a wall, a floor or a pattern: a gradient, noise, or tiles over coordinates
    [S, S]."""
    kind = rng.random()
    if kind < 0.4:
        return gradient(rng, size, 0.15)
    if kind < 0.7:
        return _tiles(rng, u, v)
    return noise(rng, size, rng.uniform(0.8, 1.6))


def to_bytes(picture: Array) -> Array:
    """A picture in [0, 1] as uint8."""
    return np.round(np.clip(picture, 0, 1) * 255).astype(np.uint8)


def to_floats(image: Image.Image) -> Array:
    """An 8-bit image as float32 in [0, 1]."""
    return np.asarray(image, np.float32) / 255
