"""Objects put together from what is there already: the methods that generation is measured against.

Retrieval of parts, as the paper formulates it (its section 3): a target says each part's box b, label c and joint; of the library's parts
with that label, ``D_c``, the one whose box is nearest in size is aligned to b,

    M = argmin over i in D_c of d_size(box(M_i), b),        d_size(s, b) = |log(s_x / b_x)| + |log(s_y / b_y)| + |log(s_z / b_z)|

and the parts together, with the target's tree and joints, are the object. The paper leaves d_size and the alignment unsaid: this distance
is how far the part has to be stretched, and since every object of the library and every target is upright with its front at -x, to align
is to move and to stretch along the three axes. Where the target has no label, or one that the library lacks, D_c holds all parts.

Retrieval of whole objects: the one whose picture is nearest, ``make_retrieval``.
"""

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
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.reconstruction import object_of_record
from uniart_jax.objects.object import ArticulatedObject, moved_mesh
from uniart_jax.pipeline import Pipeline
from uniart_jax.processes import in_order, process_pool
from uniart_jax.progress import track

LIBRARY_OBJECTS = 2_000
THINNEST = 1e-3  # object units: a box's side counts as no thinner, so that sheets have a size
Source = tuple[str, int]  # family and seed of a procedural object


@dataclasses.dataclass(frozen=True)
class PartLibrary:
    """Parts of procedural training objects at rest, by size and label; their meshes are made again when they are asked for.

    Attributes:
      sizes: [N, 3] sides of the parts' boxes; the whole object's longest side is 1.
      labels: [N] ``Part.label``.
      places: [N] family, seed and index of the part.
    """

    sizes: np.ndarray
    labels: np.ndarray
    places: tuple[tuple[str, int, int], ...]

    def mesh(self, index: int) -> trimesh.Trimesh:
        """The part's surface with its own materials, in its own object's frame."""
        family, seed, k = self.places[index]
        return _object_at_rest(family, seed).parts[k].mesh

    def nearest(self, size: np.ndarray, label: str = "") -> int:
        """Index of the part of that label whose box [3] is nearest; of any label if there is none, the first of several equals."""
        distance = np.abs(np.log(_thick(self.sizes)) - np.log(_thick(size))).sum(-1)
        same = self.labels == label
        if label and same.any():
            distance = np.where(same, distance, np.inf)
        return int(np.argmin(distance))


def training_objects(count: int = LIBRARY_OBJECTS) -> list[Source]:
    """The first ``count`` objects of what ``uniart prepare procedural`` makes."""
    families = procedural.SEEN_FAMILIES
    return [(families[seed % len(families)], seed) for seed in range(count)]


def make_library(sources: Sequence[Source], processes: int = 1) -> PartLibrary:
    """The library of these objects' parts, made by ``processes`` workers.

    Raises:
      ValueError: no objects, or held-out ones.
    """
    if not sources:
        raise ValueError("library: it has no objects; give at least one")
    if (last := max(seed for _, seed in sources)) >= procedural.HELD_OUT_SEED:
        raise ValueError(
            f"library: it holds held-out objects (seed {last}); give seeds below {procedural.HELD_OUT_SEED}"
        )
    with process_pool(processes) as submit:
        made = in_order(submit, _sizes_and_labels, sources, 64)
        found = list(track(made, "part library", len(sources)))
    return PartLibrary(
        np.concatenate([sizes for sizes, _ in found]),
        np.concatenate([labels for _, labels in found]),
        tuple(
            (*source, k)
            for source, (sizes, _) in zip(sources, found, strict=True)
            for k in range(len(sizes))
        ),
    )


def retrieve_parts(target: ArticulatedObject, library: PartLibrary) -> ArticulatedObject:
    """The target with every part's mesh replaced by the library's nearest, in the target's boxes; tree, joints, names and labels kept.

    Args:
      target: from ``at_rest``: only its boxes, labels, tree and joints are looked at.

    Raises:
      ValueError: a box that is not finite.
    """
    parts = []
    for part in target.parts:
        box = part.box
        if not np.isfinite(box).all():
            raise ValueError(f"retrieval: the box of part '{part.name}' is not finite")
        mesh = library.mesh(library.nearest(box[3:], part.label))
        parts.append(dataclasses.replace(part, mesh=fit_to_box(mesh, box)))
    return dataclasses.replace(target, parts=tuple(parts))


def fit_to_box(mesh: trimesh.Trimesh, box: np.ndarray) -> trimesh.Trimesh:
    """A copy moved and stretched along the axes into ``box`` [6] (centre, size); what is thinner than ``THINNEST`` is not stretched across."""
    lo, hi = mesh.bounds
    stretch = _thick(box[3:]) / _thick(hi - lo)
    matrix = np.diag([*stretch, 1.0])
    matrix[:3, 3] = box[:3] - stretch * (lo + hi) / 2
    return moved_mesh(mesh, matrix)


def _thick(sizes: np.ndarray) -> np.ndarray:
    return np.maximum(sizes, THINNEST)


@functools.lru_cache(maxsize=64)
def _object_at_rest(family: str, seed: int) -> ArticulatedObject:
    return at_rest(procedural.generate(family, seed))


def _sizes_and_labels(source: Source) -> tuple[np.ndarray, np.ndarray]:
    obj = at_rest(procedural.generate(*source))
    return obj.boxes[:, 3:], np.array([part.label for part in obj.parts])


def make_retrieval(pipeline: Pipeline, records: Path) -> Callable[[np.ndarray], ArticulatedObject]:
    """Image [S, S, 3] in [0, 1] -> object of the training record whose image is nearest by cosine of its features.

    The features are the model's own image encoder's: pre-trained on joints and boxes, hence as strong a retriever as we have. Its volume is
    averaged over cubes of 2^3 cells and the index kept in half precision: 25 KB a view.
    """
    if (last := largest_seed(records)) >= procedural.HELD_OUT_SEED:
        raise ValueError(
            f"{records}: holds held-out objects (seed {last}); give the records that the checkpoint was trained on"
        )
    model, split = pipeline.config.model, pipeline.config.data.split
    table, source = load_image_table(records, model, split), RecordSource(records, split)
    views = table.images.reshape(-1, *table.images.shape[2:])

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

    def retrieve(pixels: np.ndarray) -> ArticulatedObject:
        query = features(pixels[None])[0]
        nearest = int(np.argmax(np.concatenate([p.astype(np.float32) @ query for p in parts])))
        return object_of_record(source[nearest // table.images.shape[1]])

    return retrieve


def largest_seed(records: Path) -> int:
    """Of all objects in a folder that ``uniart prepare`` made; 0 for other records."""
    if not (Path(records) / "manifest.csv").is_file():
        return 0
    return max((int(row["seed"] or 0) for row in read_manifest(records)), default=0)


def unit(x: np.ndarray) -> np.ndarray:
    """Rows [n, d] at length 1."""
    return x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9)
