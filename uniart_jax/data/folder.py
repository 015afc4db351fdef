"""A prepared folder: its layout, its settings, its manifest.

    OUT/metadata.json              what the records are: settings that every shard shares
    OUT/records-00000.arrayrecord  finished shards; each holds the records of ``shard_size`` consecutive objects
    OUT/orbit-00000.arrayrecord    pictures all around each record, in the same order, for ``uniart features``; may be removed after
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
    "object",
    "category",
    "seed",
    "state",
    "joints",
    "parts",
    "voxels",
    "split",
    "repairs",
    "refused",
    "error",
]
ORBIT = "orbit"
PLACE = ("root",)  # settings that say where, not what: not compared


@dataclasses.dataclass(frozen=True)
class Settings:
    """What decides the bytes of a shard; kept in ``metadata.json``.

    Attributes:
      source: where objects come from: "procedural", "partnet-mobility" or "urdf".
      families, start_seed: of procedural objects.
      root: folder of the assets, as it was given.
      front: where the assets' fronts face in their own frame; objects are turned so that it is -x.
      resolution, subdivisions, max_parts: the grid.
      views, image_size: pictures for conditioning.
      states: shown states an object.
      shard_size: objects a shard.
      split: rule that names each object's split (``data.splits``), with the digest of the list that it read.
      strict: objects of which something was lost are failures.
      allow_outside: assets may name files outside their folders.
      part_scale: strength of the random stretching of parts, drawn anew for every shown state but the first (``objects.perturb``).
      orbit_views, orbit_size: pictures all around, for multi-view features; 0 = none.
    """

    source: str = "procedural"
    families: tuple[str, ...] = ()
    start_seed: int = 0
    root: str = ""
    front: str = "-x"
    resolution: int = 32
    subdivisions: int = 4
    max_parts: int = 16
    views: int = 2
    image_size: int = 128
    states: int = 1
    shard_size: int = 64
    split: str = "none"
    strict: bool = False
    allow_outside: bool = False
    part_scale: float = 0.0
    orbit_views: int = 0
    orbit_size: int = 518
    schema_version: int = SCHEMA_VERSION


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
        reader = csv.DictReader(file)
        if missing := [name for name in COLUMNS if name not in (reader.fieldnames or ())]:
            raise ValueError(
                f"{path}: no column {', '.join(missing)}; an older version made it: prepare the records again, in another folder"
            )
        return list(reader)


def claim(out: Path, settings: Settings, keys: Sequence[str]) -> None:
    """Make ``out`` ours, or check that it is. Removes nothing.

    Args:
      keys: of all objects, in order.

    Raises:
      ValueError: it holds records of other settings, of other or more objects, or other files.
    """
    wanted = json.loads(json.dumps(dataclasses.asdict(settings)))
    if (out / "metadata.json").exists():
        found = {**json.loads(json.dumps(dataclasses.asdict(Settings()))), **read_metadata(out)}
        different = [
            f"{key} {found.get(key)} (asked: {wanted.get(key)})"
            for key in sorted({*wanted, *found} - {*PLACE})
            if found.get(key) != wanted.get(key)
        ]
        if different:
            raise ValueError(
                f"{out}: holds records of another setting: {'; '.join(different)}; choose another folder"
            )
        _check_held(out, settings, keys)
        return
    if out.exists() and (
        not out.is_dir() or any(p.name != "rows" and p.suffix != ".tmp" for p in out.iterdir())
    ):
        raise ValueError(f"{out}: exists and holds no records of ours; choose another folder")
    (out / "rows").mkdir(parents=True, exist_ok=True)
    write_text(out / "metadata.json", json.dumps(wanted, indent=2) + "\n")


def _check_held(out: Path, settings: Settings, keys: Sequence[str]) -> None:
    """Finished shards must hold the beginning of what is asked for."""
    size = settings.shard_size
    for path in sorted(out.glob(SHARD_PATTERN)):
        number = int(path.stem.removeprefix("records-"))
        held = object_keys(out, number)
        last = number * size + max(len(held), 1)  # though its rows be lost
        if last > len(keys):
            raise ValueError(
                f"{out}: holds {last} objects, more than the {len(keys)} asked for; ask for {last} or more, or choose another folder"
            )
        asked = [keys[k] for k in range(number * size, number * size + len(held))]
        if other := [(a, b) for a, b in zip(held, asked, strict=True) if a != b]:
            raise ValueError(
                f"{out}: made of other objects than those asked for ('{other[0][0]}' where '{other[0][1]}' would be); choose another folder"
            )


def shard_path(out: Path, number: int, kind: str = "records") -> Path:
    """The shard of records, or of what belongs to each record in the same order: "orbit"."""
    return out / f"{kind}-{number:05d}.arrayrecord"


def rows_path(out: Path, number: int) -> Path:
    return out / "rows" / f"{number:05d}.csv"


def sweep(out: Path) -> None:
    """Remove files that never got their name."""
    for place in (out, out / "rows"):
        for path in place.glob(".*.tmp"):
            path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.write_text(text)
    os.replace(temporary, path)


def write_rows(path: Path, rows: Sequence[Row | dict[str, str]]) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(temporary, path)


def finished(out: Path, number: int, keys: Sequence[str]) -> bool:
    """Whether the shard is there and covers just these objects (a smaller run may have left a short last shard)."""
    return shard_path(out, number).exists() and object_keys(out, number) == list(keys)


def object_keys(out: Path, number: int) -> list[str]:
    """Objects that the rows of a shard name, in order; none where the rows are lost."""
    if not rows_path(out, number).is_file():
        return []
    with rows_path(out, number).open(newline="") as file:
        return list(dict.fromkeys(row["object"] for row in csv.DictReader(file)))
