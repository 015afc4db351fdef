"""What the page does with a picture or a table: look at it, make objects of it, put them in a zip.

Everything is told as it goes: ``tell(stage)`` is called as each of ``STAGES`` begins, and whatever
it raises ends the work.
"""

from __future__ import annotations

import dataclasses
import json
import re
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from uniart_jax.app.part_words import root_first
from uniart_jax.config import Background
from uniart_jax.data.background import cut_out
from uniart_jax.data.images import crop, read_image
from uniart_jax.data.layout_renders import render_layout
from uniart_jax.evaluation.sampled import details, steps_of_several
from uniart_jax.export.words import moving_words
from uniart_jax.inference.ask_layout import told_layout
from uniart_jax.simulation.refine import mend
from uniart_jax.simulation.summary import verdicts
from uniart_jax.simulation.validate import validate
from uniart_jax.visual.layout_picture import draw_layout
from uniart_jax.voxels.layout import Layout

if TYPE_CHECKING:
    from uniart_jax.pipeline import Pipeline, Sample

SIDE = 512  # pixels of the pictures that the page shows
MOST_SAMPLES = 4
MOST_STEPS = 50
MOST_GUIDANCE = 10.0
SEEDS = 2**31
# in their order: drawn are all samples, one after the other, and then each is written
STAGES = {
    "look": "Looking at the picture",
    "structure": "Which voxels it fills",
    "surfaces": "Surfaces and colours",
    "joints": "Parts and joints",
    "files": "Collision shapes, texture, files",
    "refine": "Joints that run into the object",
    "check": "Tried in physics engines",
    "zip": "Zip",
}
Tell = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class Options:
    """How objects are made. ``steps`` and ``guidance`` None: as the checkpoint has them; ``check``:
    also try them in the physics engines that are installed."""

    samples: int = 1
    seed: int = 0
    steps: int | None = None
    guidance: float | None = None
    background: Background = "auto"
    check: bool = True

    def __post_init__(self) -> None:
        if not 1 <= self.samples <= MOST_SAMPLES:
            raise ValueError(f"samples: give 1 to {MOST_SAMPLES}")
        if self.seed < 0 or self.seed + self.samples > SEEDS:
            raise ValueError(f"seed: give a whole number from 0 to {SEEDS - self.samples}")
        if self.steps is not None and not 1 <= self.steps <= MOST_STEPS:
            raise ValueError(f"steps: give a whole number from 1 to {MOST_STEPS}, or nothing")
        if self.guidance is not None and not 0 <= self.guidance <= MOST_GUIDANCE:
            raise ValueError(f"guidance: give 0 to {MOST_GUIDANCE:g}, or nothing")
        if self.background not in ("auto", "keep", "rembg"):
            raise ValueError("background: give auto, keep or rembg")

    @staticmethod
    def read(
        samples: Any, seed: Any, steps: Any, guidance: Any, background: Any, check: Any
    ) -> Options:
        """Of what a form holds: numbers or texts of numbers, None or "" where nothing was given.

        Raises:
          ValueError: one line that names the field.
        """
        return Options(
            _whole("samples", samples) or 0,
            _whole("seed", 0 if seed in (None, "") else seed) or 0,
            _whole("steps", steps),
            _number("guidance", guidance),
            background,
            bool(check),
        )


@dataclasses.dataclass(frozen=True)
class Analysis:
    """What is seen in a picture before anything is made of it.

    Attributes:
      picture: the file; None of a table alone. rgba, cut: [H, W, 4] uint8, as it was read and with
        the object cut out; of a table alone the plain picture of it.
      background: how it was to be cut out; way: how it was (``data.background``), or "table".
      layout: the parts as they are read, or as a table says; None where the checkpoint has no
        layout network. Of a table alone its lengths are those of the table.
      shown, drawn: PNG files of the cut-out and, if there is a layout, of boxes and axes over it.
      edited: whether the layout is not as it was read.
    """

    picture: Path | None
    rgba: np.ndarray
    cut: np.ndarray
    background: Background
    way: str
    layout: Layout | None
    shown: Path
    drawn: Path | None
    edited: bool = False

    @property
    def stem(self) -> str:
        """What files of it are called."""
        return "object" if self.picture is None else safe_stem(self.picture)


@dataclasses.dataclass(frozen=True)
class Made:
    """An object that was made. ``folder``: the asset's; ``found``: what it is like and
    what moves, in words;
    ``report``: its ``report.json``."""

    folder: Path
    seed: int
    found: str
    report: dict[str, Any]


def analyze(pipeline: Pipeline, picture: Path, background: Background, folder: Path) -> Analysis:
    """Read a picture, cut the object out, find its parts, and draw both into ``folder``.

    Raises:
      FileNotFoundError, ValueError: it is no picture that can be used; one line that names it.
    """
    rgba = read_image(picture)
    name = f"image '{picture}'"
    cut, way = cut_out(rgba, background, name, lambda: pipeline.mask_predictor)
    layout = pipeline.layout_or_none(cut, "keep")
    shown = folder / "cut-out.png"
    square = _square(pipeline, cut)
    Image.fromarray(square).save(shown)
    drawn = None if layout is None else _drawn(square, layout, folder)
    return Analysis(picture, rgba, cut, background, way, layout, shown, drawn)


def edited(pipeline: Pipeline, seen: Analysis, layout: Layout, folder: Path) -> Analysis:
    """The same picture with another layout, drawn into ``folder``."""
    drawn = _drawn(_square(pipeline, seen.cut), layout, folder)
    return dataclasses.replace(seen, layout=layout, drawn=drawn, edited=True)


def told_of(pipeline: Pipeline, seen: Analysis, text: str) -> Layout:
    """What an answer of a vision-language model tells of the picture.

    Raises:
      ValueError: one line that says what is wrong with it.
    """
    margin = pipeline.config.model.image_encoder.crop_margin
    guess = None if seen.layout is None else seen.layout.camera
    return told_layout(text, seen.cut, guess, margin)


def of_table(pipeline: Pipeline, layout: Layout, folder: Path) -> Analysis:
    """A table without a picture: the plain picture of it, which the networks are shown
    (``Pipeline.sample``), and its boxes over that, both drawn into ``folder``."""
    plain, _ = layout.normalized()
    image, camera = render_layout(plain)
    shown, square = folder / "plain.png", _square(pipeline, image)
    Image.fromarray(square).save(shown)
    drawn = _drawn(square, dataclasses.replace(plain, camera=camera), folder)
    return Analysis(None, image, image, "auto", "table", layout, shown, drawn, edited=True)


def _square(pipeline: Pipeline, cut: np.ndarray) -> np.ndarray:
    """What the page shows of a cut-out."""
    return crop(cut, SIDE, pipeline.config.model.image_encoder.crop_margin)


def _drawn(square: np.ndarray, layout: Layout, folder: Path) -> Path:
    """The file of a layout drawn over its picture."""
    path = folder / "parts.png"
    draw_layout(square, root_first(layout), SIDE).save(path)
    return path


def make(
    pipeline: Pipeline,
    seen: Analysis,
    options: Options,
    folder: Path,
    tell: Tell,
    checkpoint: str = "",
) -> tuple[list[Made], list[str]]:
    """Objects of what was seen, as ``sample.py`` makes them, each in a folder of its own in
    ``folder``.

    Args:
      seen: the picture and its parts. tell: called as each stage begins.
      checkpoint: its name, for the reports.

    Returns:
      The objects, and a line for each of several samples that could not be made.

    Raises:
      ValueError: none could be made.
    """
    failed: list[tuple[int, Exception]] = []
    drawn: dict[int, Sample] = {}
    for i in range(options.samples):
        try:
            drawn[i] = _draw(pipeline, seen, options, i, tell)
        except ValueError as error:
            failed.append((options.seed + i, error))
    objects = list(drawn.values())
    made = []
    for index, (i, one) in enumerate(drawn.items()):
        name = "asset" if options.samples == 1 else f"sample-{i}"
        told = details(objects, index) | {"background": [seen.way]}
        if seen.picture is None:
            del told["background"]  # nothing was cut out
        try:
            made.append(
                _write(one, seen, options, options.seed + i, folder / name, told, tell, checkpoint)
            )
        except ValueError as error:
            failed.append((options.seed + i, error))
    if not made:
        raise failed[0][1]
    return made, [f"seed {seed}: {sentence(error, seen.picture)}" for seed, error in failed]


def _draw(pipeline: Pipeline, seen: Analysis, options: Options, i: int, tell: Tell) -> Sample:
    """Sample ``i``."""
    steps = options.steps
    if steps is None and options.samples > 1:
        steps = steps_of_several(pipeline.options())

    def progress(step: str) -> None:
        if (stage := stage_of(step)) is not None:
            tell(stage)

    return pipeline.sample(
        None if seen.picture is None else seen.cut,
        seed=options.seed + i,
        name=seen.stem,
        layout=seen.layout or True,
        background="keep",  # what is cut away is cut away
        progress=progress,
        steps=steps,
        adaptive=None if steps is None else False,
        guidance=options.guidance,
    )


def _write(
    one: Sample,
    seen: Analysis,
    options: Options,
    seed: int,
    folder: Path,
    told: dict[str, Any],
    tell: Tell,
    checkpoint: str,
) -> Made:
    """The asset folder of a sample."""

    def mended(*given: Any) -> Any:
        tell("refine")
        return mend(*given)

    def checked(written: Path) -> dict:
        tell("check")
        return verdicts(validate(written))

    tell("files")
    one.obj.save(
        folder,
        image=seen.cut,
        picture=one.picture,
        seed=seed,
        checkpoint=checkpoint,
        details=told,
        mend=mended,
        check=checked if options.check else None,
    )
    report = json.loads((folder / "report.json").read_text("utf-8"))
    return Made(folder, seed, f"{one.kind}: {moving_words(one.obj)}", report)


def stage_of(step: str) -> str | None:
    """The stage that begins with a step of ``Pipeline.sample``, by the name that it tells; None:
    no new one (the picture was looked at before)."""
    if step.endswith(" voxels"):
        return "surfaces"
    return {"structure": "structure", "parts and joints": "joints"}.get(step)


def planned(options: Options) -> dict[str, int]:
    """Stage -> how often it comes."""
    left_out = set() if options.check else {"check"}
    count = {stage: options.samples for stage in STAGES if stage not in left_out}
    return count | {"look": 1, "zip": 1}


def zip_assets(made: Sequence[Made], stem: str, path: Path) -> Path:
    """All files of the objects in one zip: below ``stem``/, or where there are several below
    ``stem``/``sample-<i>``/. The same files give the same bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for one in made:
            top = stem if len(made) == 1 else f"{stem}/{one.folder.name}"
            for file in sorted(one.folder.rglob("*")):
                if file.is_file():
                    name = f"{top}/{file.relative_to(one.folder).as_posix()}"
                    entry = zipfile.ZipInfo(name)  # of 1980, whatever the clock says
                    entry.compress_type = zipfile.ZIP_DEFLATED
                    entry.external_attr = 0o644 << 16
                    archive.writestr(entry, file.read_bytes())
    return path


def safe_stem(picture: Path) -> str:
    """A picture's name without its ending, as every file system takes it."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", picture.stem).strip("_")[:60] or "object"


def sentence(error: BaseException, picture: Path | None = None) -> str:
    """An error in one line for the page: of the picture its name alone is told, not where it
    lies."""
    text = " ".join(str(error).split()) or type(error).__name__
    if picture is not None:
        text = text.replace(str(picture), picture.name)
    return text


def _whole(name: str, value: Any) -> int | None:
    number = _number(name, value)
    if number is None:
        return None
    if number != int(number):
        raise ValueError(f"{name}: give a whole number, not {number:g}")
    return int(number)


def _number(name: str, value: Any) -> float | None:
    if value is None or value == "":
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: give a number") from None
    if not np.isfinite(number):
        raise ValueError(f"{name}: give a finite number")
    return number
