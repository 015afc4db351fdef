"""The objects that ``tools/train_pool.py`` trains on: processes that make them, and a pool in host
memory from which batches are drawn. No jax."""

from __future__ import annotations

import collections
import itertools
import multiprocessing
import os
import queue
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from uniart_jax import procedural
from uniart_jax.data.backdrop_pictures import picture_paths
from uniart_jax.data.backdrops import training_backdrop
from uniart_jax.data.layouts import COLUMNS, LayoutSettings, make_item
from uniart_jax.data.photographs import photographed
from uniart_jax.data.scenes import GRAIN, OTHERS, scene
from uniart_jax.voxels.overlap import touched_cells

CHUNK = 32  # objects a file
WAITING = 200  # files that may wait before a process rests
NEWER = 1.5  # ages are drawn as u^NEWER of the pool's, so newer objects more often
JUDGED, JUDGED_ROWS = 8, 24  # files that are held back until they are judged, objects of each

BACKDROPS = 32  # that a process keeps, for photographs
SCENES = 0.35  # scenes an object, for the mask network

# columns that layouts and structures are trained on, and those of the mask network
READ = (*(name for name in COLUMNS if name != "masks"), "voxels", "photos", "photo_cameras")
SEEN = ("scenes", "scene_masks")

Rows = dict[str, np.ndarray]


class Sizes(NamedTuple):
    """Pixels a side of the layout network's pictures and of the mask network's; voxels a side."""

    layout: int
    mask: int
    voxels: int


def make_files(
    worker: int,
    workers: int,
    first: int,
    folder: str,
    sizes: Sizes,
    world: str,
    backgrounds: str = "",
) -> None:
    """Write files of ``CHUNK`` objects of a world, numbers worker, worker + workers, ... without
    end; ``first``: number of the first object; ``backgrounds``: as in ``config.DataConfig``."""
    os.nice(10)
    keep_to_core(worker)
    settings = LayoutSettings(sizes.layout, views=1, families=procedural.WORLDS[world])
    photographer = Photographer(sizes, picture_paths(backgrounds))
    for number in itertools.count(worker, workers):
        while len(list(Path(folder).glob("*.npz"))) > WAITING:
            time.sleep(0.5)
        rows, seen = [], []
        for index in range(first + number * CHUNK, first + (number + 1) * CHUNK):
            try:
                made = make_item(index, settings)
                if made is None:
                    continue
                row = {**made[1], "voxels": packed_voxels(made[0], sizes.voxels)}
                photo, shown = photographer.take(np.random.default_rng([index, 7]), row)
            except Exception as error:  # one faulty object in many thousands ends no process
                print(f"object {index} is left out: {error!r:.200}", flush=True)
                continue
            rows.append({**row, **photo})
            seen += shown
        if rows:
            table: dict[str, Any] = {k: np.stack([r[k] for r in rows]) for k in READ}
            table |= {k: np.stack([r[k] for r in seen]) for k in SEEN if seen}
            partial = Path(folder, f".{number}.part")
            with partial.open("wb") as file:
                np.savez(file, **table)
            partial.rename(Path(folder, f"{number:07d}.npz"))


class Photographer:
    """Takes pictures of objects as people do; backgrounds, which take long to draw, are used
    several times, and the objects before stand behind the next."""

    def __init__(self, sizes: Sizes, pictures: tuple[Path, ...] = ()):
        self._sizes, self._pictures = sizes, pictures
        self._backs: collections.deque[np.ndarray] = collections.deque(maxlen=BACKDROPS)
        self._others: collections.deque[Any] = collections.deque(maxlen=OTHERS)

    def take(self, rng: np.random.Generator, row: Rows) -> tuple[Rows, list[Rows]]:
        """Of the row of an object with one view: columns "photos", "photo_cameras", and no or one
        row of ``SEEN``."""
        crop, others, seen = (row["images"][0], row["masks"][0]), list(self._others), []
        if not self._backs or rng.random() < SCENES:
            self._backs.append(training_backdrop(rng, self._sizes.mask, self._pictures))
            back, size = self._backs[-1], self._sizes.mask
            image, mask = scene(rng, crop, others, size, back=back, grain=GRAIN)
            seen = [{"scenes": image, "scene_masks": np.packbits(mask > 127)}]
        back = self._backs[rng.integers(len(self._backs))]
        back = back[:, ::-1] if rng.random() < 0.5 else back
        size = self._sizes.layout
        photo, camera = photographed(rng, crop, row["cameras"][0], others, size, back)
        self._others.append(crop)
        return {"photos": photo, "photo_cameras": camera}, seen


def keep_to_core(worker: int) -> None:
    """Keep this thread, and those that it starts (embree's), to one core; the last are taken
    first."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0), reverse=True)
        os.sched_setaffinity(0, {cores[worker % len(cores)]})


def packed_voxels(obj: Any, side: int = 32) -> np.ndarray:
    """[side^3 / 8] uint8, the bits of the voxels that an object's surface touches."""
    corners = np.concatenate([part.mesh.vertices[part.mesh.faces] for part in obj.parts])
    cells = touched_cells((corners + 0.5) * side, side)[1]
    grid = np.zeros((side,) * 3, bool)
    grid[tuple(cells.T)] = True
    return np.packbits(grid.reshape(-1))


class Pool:
    """The newest ``capacity`` objects."""

    def __init__(self, capacity: int):
        self.capacity, self.total = capacity, 0
        self._rows: Rows = {}

    def add(self, rows: Rows) -> None:
        count = len(next(iter(rows.values())))
        place = (self.total + np.arange(count)) % self.capacity
        for name, values in rows.items():
            if name not in self._rows:
                self._rows[name] = np.zeros((self.capacity, *values.shape[1:]), values.dtype)
            self._rows[name][place] = values
        self.total += count

    def draw(self, rng: np.random.Generator, size: int) -> Rows:
        """``size`` rows, newer ones more often."""
        held = min(self.total, self.capacity)
        age = np.minimum((held * rng.random(size) ** NEWER).astype(np.int64), held - 1)
        place = (self.total - 1 - age) % self.capacity
        return {name: np.take(values, place, 0) for name, values in self._rows.items()}


class Objects:
    """Objects that processes make, as a context: ``batch`` draws from the pool, ``scene_batch``
    from that of scenes, ``unseen`` gives the objects that were not in the pool yet."""

    def __init__(
        self,
        processes: int,
        first: int,
        sizes: Sizes,
        pool: Pool,
        scenes: Pool,
        world: str,
        backgrounds: str = "",
    ):
        self.pool, self.scenes = pool, scenes
        self._folder = tempfile.TemporaryDirectory(prefix="pool-")
        start = multiprocessing.get_context("spawn").Process
        given = (processes, first, self._folder.name, sizes, world, backgrounds)
        self._makers = [
            start(target=make_files, args=(i, *given), daemon=True) for i in range(processes)
        ]
        self._unseen: queue.Queue[Rows] = queue.Queue(JUDGED)
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Objects:
        for maker in self._makers:
            maker.start()
        self._reader.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._stop.set()
        for maker in self._makers:
            maker.terminate()
            maker.join()
        self._reader.join()
        self._folder.cleanup()

    def wait_for(self, count: int) -> None:
        """Until the pool has so many.

        Raises:
          RuntimeError: no objects come any more.
        """
        while self.pool.total < count:
            self.check()
            time.sleep(0.2)

    def check(self) -> None:
        """RuntimeError if all processes, or the thread that reads what they make, have ended."""
        if not (self._reader.is_alive() and any(maker.is_alive() for maker in self._makers)):
            raise RuntimeError("pool: nothing makes objects any more; see the errors above")

    def batch(self, rng: np.random.Generator, size: int) -> Rows:
        with self._lock:
            return self.pool.draw(rng, size)

    def scene_batch(self, rng: np.random.Generator, size: int) -> Rows:
        with self._lock:
            return self.scenes.draw(rng, size)

    def unseen(self) -> list[Rows]:
        """What was held back: the first ``JUDGED_ROWS`` of each file. It joins the pool now."""
        held = []
        while not self._unseen.empty():
            held.append(self._unseen.get())
        for rows in held:
            self._add(rows)
        return [{k: v[:JUDGED_ROWS] for k, v in rows.items()} for rows in held]

    def _add(self, rows: Rows) -> None:
        with self._lock:
            self.pool.add(rows)

    def _read(self) -> None:
        while not self._stop.is_set():
            for path in sorted(Path(self._folder.name).glob("*.npz")):
                with np.load(path, allow_pickle=False) as held:
                    rows = {name: held[name] for name in held.files}
                path.unlink()
                rows["images"], rows["cameras"] = rows["images"][:, 0], rows["cameras"][:, 0]
                seen = {name: rows.pop(name) for name in SEEN if name in rows}
                if seen:
                    with self._lock:
                        self.scenes.add(seen)
                if len(rows["boxes"]) < JUDGED_ROWS or self._unseen.full():
                    self._add(rows)
                else:
                    self._unseen.put(rows)
            time.sleep(0.1)
