"""Parametric articulated objects, one file a family: licence-clean training and test data.

``generate(family, seed)`` is a pure function of its arguments. Objects are normalised, at rest
(closed), z up, front at -x, with their metric size in ``scale``. Seeds from ``HELD_OUT_SEED`` on
are never trained on.

A family is a module ``procedural/<family>.py`` with ``build(rng) -> ArticulatedObject`` in metres,
and its name in one of five tuples: ``SEEN_FAMILIES``, the paper's seven seen categories;
``MORE_FAMILIES``, which networks of the wide world are trained on besides; ``DETAILED_FAMILIES``,
furniture and appliances of the seven categories again, as varied as real ones;
``EVERYDAY_FAMILIES``, other things of a household, with lids, levers, screws and stands, in the
folder ``everyday``; ``UNSEEN_FAMILIES``, which nothing is ever trained on. Appending to a tuple
leaves the objects of the other families as they are, since names seed the generator.

What a training draws from is a *world*, a tuple of families taken in turn or at random, of
``WORLDS``: "seven"; "wide", in which half of the objects are of the seven and half, evenly, of
``MORE_FAMILIES``; "detailed", in which a third is of each of these and of ``DETAILED_FAMILIES``;
"everyday", in which a quarter is of each of these three and of ``EVERYDAY_FAMILIES``;
"household", in which half is of ``EVERYDAY_FAMILIES`` and a sixth of each of the others; or "open",
in which half is of ``EVERYDAY_FAMILIES`` and an eighth of each of the others and of ``assemblies``,
which look like nothing in particular.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
import zlib
from collections.abc import Iterable

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural.shapes import NoRoomError

SEEN_FAMILIES: tuple[str, ...] = (
    "storage_furniture",
    "table",
    "refrigerator",
    "dishwasher",
    "oven",
    "washer",
    "microwave",
)
MORE_FAMILIES: tuple[str, ...] = (
    "scissors",
    "box",
    "sliding_window",
    "door",
    "tool_cabinet",
    "trolley",
    "safe",
    "casement_window",
    "suitcase",
    "desk_lamp",
    "fan",
    "stapler",
    "toaster",
    "assemblies",
)
DETAILED_FAMILIES: tuple[str, ...] = (
    "desk",
    "cupboard",
    "cooker",
    "built_in_appliance",
    "cold_appliance",
)
EVERYDAY_FAMILIES: tuple[str, ...] = (
    "kettle",
    "kitchen_pot",
    "dispenser",
    "display",
    "contact_grill",
    "record_player",
    "valve",
    "wall_switch",
    "stool",
    "bucket",
    "letter_box",
    "printer",
    "coffee_machine",
    "barbecue",
    "globe",
    "jar",
    "eyeglasses",
    "camera",
    "pocket_knife",
    "folding_chair",
    "clock",
)
UNSEEN_FAMILIES: tuple[str, ...] = (
    "toilet",
    "laptop",
    "trash_can",
    "bottle",
    "swivel_chair",
    "faucet",
)
FAMILIES = SEEN_FAMILIES + MORE_FAMILIES + DETAILED_FAMILIES + EVERYDAY_FAMILIES + UNSEEN_FAMILIES


def _in_turn(*groups: tuple[str, ...]) -> tuple[str, ...]:
    """The shortest cycle in which a name of each group follows one of the group before, and each
    group is taken in turn, evenly."""
    count = math.lcm(*(len(group) for group in groups))
    return tuple(group[k % len(group)] for k in range(count) for group in groups)


WORLDS: dict[str, tuple[str, ...]] = {
    "seven": SEEN_FAMILIES,
    "wide": _in_turn(SEEN_FAMILIES, MORE_FAMILIES),
    "detailed": _in_turn(SEEN_FAMILIES, MORE_FAMILIES, DETAILED_FAMILIES),
    "everyday": _in_turn(SEEN_FAMILIES, MORE_FAMILIES, DETAILED_FAMILIES, EVERYDAY_FAMILIES),
    "household": _in_turn(
        *(SEEN_FAMILIES, EVERYDAY_FAMILIES),
        *(MORE_FAMILIES, EVERYDAY_FAMILIES),
        *(DETAILED_FAMILIES, EVERYDAY_FAMILIES),
    ),
    "open": _in_turn(
        *(SEEN_FAMILIES, EVERYDAY_FAMILIES),
        *(MORE_FAMILIES, EVERYDAY_FAMILIES),
        *(DETAILED_FAMILIES, EVERYDAY_FAMILIES),
        *(("assemblies",), EVERYDAY_FAMILIES),
    ),
}
HELD_OUT_SEED = 1_000_000
MAX_PARTS = 16
BOX_SEPARATION = (
    0.012  # L-inf of two own boxes' corners, a little above what the joint code refuses
)

_ATTEMPTS = 50


def check_families(names: Iterable[str]) -> None:
    """ValueError if a name is not of ``FAMILIES``."""
    for name in names:
        if name not in FAMILIES:
            raise ValueError(f"procedural: no family '{name}'; there are {', '.join(FAMILIES)}")


def generate(family: str, seed: int) -> ArticulatedObject:
    """One object of a family at its closed state, normalised.

    Args:
      family: a name of ``FAMILIES``.
      seed: 0 and up; evaluation uses ``HELD_OUT_SEED`` and above.

    Raises:
      ValueError: no such family, or a negative seed.
    """
    check_families([family])
    if seed < 0:
        raise ValueError(f"procedural: the seed must be 0 or more, got {seed}")
    folder = "procedural.everyday" if family in EVERYDAY_FAMILIES else "procedural"
    module = importlib.import_module(f"uniart_jax.{folder}.{family}")
    rng = np.random.default_rng([seed, zlib.crc32(family.encode())])
    failed: NoRoomError | None = None
    for _ in range(
        _ATTEMPTS
    ):  # the generator moves on, so a redraw is another object and still a function of the seed
        try:
            obj = module.build(rng).normalized()
        except NoRoomError as error:
            failed = error
            continue
        if len(obj.parts) <= MAX_PARTS and box_separation(obj) > BOX_SEPARATION:
            return dataclasses.replace(obj, name=f"{family}-{seed}", category=family)
    raise ValueError(
        f"procedural: family '{family}' gave no sound object at seed {seed}"
    ) from failed


def draw(seed: int, families: tuple[str, ...] = SEEN_FAMILIES) -> ArticulatedObject:
    """An object of a family that the seed chooses among ``families``, each place equally likely (a
    world names some twice)."""
    family = families[int(np.random.default_rng([seed, 0]).integers(len(families)))]
    return generate(family, seed)


def box_separation(obj: ArticulatedObject) -> float:
    """The smallest L-inf distance between the corners (lo, hi) of two parts' own boxes; infinite
    for one part."""
    corners = np.stack([part.mesh.bounds.ravel() for part in obj.parts])
    gaps = np.abs(corners[:, None] - corners[None]).max(-1)
    np.fill_diagonal(gaps, np.inf)
    return float(gaps.min())
