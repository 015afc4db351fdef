"""Fits the table by which a layout's kind is told (``voxels/kind.py``), and says how often it is
right.

    python tools/fit_kinds.py OUT [--layouts DIR] [--first 0] [--blocks 6] [--seen 1]
        [--validation 4] [--count 210] [--write]

Fitted to true and found layouts of procedural training objects of the wide world (blocks of
``uniart prepare layouts``; those that are missing in DIR are made). The least probability of a kind
that is named is chosen on found layouts of validation objects, also such whose family was left out
of the fit, one family at a time. The figures are of held-out objects (seeds from 1,000,000 on), and
of families that nothing was trained on. ``--write`` puts the table into the package. OUT keeps the
layouts, a JSON a line. About 20 minutes on one core.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import optimize, special

from uniart_jax import procedural
from uniart_jax.config import DataConfig
from uniart_jax.data.layouts import (
    BLOCK,
    RENDERINGS,
    LayoutSettings,
    check_settings,
    encodable_state,
    load_block,
    shown_object,
    take_picture,
    training_seed,
)
from uniart_jax.inference.layouts import LayoutPredictor, load_layout_predictor
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import HELD_OUT_SEED
from uniart_jax.runtime.compilation_cache import enable_compilation_cache
from uniart_jax.visual.render import sample_camera
from uniart_jax.voxels import kind
from uniart_jax.voxels.kind import MOVING, NAMELESS, WORDS, KindTable, features
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.read_layout import read_layout

FOUND = 3.0  # true layouts that a found one counts as
DECAY = 3e-3  # of the weights
LEAST_DEVIATION = 0.01  # added to a feature's
RIGHT = 0.95  # of the kinds that are named, on validation objects
STRANGE = 0.3  # of validation objects that are named at most where their family was left out


class Row(NamedTuple):
    """A layout's features and the family of its object; ``found``: by the network, else the
    truth."""

    family: str
    found: bool
    values: np.ndarray


Seen = tuple[str, bool, Layout]


def block_objects(number: int, settings: LayoutSettings) -> list[ArticulatedObject]:
    """The objects of a block at their shown states, as ``make_block`` draws them."""
    objects = []
    for index in range(number * BLOCK, (number + 1) * BLOCK):
        seed = training_seed(index, settings.start_seed)
        try:
            made = shown_object(seed, settings.families, np.random.default_rng([seed, 2]))
        except ValueError:
            continue
        if made is not None and len(made[0].parts) <= settings.max_parts:
            objects.append(made[0])
    return objects


def of_block(
    number: int, settings: LayoutSettings, folder: str, predictor: LayoutPredictor | None
) -> Iterator[Seen]:
    """The true layouts of a block; with a predictor also those found in each first view."""
    objects = block_objects(number, settings)
    for obj in objects:
        yield obj.category, False, Layout.of_object(obj)
    if predictor is None:
        return
    check_settings(folder, settings)
    images = load_block(folder, number, settings)["images"][:, 0]
    if len(images) != len(objects):
        raise ValueError(f"{folder}: block {number} holds other objects than are made today")
    for obj, found in zip(objects, predictor(list(images)), strict=True):
        yield obj.category, True, read_layout(found)


def of_held_out(
    count: int, families: tuple[str, ...], predictor: LayoutPredictor
) -> Iterator[Seen]:
    """True and found layouts of held-out objects, families in turn, a random state and view."""
    objects, pictures = [], []
    for index in range(count):
        seed, family = HELD_OUT_SEED + index, families[index % len(families)]
        rng = np.random.default_rng([seed, 1])
        made = encodable_state(procedural.generate(family, seed), rng)
        if made is None:
            continue
        camera, side = sample_camera(rng), predictor.image_size
        objects.append(made[0])
        pictures.append(take_picture(made[0], camera, side, RENDERINGS[-1])[0])
    for obj, found in zip(objects, predictor(pictures), strict=True):
        yield obj.category, False, Layout.of_object(obj)
        yield obj.category, True, read_layout(found)


def kept(path: Path, seen: Iterator[Seen]) -> list[Row]:
    """The rows of a file; written first where it is not there."""
    if not path.is_file():
        partial = path.with_suffix(".part")
        with partial.open("w") as file:
            for family, found, layout in seen:
                file.write(json.dumps([family, found, json.loads(layout.to_json())]) + "\n")
        partial.rename(path)
    lines = map(json.loads, path.read_text().splitlines())
    return [Row(f, found, features(Layout.from_json(json.dumps(x)))) for f, found, x in lines]


def fit(rows: Sequence[Row]) -> KindTable:
    """Multinomial logistic regression; a found layout counts as much as three true ones."""
    families = tuple(sorted({row.family for row in rows}))
    values = np.array([row.values for row in rows])
    names = np.array([families.index(row.family) for row in rows])
    counts = np.where([row.found for row in rows], FOUND, 1.0)
    counts = counts / counts.sum()
    first = np.zeros((values.shape[1] + 1, len(families)))
    table = KindTable(families, values.mean(0), values.std(0) + LEAST_DEVIATION, first, 1.0)
    scaled, truth = table.scaled(values), np.eye(len(families))[names]

    def loss(flat: np.ndarray) -> tuple[float, np.ndarray]:
        weights = flat.reshape(first.shape)
        shares = special.log_softmax(scaled @ weights, 1)
        told = -(counts * shares[np.arange(len(names)), names]).sum()
        slope = scaled.T @ ((np.exp(shares) - truth) * counts[:, None]) + DECAY * weights
        return told + DECAY * (weights**2).sum() / 2, slope.ravel()

    found = optimize.minimize(loss, first.ravel(), jac=True, method="L-BFGS-B")
    table = dataclasses.replace(table, weights=found.x.reshape(first.shape))
    return KindTable.from_json(table.to_json())  # as it is kept


def kinds_of(table: KindTable, rows: Sequence[Row]) -> tuple[np.ndarray, np.ndarray]:
    """[N] the likeliest family of each row, "" where it has no word or nothing moves; [N] its
    probability."""
    values = np.array([row.values for row in rows])
    shares, moves = table.probabilities(values), values[:, MOVING].any(1)
    names = [table.families[k] for k in shares.argmax(1)]
    named = [m and WORDS.get(name, name) for name, m in zip(names, moves, strict=True)]
    return np.where(np.array(named, bool), names, ""), shares.max(1)


def strangers(train: Sequence[Row], rows: Sequence[Row]) -> np.ndarray:
    """[N] how sure a table is of each row that was fitted without the row's family; 0 where it
    names nothing."""
    sure = []
    for family in sorted({row.family for row in rows}):
        some = [row for row in rows if row.family == family]
        table = fit([row for row in train if row.family != family])
        names, shares = kinds_of(table, some)
        sure.append(np.where(names == "", 0.0, shares))
    return np.concatenate(sure)


def least_probability(
    table: KindTable, rows: Sequence[Row], unknown: np.ndarray
) -> tuple[float, float]:
    """The least probability from which on ``RIGHT`` of the rows that are named are right, and
    ``STRANGE`` at most of what it cannot know (``strangers``) are named; and that share."""
    names, sure = kinds_of(table, rows)
    right = names == [row.family for row in rows]
    for least in np.arange(0.3, 0.99, 0.01).round(2):
        named, strange = (sure >= least) & (names != ""), (unknown >= least).mean()
        if named.any() and right[named].mean() >= RIGHT and strange <= STRANGE:
            return float(least), float(strange)
    raise ValueError(f"no probability from which on {RIGHT:.0%} are right and few strangers named")


def told(name: str, table: KindTable, rows: Sequence[Row]) -> None:
    """Print how often the likeliest family is right, how many objects are named and how many of
    those rightly; of true and of found layouts."""
    for found in (False, True):
        some = [row for row in rows if row.found == found]
        names, sure = kinds_of(table, some)
        right = names == [row.family for row in some]
        named = (sure >= table.threshold) & (names != "")
        print(
            f"{name}, {'found' if found else 'true'} layouts of {len(some)}: likeliest is right "
            f"{right.mean():.2f}; named {named.mean():.2f}, of these right "
            f"{right[named].mean() if named.any() else float('nan'):.2f}"
        )


def by_family(table: KindTable, rows: Sequence[Row]) -> None:
    """Print what found layouts of each family are called."""
    for family in dict.fromkeys(row.family for row in rows):
        names, sure = kinds_of(table, [r for r in rows if r.family == family and r.found])
        said = collections.Counter(np.where(sure >= table.threshold, names, "").tolist())
        print(f"  {family}: {', '.join(f'{k or NAMELESS} {n}' for k, n in said.most_common())}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--layouts", default=DataConfig.layouts)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--blocks", type=int, default=6)
    parser.add_argument("--seen", type=int, default=1)
    parser.add_argument("--validation", type=int, default=4)
    parser.add_argument("--count", type=int, default=210)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    enable_compilation_cache()
    predictor = load_layout_predictor("nano")
    wide = LayoutSettings(256, families=procedural.WORLDS["wide"])
    begun = LayoutSettings(256, families=wide.families, start_seed=DataConfig.validation_seed)
    train = []
    for k in range(given.blocks):
        number = given.first + k
        looks = predictor if k < given.seen else None
        path = given.out / f"train-{number}{'-seen' if looks else ''}.jsonl"
        train += kept(path, of_block(number, wide, given.layouts, looks))
        print(path, len(train), flush=True)
    folder = f"{given.layouts}-validation"
    path = given.out / f"validation-{given.validation}.jsonl"
    judge = kept(path, of_block(given.validation, begun, folder, predictor))
    print(path, len(judge), flush=True)
    tests = {
        name: kept(given.out / f"{name}.jsonl", of_held_out(count, families, predictor))
        for name, count, families in (
            ("held-out", given.count, procedural.SEEN_FAMILIES),
            ("unseen", given.count // 2, procedural.UNSEEN_FAMILIES),
        )
    }
    table, found = fit(train), [row for row in judge if row.found]
    least, strange = least_probability(table, found, strangers(train, found))
    table = dataclasses.replace(table, threshold=least)
    print(f"named from {least:g} on; of validation objects of a family left out {strange:.2f}")
    told("training", table, train)
    told("validation", table, judge)
    for name, rows in tests.items():
        told(name, table, rows)
        by_family(table, rows)
    text = table.to_json()
    (given.out / "kinds.json").write_text(text)
    if given.write:
        (Path(kind.__file__).parent / "kinds.json").write_text(text)


if __name__ == "__main__":
    main()
