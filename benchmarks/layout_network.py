"""Milliseconds that the layout network takes for a picture, on one core, once compiled.

    taskset -c 0 python benchmarks/layout_network.py [--checkpoint nano] [--count 32]

Crops of held-out objects, one at a time: with the mirrored picture, as it is used, and without.
"""

from __future__ import annotations

import argparse
import time

from uniart_jax.data.images import crop
from uniart_jax.evaluation.procedural import held_out
from uniart_jax.evaluation.table import markdown
from uniart_jax.inference.layouts import LayoutPredictor
from uniart_jax.models.checkpoint import Checkpoint

LIMIT = 80.0  # ms a picture that were asked for
ROUNDS = 3  # the fastest counts: other work on the machine only slows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument("--count", type=int, default=32, help="pictures")
    given = parser.parse_args()
    checkpoint = Checkpoint.find(given.checkpoint)
    rows = []
    for name, mirrored in (("with the mirrored picture", True), ("as it is alone", False)):
        found = LayoutPredictor(checkpoint.config.model, checkpoint.load("layout"), mirrored)
        size, margin = found.image_size, found.crop_margin
        crops = [
            crop(held_out(i, image_size=2 * size).image, size, margin) for i in range(given.count)
        ]
        found(crops[:1])  # compiled
        taken = min(seconds(found, crops) for _ in range(ROUNDS))
        each = 1000 * taken / given.count
        rows.append([name, f"{each:.0f}", f"{each / LIMIT:.2f}"])
    print(markdown(["", "ms a picture", f"of {LIMIT:.0f} ms"], rows))


def seconds(predictor: LayoutPredictor, crops: list) -> float:
    start = time.perf_counter()
    predictor(crops)
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
