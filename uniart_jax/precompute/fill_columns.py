"""Columns beside prepared records (``data.columns``), made shard by shard.

Memory does not grow with the records. A column's shard gets its name when it is complete, so a run
may be killed at any moment; run again, it keeps the finished shards and ends with the same bytes.
``<column>.json`` says what a column is made from; another source is refused.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.data.columns import VALUES, column_note, column_path
from uniart_jax.data.records import Record, from_bytes, shard_paths
from uniart_jax.data.shards import open_shards, pack_arrays, unpack_arrays, write_shard
from uniart_jax.runtime.files import sweep, write_text
from uniart_jax.runtime.progress import advancing

Columns = Iterator[tuple[Record, np.ndarray]]


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
    mine = {shard: len(open_shards([shard])) for shard in own_shards(shards, part)}
    todo = [shard for shard in mine if not finished(shard, name)]
    total, left = sum(mine.values()), sum(mine[shard] for shard in todo)
    with progress_of(progress, name, total, total - left) as advance:
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


def held_note(folder: str | Path, name: str) -> dict[str, Any]:
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


def own_shards(shards: list[Path], part: tuple[int, int]) -> list[Path]:
    """Every n-th shard by its number: the same ones while a folder still grows."""
    return [s for s in shards if int(s.stem.rpartition("-")[2]) % part[1] == part[0]]


def records_of(shard: Path) -> Iterator[tuple[int, Record]]:
    source = open_shards([shard])
    return ((row, from_bytes(source[row])) for row in range(len(source)))


def progress_of(show: bool, what: str, total: int, done: int):
    if show:
        return advancing(what, total, done=done, unit="records")
    return contextlib.nullcontext(lambda: None)
