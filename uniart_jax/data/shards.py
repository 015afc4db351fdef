"""Arrays as byte strings, and byte strings in ArrayRecord files: what records, their columns and
cached latents are stored in.

A zip of ``.npy`` arrays, stored without compression, plus ``meta.json``: readable by any numpy,
never unpickled. ArrayRecord files have one item a group (random access) and compress each with
zstd.
"""

from __future__ import annotations

import contextlib
import io
import json
import threading
import zipfile
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
from absl import flags
from array_record.python import array_record_module
from array_record.python.array_record_data_source import ArrayRecordDataSource

from uniart_jax.runtime.files import complete

MAX_RECORD_BYTES = 1 << 30
MIN_FILE_BYTES = 1 << 16  # of any ArrayRecord file
# numpy parses a header with ``ast``, which CPython does not always survive in several threads at
# once ("AST constructor recursion depth
# mismatch"), and Grain reads records in several.
HEADERS = threading.Lock()
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
    data: bytes, name: str = "record", without: Collection[str] = ()
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays and metadata of ``pack_arrays``; nothing is unpickled.

    Args:
      name: of what the bytes are, for errors.
      without: arrays to pass over: they are not read.

    Raises:
      ValueError: the bytes are truncated, foreign, or larger than 1 GiB when read; one line.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(info.file_size for info in archive.infolist()) > MAX_RECORD_BYTES:
                raise ValueError("it would be larger than 1 GiB")
            left = {f"{array}.npy" for array in without}
            files = {
                i.filename: archive.read(i) for i in archive.infolist() if i.filename not in left
            }
        with HEADERS:
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


@contextlib.contextmanager
def shard_writer(path: str | Path) -> Iterator[Callable[[bytes], None]]:
    """``write(item)`` adds a byte string to an ArrayRecord file, which gets its name at the end, if
    nothing was raised."""
    with complete(Path(path)) as temporary:
        writer = array_record_module.ArrayRecordWriter(str(temporary), "group_size:1,zstd:3")
        try:
            yield writer.write
        finally:
            if writer.is_open():
                writer.close()


def write_shard(path: str | Path, items: Iterable[bytes]) -> None:
    """Write byte strings as one ArrayRecord file, complete or absent."""
    with shard_writer(path) as write:
        for item in items:
            write(item)


class Shards(ArrayRecordDataSource):
    """Random access to the byte strings of several ArrayRecord files, in their order; picklable."""

    def __init__(self, paths: Sequence[str | Path]):
        self.paths = [str(path) for path in paths]
        super().__init__(self.paths)

    def __getitem__(self, record_key: SupportsIndex) -> bytes:
        """
        Raises:
          ValueError: the item is damaged; it names the file.
        """
        try:
            return super().__getitem__(record_key)
        except RuntimeError as error:
            raise _damaged(self.where(record_key.__index__()), error) from None

    def where(self, place: int) -> str:
        """The file that holds an item, and its number there, for errors."""
        for path in self.paths:
            if place < (count := len(ArrayRecordDataSource(path))):
                return f"{path}, item {place}"
            place -= count
        return f"item {place} beyond {len(self.paths)} files"


def open_shards(paths: Sequence[str | Path]) -> Shards:
    """The byte strings of several ArrayRecord files, in the order given.

    Raises:
      ValueError: a file is damaged; it names them.
    """
    if not flags.FLAGS.is_parsed():  # programs without absl: ArrayRecord reads its flags on use
        flags.FLAGS.mark_as_parsed()
    try:
        return Shards(paths)
    except RuntimeError as error:
        small = [str(p) for p in paths if Path(p).stat().st_size < MIN_FILE_BYTES]
        which = ", ".join(small) or (
            str(paths[0])
            if len(paths) == 1
            else f"one of {len(paths)} files in {Path(paths[0]).parent}"
        )
        raise _damaged(which, error) from None


def _damaged(which: str, error: RuntimeError) -> ValueError:
    reason = " ".join(str(error).split())[:120]
    return ValueError(
        f"{which}: damaged or cut off ({reason}); remove the file and run the command that made it "
        "again"
    )
