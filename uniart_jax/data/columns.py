"""Columns: what belongs to each record of a prepared folder but is made by another command, in
sidecar shards.

    OUT/records-00000.arrayrecord     OUT/orbit-00000.arrayrecord     OUT/visual-00000.arrayrecord     OUT/part_feature-00000.arrayrecord

A column's shard holds one item a record, in the records' order; an item is ``pack_arrays({...},
{"id": the record's})``.

    orbit         png, ends: M pictures [S, S, 4] straight alpha, sRGB, as PNG files one after another; cameras [M, 4] azimuth, elevation, field of view (degrees), distance
    visual        values [V, F] float16, mean over views of image features, in the order of the record's voxels
    part_feature  values [V, P] float16
"""  # noqa: E501

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from uniart_jax.data.shards import Shards, open_shards, pack_arrays, unpack_arrays

FEATURES = ("visual", "part_feature")  # columns that join a record as fields
VALUES = "values"
_MAKERS = {
    "orbit": "uniart prepare … --orbit-views 150",
    "visual": "uniart features {folder} --weights image_encoder.safetensors",
    "part_feature": "uniart features {folder} --part-features geometric (or PartField's folder)",
}


def maker(name: str, folder: str | Path) -> str:
    """The command that makes a column."""
    return _MAKERS[name].format(folder=folder)


def column_path(shard: Path, name: str) -> Path:
    """Where a column's part of a shard of records lies."""
    return shard.with_name(shard.name.replace("records", name, 1))


def column_note(folder: str | Path, name: str) -> Path:
    """The small JSON that says what a column was made from."""
    return Path(folder) / f"{name}.json"


def open_column(name: str, shards: Sequence[Path], records: int) -> Shards:
    """The items of a column, beside these shards of so many records.

    Raises:
      ValueError: it is not there, or not all of it; one line with the command that makes it.
    """
    folder = shards[0].parent
    paths = [column_path(shard, name) for shard in shards]
    if missing := sum(not path.is_file() for path in paths):
        held = "no" if missing == len(paths) else "an unfinished"
        raise ValueError(
            f"{folder}: {held} column '{name}' ({missing} of {len(paths)} shards are missing); "
            f"make it with: {maker(name, folder)}"
        )
    items = open_shards(paths)
    if len(items) != records:
        raise ValueError(
            f"{folder}: the column '{name}' has {len(items)} items for {records} records; make it "
            f"again with: {maker(name, folder)}"
        )
    return items


def read_item(name: str, data: bytes, record_id: Any) -> dict[str, np.ndarray]:
    """The arrays of a column's item.

    Raises:
      ValueError: damaged, or another record's.
    """
    arrays, meta = unpack_arrays(data, f"column '{name}'")
    if meta.get("id") != record_id:
        raise ValueError(
            f"column '{name}': its item is of '{meta.get('id')}' where the record is "
            f"'{record_id}'; remove the column's files and make it again"
        )
    return arrays


def pack_orbit(images: np.ndarray, cameras: np.ndarray, record_id: str) -> bytes:
    """An item of the column "orbit": pictures [M, S, S, 4] uint8 and cameras [M, 4] of a record."""
    files = []
    for image in images:
        stream = io.BytesIO()
        Image.fromarray(image).save(stream, "png", compress_level=3)
        files.append(stream.getvalue())
    ends = np.cumsum([len(file) for file in files], dtype=np.int64)
    png = np.frombuffer(b"".join(files), np.uint8)
    return pack_arrays({"png": png, "ends": ends, "cameras": cameras}, {"id": record_id})


def read_orbit(data: bytes, record_id: Any) -> tuple[list[np.ndarray], np.ndarray]:
    """M pictures [S, S, 4] uint8 and cameras [M, 4] float32 of an item of the column "orbit".

    Raises:
      ValueError: damaged, or another record's.
    """
    item = read_item("orbit", data, record_id)
    try:
        cameras, ends = item["cameras"], item["ends"].tolist()
        files = [item["png"][a:b].tobytes() for a, b in zip([0, *ends], ends, strict=False)]
        images = [np.asarray(Image.open(io.BytesIO(f), formats=["PNG"])) for f in files]
    except (KeyError, OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(
            f"column 'orbit' of '{record_id}': damaged ({error}); prepare it again"
        ) from None
    if cameras.shape != (len(images), 4) or any(i.shape[2:] != (4,) for i in images):
        raise ValueError(f"column 'orbit' of '{record_id}': damaged; prepare it again")
    return images, cameras


def read_feature(name: str, data: bytes, record_id: Any, voxels: int) -> np.ndarray:
    """[V, F] float16 of an item of one of ``FEATURES``.

    Raises:
      ValueError: damaged, another record's, or of another number of voxels.
    """
    values = read_item(name, data, record_id).get(VALUES)
    if values is None or values.dtype != np.float16 or values.ndim != 2 or len(values) != voxels:
        found = "nothing" if values is None else f"{values.dtype} {list(values.shape)}"
        raise ValueError(
            f"column '{name}' of '{record_id}': expected float16 [{voxels}, channels], found "
            f"{found}; remove the column's files and make it again"
        )
    return values


def half(values: np.ndarray, record_id: str, column: str) -> np.ndarray:
    """Values as float16.

    Raises:
      ValueError: they are not finite there.
    """
    with np.errstate(over="ignore"):
        out = np.asarray(values).astype(np.float16)
    if not np.isfinite(out).all():
        raise ValueError(
            f"{column} of '{record_id}' is not finite in half precision; check what it is computed "
            "from"
        )
    return out
