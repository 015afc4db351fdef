"""Records: one object at one shown state with its voxels, parts and rendered views, as bytes and in
ArrayRecord shards.

A record's bytes are a zip of ``.npy`` arrays, stored without compression, plus ``meta.json``:
readable by any numpy, never unpickled. Shards are ArrayRecord files with one record a group (random
access) that compress each record with zstd: a record of 7,000 voxels at r = 4 is 2.3 MB raw and
inflates several times faster than a deflated zip.

Quantisation, and what it costs:

* ``sdf``: int8, 127 = ``SDF_CLIP`` sub-cells. Error at most 3/254 = .012 sub-cells; the sign is
  kept, so negative values above
  -.012 are stored as -.024.
* ``color``: uint8 of the sRGB-encoded value. Error at most 1/510 in sRGB, at most .0045 in linear
  RGB.
"""

from __future__ import annotations

import collections
import csv
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.data.columns import FEATURES, open_column, read_feature
from uniart_jax.data.shards import open_shards, pack_arrays, unpack_arrays
from uniart_jax.data.shards import write_shard as write_shard  # where those who write records look
from uniart_jax.objects.appearance import linear_to_srgb, srgb_to_linear
from uniart_jax.objects.kinematics import topological_order
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.grid import SDF_CLIP, PartGrid

SCHEMA_VERSION = 1
SHARD_PATTERN = "records-*.arrayrecord"

# name -> (dtype, shape); letters bind to one size across the fields, numbers are exact.
_FIELDS: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "coords": ("uint8", ("V", 3)),
    "sdf": ("int8", ("V", "r^3")),
    "color": ("uint8", ("V", "r^3", 3)),
    "owner": ("uint8", ("V", "r^3")),
    "voxel_part": ("uint8", ("V",)),
    "boxes": ("float32", ("K", 6)),
    "codes": ("float32", ("K", 9)),
    "parents": ("int32", ("K",)),
    "images": ("uint8", ("N", "H", "W", 4)),
    "cameras": ("float32", ("N", 4)),
}


@dataclasses.dataclass(frozen=True)
class Record:
    """One object at one shown state, in its stored types.

    Attributes:
      coords: [V, 3] uint8 active voxels, lexicographic order.
      sdf: [V, r^3] int8; ``decode_sdf`` gives sub-cells.
      color: [V, r^3, 3] uint8 sRGB; ``decode_color`` gives linear RGB.
      owner: [V, r^3] uint8 part id of each sub-cell.
      voxel_part: [V] uint8 part that owns most of the voxel's surface.
      boxes: [K, 6] float32 own boxes; codes: [K, 9] float32; parents: [K] int32, the root is its
        own parent.
      images: [N, H, W, 4] uint8 straight-alpha sRGB views of the shown state.
      cameras: [N, 4] float32 azimuth and elevation (radians), field of view (degrees), distance
        (object units).
      meta: schema_version, resolution, subdivisions, joint_types, and what the source says (id,
        category, seed, state).
      visual, part_feature: [V, F], [V, P] float16 of the columns of these names (``data.columns``)
        where ``RecordSource`` is asked for them; never part of the record's own bytes.
    """

    coords: np.ndarray
    sdf: np.ndarray
    color: np.ndarray
    owner: np.ndarray
    voxel_part: np.ndarray
    boxes: np.ndarray
    codes: np.ndarray
    parents: np.ndarray
    images: np.ndarray
    cameras: np.ndarray
    meta: dict[str, Any]
    visual: np.ndarray | None = None
    part_feature: np.ndarray | None = None

    @property
    def resolution(self) -> int:
        return self.meta["resolution"]

    @property
    def subdivisions(self) -> int:
        return self.meta["subdivisions"]

    def grid(self) -> PartGrid:
        """The voxels with decoded distances and colours."""
        return PartGrid(
            self.resolution,
            self.subdivisions,
            self.coords.astype(np.int32),
            decode_sdf(self.sdf),
            decode_color(self.color),
            self.owner,
            self.voxel_part,
            self.boxes,
            self.codes,
            self.parents,
        )


def encode_sdf(sdf: np.ndarray) -> np.ndarray:
    """Distances in sub-cells to int8; values outside +-SDF_CLIP are clipped and negative stays
    negative."""
    scaled = np.clip(np.rint(np.asarray(sdf) * (127 / SDF_CLIP)), -127, 127).astype(np.int8)
    return np.where(sdf < 0, np.minimum(scaled, -1), scaled).astype(np.int8)


def encode_color(linear: np.ndarray) -> np.ndarray:
    """Linear RGB in [0, 1] to sRGB-encoded uint8."""
    return np.rint(linear_to_srgb(linear) * 255).astype(np.uint8)


_SDF_TABLE = (np.arange(256).astype(np.uint8).view(np.int8) * (SDF_CLIP / 127)).astype(np.float32)
_COLOR_TABLE = srgb_to_linear(np.arange(256) / 255).astype(np.float32)


def decode_sdf(sdf: np.ndarray) -> np.ndarray:
    """int8 to float32 sub-cells."""
    return _SDF_TABLE[sdf.view(np.uint8)]


def decode_color(color: np.ndarray) -> np.ndarray:
    """sRGB-encoded uint8 to float32 linear RGB."""
    return _COLOR_TABLE[color]


def from_object(
    obj: ArticulatedObject,
    images: np.ndarray,
    cameras: np.ndarray,
    meta: dict[str, Any],
    grid: PartGrid,
) -> Record:
    """A record of a voxelised object.

    Args:
      obj: the normalised object at its shown state.
      images: [N, H, W, 4] straight-alpha sRGB, float in [0, 1] or uint8.
      cameras: [N, 4] azimuth, elevation, field of view in degrees, distance.
      meta: what the source knows (id, category, seed, state); version, sizes, joint types and scale
        are added here.
      grid: ``voxelize(obj)``.

    Raises:
      ValueError: the grid is finer than 256 voxels a side, or has more than 255 parts.
    """
    if grid.resolution > 256 or len(grid.boxes) > 255:
        raise ValueError(
            f"record: at most 256 voxels a side and 255 parts, got {grid.resolution} and "
            f"{len(grid.boxes)}"
        )
    if images.dtype != np.uint8:
        images = np.rint(np.clip(images, 0, 1) * 255).astype(np.uint8)
    meta = {
        **meta,
        "schema_version": SCHEMA_VERSION,
        "resolution": int(grid.resolution),
        "subdivisions": int(grid.subdivisions),
        "joint_types": [joint.type for joint in obj.joints],
        "scale": float(obj.scale),
    }
    return Record(
        grid.coords.astype(np.uint8),
        encode_sdf(grid.sdf),
        encode_color(grid.color),
        grid.owner.astype(np.uint8),
        grid.voxel_part.astype(np.uint8),
        grid.boxes.astype(np.float32),
        grid.codes.astype(np.float32),
        grid.parents.astype(np.int32),
        images,
        np.asarray(cameras, np.float32).reshape(-1, 4),
        meta,
    )


def to_bytes(record: Record) -> bytes:
    """The record's bytes; ``from_bytes`` gives the same record back exactly."""
    return pack_arrays({key: getattr(record, key) for key in _FIELDS}, record.meta)


def from_bytes(data: bytes) -> Record:
    """A record from its bytes.

    Raises:
      ValueError: damaged bytes, another schema version, missing or extra fields, wrong types or
        shapes, values that are not finite, parents that are no tree, a voxel twice; one line that
        names what differs, and the record's id.
    """
    arrays, meta = unpack_arrays(data)
    version = meta.get("schema_version")
    if version != SCHEMA_VERSION:
        raise ValueError(
            f"record: schema_version is {version}, this version reads {SCHEMA_VERSION}; prepare "
            "the records again"
        )
    problems = [f"{key} missing" for key in _FIELDS if key not in arrays]
    problems += [f"{key} unknown" for key in arrays if key not in _FIELDS]
    sizes: dict[str | int, Any] = {}
    subdivisions = meta.get("subdivisions")
    if isinstance(subdivisions, int):
        sizes["r^3"] = subdivisions**3
    else:
        problems.append("meta.subdivisions missing")
    if not isinstance(meta.get("resolution"), int):
        problems.append("meta.resolution missing")
    for key, (dtype, shape) in _FIELDS.items():
        if key not in arrays:
            continue
        array = arrays[key]
        if array.dtype != dtype:
            problems.append(f"{key} is {array.dtype}, expected {dtype}")
        expected = tuple(sizes.get(axis, axis) for axis in shape)
        matches = array.ndim == len(shape) and all(
            isinstance(size, str) or size == actual
            for size, actual in zip(expected, array.shape, strict=True)
        )
        if not matches:
            problems.append(f"{key} has shape {array.shape}, expected {expected}")
            continue
        sizes.update(
            {axis: n for axis, n in zip(shape, array.shape, strict=True) if axis not in sizes}
        )
    problems = problems or _wrong_values(arrays, meta["resolution"])
    if problems:
        known = f" (id '{meta['id']}')" if isinstance(meta.get("id"), str) else ""
        raise ValueError("record: " + ", ".join(problems) + known)
    return Record(**arrays, meta=meta)


def _wrong_values(arrays: dict[str, np.ndarray], resolution: int) -> list[str]:
    """What is wrong with arrays of the right types and shapes."""
    parts, coords = len(arrays["boxes"]), arrays["coords"]
    problems = [
        f"{key} names a part outside 0..{parts - 1}"
        for key in ("owner", "voxel_part", "parents")
        if arrays[key].size and not 0 <= arrays[key].min() <= arrays[key].max() < parts
    ]
    if coords.size and coords.max() >= resolution:
        problems.append(f"coords lie outside the grid of {resolution}")
    problems += [
        f"{key} hold numbers that are not finite"
        for key in ("boxes", "codes", "cameras")
        if not np.isfinite(arrays[key]).all()
    ]
    place = coords.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], np.int32)
    if not (np.diff(place) > 0).all() and len(np.unique(place)) != len(place):  # mostly sorted
        problems.append("coords hold a voxel twice")
    if not problems:
        above = [-1 if p == k else int(p) for k, p in enumerate(arrays["parents"])]
        try:
            topological_order(above)
        except ValueError as error:
            problems.append(f"parents are no tree ({error})")
    return problems


def shard_paths(folder: str | Path) -> list[Path]:
    """The finished shards of a prepared folder, in order.

    Raises:
      FileNotFoundError: no such folder, or no shards in it.
    """
    folder = Path(folder)
    paths = sorted(folder.glob(SHARD_PATTERN))
    if not paths:
        reason = "no records in it" if folder.is_dir() else "no such folder"
        raise FileNotFoundError(
            f"{folder}: {reason}; make some with: uniart prepare procedural --out {folder} (or "
            "partnet-mobility ROOT, urdf ROOT)"
        )
    return paths


def record_rows(folder: str | Path) -> list[dict[str, str]]:
    """Manifest rows of a folder's records, in their order: of ``manifest.csv``, or of the finished
    shards while ``prepare`` is under way; [] without either."""
    folder = Path(folder)
    paths = [folder / "manifest.csv"]
    if not paths[0].is_file():
        numbers = [path.stem.rpartition("-")[2] for path in shard_paths(folder)]
        paths = [folder / "rows" / f"{number}.csv" for number in numbers]
    rows: list[dict[str, str]] = []
    for path in paths:
        if path.is_file():
            with path.open(newline="") as file:
                rows.extend(row for row in csv.DictReader(file) if not row["error"])
    return rows


class RecordSource:
    """Random access to the records of a prepared folder, or of some of its splits: ``source[i] ->
    Record``. Picklable.

    Attributes:
      places: [n] index of each of them among all records of the folder.
    """

    def __init__(self, folder: str | Path, split: str = "", columns: Sequence[str] = ()):
        """
        Args:
          split: only records of this split, or of several joined by commas, as the manifest says;
            "" = all.
          columns: of ``columns.FEATURES``, read as fields of each record.

        Raises:
          FileNotFoundError: no records. ValueError: no such split or column; one line that says
            what to do.
        """
        if unknown := [name for name in columns if name not in FEATURES]:
            raise ValueError(
                f"records have no column {', '.join(unknown)} that can be joined; there are "
                f"{', '.join(FEATURES)}"
            )
        self._paths = shard_paths(folder)
        self._shards = open_shards(self._paths)
        count = len(self._shards)
        self._columns = {name: open_column(name, self._paths, count) for name in columns}
        self.places = split_places(folder, split, count) if split else np.arange(count)

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> Record:
        place = int(self.places[index])
        data = self._shards[place]
        try:
            record = from_bytes(data)
        except ValueError as error:
            raise ValueError(f"{self._shards.where(place)}: {error}") from None
        name, voxels = record.meta.get("id"), len(record.coords)
        features = {
            key: read_feature(key, items[place], name, voxels)
            for key, items in self._columns.items()
        }
        return dataclasses.replace(record, **features) if features else record

    def __repr__(self) -> str:  # Grain puts it into messages and checkpoints
        return f"RecordSource({len(self)} records in {len(self._paths)} shards)"


def split_places(folder: str | Path, split: str, count: int) -> np.ndarray:
    """Indices of the records of a split, or of several joined by commas.

    Raises:
      ValueError: the manifest does not name all ``count`` records, or none of a split.
    """
    known = [row["split"] for row in record_rows(folder)]
    if len(known) != count:
        raise ValueError(
            f"{folder}: its manifest names {len(known)} records of {count}, so their splits are "
            "unknown; run the same prepare command again to finish it"
        )
    asked = [name.strip() for name in split.split(",")]
    if absent := [name for name in asked if name not in known]:
        held = ", ".join(f"{name} ({n})" for name, n in sorted(collections.Counter(known).items()))
        raise ValueError(f"{folder}: no record of split '{', '.join(absent)}'; it has {held}")
    return np.flatnonzero(np.isin(known, asked))
