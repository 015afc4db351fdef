"""Records on the voxels that a model finds in a picture, in place of the true ones.

What flows sample lies on voxels that the structure flow found: too many of them, some missing. A
decoder that has seen true voxels alone draws a surface through each. Of such records it can learn
which of them hold no surface (``loss.sampled`` 1, ``loss.found`` 1).
"""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy.spatial import cKDTree

from uniart_jax.data.folder import read_metadata
from uniart_jax.data.records import (
    Record,
    RecordSource,
    encode_sdf,
    record_rows,
    to_bytes,
    write_shard,
)
from uniart_jax.inference.mirror_average import encode_views, find_voxels
from uniart_jax.pipeline import Pipeline, load
from uniart_jax.runtime.files import write_text
from uniart_jax.runtime.progress import track
from uniart_jax.voxels.grid import SDF_CLIP, subcell_indices
from uniart_jax.voxels.isosurface import dense_field

SHARD = 64  # records a file
NEAR = 1.0  # sub-cells from the surface, of those that give colour and part to others


def on_voxels(record: Record, coords: np.ndarray) -> Record:
    """A record's object on other voxels.

    Args:
      record: on the voxels that hold its surface.
      coords: [V, 3] integers, unique, in lexicographic order.

    Returns:
      What the record says where it has the voxel. Elsewhere, inside or outside as ``dense_field``
      fills space, at the distance from the nearest sub-cells at the surface, with their colour and
      part.
    """
    grid, r = record.grid(), record.subdivisions
    coords = np.asarray(coords, np.int64)
    sides = (record.resolution,) * 3
    at = np.full(sides, -1)
    at[tuple(record.coords.astype(int).T)] = np.arange(len(record.coords))
    place = at[tuple(coords.T)]
    known = place >= 0
    shape = (len(coords), r**3)
    sdf, owner = np.zeros(shape, np.int8), np.zeros(shape, np.uint8)
    color, part = np.zeros((*shape, 3), np.uint8), np.zeros(len(coords), np.uint8)
    for out, values in (
        (sdf, record.sdf), (color, record.color), (owner, record.owner), (part, record.voxel_part),
    ):  # fmt: skip
        out[known] = values[place[known]]
    if not known.all():
        cells = subcell_indices(coords[~known], r).reshape(-1, 3)
        inside = dense_field(grid, grid.owner).sdf[tuple((cells + 1).T)] < 0
        its_cells = subcell_indices(record.coords.astype(np.int64), r).reshape(-1, 3)
        surface = np.flatnonzero(np.abs(grid.sdf).ravel() <= NEAR)
        surface = surface if len(surface) else np.arange(len(its_cells))
        tree = cKDTree(its_cells[surface])
        distance, nearest = tree.query(cells, distance_upper_bound=SDF_CLIP)
        # beyond that what is nearest to the voxel's centre does
        _, about = tree.query((coords[~known] + 0.5) * r - 0.5)
        nearest = np.where(np.isfinite(distance), nearest, np.repeat(about, r**3))
        source = surface[nearest]
        size = np.clip(distance, 0.5, SDF_CLIP)
        sdf[~known] = encode_sdf(np.where(inside, -size, size)).reshape(-1, r**3)
        color[~known] = record.color.reshape(-1, 3)[source].reshape(-1, r**3, 3)
        owner[~known] = record.owner.reshape(-1)[source].reshape(-1, r**3)
        part[~known] = record.owner.reshape(-1)[surface[about]]
    return dataclasses.replace(
        record, coords=coords.astype(np.uint8), sdf=sdf, color=color, owner=owner, voxel_part=part
    )


def found_record(record: Record, view: int, pipeline: Pipeline) -> Record:
    """A record with one of its pictures, on the voxels that a pipeline finds in it (``on_voxels``);
    on its own where it finds none."""
    image = record.images[view]
    pixels = pipeline.prepare(image)
    options = pipeline.options()
    conditions = encode_views(pipeline, pixels[None], pipeline.layout_or_none(image), *options)
    coords, _ = find_voxels(pipeline, conditions, jax.random.key(0), options[0])
    made = on_voxels(record, coords) if len(coords) else record
    return dataclasses.replace(
        made,
        images=image[None],
        cameras=record.cameras[view : view + 1],
        meta={**record.meta, "id": f"{record.meta['id']}-view{view}"},
    )


def prepare_found(root: Path, out: Path, checkpoint: str, views: int = 1) -> None:
    """``found_record`` of the first ``views`` pictures of each record of a folder. Can be killed
    and run again: finished shards are kept.

    Raises:
      FileNotFoundError, ValueError: no such records or checkpoint, another grid, or ``out`` holds
        records of other settings.
    """
    if views < 1:
        raise ValueError(f"prepare: --views must be at least 1, got {views}")
    source, rows, pipeline = RecordSource(root), record_rows(root), load(checkpoint)
    grid, first = pipeline.config.model.grid, source[0]
    if (first.resolution, first.subdivisions) != (grid.resolution, grid.subdivisions):
        raise ValueError(
            f"{root}: its records have {first.resolution} voxels of {first.subdivisions} sub-cells "
            f"a side, checkpoint '{checkpoint}' {grid.resolution} of {grid.subdivisions}; "
            "give another"
        )
    settings = read_metadata(root) | {"views": 1, "found_by": checkpoint, "found_views": views}
    note = out / "metadata.json"
    if note.is_file() and read_metadata(out) != settings:
        raise ValueError(f"{out}: holds records of other settings; give another folder")
    (out / "rows").mkdir(parents=True, exist_ok=True)
    write_text(note, json.dumps(settings, indent=2) + "\n")
    starts = range(0, len(source), SHARD)
    for number, start in enumerate(track(starts, "found records", len(starts), unit="shards")):
        shard, listed = out / f"records-{number:05d}.arrayrecord", out / f"rows/{number:05d}.csv"
        places = range(start, min(start + SHARD, len(source)))
        if shard.is_file() and _made_of(listed) == [rows[index]["id"] for index in places]:
            continue
        made, lines = [], []
        for index in places:
            record = source[index]
            for view in range(min(views, len(record.images))):
                made.append(found_record(record, view, pipeline))
                changed = {"id": made[-1].meta["id"], "voxels": len(made[-1].coords)}
                lines.append(rows[index] | changed)
        write_shard(shard, [to_bytes(record) for record in made])
        write_text(listed, _csv(lines))
    tables = [path.read_text().splitlines() for path in sorted((out / "rows").glob("*.csv"))]
    lines = tables[0][:1] + [line for table in tables for line in table[1:]]
    write_text(out / "manifest.csv", "\n".join(lines) + "\n")


def _made_of(listed: Path) -> list[str]:
    """The records that a finished shard was made of; [] where it is not finished."""
    if not listed.is_file():
        return []
    with listed.open(newline="") as file:
        names = (row["id"].rpartition("-view")[0] for row in csv.DictReader(file))
        return list(dict.fromkeys(names))


def _csv(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
