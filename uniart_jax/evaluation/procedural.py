"""Held-out procedural objects: how far each station of the road gets, beside retrieval and the representation's ceiling.

One object a seed from ``HELD_OUT_SEED`` on, families in turn, a random shown state, one rendered view, one sample. Rows of the table:

    representation     truth -> voxels -> object
    vae                truth -> voxels -> UniArt VAE -> object
    latent_flow        image + true active voxels -> latent flow -> object
    image_to_object    image -> object: the model
    retrieval          image -> the nearest training image's object (by image features), the paper's section 3
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import importlib.util
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from uniart_jax import procedural
from uniart_jax.data.image_table import load_image_table
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.geometry import object_chamfer
from uniart_jax.evaluation.parts import PartScores, compare_parts, summarize
from uniart_jax.evaluation.pictures import write_comparison
from uniart_jax.evaluation.reconstruction import object_of_record
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import Pipeline, load
from uniart_jax.procedural.states import sample_state
from uniart_jax.render import render, sample_camera
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.grid import PartGrid, occupancy
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE
from uniart_jax.voxels.voxelize import voxelize

ATTEMPTS = 20
COLUMNS = {
    "recall": "recall",
    "parts_right": "parts right",
    "count": "count",
    "tree": "tree",
    "type_accuracy": "type",
    "axis_median": "axis (deg)",
    "opens_wrong_way": "wrong way",
    "pivot_median": "pivot",
    "range_iou": "range IoU",
    "chamfer": "Chamfer",
    "chamfer_open": "Chamfer open",
    "watertight": "watertight",
}
console = Console(stderr=True, highlight=False)


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """One test object.

    Attributes:
      obj: the truth, normalised, at its shown state. grid: its voxels.
      image: [S, S, 4] uint8 straight-alpha rendering.
    """

    family: str
    seed: int
    obj: ArticulatedObject
    grid: PartGrid
    image: np.ndarray


def held_out(
    count: int,
    *,
    unseen: bool = False,
    resolution: int = 32,
    subdivisions: int = 4,
    image_size: int = 128,
) -> Iterator[HeldOut]:
    """Test objects, deterministic; a shown state that cannot be encoded (two equal boxes) is drawn again."""
    families = procedural.UNSEEN_FAMILIES if unseen else procedural.SEEN_FAMILIES
    for k in range(count):
        family, seed = families[k % len(families)], procedural.HELD_OUT_SEED + k
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
        picture = render(
            obj, sample_camera(rng), size=image_size, samples=4
        )  # as data.prepare draws them
        yield HeldOut(family, seed, obj, grid, np.round(picture * 255).astype(np.uint8))


class Row:
    """Scores of one station over all objects."""

    def __init__(self, name: str):
        self.name = name
        self.scores: list[PartScores] = []
        self.distances: list[tuple[float, float]] = []
        self.closed: list[bool] = []
        self.families: list[str] = []

    def add(self, predicted: ArticulatedObject, test: HeldOut) -> None:
        self.scores.append(compare_parts(predicted, test.obj))
        shown = object_chamfer(predicted, test.obj)
        opened = object_chamfer(predicted, test.obj, predicted.open(), test.obj.open())
        self.distances.append((shown, opened))
        self.closed.append(all(part.mesh.is_watertight for part in predicted.parts))
        self.families.append(test.family)

    def summary(self, family: str | None = None) -> dict[str, float]:
        keep = [i for i, f in enumerate(self.families) if family in (None, f)]
        distances = np.array([self.distances[i] for i in keep])
        return {
            **summarize([self.scores[i] for i in keep]),
            "chamfer": float(distances[:, 0].mean()),
            "chamfer_open": float(distances[:, 1].mean()),
            "watertight": float(np.mean([self.closed[i] for i in keep])),
        }


def evaluate_representation(out: Path, *, count: int = 200, unseen: bool = False) -> dict[str, Any]:
    """Truth -> voxels -> object over ``count`` held-out objects: the ceiling of everything else. Writes ``metrics.json``, ``table.md``."""
    row = Row("representation")
    for test in track(
        held_out(count, unseen=unseen), "representation", total=count, console=console
    ):
        row.add(assemble(test.grid.gather()), test)
    return write_results(Path(out), [row], {"count": count, "unseen": unseen})


def evaluate_checkpoint(
    checkpoint: str,
    out: Path,
    *,
    count: int = 128,
    records: Path | None = None,
    pictures: int = 16,
    unseen: bool = False,
) -> dict[str, Any]:
    """All rows for a checkpoint; ``records`` (what it was trained on) adds retrieval. Writes ``metrics.json``, ``table.md``, pictures."""
    pipeline = load(checkpoint)
    retrieve = None if records is None else make_retrieval(pipeline, records)
    names = ["representation", "vae", "latent_flow", "image_to_object"] + (
        ["retrieval"] if retrieve else []
    )
    rows = {name: Row(name) for name in names}
    overlaps: list[float] = []
    loads: list[dict[str, bool]] = []
    model = pipeline.config.model
    tests = held_out(
        count,
        unseen=unseen,
        resolution=model.grid.resolution,
        subdivisions=model.grid.subdivisions,
        image_size=model.image_encoder.image_size,
    )
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    for k, test in enumerate(track(tests, "held-out objects", total=count, console=console)):
        predicted, overlap = predict_all(pipeline, test, k, retrieve)
        overlaps.append(overlap)
        for name, obj in predicted.items():
            rows[name].add(obj, test)
        if k < pictures:
            loads.append(
                check_asset(predicted["image_to_object"], out / "assets" / f"{k:03d}-{test.family}")
            )
            write_comparison(
                out / "pictures" / f"{k:03d}-{test.family}.png", test.image, test.obj, predicted
            )
    extra = {
        "count": count,
        "unseen": unseen,
        "checkpoint": str(checkpoint),
        "structure_iou": float(np.mean(overlaps)),
        "assets": {
            name: float(np.mean([load[name] for load in loads])) for name in (loads or [{}])[0]
        },
    }
    return write_results(out, list(rows.values()), extra)


def predict_all(
    pipeline: Pipeline,
    test: HeldOut,
    seed: int,
    retrieve: Callable[[np.ndarray], ArticulatedObject] | None,
) -> tuple[dict[str, ArticulatedObject], float]:
    """The object of every station, and the IoU of the sampled structure with the true one."""
    predicted = {"representation": assemble(test.grid.gather())}
    coords = test.grid.coords
    build = functools.partial(assemble, tolerance=NETWORK_TOLERANCE)
    predicted["vae"] = build(pipeline.decode([coords], [pipeline.encode_voxels(test.grid)])[0])
    pixels = pipeline.prepare(test.image)
    condition = pipeline.encode_images(pixels[None])
    keys = jax.random.split(jax.random.key(seed))
    latent = pipeline.sample_latents([coords], condition, keys[1])[0]
    predicted["latent_flow"] = build(pipeline.decode([coords], [latent])[0])
    found = pipeline.sample_structure(condition, keys[0])[0]
    if len(found) == 0:  # a failure counts: an object of one speck
        found = np.array([[pipeline.config.model.grid.resolution // 2] * 3], np.int32)
    latent = pipeline.sample_latents([found], condition, keys[1])[0]
    predicted["image_to_object"] = build(pipeline.decode([found], [latent])[0])
    if retrieve is not None:
        predicted["retrieval"] = retrieve(pixels)
    dense = [occupancy(c, test.grid.resolution) for c in (found, coords)]
    return predicted, float((dense[0] & dense[1]).sum() / (dense[0] | dense[1]).sum())


def check_asset(obj: ArticulatedObject, folder: Path) -> dict[str, bool]:
    """Write an object as an asset and open it as its users do: yourdfpy, and MuJoCo where it is installed; all parts closed."""
    import yourdfpy

    obj.save(folder, overwrite=True, motion=False)
    found = {"watertight": all(part.mesh.is_watertight for part in obj.parts)}
    path = str(folder / "object.urdf")
    openers: dict[str, Callable[[], Any]] = {"yourdfpy": lambda: yourdfpy.URDF.load(path)}
    if importlib.util.find_spec("mujoco"):
        mujoco = importlib.import_module("mujoco")
        openers["mujoco"] = lambda: mujoco.MjModel.from_xml_path(path)
    for name, opener in openers.items():
        try:
            opener()
            found[name] = True
        except Exception as error:  # whatever a foreign loader raises is a failure to be counted
            console.print(f"{folder.name}: {name} refused it ({error})")
            found[name] = False
    return found


def make_retrieval(pipeline: Pipeline, records: Path) -> Callable[[np.ndarray], ArticulatedObject]:
    """Image [S, S, 3] in [0, 1] -> object of the training record whose image is nearest by cosine of its features.

    The features are the model's own image encoder's: pre-trained on joints and boxes, hence as strong a retriever as we have. Its volume is
    averaged over cubes of 2^3 cells and the index kept in half precision: 25 KB a view.
    """
    table, source = load_image_table(records, pipeline.config.model), RecordSource(records)
    views = table.images.reshape(-1, *table.images.shape[2:])

    def features(images: np.ndarray) -> np.ndarray:
        condition = pipeline.encode_images(images)
        tokens = np.asarray(condition.tokens).reshape(len(images), -1)
        volume = np.asarray(condition.volume)
        items, side, channels = len(volume), volume.shape[1] // 2, volume.shape[-1]
        pooled = volume.reshape(items, side, 2, side, 2, side, 2, channels).mean((2, 4, 6))
        return np.concatenate([unit(tokens), unit(pooled.reshape(items, -1))], -1)

    index: np.ndarray | None = None
    for start in track(
        range(0, len(views), 32), "retrieval index", console=console, transient=True
    ):
        chunk = views[start : start + 32]
        padded = np.zeros((32, *views.shape[1:]), np.float32)
        padded[: len(chunk)] = chunk / np.float32(255)
        rows = features(padded)[: len(chunk)]
        if index is None:
            index = np.zeros((len(views), rows.shape[1]), np.float16)
        index[start : start + len(chunk)] = rows
    assert index is not None
    parts = np.array_split(index, max(1, len(index) // 4096))

    def retrieve(pixels: np.ndarray) -> ArticulatedObject:
        query = features(pixels[None])[0]
        nearest = int(np.argmax(np.concatenate([p.astype(np.float32) @ query for p in parts])))
        return object_of_record(source[nearest // table.images.shape[1]])

    return retrieve


def unit(x: np.ndarray) -> np.ndarray:
    """Rows [n, d] at length 1."""
    return x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9)


def without_nan(value: Any) -> Any:
    """Nested dictionaries of figures with NaN as None: JSON has no NaN."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_results(out: Path, rows: list[Row], extra: dict[str, Any]) -> dict[str, Any]:
    """``metrics.json`` (all figures, also per family) and ``table.md``; prints the table. Returns what metrics.json holds."""
    families = sorted(set(rows[0].families))
    results: dict[str, Any] = {
        **extra,
        "rows": {row.name: row.summary() for row in rows},
        "families": {f: {row.name: row.summary(f) for row in rows} for f in families},
    }
    out.mkdir(parents=True, exist_ok=True)
    (out / "metrics.json").write_text(json.dumps(without_nan(results), indent=2) + "\n")
    header = ["", *COLUMNS.values()]
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    table = Table(*header)
    for row in rows:
        cells = [f"{results['rows'][row.name][key]:.3f}" for key in COLUMNS]
        table.add_row(row.name, *cells)
        lines.append("| " + " | ".join([row.name, *cells]) + " |")
    if "structure_iou" in extra:
        lines += ["", f"Structure IoU {extra['structure_iou']:.3f} over {extra['count']} objects."]
        if extra["assets"]:
            shares = ", ".join(f"{name} {share:.0%}" for name, share in extra["assets"].items())
            lines += [f"Assets written and opened again: {shares}."]
    (out / "table.md").write_text("\n".join(lines) + "\n")
    console.print(table)
    if "structure_iou" in extra:
        console.print(f"structure IoU {extra['structure_iou']:.3f}")
    return results
