"""Records made again while training: the objects of a prepared folder at new shown states and with
parts of new sizes.

    manifest row -> object -> scale_parts at rest -> sample_state -> voxelize -> record without
    pictures

A pure function of (folder, row, random numbers), so batches with live records resume exactly. For
stages that read no picture: the UniArt VAE, and only without multi-view features. Voxelising is
what it costs (docs/data.md): ``data.workers`` shares it among processes.
"""

from __future__ import annotations

import dataclasses
import functools
import logging
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.config import DataConfig, GridConfig
from uniart_jax.data.folder import Settings, read_manifest, read_metadata
from uniart_jax.data.records import Record, RecordSource, from_object
from uniart_jax.data.sources import Entry, entry_of, load_entry
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.perturb import part_factors, scale_parts
from uniart_jax.objects.states import sample_state
from uniart_jax.voxels.voxelize import voxelize

ATTEMPTS = 3  # sizes and states drawn before the stored record is used
OBJECTS_HELD = 64  # loaded objects a process keeps

logger = logging.getLogger(__name__)


class LiveRecords:
    """The objects behind all records of a folder, in their order: ``live.record(index, ...)`` makes
    one again. Picklable.

    Attributes:
      made, kept: how many were made, and for how many the stored record has to serve, in this
        process.
    """

    def __init__(self, folder: str | Path, data: DataConfig, grid: GridConfig):
        """
        Raises:
          ValueError: ``data.live`` or ``data.part_scale`` is out of range.
          FileNotFoundError, ValueError: no metadata or manifest, or of an older version; the
            folder's assets are not where they were.
        """
        if not 0 <= data.live <= 1 or data.part_scale < 0:
            raise ValueError(
                f"data: live must be in 0..1 and part_scale at least 0, got {data.live} and "
                f"{data.part_scale}"
            )
        self.settings = read_settings(folder)
        self.scale, self.max_parts = data.part_scale, grid.max_parts
        rows = [row for row in read_manifest(folder) if not row["error"]]
        if self.settings.source != "procedural" and not Path(self.settings.root).exists():
            raise FileNotFoundError(
                f"{folder}: its assets are not at '{self.settings.root}' any more; put them there, "
                "start from where they were prepared, or set data.live to 0"
            )
        if len(rows) != (held := len(RecordSource(folder))):
            raise ValueError(
                f"{folder}: {held} records, but its manifest names {len(rows)}: run its prepare "
                "command to the end"
            )
        self.entries = [entry_of(row, self.settings) for row in rows]
        self.made = self.kept = 0

    def record(self, index: int, voxels: int, rng: np.random.Generator) -> Record | None:
        """Record ``index`` made again; None where its object cannot be loaded or gives none of at
        most ``voxels`` voxels and ``max_parts`` parts."""
        obj = loaded(self.entries[index], self.settings)
        for draw in rng.spawn(ATTEMPTS):
            try:
                record = remake(obj, self.settings, self.scale, draw) if obj else None
            except ValueError:  # parts too small or with the same box: not so in another state
                continue
            if record and len(record.coords) <= voxels and len(record.boxes) <= self.max_parts:
                self._count(True)
                return record
        self._count(False)
        return None

    def _count(self, made: bool) -> None:
        self.made, self.kept = self.made + made, self.kept + (not made)
        if (self.made + self.kept) % 1000 == 0:
            logger.info("data: %d records made again, %d kept as stored", self.made, self.kept)

    def __repr__(self) -> str:  # Grain puts it into messages
        return f"LiveRecords({len(self.entries)} objects)"


def remake(
    obj: ArticulatedObject, settings: Settings, scale: float, rng: np.random.Generator
) -> Record:
    """A record of the object with parts of new sizes, at a new shown state; its ``images`` and
    ``cameras`` are empty.

    Args:
      scale: strength of ``objects.perturb.part_factors``.

    Raises:
      ValueError: two parts have the same box, or one is too small to own a voxel.
    """
    if scale:
        rest = obj.shown_at(obj.rest())  # factors along the object's axes shear what is half open
        obj = scale_parts(rest, part_factors(rest, rng, scale))
    shown = sample_state(obj, rng)
    grid = voxelize(shown, settings.resolution, settings.subdivisions)
    size = settings.image_size
    images = np.zeros((0, size, size, 4), np.uint8)
    return from_object(shown, images, np.zeros((0, 4)), {"id": obj.name}, grid)


def read_settings(folder: str | Path) -> Settings:
    """``metadata.json`` as ``Settings``; what an older version did not write has its default.

    Raises:
      FileNotFoundError, ValueError: as ``read_metadata``.
    """
    known = {field.name for field in dataclasses.fields(Settings)}
    held = {k: v for k, v in read_metadata(folder).items() if k in known}
    plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in held.items()}
    return Settings(**plain)


@functools.lru_cache(OBJECTS_HELD)
def loaded(entry: Entry, settings: Settings) -> ArticulatedObject | None:
    """The object, kept while it is asked for; None, with a warning, where it cannot be made."""
    try:
        return load_entry(entry, settings)
    except Exception as error:  # one bad object must not stop a run; as in ``data.prepare``
        logger.warning(
            "data: '%s' cannot be made again, its stored record is used: %s", entry.key, error
        )
        return None
