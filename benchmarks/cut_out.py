"""How well objects are cut out of photographs, and what that costs their layouts.

    python benchmarks/cut_out.py [--checkpoint nano] [--count 64] [--photos FOLDER] [--grain .18]
                                 [--filling]

Held-out objects stand in front of procedural backgrounds (``data.backdrops``), or in front of the
pictures of FOLDER, in turn, each cut to a square. With --grain half of them have a grain like
wood's or a pattern besides their colours (.18 is what the layout network learns on, .35 what the
mask network does); with --filling they reach from side to side of the picture. They are cut out by
their true mask (the limit), by the checkpoint's mask network, by GrabCut, and not at all; then the
layout network looks at them. Mask: intersection over union, mean and worst tenth. Parts: over
moving parts, with 95 % intervals over objects (``evaluation.layout``).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from uniart_jax.data.background import grabcut, with_alpha
from uniart_jax.data.images import crop, read_image
from uniart_jax.evaluation.layout import score_layout, with_intervals
from uniart_jax.evaluation.photographed import FILLING, SIDE, overlap, photograph
from uniart_jax.evaluation.procedural import held_out
from uniart_jax.evaluation.table import markdown
from uniart_jax.inference.layouts import load_layout_predictor
from uniart_jax.inference.masks import load_mask_predictor
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.voxels.read_layout import read_layout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument("--count", type=int, default=64, help="held-out objects")
    parser.add_argument("--photos", type=Path, help="folder of pictures that stand behind them")
    parser.add_argument("--grain", type=float, default=0.0, help="share of the brightness")
    parser.add_argument("--filling", action="store_true", help="objects fill the picture")
    parser.add_argument("--sheet", type=Path, help="write pictures and cut-outs there (PNG)")
    given = parser.parse_args()
    predictor = load_layout_predictor(given.checkpoint)
    network = load_mask_predictor(Checkpoint.find(given.checkpoint))
    tests = [held_out(i, image_size=2 * SIDE) for i in range(given.count)]
    backs = [square(path) for path in sorted(given.photos.iterdir())] if given.photos else [None]
    how = {"grain": given.grain, "scales": FILLING if given.filling else None}
    taken = [photograph(tests, i, backs[i % len(backs)], **how) for i in range(len(tests))]
    ways = {
        "true mask": lambda picture, mask: mask,
        "mask network": lambda picture, mask: network(picture) if network else None,
        "GrabCut": lambda picture, mask: grabcut(picture),
        "not cut out": lambda picture, mask: None,
    }
    rows, sheet = [], [[picture[..., :3] for picture, _ in taken[:8]]]
    for name, way in ways.items():
        masks = [way(*pair) for pair in taken]
        masks = [np.full((SIDE, SIDE), 255, np.uint8) if m is None else m for m in masks]
        scores = [overlap(m, pair[1]) for m, pair in zip(masks, taken, strict=True)]
        cut = [with_alpha(pair[0], m) for m, pair in zip(masks, taken, strict=True)]
        crops = [crop(c, predictor.image_size, predictor.crop_margin) for c in cut]
        layouts = [read_layout(found) for found in predictor(crops)]
        found = with_intervals([score_layout(*p) for p in zip(layouts, tests, strict=True)])
        cells = [f"{np.mean(scores):.3f}", f"{np.quantile(scores, 0.1):.3f}"]
        for key in ("parts_right", "recall", "count"):
            low, high = found[f"{key}_interval"]
            cells.append(f"{found[key]:.2f} [{low:.2f}, {high:.2f}]")
        rows.append([name, *cells])
        sheet.append([crop(c, SIDE) for c in cut[:8]])
    print(markdown(["", "mask", "worst tenth", "parts right", "moving found", "count"], rows))
    if given.sheet:
        Image.fromarray(np.vstack([np.hstack(row) for row in sheet])).save(given.sheet)


def square(path: Path) -> np.ndarray:
    """[S, S, 3] in [0, 1]: the middle of a picture."""
    picture = Image.fromarray(read_image(path)[..., :3])
    side = min(picture.size)
    left, top = (picture.width - side) // 2, (picture.height - side) // 2
    box = (left, top, left + side, top + side)
    return np.asarray(picture.resize((SIDE, SIDE), box=box), np.float32) / 255


if __name__ == "__main__":
    main()
