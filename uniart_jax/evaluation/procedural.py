"""Quality after each pipeline stage (VAE, latent flow, image to object), compared with retrieval
and with the representation's upper bound.

Held-out procedural objects: one object a seed from ``HELD_OUT_SEED`` on (or from another first
seed: weights and rules are chosen on validation objects), families in turn, a random shown state,
one rendered view, one sample. Rows of the table:

    representation     truth -> voxels -> object
    vae                truth -> voxels -> UniArt VAE -> object
    latent_flow        image + true active voxels -> latent flow -> object
    image_to_object    image -> object: the model
                       (these three follow the layout found in the image, where the checkpoint has a
                       layout network)
    without_layout     the same voxels, their parts and joints read off themselves
    layout_alone       true boxes, joints, legs and colours (of the shown state) -> object, without
                       an image
    retrieval          image -> the nearest training image's object (by image features), the paper's section 3
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import functools
import importlib
import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import trimesh
from rich.table import Table

from uniart_jax import procedural
from uniart_jax.config import DataConfig, ModelConfig
from uniart_jax.data.images import PICTURE_SIDE
from uniart_jax.data.layouts import part_colors
from uniart_jax.data.legs import legs_of
from uniart_jax.evaluation.geometry import object_chamfer
from uniart_jax.evaluation.parts import PartScores, compare_parts, summarize
from uniart_jax.evaluation.pictures import write_comparison
from uniart_jax.evaluation.retrieval import make_retrieval
from uniart_jax.evaluation.runner import run, run_staged, write_metrics
from uniart_jax.evaluation.table import markdown
from uniart_jax.inference.mirror_average import encode_views, find_grid, find_voxels
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.states import sample_state
from uniart_jax.pipeline import Pipeline, load
from uniart_jax.runtime.progress import messages
from uniart_jax.visual.render import part_pixels, render, sample_camera
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.grid import PartGrid, VoxelGrid, occupancy
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.voxelize import voxelize

ATTEMPTS = 20
COLUMNS = {
    "recall": "moving found",
    "parts_right": "parts right",
    "count": "count",
    "tree": "tree",
    "type_accuracy": "moving type",
    "axis_median": "axis (deg)",
    "opens_wrong_way": "wrong way",
    "pivot_median": "pivot",
    "range_iou": "range IoU",
    "chamfer": "Chamfer",
    "chamfer_open": "Chamfer open",
    "watertight": "watertight",
}
Finish = Callable[[], tuple[dict[str, "Score"], dict[str, bool]]]
console = messages()


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """One test object.

    Attributes:
      obj: the truth, normalised, at its shown state. grid: its voxels.
      image: [S, S, 4] uint8 straight-alpha rendering.
      sight: [K] share of the picture's pixels that show each part, where the camera is known.
    """

    family: str
    seed: int
    obj: ArticulatedObject
    grid: PartGrid
    image: np.ndarray
    sight: np.ndarray | None = None


def check_first_seed(seed: int, count: int) -> None:
    """ValueError if some of ``count`` objects from a seed on may have been trained on, or if they
    are validation objects and held-out ones."""
    low, held, beyond = (  # data.layouts
        DataConfig.validation_seed, procedural.HELD_OUT_SEED, 10 * procedural.HELD_OUT_SEED
    )  # fmt: skip
    if not low <= seed <= beyond - count:
        raise ValueError(
            f"evaluate: objects of seeds from {seed} on may have been trained on; give "
            f"--first-seed from {low:,} (validation) or {held:,} (held out) on, below {beyond:,}"
        )
    if seed < held < seed + count:
        raise ValueError(
            f"evaluate: {count} objects from --first-seed {seed:,} on are partly held-out ones "
            f"(from {held:,} on); begin earlier or take fewer"
        )


def split_families(unseen: bool) -> tuple[str, ...]:
    """The families of a held-out split."""
    return procedural.UNSEEN_FAMILIES if unseen else procedural.SEEN_FAMILIES


def held_out(
    index: int,
    *,
    unseen: bool = False,
    families: Sequence[str] = (),
    first_seed: int = procedural.HELD_OUT_SEED,
    resolution: int = 32,
    subdivisions: int = 4,
    image_size: int = PICTURE_SIDE,
) -> HeldOut:
    """Test object ``index``, deterministic; a shown state that cannot be encoded (two equal boxes)
    is drawn again. ``families``: in turn, in place of those of ``split_families``;
    ``first_seed``: of object 0."""
    families = tuple(families) or split_families(unseen)
    family, seed = families[index % len(families)], first_seed + index
    closed = procedural.generate(family, seed)
    rng = np.random.default_rng([seed, 1])
    for attempt in range(ATTEMPTS):
        obj = sample_state(closed, rng)
        try:
            grid = voxelize(obj, resolution, subdivisions)
            break
        except ValueError:
            if attempt == ATTEMPTS - 1:
                raise
    camera = sample_camera(rng)
    picture = render(obj, camera, size=image_size, samples=4)
    sight = part_pixels(obj, camera, image_size) / image_size**2
    return HeldOut(family, seed, obj, grid, np.round(picture * 255).astype(np.uint8), sight)


def held_out_for(
    model: ModelConfig,
    index: int,
    unseen: bool = False,
    families: Sequence[str] = (),
    first_seed: int = procedural.HELD_OUT_SEED,
) -> HeldOut:
    """``held_out`` with the voxels and the image that a model reads."""
    return held_out(
        index,
        unseen=unseen,
        families=families,
        first_seed=first_seed,
        resolution=model.grid.resolution,
        subdivisions=model.grid.subdivisions,
        image_size=max(PICTURE_SIDE, model.image_encoder.image_size),
    )


@dataclasses.dataclass(frozen=True)
class Score:
    """The object of one pipeline stage against the truth; ``chamfer`` at the shown state,
    ``chamfer_open`` with both opened."""

    family: str
    parts: PartScores
    chamfer: float
    chamfer_open: float
    watertight: bool


def score(predicted: ArticulatedObject, test: HeldOut) -> Score:
    """Compare with the truth."""
    return Score(
        test.family,
        compare_parts(predicted, test.obj),
        object_chamfer(predicted, test.obj),
        object_chamfer(predicted, test.obj, predicted.open(), test.obj.open()),
        all(part.mesh.is_watertight for part in predicted.parts),
    )


def summarize_scores(scores: Sequence[Score]) -> dict[str, float]:
    """The figures of one row of the table."""
    return {
        **summarize([s.parts for s in scores]),
        "chamfer": float(np.mean([s.chamfer for s in scores])),
        "chamfer_open": float(np.mean([s.chamfer_open for s in scores])),
        "watertight": float(np.mean([s.watertight for s in scores])),
    }


def evaluate_representation(
    out: Path, *, count: int = 200, unseen: bool = False, processes: int = 1
) -> dict[str, Any]:
    """Truth -> voxels -> object over ``count`` held-out objects: the ceiling of everything else.
    Writes ``metrics.json``, ``table.md``."""
    ceiling = functools.partial(_ceiling, unseen=unseen)
    scores = list(run(ceiling, range(count), "representation", processes=processes))
    return write_results(Path(out), {"representation": scores}, {"count": count, "unseen": unseen})


def _ceiling(index: int, unseen: bool) -> Score:
    test = held_out(index, unseen=unseen)
    return score(assemble(test.grid.gather()), test)


def evaluate_checkpoint(
    checkpoint: str,
    out: Path,
    *,
    count: int = 128,
    records: Path | None = None,
    pictures: int = 16,
    unseen: bool = False,
    families: Sequence[str] = (),
    first_seed: int | None = None,
    processes: int = 1,
) -> dict[str, Any]:
    """All rows for a checkpoint; ``records`` (what it was trained on) adds retrieval. Writes
    ``metrics.json``, ``table.md``, pictures. ``families``: of the held-out objects, in turn, in
    place of a split's; ``first_seed``: of the first.

    Networks and retrieval run in this process; ``processes`` others draw, assemble and compare the
    objects (1 = this one does).
    """
    first_seed = procedural.HELD_OUT_SEED if first_seed is None else first_seed
    check_first_seed(first_seed, count)
    pipeline = load(checkpoint)
    retrieve = None if records is None else make_retrieval(pipeline, records, first_seed)
    model = pipeline.config.model
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    overlaps: list[float] = []

    def at_stages(index: int, test: HeldOut) -> list[Finish]:
        grids, overlap, pixels, layout = predict(pipeline, test, index)
        overlaps.append(overlap)
        others = {} if retrieve is None else {"retrieval": retrieve(pixels)}
        if layout is not None:
            others["layout_alone"] = from_layout_alone(pipeline, test, index)
        folder = out if index < pictures else None
        name = f"{index:03d}-{test.family}"
        return [functools.partial(finish, test, grids, others, folder, name, layout)]

    draw = functools.partial(
        held_out_for, model, unseen=unseen, families=families, first_seed=first_seed
    )
    made = run_staged(draw, at_stages, range(count), "held-out objects", processes=processes)
    results = [one for (one,) in made]
    loads = [load for _, load in results if load]
    extra = {
        "count": count,
        "unseen": unseen,
        "first_seed": first_seed,
        "checkpoint": str(checkpoint),
        "structure_iou": float(np.mean(overlaps)),
        "assets": {
            name: float(np.mean([load[name] for load in loads])) for name in (loads or [{}])[0]
        },
    }
    rows = {name: [scores[name] for scores, _ in results] for name in results[0][0]}
    return write_results(out, rows, extra)


def predict(
    pipeline: Pipeline, test: HeldOut, seed: int
) -> tuple[dict[str, VoxelGrid], float, np.ndarray, Layout | None]:
    """What the networks say at every pipeline stage, the IoU of the sampled structure with the true
    one, the image as they see it, and its layout."""
    coords = test.grid.coords
    pixels = pipeline.prepare(test.image)
    layout = pipeline.layout_or_none(test.image)
    options = pipeline.options()
    conditions = encode_views(pipeline, pixels[None], layout, *options)
    keys = jax.random.split(jax.random.key(seed))
    found, _ = find_voxels(pipeline, conditions, keys[0], options[0])
    if len(found) == 0:  # a failure counts: an object of one speck
        found = np.array([[pipeline.config.model.grid.resolution // 2] * 3], np.int32)
    encoded = pipeline.encode_voxels(test.grid)
    grids = {"vae": pipeline.decode([coords], [encoded], [layout])[0]}
    for name, where in (("latent_flow", coords), ("image_to_object", found)):
        grids[name], _ = find_grid(pipeline, where, conditions, keys[1], options[1], layout)
    dense = [occupancy(c, test.grid.resolution) for c in (found, coords)]
    return grids, float((dense[0] & dense[1]).sum() / (dense[0] | dense[1]).sum()), pixels, layout


def from_layout_alone(pipeline: Pipeline, test: HeldOut, seed: int) -> ArticulatedObject:
    """What the networks make of the truth's boxes, joints, legs and colours without an image."""
    obj = test.obj
    legs = legs_of(obj.shown_at(obj.rest()), obj)
    written = dataclasses.replace(Layout.of_object(obj, part_colors(obj)), legs=legs)
    try:
        return pipeline(seed=seed, layout=written)
    except ValueError:  # no voxels: a failure counts, an object of one speck
        speck = trimesh.creation.box([1 / pipeline.config.model.grid.resolution] * 3)
        return ArticulatedObject((Part("base", speck),))


def finish(
    test: HeldOut,
    grids: dict[str, VoxelGrid],
    others: dict[str, ArticulatedObject],
    out: Path | None,
    name: str,
    layout: Layout | None = None,
) -> tuple[dict[str, Score], dict[str, bool]]:
    """Assemble every stage's object and score it; where ``out`` is given, draw them and write the
    model's as an asset (``check_asset``)."""
    read_off = functools.partial(assemble, tolerance=NETWORK_TOLERANCE)
    follow = read_off if layout is None else functools.partial(assemble_layout, layout=layout)
    predicted = {"representation": assemble(test.grid.gather())}
    for stage in ("vae", "latent_flow", "image_to_object"):
        predicted[stage] = follow(grids[stage])
    if layout is not None:
        predicted["without_layout"] = read_off(grids["image_to_object"])
    predicted |= others
    loads: dict[str, bool] = {}
    if out is not None:
        loads = check_asset(predicted["image_to_object"], out / "assets" / name)
        write_comparison(out / "pictures" / f"{name}.png", test.image, test.obj, predicted)
    return {stage: score(obj, test) for stage, obj in predicted.items()}, loads


def check_asset(obj: ArticulatedObject, folder: Path) -> dict[str, bool]:
    """Write an object as an asset and open it as its users do: yourdfpy, and MuJoCo where it is
    installed; all parts closed."""
    obj.save(folder, overwrite=True, motion=False)
    found = {"watertight": all(part.mesh.is_watertight for part in obj.parts)}
    loaders = [name for name in ("yourdfpy", "mujoco") if importlib.util.find_spec(name)]
    return found | {name: opens(name, folder / "object.urdf") for name in loaders}


def opens(loader: str, urdf: Path) -> bool:
    """Whether "yourdfpy" or "mujoco" takes a URDF; if not, what it says is told."""
    try:
        module = importlib.import_module(loader)
        load = module.URDF.load if loader == "yourdfpy" else module.MjModel.from_xml_path
        load(str(urdf))
    except Exception as error:  # whatever a foreign loader raises is a failure to be counted
        console.print(f"{urdf.parent.name}: {loader} refused it ({error})")
        return False
    return True


def write_results(out: Path, rows: dict[str, list[Score]], extra: dict[str, Any]) -> dict[str, Any]:
    """``metrics.json`` (all figures, also per family) and ``table.md``; prints the table. Returns
    what metrics.json holds."""
    families = sorted({s.family for scores in rows.values() for s in scores})
    results: dict[str, Any] = {
        **extra,
        "rows": {name: summarize_scores(scores) for name, scores in rows.items()},
        "families": {
            f: {
                name: summarize_scores([s for s in scores if s.family == f])
                for name, scores in rows.items()
            }
            for f in families
        },
    }
    cells = {name: [f"{results['rows'][name][key]:.3f}" for key in COLUMNS] for name in rows}
    named = [[name, *values] for name, values in cells.items()]
    lines = [markdown(["", *COLUMNS.values()], named)]
    table = Table("", *rows)  # a terminal is narrower than it is high
    for title, *values in zip(COLUMNS.values(), *cells.values(), strict=True):
        table.add_row(title, *values)
    if "structure_iou" in extra:
        lines += ["", f"Structure IoU {extra['structure_iou']:.3f} over {extra['count']} objects."]
        if extra["assets"]:
            shares = ", ".join(f"{name} {share:.0%}" for name, share in extra["assets"].items())
            lines += [f"Assets written and opened again: {shares}."]
    write_metrics(out, results, "\n".join(lines))
    console.print(table)
    if "structure_iou" in extra:
        console.print(f"structure IoU {extra['structure_iou']:.3f}")
    return results
