"""A prepared folder: its layout, its settings, its manifest.

    OUT/metadata.json              what the records are: settings that every shard shares
    OUT/records-00000.arrayrecord  finished shards; each holds the records of ``shard_size`` consecutive objects
    OUT/orbit-00000.arrayrecord    pictures all around each record, in the same order, for ``uniart features``; may be removed after
    OUT/rows/00000.csv             one row a record, or a failed object, of that shard
    OUT/manifest.csv  data-card.md  contact-sheet.png     written when all shards are there

Everything gets its name only when it is complete.
"""  # noqa: E501

from __future__ import annotations

import csv
import dataclasses
import json
import os
from collections.abc import Sequence
from pathlib import Path

from uniart_jax.data.records import SCHEMA_VERSION, SHARD_PATTERN
from uniart_jax.runtime.files import complete, temporary_path

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
      split: rule that names each object's split (``data.splits``), with the digest of the list that
        it read.
      strict: objects of which something was lost are failures.
      allow_outside: assets may name files outside their folders.
      part_scale: strength of the random stretching of parts, drawn anew for every shown state but
        the first (``objects.perturb``).
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
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: damaged ({error}); prepare the records again") from None


def read_manifest(folder: str | Path) -> list[dict[str, str]]:
    """Rows of ``manifest.csv`` in the order of the records; rows with an ``error`` have no
    record."""
    path = Path(folder) / "manifest.csv"
    if not Path(folder).is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: missing; run the same prepare command again to finish it")
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        if missing := [name for name in COLUMNS if name not in (reader.fieldnames or ())]:
            raise ValueError(
                f"{path}: no column {', '.join(missing)}; an older version made it: prepare the "
                "records again, in another folder"
            )
        return list(reader)


def check_settings(
    out: Path, settings: Settings, keys: Sequence[str], splits: Sequence[str] | None = None
) -> None:
    """Make ``out`` ours, or check that it is. Removes nothing.

    Args:
      keys, splits: of all objects, in order.

    Raises:
      ValueError: it holds records of other settings, of other or more objects, or other files.
    """
    wanted = json.loads(json.dumps(dataclasses.asdict(settings)))
    if not (out / "metadata.json").exists():
        _begin(out, json.dumps(wanted, indent=2) + "\n")
    found = {**json.loads(json.dumps(dataclasses.asdict(Settings()))), **read_metadata(out)}
    different = [
        f"{key} {found.get(key)} (asked: {wanted.get(key)})"
        for key in sorted({*wanted, *found} - {*PLACE})
        if found.get(key) != wanted.get(key)
    ]
    if different:
        raise ValueError(
            f"{out}: holds records of another setting: {'; '.join(different)}; choose another "
            "folder"
        )
    _check_held(out, settings, keys, splits)


def _begin(out: Path, metadata: str) -> None:
    """Make the folder, unless another run was quicker."""
    if out.exists() and (
        not out.is_dir()
        or any(
            p.name not in ("rows", "metadata.json") and p.suffix != ".tmp" for p in out.iterdir()
        )
    ):
        raise ValueError(f"{out}: exists and holds no records of ours; choose another folder")
    (out / "rows").mkdir(parents=True, exist_ok=True)
    temporary = temporary_path(out / "metadata.json")
    temporary.write_text(metadata, encoding="utf-8")
    try:
        os.link(temporary, out / "metadata.json")
    except FileExistsError:
        pass
    except OSError:  # a file system without links
        os.replace(temporary, out / "metadata.json")
    temporary.unlink(missing_ok=True)


def _check_held(
    out: Path, settings: Settings, keys: Sequence[str], splits: Sequence[str] | None
) -> None:
    """Finished shards must hold the beginning of what is asked for."""
    size = settings.shard_size
    for path in sorted(out.glob(SHARD_PATTERN)):
        number = int(path.stem.removeprefix("records-"))
        rows = shard_rows(out, number)
        held = {row["object"]: row["split"] for row in rows}
        start = number * size
        if (last := start + max(len(held), 1)) > len(keys):  # though its rows be lost
            raise ValueError(
                f"{out}: holds {last} objects, more than the {len(keys)} asked for; ask for {last} "
                "or more, or choose another folder"
            )
        for k, (key, split) in enumerate(held.items(), start=start):
            if key != keys[k]:
                raise ValueError(
                    f"{out}: made of other objects than those asked for ('{key}' where '{keys[k]}' "
                    "would be); choose another folder"
                )
            if splits is not None and split != splits[k]:
                raise ValueError(
                    f"{out}: '{key}' is '{split}' in it and would be '{splits[k]}' now; choose "
                    "another folder"
                )


def shard_path(out: Path, number: int, kind: str = "records") -> Path:
    """The shard of records, or of what belongs to each record in the same order: "orbit"."""
    return out / f"{kind}-{number:05d}.arrayrecord"


def rows_path(out: Path, number: int) -> Path:
    return out / "rows" / f"{number:05d}.csv"


def write_rows(path: Path, rows: Sequence[Row | dict[str, str]]) -> None:
    with complete(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def finished(out: Path, number: int, keys: Sequence[str], orbits: bool = False) -> bool:
    """Whether the shard is there and covers just these objects (a smaller run may have left a short
    last shard).

    Args:
      orbits: it must have its orbits too, or the features that are made of them.
    """
    if not shard_path(out, number).exists():
        return False
    if orbits and not any(shard_path(out, number, kind).exists() for kind in (ORBIT, "visual")):
        return False
    return list(dict.fromkeys(row["object"] for row in shard_rows(out, number))) == list(keys)


def shard_rows(out: Path, number: int) -> list[dict[str, str]]:
    """Rows of a shard; none where they are lost."""
    path = rows_path(out, number)
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
