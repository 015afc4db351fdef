"""Prepared folders: thousands of objects voxelised and rendered into ArrayRecord shards, by several processes.

The folder's layout is in ``data.folder``. A shard gets its name only when it is complete (its rows first, then the shard itself),
and depends on nothing but the settings and its number. So a run may be killed at any moment; run again, it keeps the finished shards and ends with the same bytes.
Object k is drawn from seed start_seed + k and family k mod F: every prefix is balanced.
"""

from __future__ import annotations

import collections
import contextlib
import csv
import functools
import os
import sys
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path

import numpy as np

from uniart_jax.config import GridConfig
from uniart_jax.data.folder import Row, Settings, claim, finished, rows_path, shard_path, write_rows
from uniart_jax.data.records import from_object, to_bytes, write_shard
from uniart_jax.processes import in_order, process_pool
from uniart_jax.progress import advancing

ATTEMPTS = 8  # shown states drawn before an object counts as failed


def prepare_procedural(
    out: str | Path,
    count: int,
    *,
    families: Sequence[str] | None = None,
    start_seed: int = 0,
    grid: GridConfig = GridConfig(32, 4),  # noqa: B008  frozen
    views: int = 2,
    image_size: int = 128,
    states: int = 1,
    processes: int = 2,
    shard_size: int = 64,
    progress: bool = True,
) -> Path:
    """Draw ``count`` procedural objects and write their records.

    Args:
      out: folder to make, or one that an earlier run with the same settings left unfinished or smaller.
      count: objects; each gives ``states`` records, with ``views`` images of ``image_size`` pixels a side.
      families: names of ``procedural`` families in turn; the seen ones by default.
      start_seed: object k uses seed ``start_seed + k``.
      processes: workers; 1 works in this process. More need the caller's main module to be importable (as spawn does).
      shard_size: objects a shard; what a killed run loses at most.
      progress: a bar on stderr, or lines now and then where stderr is no terminal.

    Returns:
      The folder.

    Raises:
      ValueError: a setting is out of range or a family unknown; ``out`` holds records of other settings, more objects than
        ``count``, or other files; a worker died; or no object succeeded.
    """
    from uniart_jax import procedural

    for name, value, low, high in (
        ("count", count, 1, None),
        ("start seed", start_seed, 0, None),
        ("resolution", grid.resolution, 1, 256),
        ("subdivisions", grid.subdivisions, 1, 8),
        ("max_parts", grid.max_parts, 1, 255),
        ("views", views, 1, None),
        ("image size", image_size, 8, None),
        ("states", states, 1, None),
        ("shard size", shard_size, 1, None),
        ("processes", processes, 1, None),
    ):
        if value < low or (high is not None and value > high):
            span = f"at least {low}" if high is None else f"in {low}..{high}"
            raise ValueError(f"prepare: {name} must be {span}, got {value}")
    families = tuple(procedural.SEEN_FAMILIES if families is None else families)
    known = (*procedural.SEEN_FAMILIES, *procedural.UNSEEN_FAMILIES)
    unknown = [name for name in families if name not in known]
    if unknown or not families:
        raise ValueError(
            f"prepare: unknown families {', '.join(unknown) or '(none given)'}; known: {', '.join(known)}"
        )
    settings = Settings(
        families,
        start_seed,
        grid.resolution,
        grid.subdivisions,
        grid.max_parts,
        views,
        image_size,
        states,
        shard_size,
    )
    out = Path(out)
    claim(out, settings, count)
    shards = [range(k, min(k + shard_size, count)) for k in range(0, count, shard_size)]
    todo = [i for i, objects in enumerate(shards) if not finished(out, i, objects, settings)]
    indices = [k for i in todo for k in shards[i]]
    with (
        _progress(progress, count, count - len(indices)) as advance,
        contextlib.closing(_make_all(settings, indices, processes)) as made,
    ):
        for i in todo:
            rows: list[Row] = []
            _write_shard(out, i, _items(made, len(shards[i]), rows, advance), rows)
    _finish(out, settings, count)
    return out


def _write_shard(out: Path, number: int, items: Iterator[bytes], rows: list[Row]) -> None:
    """Write the shard, then its rows, then give the shard its name."""
    path = shard_path(out, number)
    pending = path.with_name(f".{path.name}.pending")
    write_shard(pending, items)
    path.unlink(missing_ok=True)  # a smaller run's short last shard: the new one begins with it
    write_rows(rows_path(out, number), rows)
    os.replace(pending, path)


def _items(
    made: Iterator[list[tuple[bytes, Row]]], count: int, rows: list[Row], advance
) -> Iterator[bytes]:
    for _ in range(count):
        for data, row in next(made):
            rows.append(row)
            if data:
                yield data
        advance()


def make_object(settings: Settings, index: int) -> list[tuple[bytes, Row]]:
    """Records and manifest rows of object ``index``; b"" instead of a record where it failed. Never raises ``Exception``."""
    from uniart_jax import procedural

    family = settings.families[index % len(settings.families)]
    seed = settings.start_seed + index
    split = "held-out" if seed >= procedural.HELD_OUT_SEED else "train"
    base: Row = {"family": family, "seed": seed, "split": split, "refused": 0, "error": ""}
    made: list[tuple[bytes, Row]] = []
    try:
        obj = procedural.generate(family, seed)
    except Exception as error:  # one bad object must not stop a run of thousands; its row says why
        row: Row = {**base, "id": f"{family}-{seed:07d}-0", "state": 0, "error": _reason(error)}
        return [(b"", row)]
    for state in range(settings.states):
        row = {**base, "id": f"{family}-{seed:07d}-{state}", "state": state}
        data = b""
        for attempt in range(ATTEMPTS):
            try:
                data, facts = _make_record(settings, obj, row, attempt)
                row = {**row, **facts, "error": ""}
                break
            except (
                ValueError
            ) as error:  # boxes too close, parts too small: in another state they may not be
                row = {**row, "refused": attempt + 1, "error": _reason(error)}
            except Exception as error:
                row = {**row, "error": _reason(error)}
                break
        made.append((data, row))
    return made


def _make_record(settings: Settings, obj, row: Row, attempt: int) -> tuple[bytes, Row]:
    from uniart_jax.procedural.states import sample_state
    from uniart_jax.render import render, sample_camera
    from uniart_jax.voxels.voxelize import voxelize

    # Own stream (last entry): generate() uses [seed, family index].
    rng = np.random.default_rng([int(row["seed"]), int(row["state"]), attempt, 7])
    shown = sample_state(obj, rng)
    if len(shown.parts) > settings.max_parts:
        raise ValueError(f"{len(shown.parts)} parts, more than max_parts = {settings.max_parts}")
    grid = voxelize(shown, settings.resolution, settings.subdivisions)
    cameras = [sample_camera(rng) for _ in range(settings.views)]
    images = np.stack([render(shown, camera, size=settings.image_size) for camera in cameras])
    angles = [(c.azimuth, c.elevation, c.fov_degrees, c.distance) for c in cameras]
    meta = {key: row[key] for key in ("id", "family", "seed", "state")}
    record = from_object(shown, images, np.array(angles, np.float32), meta, grid)
    types = collections.Counter(j.type for j in shown.joints[1:])
    facts: Row = {
        "joints": " ".join(f"{name}:{n}" for name, n in sorted(types.items())),
        "parts": len(shown.parts),
        "voxels": len(grid.coords),
    }
    return to_bytes(record), facts


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"


def _make_all(
    settings: Settings, indices: Sequence[int], processes: int
) -> Generator[list[tuple[bytes, Row]], None, None]:
    """Results of ``make_object`` in order; workers stay a bounded number of objects ahead."""
    processes = processes if len(indices) > 1 else 1
    with process_pool(processes) as submit:
        make = functools.partial(make_object, settings)
        yield from in_order(submit, make, indices, 1 if processes == 1 else 8 * processes)


def _progress(show: bool, total: int, done: int):
    if show:
        return advancing("prepare", total, done=done)
    return contextlib.nullcontext(lambda: None)


def _finish(out: Path, settings: Settings, count: int) -> None:
    """Manifest, data card and contact sheet of a complete folder; says on stderr how many objects failed.

    Raises:
      ValueError: all of them.
    """
    from uniart_jax.data.card import write_contact_sheet, write_data_card

    rows: list[dict[str, str]] = []
    for number in range(-(-count // settings.shard_size)):
        with rows_path(out, number).open(newline="") as file:
            rows.extend(csv.DictReader(file))
    write_rows(out / "manifest.csv", rows)
    write_data_card(out, rows)
    write_contact_sheet(out, rows)
    failed = [row for row in rows if row["error"]]
    if not failed:
        return
    if len(failed) == len(rows):
        raise ValueError(
            f"{out}: none of {count} objects succeeded, the first because: {failed[0]['error']}; choose other settings and another folder"
        )
    objects = len({row["seed"] for row in failed})
    print(f"prepare: {objects} of {count} objects failed; see the column error of {out}/manifest.csv", file=sys.stderr)  # fmt: skip
