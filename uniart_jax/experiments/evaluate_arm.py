"""What an arm is worth: its networks at one pipeline stage, on held-out objects, by the
figures of ``uniart evaluate``.

vae            the truth's voxels -> UniArt VAE -> object
structure      image -> active voxels
latent_flow    image and the truth's active voxels -> object
object         image -> object

What cannot be made or measured of one object counts with the worst values, and says why; where the
truth itself is at fault, the object counts for no arm. The others go on. Only what speaks of the
machine stops: memory, files, the device.
"""

from __future__ import annotations

import dataclasses
import functools
import gc
import math
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import LatentSampleConfig, ModelConfig, StructureSampleConfig
from uniart_jax.data.folder import read_manifest
from uniart_jax.data.geometric_features import CHANNELS as GEOMETRIC_CHANNELS
from uniart_jax.data.geometric_features import geometric_features
from uniart_jax.data.records import RecordSource, from_object, split_places
from uniart_jax.evaluation.families import FAMILIES as ALL_FAMILIES
from uniart_jax.evaluation.families import Posed, family_module, measure_families, posed
from uniart_jax.evaluation.metric import Figures, Metric
from uniart_jax.evaluation.procedural import HeldOut, held_out_for, split_families
from uniart_jax.evaluation.reconstruction import object_of_record
from uniart_jax.evaluation.result_store import ResultStore, without_nan
from uniart_jax.evaluation.runner import error_line, run
from uniart_jax.experiments.design import Arm, Objects, PipelineStage
from uniart_jax.inference.mirror_average import (
    ImageConditions,
    encode_views,
    find_grid,
    find_voxels,
)
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import Pipeline
from uniart_jax.procedural import HELD_OUT_SEED, generate
from uniart_jax.visual.render import render, sample_camera
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.grid import occupancy
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE
from uniart_jax.voxels.layout import Layout

NEEDS: dict[PipelineStage, tuple[str, ...]] = {
    "vae": ("uniart_vae",),
    "structure": ("image_encoder", "structure_vae", "structure_flow"),
    "latent_flow": ("image_encoder", "uniart_vae", "latent_flow"),
    "object": ("image_encoder", "structure_vae", "uniart_vae", "structure_flow", "latent_flow"),
}
JUDGED = ("surface", "articulation", "pose_error", "appearance")
FAMILIES = {name: ALL_FAMILIES[name] for name in JUDGED}
METRICS: dict[str, Metric] = {
    "structure_iou": Metric(
        "structure IoU", "higher", 0.0, "overlap of the sampled active voxels with the true ones"
    ),
    "velocities": Metric(
        "network calls",
        "lower",
        math.nan,
        "velocities that the flows of the pipeline stage were asked for, together",
    ),
    **{
        name: metric
        for family in FAMILIES
        for name, metric in family_module(family).METRICS.items()
    },
}
MACHINE = (MemoryError, OSError, jax.errors.JaxRuntimeError)  # no network's failures
TRUTH = "the truth: "  # what a failure begins with that is no arm's
SEARCHED = 40  # objects looked through for one that has a joint of the wanted type


@dataclasses.dataclass(frozen=True)
class TestObject:
    """A test object as an arm sees it.

    Attributes:
      truth: the object, its voxels and its first image. images: all that are shown, [S, S, 4]
        uint8.
      features: of its voxels, where the model reads them.
    """

    truth: HeldOut
    images: list[np.ndarray]
    features: dict[str, np.ndarray]


def evaluate_arm(arm: Arm, checkpoint: Path, seed: int, folder: Path, count: int) -> None:
    """The figures of ``count`` test objects, each in ``folder/<object>.json`` as soon as it is
    known; those that lie there are kept.

    Args:
      seed: of the noise of sampling, with the object's number.

    Raises:
      FileNotFoundError, ValueError: the checkpoint lacks a network that the pipeline stage
        needs, or the network is not trained.
    """
    networks = functools.cache(lambda: load_networks(checkpoint, NEEDS[arm.pipeline_stage]))
    tests = list(enumerate(test_names(arm.tests, count)))

    def evaluate_one(place: tuple[int, str]) -> dict[str, Any]:
        k, name = place
        pipeline = networks()
        gc.collect()  # meshes hold themselves in cycles
        begin = time.perf_counter()
        try:
            test = test_object(arm, name, pipeline.config.model)
            posed(test.truth.obj)
        except MACHINE:
            raise
        except Exception as error:
            figures = dict.fromkeys(figure_names(arm.pipeline_stage), math.nan)
            failure = TRUTH + error_line(error)
        else:
            figures, failure = measure(arm, pipeline, test, seed * 10_000 + k)
        seconds = time.perf_counter() - begin
        return {"figures": without_nan(figures), "failure": failure, "seconds": seconds}

    store = ResultStore[tuple[int, str]](lambda place: folder / f"{place[1]}.json")
    list(run(evaluate_one, tests, "judging", store=store))


def load_networks(checkpoint: Path, networks: tuple[str, ...]) -> Pipeline:
    """A pipeline of some networks of a checkpoint.

    Raises:
      FileNotFoundError, ValueError: as ``Pipeline.of``, or one of them is not
        trained.
    """
    found = Checkpoint.find(checkpoint)
    if left := found.untrained(networks):
        raise ValueError(f"checkpoint '{found.folder}': not trained yet ({', '.join(left[:3])})")
    return Pipeline.of(found, networks)


@functools.lru_cache
def parameter_count(model: ModelConfig, stage: PipelineStage) -> int:
    """Of the networks that a pipeline stage runs."""
    leaves = [leaf for n in NEEDS[stage] for leaf in jax.tree.leaves(build(n, model).abstract())]
    return sum(math.prod(leaf.shape) for leaf in leaves)


def measure(arm: Arm, pipeline: Pipeline, test: TestObject, seed: int) -> tuple[Figures, str]:
    """What the networks make of one object, against the truth; and what failed of it, "" if nothing
    did.

    Raises:
      OSError, MemoryError, JaxRuntimeError: the machine is at fault.
    """
    ref = posed(test.truth.obj)
    try:
        if arm.pipeline_stage == "structure":
            return structure_overlap(arm, pipeline, test, seed), ""
        made, velocities = make_object(arm, pipeline, test, seed)
        pred = posed(made)
    except MACHINE:
        raise
    except Exception as error:  # one object must not cost the figures of all others
        if arm.pipeline_stage == "structure":
            missed = {name: METRICS[name].worst for name in figure_names(arm.pipeline_stage)}
            return missed, error_line(error)
        figures: Figures = {} if arm.pipeline_stage == "vae" else {"velocities": math.nan}
        for family in FAMILIES:
            figures |= worst(family, ref)
        return figures, error_line(error)
    found = measure_families(FAMILIES, pred, ref)
    figures = {} if velocities is None else {"velocities": velocities}
    figures |= found.figures
    for family, error in found.errors.items():
        if isinstance(error, MACHINE):
            raise error
        figures |= worst(family, ref)
    return figures, "; ".join(f"{name}: {error_line(e)}" for name, e in found.errors.items())


def worst(family: str, ref: Posed) -> Figures:
    """A family's worst values, and NaN where the truth has nothing to compare, as for every other
    prediction."""
    own = measure_families({family: FAMILIES[family]}, ref, ref)
    for error in own.errors.values():  # of the truth itself: nothing tells what there is to compare
        if isinstance(error, MACHINE):
            raise error
    metrics = family_module(family).METRICS
    return {
        n: math.nan if math.isnan(own.figures.get(n, 0.0)) else m.worst for n, m in metrics.items()
    }


def figure_names(stage: PipelineStage) -> list[str]:
    """Those that a pipeline stage is judged by."""
    if stage == "structure":
        return ["structure_iou", "velocities"]
    return [
        n
        for n in METRICS
        if n not in ("structure_iou", *(("velocities",) if stage == "vae" else ()))
    ]


def structure_overlap(arm: Arm, pipeline: Pipeline, test: TestObject, seed: int) -> Figures:
    """Of the sampled active voxels with the true ones."""
    grid, options = test.truth.grid, pipeline.options(**arm.sampling)
    conditions, _ = encode_test(pipeline, test, options)
    found, solution = find_voxels(pipeline, conditions, jax.random.key(seed), options[0])
    one, other = (occupancy(c, grid.resolution) for c in (found, grid.coords))
    iou = float((one & other).sum() / (one | other).sum())
    return {"structure_iou": iou, "velocities": float(solution.evaluations[0])}


def make_object(
    arm: Arm, pipeline: Pipeline, test: TestObject, seed: int
) -> tuple[ArticulatedObject, float | None]:
    """The object that an arm's pipeline stage makes, and the velocities that it took; None where
    nothing is sampled.

    Raises:
      ValueError: nothing was found in the image.
    """
    if arm.pipeline_stage == "object":
        sample = pipeline.sample(test.images, seed=seed, **arm.sampling)
        return sample.obj, float(sum(sample.evaluations.values()))
    grid = test.truth.grid
    if arm.pipeline_stage == "vae":
        latent = pipeline.encode_voxels(grid, **test.features)
        sees = pipeline.config.model.uniart_vae.layout_channels > 0
        layout = pipeline.layout_or_none(test.images[0]) if sees else None
        out = pipeline.decode([grid.coords], [latent], [layout])[0]
        if layout is not None:
            return assemble_layout(out, layout), None
        return assemble(out, tolerance=NETWORK_TOLERANCE), None
    options = pipeline.options(**arm.sampling)
    conditions, layout = encode_test(pipeline, test, options)
    key = jax.random.key(seed)
    sampled, solution = find_grid(pipeline, grid.coords, conditions, key, options[1], layout)
    if layout is not None:
        return assemble_layout(sampled, layout), float(solution.evaluations[0])
    obj = assemble(sampled, tolerance=NETWORK_TOLERANCE)
    return obj, float(solution.evaluations[0])


def encode_test(
    pipeline: Pipeline,
    test: TestObject,
    options: tuple[StructureSampleConfig, LatentSampleConfig],
) -> tuple[ImageConditions, Layout | None]:
    """What the flows see of an object's images, and the layout of the first, which flows that see
    layouts are given."""
    pixels = np.stack([pipeline.prepare(image) for image in test.images])
    layout = pipeline.layout_or_none(test.images[0])
    return encode_views(pipeline, pixels, layout, *options), layout


@functools.lru_cache
def test_names(tests: Objects, count: int) -> tuple[str, ...]:
    """The first ``count`` test objects by name, fewer if there are no more: their number, and their
    family where they are procedural.

    Raises:
      FileNotFoundError, ValueError: the records are not complete or have no such split; or of
        ``SEARCHED`` objects in a row none has a joint of the wanted type.
    """
    if tests.records:
        return record_names(tests.records, tests.split, count)
    families = split_families(tests.unseen)
    names: list[str] = []
    index, last = 0, -1
    while len(names) < count:
        family = families[index % len(families)]
        if not tests.joint_type or tests.joint_type in {
            part.joint.type for part in generate(family, HELD_OUT_SEED + index).parts
        }:
            names.append(f"{index:04d}-{family}")
            last = index
        index += 1
        if index - last > SEARCHED:
            raise ValueError(
                f"experiment: {SEARCHED} test objects in a row have no joint of type "
                f"'{tests.joint_type}'"
            )
    return tuple(names)


def record_names(folder: str, split: str, count: int) -> tuple[str, ...]:
    """The first record of each object of a split, by its number among the records of that split."""
    objects = [row["object"] for row in read_manifest(folder) if not row["error"]]
    places = split_places(folder, split, len(objects)) if split else range(len(objects))
    first: dict[str, int] = {}
    for k, place in enumerate(places):
        first.setdefault(objects[place], k)
    return tuple(f"{k:04d}" for k in list(first.values())[:count])


def test_object(arm: Arm, name: str, model: ModelConfig) -> TestObject:
    """The test object of that name, as the model's grid and image size want it.

    Raises:
      ValueError: a record has fewer images than the arm shows.
    """
    tests, index = arm.tests, int(name.split("-")[0])
    if tests.records:
        columns = tuple(model.uniart_vae.feature_channels)
        record = RecordSource(tests.records, tests.split, columns)[index]
        images = list(record.images[: arm.views])
        if len(images) < arm.views:
            raise ValueError(
                f"{tests.records}: a record has {len(images)} images, {arm.views} are shown; "
                f"prepare it with --views {arm.views}"
            )
        obj, family = object_of_record(record), str(record.meta.get("category", ""))
        truth = HeldOut(family, index, obj, record.grid(), images[0])
        features = {c: getattr(record, c).astype(np.float32) for c in columns}
        return TestObject(truth, images, features)
    truth = held_out_for(model, index, tests.unseen)
    features = features_of(truth, model) if arm.pipeline_stage == "vae" else {}
    return TestObject(truth, views_of(truth, arm.views), features)


def features_of(truth: HeldOut, model: ModelConfig) -> dict[str, np.ndarray]:
    """What a model reads of the voxels of a procedural test object, which has no file of features.

    Raises:
      ValueError: it reads others than geometric part features.
    """
    asked = model.uniart_vae.feature_channels
    if not asked:
        return {}
    if asked != {"part_feature": GEOMETRIC_CHANNELS}:
        raise ValueError(
            f"experiment: of procedural test objects only part features of {GEOMETRIC_CHANNELS} "
            f"channels are known ('geometric'); this model reads {asked}; name records with its "
            "columns (tests.records)"
        )
    images, cameras = truth.image[None], np.zeros((1, 4), np.float32)
    record = from_object(truth.obj, images, cameras, {"id": truth.obj.name}, truth.grid)
    return {"part_feature": geometric_features(record).astype(np.float32)}


def views_of(truth: HeldOut, number: int) -> list[np.ndarray]:
    """``number`` images [S, S, 4] of one test object: its own, and others by cameras drawn as that
    was."""
    rng = np.random.default_rng([truth.seed, 2])
    images, size = [truth.image], truth.image.shape[0]
    while len(images) < number:
        picture = render(truth.obj, sample_camera(rng), size=size, samples=4)
        images.append(np.round(picture * 255).astype(np.uint8))
    return images
