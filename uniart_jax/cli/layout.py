"""``uniart layout``: the parts found in pictures, as JSON and drawn over them."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Annotated

import tyro

from uniart_jax.cli.arguments import CutOut, Out, Overwrite
from uniart_jax.runtime.progress import messages, working

MARKS = ("layouts.json",)  # what an output folder of this command holds


def layout(
    images: Annotated[tuple[Path, ...], tyro.conf.Positional],
    /,
    out: Out,
    checkpoint: str = "nano",
    threshold: float = 0.4,  # voxels.part_table.THRESHOLD
    background: CutOut = "auto",
    ask: str | None = None,
    overwrite: Overwrite = False,
) -> None:
    """Find an object's parts in each image: OUT/<stem>.json and OUT/<stem>.png, boxes, axes and
    travel drawn over it.

    Args:
        images: Image files. With an alpha channel or a plain background the object is cut out by
          itself.
        checkpoint: "nano" (shipped), a folder written by training, or a training WORKDIR; with a
          layout network.
        threshold: Least confidence of a part that is kept, in 0..1.
        ask: A command that shows {image} to a vision-language model, the prompt on its standard
          input or in {prompt}, and prints the answer: parts come from it (docs/vision_models.md).
    """
    if not images:
        raise ValueError("layout: give at least one image file")
    if not 0 <= threshold < 1:
        raise ValueError(f"layout: --threshold must be in 0..1, got {threshold:g}")
    stems = [path.stem for path in images]
    if len(set(stems)) != len(stems):
        repeated = next(s for s in stems if stems.count(s) > 1)
        raise ValueError(f"layout: two images are called '{repeated}'; rename one")
    from uniart_jax.cli.words import say_again
    from uniart_jax.data.background import cut_out
    from uniart_jax.data.images import crop, read_image
    from uniart_jax.export.folder import check_target, complete_folder
    from uniart_jax.inference.ask_layout import ask_command, ask_layout
    from uniart_jax.inference.masks import load_mask_predictor
    from uniart_jax.models.checkpoint import Checkpoint
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    check_target(out, overwrite, images, MARKS)
    model = None if ask is None else ask_command(ask)
    enable_compilation_cache()
    weights = Checkpoint.find(checkpoint)
    network = functools.cache(lambda: load_mask_predictor(weights))
    pictures = [
        cut_out(read_image(path), background, f"image '{path}'", network)[0] for path in images
    ]
    from uniart_jax.inference.layouts import load_layout_predictor
    from uniart_jax.visual.layout_picture import draw_layout
    from uniart_jax.voxels.read_layout import read_layout

    console = messages()
    with console.status("finding the parts"):
        predictor = load_layout_predictor(checkpoint)
        size, margin = predictor.image_size, predictor.crop_margin
        crops = [crop(picture, size, margin) for picture in pictures]
        layouts = [read_layout(found, threshold) for found in predictor(crops)]
    most = weights.config.model.grid.max_parts
    if model is not None:
        with working(console, "asking") as say:
            for k, stem in enumerate(stems):
                say(f"{stem}: asking '{ask}'")
                camera, wrong = layouts[k].camera, say_again(say, stem)
                layouts[k] = ask_layout(pictures[k], model, camera, margin, wrong, stem, most)
    with complete_folder(out, overwrite, MARKS) as folder:
        (folder / MARKS[0]).write_text(json.dumps(stems) + "\n")
        for stem, cut, found in zip(stems, crops, layouts, strict=True):
            (folder / f"{stem}.json").write_text(found.to_json())
            draw_layout(cut, found).save(folder / f"{stem}.png")
    for stem, found in zip(stems, layouts, strict=True):
        moving = sum(joint.type != "fixed" for joint in found.joints)
        sure = "" if found.certainty is None else f", certainty {found.certainty:.2f}"
        line = f"{stem}: {len(found)} parts, {moving} of them move{sure} -> {out / stem}.json"
        console.print(line, highlight=False, markup=False, soft_wrap=True)
