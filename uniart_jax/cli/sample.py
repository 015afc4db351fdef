"""``sample.py`` and ``uniart sample``: images in, assets out."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from uniart_jax.cli.arguments import (
    CutOut,
    Out,
    Overwrite,
    check_out,
    run_physics_checks,
    validation_lines,
)
from uniart_jax.cli.asset_options import AS_USUAL, Output
from uniart_jax.config import TOLERANCES
from uniart_jax.evaluation.sampled import details, steps_of_several
from uniart_jax.runtime.progress import messages, working

if TYPE_CHECKING:
    from uniart_jax.pipeline import Sample


def sample(
    images: Annotated[tuple[Path, ...], tyro.conf.Positional],
    /,
    out: Out,
    checkpoint: str = "nano",
    seed: int = 0,
    num_samples: int = 1,
    steps: int | None = None,
    guidance: float | None = None,
    solver: Literal["euler", "heun"] | None = None,
    adaptive: bool = False,
    tolerance: float | None = None,
    multi_view: bool = False,
    layout: Path | None = None,
    follow: bool = True,
    ask: str | None = None,
    background: CutOut = "auto",
    texture: Literal["both", "network"] = "both",
    output: Output = AS_USUAL,
    refine: bool = True,
    check: bool = True,
    overwrite: Overwrite = False,
) -> int:
    """One image in, a complete articulated object out; or a layout without an image.

    A sample that fails, as where no object is found in the image, does not cost the others: exit
    code 1 if some failed, 2 if all did.

    Args:
        images: Image files. With an alpha channel or a plain background the object is cut out by
          itself. Or layouts (.json), which need no image.
        checkpoint: "nano" (shipped), a folder written by training, a training WORKDIR, or
          hf:ORG/NAME of the Hugging Face hub (pip install 'uniart_jax[hub]').
        seed: Same seed, same object, on the same number of cores of the same kind; elsewhere
          meshes differ a little by rounding, and textures are laid out otherwise.
        num_samples: Samples an image; with several, report.json says how much those that were made
          agree on each joint. Where the checkpoint takes one step, which
            is the mean whatever the seed, several are made in four.
        steps: Solver steps of both flows (default: the checkpoint's).
        guidance: Classifier-free guidance of both flows: 0 = none; diffusers' guidance_scale - 1
          (default: the checkpoint's).
        solver: Of both flows (default: the checkpoint's). Heun asks the network twice a step.
        adaptive: Steps as long as the error allows, instead of --steps of them.
        tolerance: Of --adaptive: error that is allowed (default: the checkpoint's).
        multi_view: The images are views of one object.
        layout: JSON of `uniart layout`, perhaps edited: the parts, joints and tree that the object
          follows, instead of what is found in the image.
        follow: Follow a layout, where the checkpoint finds one; else parts and joints are read off
          the voxels.
        ask: A command that shows {image} to a vision-language model, with the prompt on its
          standard input or in {prompt}, and prints the answer, as "llm -a {image}": the object
          follows the parts that it tells (docs/vision_models.md).
        texture: Colours: "both" takes what the picture shows from the picture, and the rest as it
          is likely to be by what is seen and by the decoder; "network" all from the decoder.
        refine: Draw in limits and shift axes a little where a joint runs into the object
          (report.json says which).
        check: Try the asset in the physics engines that are installed (report.json says how it
          went).
    """
    if not images:
        raise ValueError("sample: give at least one image file, or a layout's JSON")
    if not 0 <= seed < 2**31:
        raise ValueError(f"sample: --seed must be in 0..{2**31 - 1}, got {seed}")
    if num_samples < 1:
        raise ValueError(f"sample: --num-samples must be at least 1, got {num_samples}")
    if steps is not None and steps < 1:
        raise ValueError(f"sample: --steps must be at least 1, got {steps}")
    if adaptive and steps is not None:
        raise ValueError(
            "sample: --adaptive chooses its own steps; give --tolerance, or --steps alone"
        )
    if tolerance is not None and not adaptive:
        raise ValueError("sample: --tolerance belongs to --adaptive; give both or neither")
    least, most = TOLERANCES
    if tolerance is not None and not least <= tolerance <= most:
        raise ValueError(f"sample: --tolerance must be in {least:g}..{most:g}, got {tolerance:g}")
    given = _layout(layout, follow, len(images) == 1 or multi_view)
    if ask is not None and (layout is not None or not follow):
        raise ValueError("sample: --ask goes without --layout and --no-follow")
    tables = {path: _table(path) for path in images if path.suffix.lower() == ".json"}
    if tables and (multi_view or layout is not None or not follow or ask is not None):
        raise ValueError(
            "sample: a layout without an image goes without --multi-view, --layout, --no-follow "
            "and --ask"
        )
    asset = output.parsed()
    from uniart_jax.cli.words import say_again
    from uniart_jax.data.background import check_background
    from uniart_jax.data.images import check_visible, read_image
    from uniart_jax.inference.ask_layout import ask_command

    model = None if ask is None else ask_command(ask)
    # all inputs are checked before any work
    pictures = {path: read_image(path) for path in images if path not in tables}
    for path, picture in pictures.items():
        check_visible(picture, f"image '{path}'")
        check_background(background, f"image '{path}'")
    folders = sample_folders(images, out, num_samples, multi_view)
    for folder in folders.values():
        check_out(folder, overwrite, images if layout is None else (*images, layout))
    from uniart_jax.pipeline import load
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    changes = {
        "steps": steps,
        "guidance": guidance,
        "solver": solver,
        "adaptive": adaptive or (False if steps is not None else None),
        "tolerance": tolerance,
    }
    enable_compilation_cache()
    console = messages()
    threading.Thread(target=_import_writers, daemon=True).start()
    with working(console, "loading the model") as say:
        pipeline = load(checkpoint)
        if num_samples > 1 and steps is None and not adaptive:
            changes["steps"] = steps_of_several(pipeline.options())
        groups = [("object", images)] if multi_view else [(path.name, (path,)) for path in images]
        wanted, failed = len(groups) * num_samples, []
        for g, (name, views) in enumerate(groups):
            drawn: dict[int, Sample] = {}
            answers: dict[str, Any] = {}  # one for all samples of an image
            for i in range(num_samples):
                if num_samples > 1:
                    say(f"{name}: sample {i + 1} of {num_samples}")
                with _noted(failed, name, seed + i, wanted):
                    table = tables.get(views[0])
                    if model is not None and name not in answers:
                        say(f"{name}: asking '{ask}'")
                        wrong = say_again(say, name)
                        answers[name] = pipeline.ask_layout(views[0], model, background, wrong)
                    drawn[i] = pipeline.sample(
                        views if table is None else None,
                        seed=seed + i,
                        name=views[0].stem,
                        layout=answers.get(name, given) if table is None else table,
                        background=background,
                        progress=lambda step, name=name: say(f"{name}: {step}"),
                        **changes,
                    )
            made = list(drawn.values())
            for index, (i, one) in enumerate(drawn.items()):
                say(f"{name}: collision shapes, textures, files")
                found: list[dict] = []
                with _noted(failed, name, seed + i, wanted):
                    one.obj.save(
                        folders[g, i],
                        **asset,
                        image=one.cut[0] if one.cut else pictures.get(views[0]),
                        picture=one.picture if texture == "both" else None,
                        seed=seed + i,
                        checkpoint=checkpoint,
                        details=details(made, index),
                        overwrite=overwrite,
                        mend=told(_mend, say, f"{name}: joints that run into the object")
                        if refine
                        else None,
                        check=told(
                            functools.partial(run_physics_checks, found=found),
                            say,
                            f"{name}: tried in physics engines",
                        )
                        if check
                        else None,
                    )
                    for line in lines(name, one, folders[g, i], found):
                        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if len(failed) == wanted:
        raise failed[0][1]
    for what, error in failed:
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        print(f"error: {what}: {kind}{' '.join(str(error).split())}", file=sys.stderr)
    return 1 if failed else 0


def _mend(*given: Any) -> Any:
    from uniart_jax.simulation.refine import mend

    return mend(*given)


def _import_writers() -> None:
    """Import what writes and checks objects while the networks run, which takes seconds; what
    cannot be imported is told where it is used."""
    for module in ("export.asset", "simulation.validate", "simulation.refine"):
        with contextlib.suppress(Exception):
            importlib.import_module(f"uniart_jax.{module}")


def _layout(path: Path | None, follow: bool, single: bool) -> Any:
    """What ``Pipeline.sample`` takes as ``layout``; one in a file may have been edited, so its
    certainty is not known."""
    if path is None:
        return follow
    if not follow or not single:
        raise ValueError("sample: --layout is of one image, and goes without --no-follow")
    return _table(path)


def _table(path: Path) -> Any:
    """The layout in a JSON file."""
    if not path.is_file():
        raise FileNotFoundError(f"layout '{path}': no such file")
    from uniart_jax.voxels.layout import Layout

    try:
        return dataclasses.replace(Layout.from_json(path.read_text("utf-8-sig")), certainty=None)
    except (ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"layout '{path}': {error}") from None


@contextlib.contextmanager
def _noted(
    failed: list[tuple[str, Exception]], name: str, seed: int, wanted: int
) -> Iterator[None]:
    """What goes wrong with one of several samples is noted: it does not cost the others. A lack of
    memory or a full disk would: it is raised."""
    import jax

    try:
        yield
    except (MemoryError, OSError):
        raise
    except jax.errors.JaxRuntimeError as error:
        raise MemoryError(f"the device failed: {str(error).splitlines()[0]}") from error
    except Exception as error:
        if wanted == 1:
            raise
        failed.append((f"{name}, seed {seed}", error))


def told(work: Callable[..., Any], say: Callable[[str], None], what: str) -> Callable[..., Any]:
    """``work``, said when it begins."""

    @functools.wraps(work)
    def run(*given: Any) -> Any:
        say(what)
        return work(*given)

    return run


def lines(name: str, one: Sample, folder: Path, found: list[dict]) -> Iterator[str]:
    """What is said about a sample that was saved, with its verdicts in the engines."""
    moving = [p.joint.type for p in one.obj.parts if p.joint.type != "fixed"]
    kinds = ", ".join(f"{moving.count(t)} {t}" for t in sorted(set(moving))) or "no moving joint"
    yield f"{name}: {len(one.obj.parts)} parts ({kinds}) -> {folder}"
    yield f"  network evaluations: {', '.join(f'{flow} {n}' for flow, n in one.evaluations.items())}"  # noqa: E501
    if guessed := sorted({"rembg", "network", "grabcut"} & set(one.background)):
        by = " and ".join("the mask network" if way == "network" else way for way in guessed)
        yield f"  cut out of its background by {by}: look at preview.png"
    for flow, steps in one.forced.items():
        if steps:
            yield (
                f"  {flow}: {steps} adaptive steps could not keep the tolerance of "
                f"{one.options[flow].tolerance:g}; give a larger --tolerance, or fixed steps"
            )
    for line in validation_lines(found[0]) if found else ():
        yield f"  {line}"
    from uniart_jax.cli.words import certainty_line, closing_line

    if sure := certainty_line(one.layout):
        yield f"  {sure}"
    yield closing_line(one.kind, one.obj, folder)


def sample_folders(
    images, out: Path, num_samples: int, multi_view: bool
) -> dict[tuple[int, int], Path]:
    """(image or group, sample) -> folder: OUT itself for one object, else OUT/<stem>/sample-<i>.

    Raises:
      ValueError: two images have the same stem, so that their folders would be the same.
    """
    groups = images[:1] if multi_view else images
    if len(groups) == 1 and num_samples == 1:
        return {(0, 0): Path(out)}
    stems = [Path(p).stem for p in groups]
    if len(set(stems)) != len(stems):
        repeated = next(s for s in stems if stems.count(s) > 1)
        raise ValueError(
            f"sample: two images are called '{repeated}'; rename one, their folders would be the "
            "same"
        )
    return {
        (g, i): Path(out) / stem / f"sample-{i}"
        for g, stem in enumerate(stems)
        for i in range(num_samples)
    }
