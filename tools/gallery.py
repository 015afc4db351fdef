"""What a checkpoint makes of the first held-out pictures, one after the other, none left out, or of
layouts without a picture.

    python tools/gallery.py OUT [--count 24] [--checkpoint nano] [--unseen] [--families …]
        [--ask "cat examples/answers/unseen/{name}.json"]
    python tools/gallery.py OUT --layouts examples/layouts/*.json

OUT gets an asset folder an object, made and checked as ``sample.py`` does, and ``gallery.jpg``:
input, rest and open of each, and the picture alone where no object could be made of it. Prints of
each whether it loads and stands and whether it is plausible (``uniart validate``), and the shares.
Assets that are there are kept. About 30 s an object on one core.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from uniart_jax.evaluation.baselines import object_name
from uniart_jax.evaluation.procedural import held_out_for, split_families
from uniart_jax.evaluation.result_store import check_settings
from uniart_jax.export.preview import BACKGROUND, GAP, INK, TILE
from uniart_jax.inference.ask_layout import ask_command
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.pipeline import Pipeline, load
from uniart_jax.runtime.compilation_cache import enable_compilation_cache
from uniart_jax.simulation.refine import mend
from uniart_jax.simulation.summary import is_plausible, stands, verdicts
from uniart_jax.simulation.validate import validate
from uniart_jax.voxels.layout import Layout

SIDE = 176  # pixels of a tile in the gallery
COLUMNS = 3  # objects a row
SHOWN = 3  # tiles of a preview: input, rest, open


def make_asset(
    pipeline: Pipeline,
    folder: Path,
    seed: int,
    image: np.ndarray | None,
    layout: Layout | bool = True,
) -> dict:
    """The asset that a pipeline makes of a held-out object's picture, or of a layout; its
    report."""
    if not (folder / "report.json").is_file():
        made = pipeline.sample(image, seed=seed, name=folder.name, layout=layout)
        made.obj.save(
            folder,
            image=made.cut[0] if image is None else image,
            picture=made.picture,
            seed=seed,
            mend=mend,
            check=lambda path: verdicts(validate(path)),
            motion=False,
            overwrite=True,
        )
    return json.loads((folder / "report.json").read_text())


def tiles(preview: Path, line: str) -> Image.Image:
    """Input, rest and open of an asset's ``preview.png`` with a line below."""
    with Image.open(preview) as sheet:
        box = (0, sheet.height - TILE - GAP, SHOWN * (TILE + GAP), sheet.height)
        shown = sheet.convert("RGB").crop(box)
    shown = shown.resize((SHOWN * SIDE, SIDE), Image.Resampling.LANCZOS)
    out = Image.new("RGB", (shown.width, SIDE + 20), BACKGROUND)
    out.paste(shown)
    ImageDraw.Draw(out).text((6, SIDE + 3), line, fill=INK)
    return out


def failure(image: np.ndarray, line: str) -> Image.Image:
    """A tile as ``tiles`` makes, of a picture [H, W, 4] uint8 of which nothing could be made."""
    out = Image.new("RGB", (SHOWN * SIDE, SIDE + 20), BACKGROUND)
    shown = Image.fromarray(image).convert("RGBA").resize((SIDE, SIDE), Image.Resampling.LANCZOS)
    out.paste(shown, (0, 0), shown)
    ImageDraw.Draw(out).text((6, SIDE + 3), line, fill=INK)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument("--unseen", action="store_true", help="families never trained on")
    parser.add_argument("--families", nargs="+", default=(), help="these, in turn")
    parser.add_argument("--ask", help="a command that asks a vision-language model, as sample.py's")
    parser.add_argument("--layouts", type=Path, nargs="+", help="JSON files; no pictures then")
    given = parser.parse_args()
    enable_compilation_cache()
    which = f"{given.checkpoint} {Checkpoint.find(given.checkpoint).digest()}"
    settings = {"checkpoint": which, "unseen": given.unseen}
    settings |= {n: getattr(given, n) for n in ("families", "ask") if getattr(given, n)}
    if given.layouts:
        settings["layouts"] = {
            path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in given.layouts
        }
    check_settings(given.out, settings, "another checkpoint, split or layouts")
    pipeline, rows, found = load(given.checkpoint), [], []
    ask = ask_command(given.ask) if given.ask else None
    families = given.families or split_families(given.unseen)
    names = [object_name(index, families) for index in range(given.count)]
    for index, name in enumerate([path.stem for path in given.layouts or ()] or names):
        image, layout = None, True
        try:
            if given.layouts:
                layout = Layout.from_json(given.layouts[index].read_text())
            else:
                test = held_out_for(pipeline.config.model, index, given.unseen, given.families)
                image = test.image
            if ask is not None and not (given.out / name / "report.json").is_file():
                layout = pipeline.ask_layout(image, ask, name=str(index))
            report = make_asset(pipeline, given.out / name, index, image, layout)
        except ValueError as error:
            print(f"{name}: {error}", flush=True)
            found.append((False, False))
            blank = np.zeros((SIDE, SIDE, 4), np.uint8)
            rows.append(failure(blank if image is None else image, f"{name}: no object"))
            continue
        good = stands(report["validation"]), is_plausible(report["validation"])
        line = f"{name}: {'stands' if good[0] else 'fails'}, {'' if good[1] else 'not '}plausible"
        found.append(good)
        rows.append(tiles(given.out / name / "preview.png", line))
        print(line, flush=True)
    share = [sum(row[k] for row in found) for k in (0, 1)]
    both = sum(all(row) for row in found)
    print(f"of {len(found)}: load and stand {share[0]}, plausible {share[1]}, both {both}")
    if rows:
        width, height = rows[0].size
        sheet = Image.new("RGB", (COLUMNS * width, -(-len(rows) // COLUMNS) * height), BACKGROUND)
        for k, row in enumerate(rows):
            sheet.paste(row, (k % COLUMNS * width, k // COLUMNS * height))
        sheet.save(given.out / "gallery.jpg", quality=82)


if __name__ == "__main__":
    main()
