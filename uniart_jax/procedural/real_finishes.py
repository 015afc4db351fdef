"""Finishes that are strong in a picture: boldly grained wood, vivid glass, steel that mirrors its
room in broad bands, speckled stone and plastic."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural.materials import TEXTURE_SIZE, Material, hsv, noise

# hue, saturation, value of boards; the share of each
_WOODS = (
    ((0.085, 0.115), (0.42, 0.62), (0.84, 0.98), 0.24),  # orange maple, beech
    ((0.09, 0.125), (0.16, 0.34), (0.80, 0.96), 0.16),  # pale ash
    ((0.045, 0.075), (0.60, 0.85), (0.45, 0.75), 0.22),  # honey and golden oak
    ((0.015, 0.04), (0.42, 0.62), (0.46, 0.72), 0.14),  # red cherry
    ((0.03, 0.06), (0.72, 0.92), (0.22, 0.42), 0.14),  # mahogany
    ((0.02, 0.06), (0.45, 0.8), (0.08, 0.18), 0.10),  # stained nearly black
)


def _finish(rgb: np.ndarray, image: np.ndarray, grain: str, tile: float) -> Material:
    """A material of an image [64, 64, 3] in [0, 1]; its colour is ``rgb``."""
    pixels = (np.clip(image, 0, 0.996) * 255 + 0.5).astype(np.uint8)  # to 254, as ``finishes`` does
    red, green, blue = (float(c) for c in np.clip(rgb, 0, 0.996))
    return Material((red, green, blue), pixels, grain, tile)


def strong_wood(rng: np.random.Generator) -> Material:
    """Orange, brown, red or nearly black wood whose grain shows: streaks, arched rings, or boards
    of several tones."""
    *tone, _ = _WOODS[rng.choice(len(_WOODS), p=[w[-1] for w in _WOODS])]
    rgb = hsv(rng, *tone)
    strength = float(rng.uniform(0.5, 1.6))
    across = np.linspace(0, 1, TEXTURE_SIZE)[None, :]
    along = np.linspace(-1, 1, TEXTURE_SIZE)[:, None]
    shade = 0.10 * noise(rng, 2, int(rng.integers(12, 40))) + 0.05 * noise(rng, 4, 60)
    kind = rng.choice(4, p=[0.4, 0.25, 0.2, 0.15])
    if kind == 1:  # arched rings of a board sawn flat
        middle, bend = rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.9)
        rings = rng.uniform(25, 70)
        level = np.abs(across - middle) + bend * 0.25 * along**2 + 0.02 * noise(rng, 6, 6)
        shade = shade + 0.13 * np.sin(rings * level)
    elif kind == 2:  # boards of several tones beside each other
        count = int(rng.integers(3, 11))
        board = np.minimum((across * count).astype(int), count - 1)
        shade = shade + rng.uniform(-0.16, 0.16, count)[board]
        joint = np.diff(board, prepend=0, axis=1) > 0
        shade = shade - rng.uniform(0.0, 0.5) * joint
    elif kind == 3:  # flames: pale and dark stripes, wide and soft
        shade = shade + 0.16 * noise(rng, 2, int(rng.integers(5, 12)))
    warm = np.array([0.75, 1.0, 1.3])  # dark streaks are redder than the board
    image = rgb * (1 + strength * shade[..., None] * warm)
    grain = "z" if rng.random() < 0.75 else "y"
    return _finish(rgb, image, grain, float(rng.uniform(0.35, 1.3)))


def tinted_glass(rng: np.random.Generator) -> Material:
    """Glass as renderers without refraction show it: vivid blue or cyan, grey, lilac or deep blue,
    plain or with a soft slanting reflection."""
    tones = (
        ((0.53, 0.57), (0.45, 0.8), (0.75, 0.98)),  # cyan
        ((0.57, 0.63), (0.6, 0.9), (0.35, 0.8)),  # blue
        ((0.58, 0.66), (0.6, 0.95), (0.15, 0.4)),  # deep blue
        ((0.5, 0.7), (0.0, 0.12), (0.45, 0.9)),  # grey
        ((0.62, 0.7), (0.1, 0.25), (0.6, 0.8)),  # lilac
        ((0.38, 0.5), (0.05, 0.25), (0.8, 0.96)),  # frosted, greenish
    )
    rgb = hsv(rng, *tones[rng.choice(6, p=[0.24, 0.16, 0.14, 0.2, 0.12, 0.14])])
    if rng.random() < 0.55:
        red, green, blue = (float(c) for c in rgb)
        return Material((red, green, blue))
    a, b = np.meshgrid(*[np.linspace(0, 1, TEXTURE_SIZE)] * 2, indexing="ij")
    slant, start, wide = rng.uniform(-1, 1), rng.uniform(0, 1), rng.uniform(0.1, 0.4)
    gleam = np.clip(1 - np.abs(b + slant * (a - 0.5) - start) / wide, 0, 1)
    image = rgb + rng.uniform(0.15, 0.5) * gleam[..., None] * (1 - rgb)
    return _finish(rgb, image, "z", float(rng.uniform(0.4, 1.0)))


def banded_steel(rng: np.random.Generator) -> Material:
    """Steel with the broad soft light and dark bands of a mirrored room, finely brushed."""
    rgb = hsv(rng, (0.52, 0.64), (0.0, 0.05), (0.5, 0.8) if rng.random() < 0.8 else (0.25, 0.45))
    across = np.linspace(0, 1, TEXTURE_SIZE)[None, :]
    shade = np.zeros((1, TEXTURE_SIZE))
    for _ in range(int(rng.integers(2, 5))):
        middle, wide = rng.uniform(0, 1), rng.uniform(0.05, 0.25)
        lift = rng.uniform(0.15, 0.45) * rng.choice([1, -1], p=[0.6, 0.4])
        shade = shade + lift * np.exp(-(((across - middle) / wide) ** 2))
    shade = shade + 0.12 * noise(rng, 3, 4) * rng.random() + 0.03 * noise(rng, 2, 64)
    grain = "z" if rng.random() < 0.65 else "y"
    return _finish(rgb, rgb * (1 + shade[..., None]), grain, float(rng.uniform(0.4, 1.6)))


def speckled(rng: np.random.Generator) -> Material:
    """Speckled or noisy surfaces: granite, terrazzo, textured plastic, woven or marbled boards."""
    value = (0.72, 0.95) if rng.random() < 0.55 else (0.12, 0.55)
    rgb = hsv(rng, (0, 1), (0.0, 0.14) if rng.random() < 0.8 else (0.2, 0.5), value)
    kind = rng.choice(3, p=[0.45, 0.25, 0.3])
    image = np.broadcast_to(rgb, (TEXTURE_SIZE, TEXTURE_SIZE, 3))
    if kind == 0:  # grains of two more colours
        for _ in range(2):
            other = np.clip(rgb + rng.uniform(-0.45, 0.35), 0, 1) * rng.uniform(0.85, 1.0, 3)
            grains = noise(rng, 48, 48) > rng.uniform(0.35, 0.75)
            image = np.where(grains[..., None], other, image)
    elif kind == 1:
        image = rgb * (1 + rng.uniform(0.08, 0.2) * noise(rng, 60, 60)[..., None])
    else:  # clouds with veins
        cloud = noise(rng, 6, 7)
        veins = np.exp(-((cloud / rng.uniform(0.05, 0.15)) ** 2)) * rng.choice([-0.4, 0.25])
        image = rgb * (1 + 0.14 * noise(rng, 5, 5)[..., None] + veins[..., None])
    grain = str(rng.choice(["y", "z"]))
    return _finish(rgb, np.asarray(image), grain, float(rng.uniform(0.4, 1.4)))
