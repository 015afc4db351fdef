"""``uniart features``: columns of per-voxel features beside prepared records (``data.columns``), a
pass of its own.

    visual        orbit pictures -> DINOv2 -> patch maps -> read at each voxel's centre -> mean over views     (``models.multiview``)
    part_feature  PartField's files -> nearest point of each voxel                                             (``data.part_features``)
                  or the shape around each voxel, without weights                                      (``data.geometric_features``)

Shard by shard, one record at a time: memory grows neither with the records nor with the views. A
column's shard gets its name when it is complete, so a run may be killed at any moment; run again,
it keeps the finished shards and ends with the same bytes. ``<column>.json`` says what a column is
made from; another source is refused.
"""  # noqa: E501

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from PIL import Image
from safetensors import SafetensorError, safe_open

from uniart_jax.config import ImageEncoderConfig, ModelConfig
from uniart_jax.data.columns import (
    VALUES,
    column_note,
    column_path,
    half,
    open_column,
    read_orbit,
)
from uniart_jax.data.geometric_features import CHANNELS as GEOMETRIC_CHANNELS
from uniart_jax.data.geometric_features import geometric_features
from uniart_jax.data.part_features import (
    CHANNELS,
    input_name,
    on_voxels,
    read_partfield,
    result_digest,
    surface_points,
    write_points,
)
from uniart_jax.data.records import Record, from_bytes, shard_paths
from uniart_jax.data.shards import open_shards, pack_arrays, unpack_arrays, write_shard
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import read_network
from uniart_jax.models.multiview import intrinsic_matrices, multiview_features
from uniart_jax.models.network import Network, Params, build
from uniart_jax.runtime.files import sweep, write_text
from uniart_jax.runtime.progress import advancing
from uniart_jax.visual.render import Camera
from uniart_jax.weights.dinov2 import converted_config

GEOMETRIC = "geometric"  # a source of part features that is no folder
VOXEL_STEP = 4096  # positions are padded to a multiple, so that few shapes are compiled
Columns = Iterator[tuple[Record, np.ndarray]]
Item = TypeVar("Item")
Made = TypeVar("Made")


class Encoder(NamedTuple):
    """A frozen DINOv2: its network, its parameters on the device, and the digest of its file."""

    network: Network
    params: Params
    digest: str

    @property
    def config(self) -> ImageEncoderConfig:
        return self.network.config.image_encoder


def write_visual(
    folder: str | Path,
    weights: str | Path,
    *,
    views: int | None = None,
    batch: int = 8,
    part: tuple[int, int] = (0, 1),
    progress: bool = True,
) -> None:
    """The column ``visual`` of a prepared folder, on whatever device there is.

    Args:
      weights: of ``uniart convert dinov2``: the file, or the checkpoint folder that it stands in.
      views: how many of a record's orbit pictures, spread evenly; None = all.
      batch: pictures that the network reads at a time.
      part: (i, n): of n runs that share the folder, this is number i and makes every n-th shard.

    Raises:
      FileNotFoundError: no records, no weights.
      ValueError: no orbit pictures, fewer than ``views``, other weights than those of an unfinished
        column, a file that is no DINOv2.
    """
    if batch < 1 or (views is not None and views < 1):
        raise ValueError("features: --batch and --views must be at least 1")
    shards = [shard for shard in shard_paths(folder) if not finished(shard, "visual")]
    note_held = _held_note(folder, "visual")
    if shards:  # orbits of those that are done may be gone
        orbit = open_column("orbit", shards, len(open_shards(shards)))
        if not len(orbit):
            raise ValueError(f"{folder}: its shards are empty; see the errors in its manifest.csv")
        held = len(unpack_arrays(orbit[0], "column 'orbit'")[0].get("cameras", ()))
    else:
        held = int(note_held.get("views", 0))
    if not held or (views or 0) > held:
        raise ValueError(
            f"{folder}: records have {held} orbit pictures, --views asks for {views or 'all'}; "
            "prepare with more --orbit-views"
        )
    encoder = load_encoder(Path(weights))
    note = {
        "weights": encoder.digest,
        "views": views or held,
        "channels": encoder.config.width,
        "image_size": encoder.config.image_size,
    }

    def make(shard: Path) -> Columns:
        return visual_of_shard(shard, encoder, views or held, batch)

    fill_column(folder, "visual", note, make, part, progress)


def write_part_features(
    folder: str | Path, source: Path, *, part: tuple[int, int] = (0, 1), progress: bool = True
) -> None:
    """The column ``part_feature`` of a prepared folder, of PartField's files.

    Raises:
      FileNotFoundError, ValueError: no records, a record without its file, files that are not
        PartField's.
    """
    if not source.is_dir():
        raise FileNotFoundError(
            f"'{source}': no such folder; give the one that PartField wrote its results to"
        )
    note = {"source": "PartField", "channels": CHANNELS}

    def make(shard: Path) -> Columns:
        for row, record in _records(shard):
            yield (
                record,
                on_voxels(record, *read_partfield(source, _input_name(shard, row, record))),
            )

    def origin(shard: Path, row: int, record: Record) -> str:
        return result_digest(source, _input_name(shard, row, record))

    fill_column(folder, "part_feature", note, make, part, progress, origin)


def write_geometric_features(
    folder: str | Path, *, part: tuple[int, int] = (0, 1), progress: bool = True
) -> None:
    """The column ``part_feature`` of a prepared folder, of its records' own shapes.

    Raises:
      FileNotFoundError: no records. ValueError: the folder has that column from another source.
    """
    note = {"source": GEOMETRIC, "channels": GEOMETRIC_CHANNELS}

    def make(shard: Path) -> Columns:
        for _, record in _records(shard):
            yield record, geometric_features(record)

    fill_column(folder, "part_feature", note, make, part, progress)


def export_points(
    folder: str | Path, out: Path, *, part: tuple[int, int] = (0, 1), progress: bool = True
) -> None:
    """One PLY of surface points a record, for PartField; those that are there are kept.

    Raises:
      FileNotFoundError: no records. ValueError: ``out`` is a file.
    """
    shards = _mine(shard_paths(folder), part)
    if out.exists() and not out.is_dir():
        raise ValueError(f"output '{out}': a file of that name exists; choose another folder")
    out.mkdir(parents=True, exist_ok=True)
    with _progress(progress, "export", len(open_shards(shards)) if shards else 0, 0) as advance:
        for shard in shards:
            for row, record in _records(shard):
                path = out / f"{_input_name(shard, row, record)}.ply"
                if not path.exists():
                    write_points(path, surface_points(record))
                advance()


def fill_column(
    folder: str | Path,
    name: str,
    note: dict[str, Any],
    make: Callable[[Path], Columns],
    part: tuple[int, int] = (0, 1),
    progress: bool = True,
    origin: Callable[[Path, int, Record], str] | None = None,
) -> None:
    """Make the shards of a column that are not there yet.

    Args:
      note: what it is made from; kept in ``<name>.json``.
      make: shard of records -> each of them, in order, with its values [V, C] float16.
      origin: digest of what one record's values are made from, where every record has a file of its
        own; kept in its item.

    Raises:
      ValueError: the column that is there, or begun, was made from something else.
    """
    shards = shard_paths(folder)
    claim_column(folder, name, note)
    sweep(Path(folder))
    if origin is not None:
        for shard in shards:
            _check_origin(shard, name, origin)
    mine = {shard: len(open_shards([shard])) for shard in _mine(shards, part)}
    todo = [shard for shard in mine if not finished(shard, name)]
    total, left = sum(mine.values()), sum(mine[shard] for shard in todo)
    with _progress(progress, name, total, total - left) as advance:
        for shard in todo:

            def items(shard: Path = shard) -> Iterator[bytes]:
                for row, (record, values) in enumerate(make(shard)):
                    meta = {"id": record.meta.get("id")}
                    if origin is not None:
                        meta["origin"] = origin(shard, row, record)
                    yield pack_arrays({VALUES: values}, meta)
                    advance()

            write_shard(column_path(shard, name), items())


def _check_origin(shard: Path, name: str, origin: Callable[[Path, int, Record], str]) -> None:
    """
    Raises:
      ValueError: the first record of a shard that is there was made from another file.
    """
    if not finished(shard, name) or not len(items := open_shards([column_path(shard, name)])):
        return
    first = from_bytes(open_shards([shard])[0])
    if unpack_arrays(items[0])[1].get("origin") != origin(shard, 0, first):
        raise ValueError(
            f"{column_path(shard, name)}: made from other files than those given now; remove "
            f"{name}.json and {name}-*.arrayrecord to make the column again"
        )


def _held_note(folder: str | Path, name: str) -> dict[str, Any]:
    """What a column says that it is made from; nothing where there is none."""
    try:
        held = json.loads(column_note(folder, name).read_text())
    except (OSError, ValueError):
        return {}
    return held if isinstance(held, dict) else {}


def claim_column(folder: str | Path, name: str, note: dict[str, Any]) -> None:
    """Write down what a column is made from, or check that it is made from this."""
    path = column_note(folder, name)
    if not path.is_file():
        if next(Path(folder).glob(f"{name}-*.arrayrecord"), None) is not None:
            raise ValueError(
                f"{folder}: holds a column '{name}' without {path.name}, so its source is unknown; "
                f"remove {name}-*.arrayrecord"
            )
        write_text(path, json.dumps(note, indent=2) + "\n")
        return
    try:
        held = json.loads(path.read_text())
        different = [
            f"{key} {held.get(key)} (now: {note.get(key)})"
            for key in sorted({*held, *note})
            if held.get(key) != note.get(key)
        ]
    except (ValueError, AttributeError, TypeError):
        raise ValueError(f"{path}: damaged; remove it and {name}-*.arrayrecord") from None
    if different:
        raise ValueError(
            f"{folder}: its column '{name}' was made from something else: {'; '.join(different)}; "
            f"remove {path.name} and {name}-*.arrayrecord to make it again"
        )


def finished(shard: Path, name: str) -> bool:
    """Whether a column has its part of this shard: as many items, the first and the last of the
    same records (prepare may have extended a shard since)."""
    path = column_path(shard, name)
    if not path.is_file():
        return False
    records = open_shards([shard])
    try:
        items = open_shards([path])
    except ValueError:  # cut off: made again
        return False
    if len(items) != len(records):
        return False
    ends = {0, len(records) - 1} if len(records) else set()
    return all(
        unpack_arrays(items[i])[1].get("id") == unpack_arrays(records[i])[1].get("id") for i in ends
    )


def visual_of_shard(shard: Path, encoder: Encoder, views: int, batch: int) -> Columns:
    """Each record of a shard with the mean over ``views`` of its orbit pictures of what its voxels
    read in them: [V, F] float16.

    Raises:
      ValueError: a record's orbit is another's, damaged or smaller than ``views``.
    """
    records, orbits = open_shards([shard]), open_shards([column_path(shard, "orbit")])

    def load(row: int) -> tuple[Record, list[np.ndarray], np.ndarray]:
        record = from_bytes(records[row])
        images, cameras = read_orbit(orbits[row], record.meta.get("id"))
        if len(images) < views:
            raise ValueError(
                f"column 'orbit' of '{record.meta.get('id')}': {len(images)} pictures, not "
                f"{views}; prepare again"
            )
        return record, images, cameras

    for record, images, cameras in _ahead(load, range(len(records))):
        chosen = spread_views(cameras, views)
        yield record, visual(record, (images[i] for i in chosen), cameras[chosen], encoder, batch)


def visual(
    record: Record, images: Iterable[np.ndarray], cameras: np.ndarray, encoder: Encoder, batch: int
) -> np.ndarray:
    """[V, F] float16: mean over views of the patch features that each voxel's centre reads; no
    visibility test (``models.multiview``).

    Args:
      images: M pictures [S, S, 4] uint8, straight alpha, sRGB; resized to what the encoder was
        trained on. cameras: [M, 4].
    """
    size, count = encoder.config.image_size, len(record.coords)
    positions = np.zeros((-(-count // VOXEL_STEP) * VOXEL_STEP, 3), np.float32)
    positions[:count] = (record.coords + 0.5) / record.resolution - 0.5
    pictures = (resized(image, size) for image in images)
    values = multiview_features(
        encoder.network,
        encoder.params,
        pictures,
        *view_matrices(cameras),
        jax.device_put(positions),
        count,
        chunk=batch,
    )
    return half(np.asarray(values)[:count], str(record.meta.get("id")), "visual")


def view_matrices(cameras: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cameras [M, 4] of records as ``models.multiview`` takes them: extrinsics [M, 4, 4] (object to
    camera), intrinsics [M, 3, 3]."""
    extrinsics = np.stack([Camera(*row).matrix() for row in np.asarray(cameras, np.float64)])
    return extrinsics.astype(np.float32), intrinsic_matrices(np.deg2rad(cameras[:, 2]))


def resized(image: np.ndarray, size: int) -> np.ndarray:
    """[size, size, 4] uint8: Lanczos, as TRELLIS (colours weighted by alpha)."""
    if image.shape[:2] == (size, size):
        return image
    return np.asarray(Image.fromarray(image).resize((size, size), Image.Resampling.LANCZOS))


def spread_views(cameras: np.ndarray, number: int) -> np.ndarray:
    """Sorted indices of ``number`` cameras [M, 4] that look from directions far from each other:
    the first, then always the farthest from those chosen.

    Every k-th of an even spread need not be even: of a Fibonacci sphere it is a few arms of a
    spiral.
    """
    if number >= len(cameras):
        return np.arange(len(cameras))
    azimuth, elevation = np.asarray(cameras[:, :2], np.float64).T
    flat = np.cos(elevation)
    seen = np.stack([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)], -1)
    chosen, nearest = [0], seen @ seen[0]
    while len(chosen) < number:
        chosen.append(int(np.argmin(nearest)))
        nearest = np.maximum(nearest, seen @ seen[chosen[-1]])
        nearest[chosen] = np.inf
    return np.sort(chosen)


def load_encoder(path: Path) -> Encoder:
    """A converted DINOv2 on the default device. Sizes are those of its tensors; heads are 64 wide
    unless a ``config.json`` beside it says otherwise.

    Raises:
      FileNotFoundError: no such file. ValueError: it is truncated, not finite, or no DINOv2.
    """
    path = Checkpoint.find(path).path("image_encoder.safetensors") if path.is_dir() else path
    if not path.is_file():
        raise FileNotFoundError(
            f"weights '{path}': no such file; make it with: uniart convert dinov2 FILE --out "
            "image_encoder.safetensors"
        )
    try:
        with safe_open(path, "numpy") as file:
            shapes = {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}  # noqa: SIM118  not a dict
        config = converted_config(shapes)
    except (SafetensorError, ValueError) as error:
        raise ValueError(f"weights '{path}': {error}") from None
    if (path.parent / "config.json").is_file():
        beside = Checkpoint(path.parent).config.model.image_encoder
        config = config if beside.kind.trained else beside
    network = _network(config)
    params = jax.device_put(read_network(path, network.abstract()))
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Encoder(network, params, digest)


@functools.lru_cache(maxsize=1)  # one object, one compiled program
def _network(config: ImageEncoderConfig) -> Network:
    return build("image_encoder", ModelConfig(image_encoder=config))


def _mine(shards: list[Path], part: tuple[int, int]) -> list[Path]:
    """Every n-th shard by its number: the same ones while a folder still grows."""
    return [s for s in shards if int(s.stem.rpartition("-")[2]) % part[1] == part[0]]


def _records(shard: Path) -> Iterator[tuple[int, Record]]:
    source = open_shards([shard])
    return ((row, from_bytes(source[row])) for row in range(len(source)))


def _input_name(shard: Path, row: int, record: Record) -> str:
    return input_name(int(shard.stem.rpartition("-")[2]), row, str(record.meta.get("id")))


def _ahead(load: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Made]:
    """``load`` of each, the next one while this one is in use."""
    with ThreadPoolExecutor(1) as pool:
        waiting = None
        for item in items:
            following = pool.submit(load, item)
            if waiting is not None:
                yield waiting.result()
            waiting = following
        if waiting is not None:
            yield waiting.result()


def _progress(show: bool, what: str, total: int, done: int):
    if show:
        return advancing(what, total, done=done, unit="records")
    return contextlib.nullcontext(lambda: None)
