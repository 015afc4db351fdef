"""Fits what tells how sure a layout is (``inference/certainty.py``), and says what it is worth.

    python tools/fit_certainty.py OUT [--checkpoint nano] [--count 256] [--held-out 128]

Fitted to layouts found in the pictures of validation objects (COUNT of the seven families, seeds
902,000 on, and COUNT of everyday things, 903,000 on): a logistic regression of the share of their
moving parts that is right on the logarithms of the differences between the two looks. Prints the
numbers that are to stand in the module. The table, also kept as OUT/certainty.json, is of held-out
objects (HELD-OUT of the seven families, of everyday things and of families that nothing was trained
on): parts right in each quarter of the objects, the surest first. About 12 minutes on one core.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import optimize

from uniart_jax import procedural
from uniart_jax.data.images import crop
from uniart_jax.evaluation.layout import score_layout
from uniart_jax.evaluation.procedural import held_out
from uniart_jax.inference.certainty import LEAST, certainty
from uniart_jax.inference.layouts import LayoutPredictor, load_layout_predictor
from uniart_jax.procedural import HELD_OUT_SEED
from uniart_jax.runtime.compilation_cache import enable_compilation_cache
from uniart_jax.voxels.read_layout import read_layout

VALIDATION = ((procedural.SEEN_FAMILIES, 902_000), (procedural.EVERYDAY_FAMILIES, 903_000))
JUDGED = {
    "seven families": procedural.SEEN_FAMILIES,
    "everyday things": procedural.EVERYDAY_FAMILIES,
    "never trained on": procedural.UNSEEN_FAMILIES,
}
DECAY = 1e-3  # of the slopes, of the logarithms in standard deviations
SIDE = 512  # pixels of a picture


class Rows(NamedTuple):
    """Of N objects: differences [N, 3] of the two looks, moving parts [N], and those right [N]."""

    differ: np.ndarray
    moving: np.ndarray
    right: np.ndarray


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument("--count", type=int, default=256, help="validation objects of each kind")
    parser.add_argument("--held-out", type=int, default=128, help="held-out objects of each kind")
    given = parser.parse_args()
    enable_compilation_cache()
    predictor = load_layout_predictor(given.checkpoint)
    looks = [measured(predictor, names, seed, given.count) for names, seed in VALIDATION]
    known = Rows(*(np.concatenate(values) for values in zip(*looks, strict=True)))
    intercept, slopes = fit(known)
    intercept, slopes = round(intercept, 2), np.round(slopes, 2)
    print(f"INTERCEPT = {intercept}\nSLOPES = np.array({slopes.tolist()})")
    tables = {}
    for name, names in JUDGED.items():
        rows = measured(predictor, names, HELD_OUT_SEED, given.held_out)
        tables[name] = quarters(rows, certainty(rows.differ, intercept, slopes))
        print(f"{name}: {json.dumps(tables[name])}", flush=True)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "certainty.json").write_text(json.dumps(tables, indent=2) + "\n")


def measured(predictor: LayoutPredictor, families: tuple[str, ...], seed: int, count: int) -> Rows:
    """What the two looks at ``count`` objects from ``seed`` on say, and how good it is."""
    differ, moving, right = [], [], []
    for index in range(count):
        test = held_out(index, families=families, first_seed=seed, image_size=SIDE)
        cut = crop(test.image, predictor.image_size, predictor.crop_margin)
        found = predictor([cut])[0]
        scores = score_layout(read_layout(found), test)[0]
        differ.append(found["differences"])
        moving.append(int(scores.moving.sum()))
        right.append(int(scores.right[scores.moving].sum()))
    return Rows(np.array(differ), np.array(moving), np.array(right))


def fit(rows: Rows) -> tuple[float, np.ndarray]:
    """Intercept and slopes [3] on the logarithms of the differences."""
    logs = np.log(rows.differ + LEAST)
    mean, spread = logs.mean(0), logs.std(0)
    design = np.concatenate([np.ones((len(logs), 1)), (logs - mean) / spread], 1)

    def loss(weights: np.ndarray) -> float:
        logits = design @ weights
        wrong = rows.moving - rows.right
        entropy = rows.right * np.logaddexp(0, -logits) + wrong * np.logaddexp(0, logits)
        return float(entropy.sum() / rows.moving.sum() + DECAY * (weights[1:] ** 2).sum())

    weights = optimize.minimize(loss, np.zeros(design.shape[1])).x
    slopes = weights[1:] / spread
    return float(weights[0] - mean @ slopes), slopes


def quarters(rows: Rows, sure: np.ndarray) -> dict[str, list[float]]:
    """Of each quarter of the objects, the surest first, the mean certainty and the share of the
    moving parts that is right; objects of which nothing moves are left out."""
    known = np.flatnonzero(rows.moving)
    parts = np.array_split(known[np.argsort(-sure[known], kind="stable")], 4)
    right = [float(rows.right[k].sum() / rows.moving[k].sum()) for k in parts]
    told = [float((sure[k] * rows.moving[k]).sum() / rows.moving[k].sum()) for k in parts]
    return {"certainty": np.round(told, 2).tolist(), "right": np.round(right, 2).tolist()}


if __name__ == "__main__":
    main()
