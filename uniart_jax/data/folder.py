"""A prepared folder: its layout, its settings, its manifest.

    OUT/metadata.json              what the records are: settings that every shard shares
    OUT/records-00000.arrayrecord  finished shards; each holds the records of ``shard_size`` consecutive objects
    OUT/rows/00000.csv             one row a record, or a failed object, of that shard
    OUT/manifest.csv  data-card.md  contact-sheet.png     written when all shards are there

Everything gets its name only when it is complete.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import os
from collections.abc import Sequence
from pathlib import Path

from uniart_jax.data.records import SCHEMA_VERSION, SHARD_PATTERN

COLUMNS = [
    "id",
    "family",
    "seed",
    "state",
    "joints",
    "parts",
    "voxels",
    "split",
    "refused",
    "error",
]


@dataclasses.dataclass(frozen=True)
class Settings:
    """What decides the bytes of a shard; kept in ``metadata.json``."""

    families: tuple[str, ...]
    start_seed: int
    resolution: int
    subdivisions: int
    max_parts: int
    views: int
    image_size: int
    states: int
    shard_size: int
    schema_version: int = SCHEMA_VERSION
    source: str = "procedural"


Row = dict[str, str | int]


def read_metadata(folder: str | Path) -> dict:
    """``metadata.json`` of a prepared folder.

    Raises:
      FileNotFoundError: there is none. ValueError: it cannot be read.
    """
    path = Path(folder) / "metadata.json"
    if not path.is_file():
        raise FileNotFoundError(f"{folder}: no metadata.json; not a folder of prepared records")
    try:
        metadata = json.loads(path.read_text())
        if not isinstance(metadata, dict):
            raise ValueError("not an object")
        return metadata
    except ValueError as error:
        raise ValueError(f"{path}: damaged ({error}); prepare the records again") from None


def read_manifest(folder: str | Path) -> list[dict[str, str]]:
    """Rows of ``manifest.csv`` in the order of the records; rows with an ``error`` have no record."""
    path = Path(folder) / "manifest.csv"
    if not path.is_file():
        raise FileNotFoundError(f"{path}: missing; run the same prepare command again to finish it")
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def claim(out: Path, settings: Settings, count: int) -> None:
    """Make ``out`` ours, or check that it is. Removes nothing.

    Raises:
      ValueError: it holds records of other settings, records of more objects than ``count``, or other files.
    """
    wanted = json.loads(json.dumps(dataclasses.asdict(settings)))
    if (out / "metadata.json").exists():
        found = read_metadata(out)
        different = [
            f"{key} {found.get(key)} (asked: {wanted.get(key)})"
            for key in sorted({*wanted, *found})
            if found.get(key) != wanted.get(key)
        ]
        if different:
            raise ValueError(
                f"{out}: holds records of another setting: {'; '.join(different)}; choose another folder"
            )
        held = _held(out, settings)
        if held > count:
            raise ValueError(
                f"{out}: holds {held} objects, more than the {count} asked for; ask for {held} or more, or choose another folder"
            )
        return
    if out.exists() and (
        not out.is_dir() or any(p.name not in ("rows", ".metadata.json.tmp") for p in out.iterdir())
    ):
        raise ValueError(f"{out}: exists and holds no records of ours; choose another folder")
    (out / "rows").mkdir(parents=True, exist_ok=True)
    write_text(out / "metadata.json", json.dumps(wanted, indent=2) + "\n")


def _held(out: Path, settings: Settings) -> int:
    """Objects up to the last one in a finished shard."""
    held = 0
    for path in out.glob(SHARD_PATTERN):
        number = int(path.stem.removeprefix("records-"))
        held = max(held, number * settings.shard_size + 1)  # though its rows be lost
        if rows_path(out, number).is_file():
            with rows_path(out, number).open(newline="") as file:
                seeds = [int(row["seed"]) for row in csv.DictReader(file)]
            held = max([held, *(seed - settings.start_seed + 1 for seed in seeds)])
    return held


def shard_path(out: Path, number: int) -> Path:
    return out / f"records-{number:05d}.arrayrecord"


def rows_path(out: Path, number: int) -> Path:
    return out / "rows" / f"{number:05d}.csv"


def write_text(path: Path, text: str) -> None:
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text)
    os.replace(temporary, path)


def write_rows(path: Path, rows: Sequence[Row | dict[str, str]]) -> None:
    temporary = path.with_name(f".{path.name}.tmp")
    with temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(temporary, path)


def finished(out: Path, number: int, objects: range, settings: Settings) -> bool:
    """Whether the shard is there and covers just these objects (a smaller run may have left a short last shard)."""
    if not (shard_path(out, number).exists() and rows_path(out, number).exists()):
        return False
    with rows_path(out, number).open(newline="") as file:
        seeds = {int(row["seed"]) for row in csv.DictReader(file)}
    return seeds == {settings.start_seed + k for k in objects}
