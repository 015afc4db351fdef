"""Finishes as wide as real furniture's and appliances': those of ``materials``, brighter, darker,
stronger or without any colour."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material

_LUMA = np.array([0.2126, 0.7152, 0.0722])


def varied(
    rng: np.random.Generator,
    material: Material,
    *,
    gray: float = 0.0,
    chroma: tuple[float, float] = (1.0, 1.0),
    gain: tuple[float, float] = (1.0, 1.0),
) -> Material:
    """``material`` with its colour changed, its image too.

    Args:
      gray: share that comes out without any colour. chroma: range of what the distance from gray is
        multiplied by.
      gain: range of what the brightness is multiplied by.
    """
    strength = 0.0 if rng.random() < gray else float(rng.uniform(*chroma))
    bright = float(rng.uniform(*gain))

    def change(rgb: np.ndarray) -> np.ndarray:  # to 254: interpolating 255s may exceed 1
        luma = (rgb @ _LUMA)[..., None]
        return np.clip((luma + strength * (rgb - luma)) * bright, 0, 0.996)

    red, green, blue = change(np.array(material.color))
    image = material.image
    if image is not None:
        image = (change(image / 255) * 255 + 0.5).astype(np.uint8)
    color = (float(red), float(green), float(blue))
    return dataclasses.replace(material, color=color, image=image)


def wood(rng: np.random.Generator, **options) -> Material:
    """``materials.wood``, up to pale maple and down to black, pale or strong."""
    return varied(rng, materials.wood(rng, **options), chroma=(0.6, 1.35), gain=(0.85, 1.2))


def furniture(rng: np.random.Generator) -> Material:
    """A finish for furniture boards: wood or paint, whites above all."""
    if rng.random() < 0.58:
        return wood(rng)
    return varied(rng, materials.paint(rng), gray=0.3, chroma=(0.7, 1.2), gain=(0.9, 1.12))


def metal(rng: np.random.Generator, **options) -> Material:
    """``materials.metal``, from bright to dark steel."""
    return varied(rng, materials.metal(rng, **options), gray=0.5, gain=(0.85, 1.2))


def white_plastic(rng: np.random.Generator) -> Material:
    """``materials.white_plastic``, up to pure white."""
    return varied(rng, materials.white_plastic(rng), gray=0.5, gain=(0.95, 1.08))


def dark(rng: np.random.Generator) -> Material:
    """``materials.dark``, down to black."""
    return varied(rng, materials.dark(rng), gray=0.5, gain=(0.2, 1.0))


def appliance(rng: np.random.Generator) -> Material:
    """A finish for an appliance's outside: white, steel, black, or a retro colour."""
    kind = rng.choice(4, p=[0.4, 0.38, 0.12, 0.1])
    finish = (white_plastic, metal, dark)[kind](rng) if kind < 3 else materials.appliance(rng)
    return finish
