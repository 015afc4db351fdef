"""Arrays as byte strings, and byte strings in ArrayRecord files: what records, their columns and cached latents are stored in.

A zip of ``.npy`` arrays, stored without compression, plus ``meta.json``: readable by any numpy, never unpickled. ArrayRecord files have one
item a group (random access) and compress each with zstd.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from absl import flags
from array_record.python import array_record_module
from array_record.python.array_record_data_source import ArrayRecordDataSource

MAX_RECORD_BYTES = 1 << 30
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # bytes depend on content alone, so that reruns can be compared


def pack_arrays(arrays: dict[str, np.ndarray], meta: dict[str, Any]) -> bytes:
    """A zip of ``NAME.npy`` and ``meta.json``, stored; equal content gives equal bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _ZIP_DATE), buffer.getvalue())
        text = json.dumps(meta, sort_keys=True)
        archive.writestr(zipfile.ZipInfo("meta.json", _ZIP_DATE), text)
    return stream.getvalue()


def unpack_arrays(
    data: bytes, name: str = "record"
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays and metadata of ``pack_arrays``; nothing is unpickled.

    Raises:
      ValueError: the bytes are truncated, foreign, or larger than 1 GiB when read; one line.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(info.file_size for info in archive.infolist()) > MAX_RECORD_BYTES:
                raise ValueError("it would be larger than 1 GiB")
            files = {info.filename: archive.read(info) for info in archive.infolist()}
        arrays = {
            key[:-4]: np.lib.format.read_array(io.BytesIO(value), allow_pickle=False)
            for key, value in files.items()
            if key.endswith(".npy")
        }
        meta = json.loads(files["meta.json"])
        if not isinstance(meta, dict):
            raise ValueError("meta.json is not an object")
    except KeyError:
        raise ValueError(f"{name}: meta.json is missing; not one of our records") from None
    except Exception as error:  # zipfile and numpy raise a dozen kinds on damaged bytes
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"{name}: damaged or not a record ({reason}); prepare it again") from None
    return arrays, meta


def write_shard(path: str | Path, items: Iterable[bytes]) -> int:
    """Write byte strings as one ArrayRecord file, to a temporary name and then renamed; returns how many."""
    path = Path(path)
    temporary = path.with_name(f".{path.name}.tmp")
    writer = array_record_module.ArrayRecordWriter(str(temporary), "group_size:1,zstd:3")
    count = 0
    try:
        for item in items:
            writer.write(item)
            count += 1
        writer.close()
    except BaseException:
        if writer.is_open():
            writer.close()
        temporary.unlink(missing_ok=True)
        raise
    os.replace(temporary, path)
    return count


def open_shards(paths: Sequence[str | Path]) -> ArrayRecordDataSource:
    """Random access to the byte strings of several ArrayRecord files, in the order given."""
    if not flags.FLAGS.is_parsed():  # programs without absl: ArrayRecord reads its flags on use
        flags.FLAGS.mark_as_parsed()
    return ArrayRecordDataSource([str(p) for p in paths])
