"""What an arm is worth: its networks at one station of the road, on held-out objects, by the figures of ``uniart evaluate``.

vae            the truth's voxels -> UniArt VAE -> object
structure      image -> active voxels
latent_flow    image and the truth's active voxels -> object
object         image -> object
"""

from __future__ import annotations

import dataclasses
import functools
import gc
import importlib
from pathlib import Path

import jax
import numpy as np

from uniart_jax.config import ModelConfig
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.kept import keep, read_kept, without_nan
from uniart_jax.evaluation.metric import Figures, Metric, at_rest
from uniart_jax.evaluation.procedural import HeldOut, held_out
from uniart_jax.evaluation.reconstruction import object_of_record
from uniart_jax.experiments.design import Arm, Objects, Station
from uniart_jax.models.network import build
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import Pipeline, checkpoint_folder
from uniart_jax.procedural import HELD_OUT_SEED, SEEN_FAMILIES, UNSEEN_FAMILIES, generate
from uniart_jax.progress import track
from uniart_jax.render import render, sample_camera
from uniart_jax.samplers import Condition, join_views
from uniart_jax.training.export import load_network, read_config, read_statistics
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.grid import occupancy
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE

NEEDS: dict[Station, tuple[str, ...]] = {
    "vae": ("uniart_vae",),
    "structure": ("image_encoder", "structure_vae", "structure_flow"),
    "latent_flow": ("image_encoder", "uniart_vae", "latent_flow"),
    "object": ("image_encoder", "structure_vae", "uniart_vae", "structure_flow", "latent_flow"),
}
FAMILIES = ("surface", "articulation", "pose_error", "appearance")
METRICS: dict[str, Metric] = {
    "structure_iou": Metric(
        "structure IoU", "higher", 0.0, "overlap of the sampled active voxels with the true ones"
    ),
    **{
        name: metric
        for family in FAMILIES
        for name, metric in importlib.import_module(
            f"uniart_jax.evaluation.{family}"
        ).METRICS.items()
    },
}
SEARCHED = 40  # objects looked through for one that has a joint of the wanted type


@dataclasses.dataclass(frozen=True)
class Test:
    """A test object as an arm sees it.

    Attributes:
      truth: the object, its voxels and its first image. images: all that are shown, [S, S, 4] uint8.
      features: of its voxels, where the model reads them.
    """

    truth: HeldOut
    images: list[np.ndarray]
    features: dict[str, np.ndarray]


def judge(arm: Arm, checkpoint: Path, seed: int, folder: Path, count: int) -> None:
    """The figures of ``count`` test objects, each in ``folder/<object>.json`` as soon as it is known; those that lie there are kept.

    Args:
      seed: of the noise of sampling, with the object's number.

    Raises:
      FileNotFoundError, ValueError: the checkpoint lacks a network that the station needs, or it is not trained.
    """
    names = test_names(arm.tests, count)
    missing = [k for k, name in enumerate(names) if read_kept(folder / f"{name}.json") is None]
    if not missing:
        return
    pipeline = load_networks(checkpoint, NEEDS[arm.station])
    for k in track(missing, "judging", len(missing)):
        gc.collect()  # meshes hold themselves in cycles
        test = test_object(arm, names[k], pipeline.config.model)
        figures, failure = measure(arm, pipeline, test, seed * 10_000 + k)
        keep(folder / f"{names[k]}.json", {"figures": without_nan(figures), "failure": failure})


def load_networks(checkpoint: Path, networks: tuple[str, ...]) -> Pipeline:
    """A pipeline of some networks of a checkpoint.

    Raises:
      FileNotFoundError, ValueError: as ``training.export.load_network``, or one of them is not trained.
    """
    folder = checkpoint_folder(checkpoint)
    config = read_config(folder)
    if left := [mark for mark in config.untrained if mark.split(".")[0] in networks]:
        raise ValueError(f"checkpoint '{folder}': not trained yet ({', '.join(left[:3])})")
    parameters = {n: load_network(folder, n, build(n, config.model).abstract()) for n in networks}
    flows = [n.removesuffix("_flow") for n in networks if n.endswith("_flow")]
    statistics = {name: read_statistics(folder, name) for name in flows}
    return Pipeline(config, parameters, statistics, folder)


def measure(arm: Arm, pipeline: Pipeline, test: Test, seed: int) -> tuple[Figures, str]:
    """What the networks make of one object, against the truth; and why it is nothing, "" if it is something."""
    truth = test.truth
    if arm.station == "structure":
        found = pipeline.sample_structure(look(pipeline, test), jax.random.key(seed))[0]
        dense = [occupancy(c, truth.grid.resolution) for c in (found, truth.grid.coords)]
        overlap = (dense[0] & dense[1]).sum() / (dense[0] | dense[1]).sum()
        return {"structure_iou": float(overlap)}, ""
    if arm.station == "object":
        try:
            made = pipeline(test.images, seed=seed)
        except ValueError as error:  # nothing was found in the image: a failure that counts
            worst = {key: metric.worst for key, metric in METRICS.items() if key != "structure_iou"}
            return worst, str(error)
    else:
        made = make_object(arm.station, pipeline, test, seed)
    pred, ref = at_rest(made), at_rest(truth.obj)
    figures: Figures = {}
    for family in FAMILIES:
        figures |= importlib.import_module(f"uniart_jax.evaluation.{family}").measure(pred, ref)
    return figures, ""


def make_object(station: Station, pipeline: Pipeline, test: Test, seed: int) -> ArticulatedObject:
    """The object of a station that is given the true active voxels: "vae" or "latent_flow"."""
    grid = test.truth.grid
    if station == "vae":
        latent = pipeline.encode_voxels(grid, **test.features)
        return assemble(pipeline.decode([grid.coords], [latent])[0], tolerance=NETWORK_TOLERANCE)
    condition, key = look(pipeline, test), jax.random.key(seed)
    latent = pipeline.sample_latents([grid.coords], condition, key)[0]
    return assemble(pipeline.decode_sampled(grid.coords, latent), tolerance=NETWORK_TOLERANCE)


def look(pipeline: Pipeline, test: Test) -> Condition:
    """The condition that the images of an object make."""
    pixels = [pipeline.prepare(image) for image in test.images]
    return join_views(pipeline.encode_images(np.stack(pixels)))


@functools.lru_cache
def test_names(tests: Objects, count: int) -> tuple[str, ...]:
    """The first ``count`` test objects by name: their number, and their family where they are procedural.

    Raises:
      ValueError: of ``SEARCHED`` objects in a row none has a joint of the wanted type.
    """
    if tests.records:
        number = len(RecordSource(tests.records, tests.split))
        return tuple(f"{k:04d}" for k in range(min(count, number)))
    families = UNSEEN_FAMILIES if tests.unseen else SEEN_FAMILIES
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
            raise ValueError(f"experiment: {SEARCHED} test objects in a row have no joint of type '{tests.joint_type}'")  # fmt: skip
    return tuple(names)


def test_object(arm: Arm, name: str, model: ModelConfig) -> Test:
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
            raise ValueError(f"{tests.records}: a record has {len(images)} images, {arm.views} are shown")  # fmt: skip
        obj, family = object_of_record(record), str(record.meta.get("category", ""))
        truth = HeldOut(family, index, obj, record.grid(), images[0])
        return Test(truth, images, {c: getattr(record, c).astype(np.float32) for c in columns})
    truth = held_out(
        index,
        unseen=tests.unseen,
        resolution=model.grid.resolution,
        subdivisions=model.grid.subdivisions,
        image_size=model.image_encoder.image_size,
    )
    return Test(truth, views_of(truth, arm.views), {})


def views_of(truth: HeldOut, number: int) -> list[np.ndarray]:
    """``number`` images [S, S, 4] of one test object: its own, and others by cameras drawn as that was."""
    rng = np.random.default_rng([truth.seed, 2])
    images, size = [truth.image], truth.image.shape[0]
    while len(images) < number:
        picture = render(truth.obj, sample_camera(rng), size=size, samples=4)
        images.append(np.round(picture * 255).astype(np.uint8))
    return images
