"""``uniart features``: columns of per-voxel features beside prepared records (``data.columns``),
a pass of its own.

    visual        orbit pictures -> DINOv2 -> patch maps -> read at each voxel's centre
                  -> mean over views (``precompute.visual_features``)
    part_feature  PartField's files -> nearest point of each voxel (``data.part_features``)
                  or the shape around each voxel, without weights (``data.geometric_features``)

Shard by shard (``precompute.fill_columns``), one record at a time: memory grows neither with the
records nor with the views.
"""

from __future__ import annotations

from pathlib import Path

from uniart_jax.data.columns import open_column
from uniart_jax.data.geometric_features import CHANNELS as GEOMETRIC_CHANNELS
from uniart_jax.data.geometric_features import geometric_features
from uniart_jax.data.part_features import (
    CHANNELS,
    input_name,
    on_voxels,
    read_partfield,
    result_digest,
    surface_points,
    write_points,
)
from uniart_jax.data.records import Record, shard_paths
from uniart_jax.data.shards import open_shards, unpack_arrays
from uniart_jax.precompute.fill_columns import (
    Columns,
    fill_column,
    finished,
    held_note,
    own_shards,
    progress_of,
    records_of,
)
from uniart_jax.precompute.visual_features import load_encoder, visual_of_shard

GEOMETRIC = "geometric"  # a source of part features that is no folder


def write_visual(
    folder: str | Path,
    weights: str | Path,
    *,
    views: int | None = None,
    batch: int = 8,
    part: tuple[int, int] = (0, 1),
    progress: bool = True,
) -> None:
    """The column ``visual`` of a prepared folder, on whatever device there is.

    Args:
      weights: of ``uniart convert dinov2``: the file, or the checkpoint folder that it stands in.
      views: how many of a record's orbit pictures, spread evenly; None = all.
      batch: pictures that the network reads at a time.
      part: (i, n): of n runs that share the folder, this is number i and makes every n-th shard.

    Raises:
      FileNotFoundError: no records, no weights.
      ValueError: no orbit pictures, fewer than ``views``, other weights than those of an unfinished
        column, a file that is no DINOv2.
    """
    if batch < 1 or (views is not None and views < 1):
        raise ValueError("features: --batch and --views must be at least 1")
    shards = [shard for shard in shard_paths(folder) if not finished(shard, "visual")]
    note_held = held_note(folder, "visual")
    if shards:  # orbits of those that are done may be gone
        orbit = open_column("orbit", shards, len(open_shards(shards)))
        if not len(orbit):
            raise ValueError(f"{folder}: its shards are empty; see the errors in its manifest.csv")
        held = len(unpack_arrays(orbit[0], "column 'orbit'")[0].get("cameras", ()))
    else:
        held = int(note_held.get("views", 0))
    if not held or (views or 0) > held:
        raise ValueError(
            f"{folder}: records have {held} orbit pictures, --views asks for {views or 'all'}; "
            "prepare with more --orbit-views"
        )
    encoder = load_encoder(Path(weights))
    note = {
        "weights": encoder.digest,
        "views": views or held,
        "channels": encoder.config.width,
        "image_size": encoder.config.image_size,
    }

    def make(shard: Path) -> Columns:
        return visual_of_shard(shard, encoder, views or held, batch)

    fill_column(folder, "visual", note, make, part, progress)


def write_part_features(
    folder: str | Path, source: Path, *, part: tuple[int, int] = (0, 1), progress: bool = True
) -> None:
    """The column ``part_feature`` of a prepared folder, of PartField's files.

    Raises:
      FileNotFoundError, ValueError: no records, a record without its file, files that are not
        PartField's.
    """
    if not source.is_dir():
        raise FileNotFoundError(
            f"'{source}': no such folder; give the one that PartField wrote its results to"
        )
    note = {"source": "PartField", "channels": CHANNELS}

    def make(shard: Path) -> Columns:
        for row, record in records_of(shard):
            yield (
                record,
                on_voxels(record, *read_partfield(source, _input_name(shard, row, record))),
            )

    def origin(shard: Path, row: int, record: Record) -> str:
        return result_digest(source, _input_name(shard, row, record))

    fill_column(folder, "part_feature", note, make, part, progress, origin)


def write_geometric_features(
    folder: str | Path, *, part: tuple[int, int] = (0, 1), progress: bool = True
) -> None:
    """The column ``part_feature`` of a prepared folder, of its records' own shapes.

    Raises:
      FileNotFoundError: no records. ValueError: the folder has that column from another source.
    """
    note = {"source": GEOMETRIC, "channels": GEOMETRIC_CHANNELS}

    def make(shard: Path) -> Columns:
        for _, record in records_of(shard):
            yield record, geometric_features(record)

    fill_column(folder, "part_feature", note, make, part, progress)


def export_points(
    folder: str | Path, out: Path, *, part: tuple[int, int] = (0, 1), progress: bool = True
) -> None:
    """One PLY of surface points a record, for PartField; those that are there are kept.

    Raises:
      FileNotFoundError: no records. ValueError: ``out`` is a file.
    """
    shards = own_shards(shard_paths(folder), part)
    if out.exists() and not out.is_dir():
        raise ValueError(f"output '{out}': a file of that name exists; choose another folder")
    out.mkdir(parents=True, exist_ok=True)
    with progress_of(progress, "export", len(open_shards(shards)) if shards else 0, 0) as advance:
        for shard in shards:
            for row, record in records_of(shard):
                path = out / f"{_input_name(shard, row, record)}.ply"
                if not path.exists():
                    write_points(path, surface_points(record))
                advance()


def _input_name(shard: Path, row: int, record: Record) -> str:
    return input_name(int(shard.stem.rpartition("-")[2]), row, str(record.meta.get("id")))
