"""Objects put together from what is there already: the methods that generation is measured against.

Retrieval of parts, as the paper formulates it (its section 3): a target says each part's box b,
label c and joint; of the library's parts with that label, ``D_c``, the one whose box is nearest in
size is aligned to b,

    M = argmin over i in D_c of d_size(box(M_i), b),        d_size(s, b) = |log(s_x / b_x)| + |log(s_y / b_y)| + |log(s_z / b_z)|

and the parts together, with the target's tree and joints, are the object. The paper leaves d_size
and the alignment unsaid: this distance is how far the part has to be stretched, and since every
object of the library and every target is upright with its front at -x, to align is to move and to
stretch along the three axes. Where the target has no label, or one that the library lacks, D_c
holds all parts.

Retrieval of whole objects: the one whose picture is nearest, of training records
(``make_retrieval``) or of a library of assets (``make_asset_retrieval``).
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh

from uniart_jax import procedural
from uniart_jax.data.folder import read_manifest
from uniart_jax.data.image_table import load_image_table
from uniart_jax.data.images import PICTURE_SIDE
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.library import VIEWS, Asset, good_ones, library_pictures
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.reconstruction import object_of_record
from uniart_jax.evaluation.runner import run, run_or_reason
from uniart_jax.objects.object import ArticulatedObject, moved_mesh
from uniart_jax.pipeline import Pipeline
from uniart_jax.runtime.progress import track

LIBRARY_OBJECTS = 2_000
THINNEST = 1e-3  # object units: a box's side counts as no thinner, so that sheets have a size
Source = tuple[str, int] | Asset  # family and seed of a procedural object, or an asset


@dataclasses.dataclass(frozen=True)
class PartLibrary:
    """Parts of procedural training objects, or of assets, at rest, by size and label; their meshes
    are made or read again when they are asked for.

    Attributes:
      sizes: [N, 3] sides of the parts' boxes; the whole object's longest side is 1.
      labels: [N] ``Part.label``.
      places: [N] the object, and the part's index in it.
    """

    sizes: np.ndarray
    labels: np.ndarray
    places: tuple[tuple[Source, int], ...]

    def mesh(self, index: int) -> trimesh.Trimesh:
        """The part's surface with its own materials, in its own object's frame."""
        source, k = self.places[index]
        return _object_at_rest(source).parts[k].mesh

    def nearest(self, size: np.ndarray, label: str = "") -> int:
        """Index of the part of that label whose box [3] is nearest; of any label if there is none,
        the first of several equals."""
        distance = np.abs(np.log(_thick(self.sizes)) - np.log(_thick(size))).sum(-1)
        same = self.labels == label
        if label and same.any():
            distance = np.where(same, distance, np.inf)
        return int(np.argmin(distance))


def training_objects(count: int = LIBRARY_OBJECTS) -> list[tuple[str, int]]:
    """The first ``count`` objects of what ``uniart prepare procedural`` makes."""
    families = procedural.SEEN_FAMILIES
    return [(families[seed % len(families)], seed) for seed in range(count)]


def make_asset_library(assets: Sequence[Asset], processes: int = 1) -> PartLibrary:
    """The library of these assets' parts, read by ``processes`` workers. What cannot be read is
    told and left out.

    Raises:
      ValueError: no asset can be read.
    """
    made = run_or_reason(_sizes_and_labels, assets, "part library", processes=processes)
    return _library(list(good_ones(assets, made)))


def make_library(sources: Sequence[tuple[str, int]], processes: int = 1) -> PartLibrary:
    """The library of these procedural objects' parts, made by ``processes`` workers.

    Raises:
      ValueError: no objects, or held-out ones.
    """
    if not sources:
        raise ValueError("library: it has no objects; give at least one")
    if (last := max(seed for _, seed in sources)) >= procedural.HELD_OUT_SEED:
        raise ValueError(
            f"library: it holds held-out objects (seed {last}); give seeds below "
            f"{procedural.HELD_OUT_SEED}"
        )
    made = run(_sizes_and_labels, sources, "part library", processes=processes)
    return _library(list(zip(sources, made, strict=True)))


def _library(found: Sequence[tuple[Source, tuple[np.ndarray, np.ndarray]]]) -> PartLibrary:
    return PartLibrary(
        np.concatenate([sizes for _, (sizes, _) in found]),
        np.concatenate([labels for _, (_, labels) in found]),
        tuple((source, k) for source, (sizes, _) in found for k in range(len(sizes))),
    )


def retrieve_parts(target: ArticulatedObject, library: PartLibrary) -> ArticulatedObject:
    """The target with every part's mesh replaced by the library's nearest, in the target's boxes;
    tree, joints, names and labels kept.

    Args:
      target: from ``at_rest``: only its boxes, labels, tree and joints are looked at.
    """
    parts = []
    for part in target.parts:
        box = part.box
        mesh = library.mesh(library.nearest(box[3:], part.label))
        parts.append(dataclasses.replace(part, mesh=fit_to_box(mesh, box)))
    return dataclasses.replace(target, parts=tuple(parts))


def fit_to_box(mesh: trimesh.Trimesh, box: np.ndarray) -> trimesh.Trimesh:
    """A copy moved and stretched along the axes into ``box`` [6] (centre, size); what is thinner
    than ``THINNEST`` is not stretched across."""
    lo, hi = mesh.bounds
    stretch = _thick(box[3:]) / _thick(hi - lo)
    matrix = np.diag([*stretch, 1.0])
    matrix[:3, 3] = box[:3] - stretch * (lo + hi) / 2
    return moved_mesh(mesh, matrix)


def _thick(sizes: np.ndarray) -> np.ndarray:
    return np.maximum(sizes, THINNEST)


@functools.lru_cache(maxsize=64)
def _object_at_rest(source: Source) -> ArticulatedObject:
    return _at_rest(source)


def _at_rest(source: Source) -> ArticulatedObject:
    return source.at_rest() if isinstance(source, Asset) else at_rest(procedural.generate(*source))


def _sizes_and_labels(source: Source) -> tuple[np.ndarray, np.ndarray]:
    obj = _at_rest(source)
    return obj.boxes[:, 3:], np.array([part.label for part in obj.parts])


def make_retrieval(
    pipeline: Pipeline, records: Path, first_seed: int = procedural.HELD_OUT_SEED
) -> Callable[[np.ndarray], ArticulatedObject]:
    """Image [S, S, 3] in [0, 1] -> object of the training record whose image is nearest by cosine
    of its features.

    The features are the model's own image encoder's: pre-trained on joints and boxes, hence as
    strong a retriever as we have. Its volume is averaged over cubes of 2^3 cells and the index kept
    in half precision: 25 KB a view. ``first_seed``: of the objects under test; records must end
    before it, lest an object is found itself.
    """
    if (last := largest_seed(records)) >= min(first_seed, procedural.HELD_OUT_SEED):
        kind = "held-out" if last >= procedural.HELD_OUT_SEED else "validation"
        raise ValueError(
            f"{records}: holds {kind} objects (seed {last}); give the records that the "
            "checkpoint was trained on"
        )
    model, split = pipeline.config.model, pipeline.config.data.split
    table, source = load_image_table(records, model, split), RecordSource(records, split)
    nearest = _nearest_view(pipeline, table.images.reshape(-1, *table.images.shape[2:]))
    views = table.images.shape[1]

    def retrieve(pixels: np.ndarray) -> ArticulatedObject:
        return object_of_record(source[nearest(pixels) // views])

    return retrieve


def make_asset_retrieval(
    pipeline: Pipeline, assets: Sequence[Asset], cache: Path, processes: int = 1
) -> Callable[[np.ndarray], Asset]:
    """Image [S, S, 3] in [0, 1] -> the asset of a library one of whose pictures is nearest, by the
    same features as ``make_retrieval``.

    Args:
      cache: keeps the assets' pictures (``library.library_pictures``).

    Raises:
      ValueError: no asset can be shown.
    """
    size = max(PICTURE_SIDE, pipeline.config.model.image_encoder.image_size)
    shown, crops = [], []
    for asset, pictures in library_pictures(assets, cache, size, processes):
        shown.append(asset)
        crops += [np.round(pipeline.prepare(p) * 255).astype(np.uint8) for p in pictures]
    nearest = _nearest_view(pipeline, np.stack(crops))
    return lambda pixels: shown[nearest(pixels) // VIEWS]


def _nearest_view(pipeline: Pipeline, views: np.ndarray) -> Callable[[np.ndarray], int]:
    """Image [S, S, 3] in [0, 1] -> index of the nearest of ``views`` [N, S, S, 3] uint8."""

    def features(images: np.ndarray) -> np.ndarray:
        condition = pipeline.encode_images(images)
        tokens = np.asarray(condition.tokens).reshape(len(images), -1)
        volume = np.asarray(condition.volume)
        items, side, channels = len(volume), volume.shape[1] // 2, volume.shape[-1]
        pooled = volume.reshape(items, side, 2, side, 2, side, 2, channels).mean((2, 4, 6))
        return np.concatenate([unit(tokens), unit(pooled.reshape(items, -1))], -1)

    index: np.ndarray | None = None
    starts = range(0, len(views), 32)
    for start in track(starts, "retrieval index", len(starts), unit="batches"):
        chunk = views[start : start + 32]
        padded = np.zeros((32, *views.shape[1:]), np.float32)
        padded[: len(chunk)] = chunk / np.float32(255)
        rows = features(padded)[: len(chunk)]
        if index is None:
            index = np.zeros((len(views), rows.shape[1]), np.float16)
        index[start : start + len(chunk)] = rows
    assert index is not None
    parts = np.array_split(index, max(1, len(index) // 4096))

    def nearest(pixels: np.ndarray) -> int:
        query = features(pixels[None])[0]
        return int(np.argmax(np.concatenate([p.astype(np.float32) @ query for p in parts])))

    return nearest


def largest_seed(records: Path) -> int:
    """Of all objects in a folder that ``uniart prepare`` made; 0 for other records."""
    if not (Path(records) / "manifest.csv").is_file():
        return 0
    return max((int(row["seed"] or 0) for row in read_manifest(records)), default=0)


def unit(x: np.ndarray) -> np.ndarray:
    """Rows [n, d] at length 1."""
    return x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9)
