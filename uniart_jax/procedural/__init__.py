"""Parametric articulated objects, one file a family: licence-clean training and test data.

``generate(family, seed)`` is a pure function of its arguments. Objects are normalised, at rest (closed), z up, front at -x,
with their metric size in ``scale``. Networks are trained on ``SEEN_FAMILIES`` (the paper's seven seen categories) only, with
seeds below ``HELD_OUT_SEED``; ``UNSEEN_FAMILIES`` are for evaluation.

A family is a module ``procedural/<family>.py`` with ``build(rng) -> ArticulatedObject`` in metres, and its name in one of the
two tuples. Appending to a tuple of families leaves the objects of the others as they are: names seed the generator.
"""

from __future__ import annotations

import dataclasses
import importlib
import zlib

import numpy as np

from uniart_jax.objects.object import ArticulatedObject

SEEN_FAMILIES: tuple[str, ...] = (
    "storage_furniture",
    "table",
    "refrigerator",
    "dishwasher",
    "oven",
    "washer",
    "microwave",
)
UNSEEN_FAMILIES: tuple[str, ...] = (
    "toilet",
    "laptop",
    "trash_can",
    "bottle",
    "swivel_chair",
    "scissors",
    "faucet",
    "box",
    "sliding_window",
    "door",
)
HELD_OUT_SEED = 1_000_000
MAX_PARTS = 16
BOX_SEPARATION = (
    0.012  # L-inf of two own boxes' corners, a little above what the joint code refuses
)

_ATTEMPTS = 50


def generate(family: str, seed: int) -> ArticulatedObject:
    """One object of a family at its closed state, normalised.

    Args:
      family: a name of ``SEEN_FAMILIES`` or ``UNSEEN_FAMILIES``.
      seed: 0 and up; evaluation uses ``HELD_OUT_SEED`` and above.

    Raises:
      ValueError: no such family, or a negative seed.
    """
    if family not in SEEN_FAMILIES + UNSEEN_FAMILIES:
        known = ", ".join(SEEN_FAMILIES + UNSEEN_FAMILIES)
        raise ValueError(f"procedural: no family '{family}'; there are {known}")
    if seed < 0:
        raise ValueError(f"procedural: the seed must be 0 or more, got {seed}")
    module = importlib.import_module(f"uniart_jax.procedural.{family}")
    rng = np.random.default_rng([seed, zlib.crc32(family.encode())])
    for _ in range(
        _ATTEMPTS
    ):  # the generator moves on, so a redraw is another object and still a function of the seed
        obj = module.build(rng).normalized()
        if len(obj.parts) <= MAX_PARTS and box_separation(obj) > BOX_SEPARATION:
            return dataclasses.replace(obj, name=f"{family}-{seed}", category=family)
    raise ValueError(f"procedural: family '{family}' gave no sound object at seed {seed}")


def draw(seed: int, families: tuple[str, ...] = SEEN_FAMILIES) -> ArticulatedObject:
    """An object of a family that the seed chooses among ``families``, all equally likely."""
    family = families[int(np.random.default_rng([seed, 0]).integers(len(families)))]
    return generate(family, seed)


def box_separation(obj: ArticulatedObject) -> float:
    """The smallest L-inf distance between the corners (lo, hi) of two parts' own boxes; infinite for one part."""
    corners = np.stack([part.mesh.bounds.ravel() for part in obj.parts])
    gaps = np.abs(corners[:, None] - corners[None]).max(-1)
    np.fill_diagonal(gaps, np.inf)
    return float(gaps.min())
