"""Prepared folders: thousands of objects voxelised and rendered into ArrayRecord shards, by several
processes, several machines or Beam.

    object -> shown states -> normalised -> voxels, views -> shard + rows -> manifest, card, contact
    sheet

The folder's layout is in ``data.folder``, objects come from ``data.sources``. A shard gets its name
only when it is complete (its rows first, then the shard itself), and depends on nothing but the
settings and its objects. So a run may be killed at any moment; run again, it keeps the finished
shards and ends with the same bytes.
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import functools
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

import numpy as np

from uniart_jax.config import GridConfig
from uniart_jax.data.columns import pack_orbit
from uniart_jax.data.folder import (
    ORBIT,
    Row,
    Settings,
    check_settings,
    finished,
    rows_path,
    shard_path,
    shard_rows,
    write_rows,
)
from uniart_jax.data.memory import release
from uniart_jax.data.records import from_object, to_bytes
from uniart_jax.data.shards import MAX_RECORD_BYTES, shard_writer
from uniart_jax.data.sources import Entry, ProceduralEntries, clean, load_entry
from uniart_jax.objects.clearance import Clearance
from uniart_jax.objects.facing import check_front
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.perturb import part_factors, scale_parts
from uniart_jax.objects.robot_object import lost_pieces
from uniart_jax.objects.states import sample_state
from uniart_jax.runtime.files import sweep
from uniart_jax.runtime.processes import map_isolated
from uniart_jax.runtime.progress import advancing
from uniart_jax.visual.render import Camera

MAX_TEXT = 4000  # characters of a field of the manifest
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
      out: folder to make, or one that an earlier run with the same settings left unfinished or
        smaller.
      count: objects; each gives ``states`` records, with ``views`` images of ``image_size`` pixels
        a side.
      families: names of ``procedural`` families in turn; the seen ones by default.
      start_seed: object k uses seed ``start_seed + k``.
      processes: workers; 1 works in this process. More need the caller's main module to be
        importable (as spawn does).
      shard_size: objects a shard; what a killed run loses at most.
      progress: a bar on stderr, or lines now and then where stderr is no terminal.

    Returns:
      The folder.

    Raises:
      ValueError: a setting is out of range or a family unknown; ``out`` holds records of other
        settings, more objects than ``count``, or other files; a worker died; or no object
        succeeded.
    """
    settings = Settings(
        start_seed=start_seed,
        resolution=grid.resolution,
        subdivisions=grid.subdivisions,
        max_parts=grid.max_parts,
        views=views,
        image_size=image_size,
        states=states,
        shard_size=shard_size,
    )
    entries, settings = procedural_entries(settings, count, families)
    return prepare(out, entries, settings, processes=processes, progress=progress)


def procedural_entries(
    settings: Settings, count: int, families: Sequence[str] | None
) -> tuple[ProceduralEntries, Settings]:
    """``count`` procedural objects from the settings' first seed on, and the settings with their
    families.

    Raises:
      ValueError: no objects, or a family that does not exist.
    """
    from uniart_jax import procedural

    if count < 1:
        raise ValueError(f"prepare: count must be at least 1, got {count}")
    families = tuple(procedural.SEEN_FAMILIES if families is None else families)
    known = procedural.FAMILIES
    unknown = [name for name in families if name not in known]
    if unknown or not families:
        raise ValueError(
            f"prepare: unknown families {', '.join(unknown) or '(none given)'}; known: "
            f"{', '.join(known)}"
        )
    entries = ProceduralEntries(families, settings.start_seed, count)
    return entries, dataclasses.replace(settings, families=families)


def prepare(
    out: str | Path,
    entries: Sequence[Entry],
    settings: Settings,
    *,
    processes: int = 2,
    part: tuple[int, int] = (0, 1),
    progress: bool = True,
    run: Callable[[Path, Settings, list[tuple[int, Sequence[Entry]]]], None] | None = None,
) -> Path:
    """Make the records of objects.

    Args:
      out: folder to make, or one that an earlier run with the same settings left unfinished or
        smaller.
      entries: the objects, in an order that stays as it is.
      processes: workers; 1 works in this process, which an object that crashes takes along. More
        need the caller's main module to be importable (as spawn does).
      part: (i, n): of n runs that share ``out``, this is number i and makes every n-th shard. The
        last to finish writes the manifest.
      progress: a bar on stderr, or lines now and then where stderr is no terminal.
      run: makes the shards (number, objects) in place of the workers here (``data.beam``).

    Returns:
      The folder.

    Raises:
      ValueError: a setting is out of range; ``out`` holds records of other settings or objects, or
        other files; or no object succeeded.
    """
    check(settings, processes, part)
    out = Path(out)
    check_settings(out, settings, _keys(entries), [entry.split for entry in entries])
    for place in (out, out / "rows"):
        sweep(place)
    size = settings.shard_size
    shards = [entries[k : k + size] for k in range(0, len(entries), size)]
    mine = range(part[0], len(shards), part[1])
    orbits = settings.orbit_views > 0
    todo = [(i, shards[i]) for i in mine if not finished(out, i, _keys(shards[i]), orbits)]
    if run is not None:
        run(out, settings, todo)
    else:
        total, left = sum(len(shards[i]) for i in mine), [e for _, shard in todo for e in shard]
        with (
            _progress(progress, total, total - len(left)) as advance,
            contextlib.closing(_make_all(settings, left, processes)) as made,
        ):
            for number, shard in todo:
                write(out, number, settings, made, len(shard), advance)
    if all(finished(out, i, _keys(shard), orbits) for i, shard in enumerate(shards)):
        _finish(out, settings, len(shards))
    elif part[1] == 1:
        raise ValueError(f"{out}: some shards are missing; run the same command again")
    return out


def check(settings: Settings, processes: int = 1, part: tuple[int, int] = (0, 1)) -> None:
    """Raises ValueError where a setting is out of range."""
    check_front(settings.front, "prepare: front")
    if not 0 <= settings.part_scale <= 0.5:
        raise ValueError(f"prepare: part scale must be in 0..0.5, got {settings.part_scale}")
    if settings.orbit_views * settings.orbit_size**2 * 4 > MAX_RECORD_BYTES:
        raise ValueError(
            f"prepare: {settings.orbit_views} orbit views of {settings.orbit_size} pixels are more "
            "than 1 GiB; make them fewer or smaller"
        )
    for name, value, low, high in (
        ("start seed", settings.start_seed, 0, None),
        ("resolution", settings.resolution, 1, 256),
        ("subdivisions", settings.subdivisions, 1, 8),
        ("max_parts", settings.max_parts, 1, 255),
        ("views", settings.views, 1, None),
        ("image size", settings.image_size, 8, None),
        ("states", settings.states, 1, None),
        ("shard size", settings.shard_size, 1, None),
        ("orbit views", settings.orbit_views, 0, None),
        ("orbit size", settings.orbit_size, 8, None),
        ("processes", processes, 1, None),
        ("number of runs", part[1], 1, None),
        ("number of this run", part[0], 0, part[1] - 1),
    ):
        if value < low or (high is not None and value > high):
            span = f"at least {low}" if high is None else f"in {low}..{high}"
            raise ValueError(f"prepare: {name} must be {span}, got {value}")


def _keys(entries: Sequence[Entry]) -> list[str]:
    return [entry.key for entry in entries]


def make_shard(out: Path, settings: Settings, number: int, entries: Sequence[Entry]) -> int:
    """Make one shard, all of it in this process; its number."""
    made = (make_records(settings, entry) for entry in entries)
    write(out, number, settings, made, len(entries), lambda: None)
    return number


Made = list[tuple[bytes, bytes, Row]]  # record, orbit, row; b"" instead of a record where it failed


def write(
    out: Path,
    number: int,
    settings: Settings,
    made: Iterator[Made],
    count: int,
    advance: Callable[[], None],
) -> None:
    """Write the next ``count`` objects as a shard, as they come: to names of its own, then its
    rows, then the shards get their names, the orbits' last."""
    rows: list[Row] = []
    path = shard_path(out, number)
    with contextlib.ExitStack() as stack:
        if settings.orbit_views:
            write_orbit = stack.enter_context(shard_writer(shard_path(out, number, ORBIT)))
        write_record = stack.enter_context(shard_writer(path))
        for _ in range(count):
            for data, orbit, row in next(made):
                rows.append(row)
                if data:
                    write_record(data)
                    if settings.orbit_views:
                        write_orbit(orbit)
            advance()
        # a smaller run's short last shard: the new one begins with it
        for old in (path, shard_path(out, number, ORBIT)):
            old.unlink(missing_ok=True)
        write_rows(rows_path(out, number), rows)


def make_records(settings: Settings, entry: Entry) -> Made:
    """Records, orbits and manifest rows of an object at each of its shown states. Never raises
    ``Exception``."""
    base: Row = {
        "object": entry.key,
        "category": entry.category,
        "seed": entry.seed if entry.seed >= 0 else "",
        "split": entry.split,
        "refused": 0,
        "error": "",
    }
    made: Made = []
    try:
        obj = load_entry(entry, settings)
        if settings.source != "procedural":
            release()  # decoded textures of this object's files and of the object before
        base["repairs"] = listed(obj.normalized().provenance)  # what codes cannot hold too
        base["category"] = entry.category or obj.category
        if settings.strict and (lost := lost_pieces(obj.provenance)):
            raise ValueError(f"incomplete: {lost[0]}")
        if len(obj.parts) > settings.max_parts:
            raise ValueError(f"{len(obj.parts)} parts, more than max_parts = {settings.max_parts}")
        clearance = Clearance(obj)
    except Exception as error:  # one bad object must not stop a run of thousands; its row says why
        row: Row = {**base, "id": f"{entry.key}-0", "state": 0, "error": _reason(error)}
        return [(b"", b"", row)]
    for state in range(settings.states):
        row = {**base, "id": f"{entry.key}-{state}", "state": state}
        data = orbit = b""
        for attempt in range(ATTEMPTS):
            try:
                data, orbit, facts = _make_record(settings, obj, clearance, entry, row, attempt)
                row = {**row, **facts, "error": ""}
                break
            except ValueError as error:
                # boxes too close, parts too small: in another state they may not be
                row = {**row, "refused": attempt + 1, "error": _reason(error)}
            except Exception as error:
                row = {**row, "error": _reason(error)}
                break
        made.append((data, orbit, row))
    return made


def _make_record(
    settings: Settings,
    obj: ArticulatedObject,
    clearance: Clearance,
    entry: Entry,
    row: Row,
    attempt: int,
) -> tuple[bytes, bytes, Row]:
    from uniart_jax.visual.render import render, sample_camera
    from uniart_jax.voxels.voxelize import voxelize

    # Own stream (last entry): generate() uses [seed, family index].
    rng = entry.generator(int(row["state"]), attempt, 7)
    if settings.part_scale and int(row["state"]):
        rest = obj.shown_at(obj.rest())
        obj = scale_parts(rest, part_factors(rest, rng, settings.part_scale))
        clearance = Clearance(obj)
    shown = sample_state(obj, rng, clearance)
    grid = voxelize(shown, settings.resolution, settings.subdivisions)
    cameras = [sample_camera(rng) for _ in range(settings.views)]
    images = np.stack([render(shown, camera, size=settings.image_size) for camera in cameras])
    meta = {"id": row["id"], "category": row["category"], "state": row["state"]}
    if entry.seed >= 0:
        meta["seed"] = entry.seed
    record = from_object(shown, images, _angles(cameras), meta, grid)
    types = collections.Counter(j.type for j in shown.joints[1:])
    facts: Row = {
        "joints": " ".join(f"{name}:{n}" for name, n in sorted(types.items())),
        "parts": len(shown.parts),
        "voxels": len(grid.coords),
    }
    return to_bytes(record), _make_orbit(settings, shown, str(row["id"])), facts


def _make_orbit(settings: Settings, shown: ArticulatedObject, name: str) -> bytes:
    """Pictures from all around, evenly over the sphere, as an item of the column "orbit"; b"" if
    none are asked for."""
    from uniart_jax.visual.render import orbit_cameras, render

    if not settings.orbit_views:
        return b""
    cameras = orbit_cameras(settings.orbit_views)
    images = [
        np.rint(render(shown, camera, size=settings.orbit_size) * 255).astype(np.uint8)
        for camera in cameras
    ]
    return pack_orbit(np.stack(images), _angles(cameras), name)


def _angles(cameras: Sequence[Camera]) -> np.ndarray:
    rows = [(c.azimuth, c.elevation, c.fov_degrees, c.distance) for c in cameras]
    return np.array(rows, np.float32).reshape(-1, 4)


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    text = text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"
    return clean(text)[:MAX_TEXT]


def listed(repairs: Sequence[str]) -> str:
    """Repairs as one field of the manifest; of very many, the first and how many more there are."""
    text, shown = "", 0
    for shown, repair in enumerate(repairs):
        longer = f"{text} | {repair}" if text else repair
        if len(longer) > MAX_TEXT:
            return clean(f"{text} | and {len(repairs) - shown} more" if text else longer[:MAX_TEXT])
        text = longer
    return clean(text)


def _make_all(
    settings: Settings, entries: Sequence[Entry], processes: int
) -> Generator[Made, None, None]:
    """Results of ``make_records`` in order; workers stay a bounded number of objects ahead."""
    make = functools.partial(make_records, settings)
    ahead = 2 * processes if settings.orbit_views else 8 * processes  # orbits are large
    yield from map_isolated(processes, make, entries, ahead, _died)


def _died(entry: Entry) -> Made:
    reason = "its worker process died (out of memory?)"
    row: Row = {
        "id": f"{entry.key}-0",
        "object": entry.key,
        "category": entry.category,
        "state": 0,
        "split": entry.split,
        "refused": 0,
        "error": reason,
    }
    return [(b"", b"", row)]


def _progress(show: bool, total: int, done: int):
    if show:
        return advancing("prepare", total, done=done)
    return contextlib.nullcontext(lambda: None)


def _finish(out: Path, settings: Settings, shards: int) -> None:
    """Manifest, data card and contact sheet of a complete folder; says on stderr how many objects
    failed.

    Raises:
      ValueError: all of them.
    """
    from uniart_jax.data.card import error_kinds, write_contact_sheet, write_data_card

    rows = [row for number in range(shards) for row in shard_rows(out, number)]
    write_rows(out / "manifest.csv", rows)
    write_data_card(out, rows)
    write_contact_sheet(out, rows, settings)
    failed = [row for row in rows if row["error"]]
    if not failed:
        return
    count = len({row["object"] for row in rows})
    if len(failed) == len(rows):
        raise ValueError(
            f"{out}: none of {count} objects succeeded, the first because: {failed[0]['error']}; "
            "choose other settings and another folder"
        )
    first = {row["object"]: row for row in reversed(failed)}  # of each object
    kinds = "; ".join(f"{n} {kind}" for kind, n in error_kinds([*first.values()])[:5])
    print(
        f"prepare: {len(first)} of {count} objects failed in some state ({kinds}); see the column "
        f"error of {out}/manifest.csv",
        file=sys.stderr,
    )
