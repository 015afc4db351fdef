"""Prepared folders: thousands of objects voxelised and rendered into ArrayRecord shards, by several
processes, several machines or Beam.

    object -> records (``data.object_records``) -> shard + rows -> manifest, card, contact sheet

The folder's layout is in ``data.folder``, objects come from ``data.sources``. A shard gets its name
only when it is complete (its rows first, then the shard itself), and depends on nothing but the
settings and its objects. So a run may be killed at any moment; run again, it keeps the finished
shards and ends with the same bytes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

from uniart_jax.config import GridConfig
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
from uniart_jax.data.object_records import Made, make_records
from uniart_jax.data.shards import MAX_RECORD_BYTES, shard_writer
from uniart_jax.data.sources import Entry, ProceduralEntries
from uniart_jax.objects.facing import check_front
from uniart_jax.runtime.files import sweep
from uniart_jax.runtime.processes import map_isolated
from uniart_jax.runtime.progress import advancing


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
