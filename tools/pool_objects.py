"""The objects that ``tools/train_pool.py`` trains on: processes that make them, and a pool in host
memory from which batches are drawn. No jax."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import queue
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax import procedural
from uniart_jax.data.layouts import COLUMNS, LayoutSettings, make_item
from uniart_jax.voxels.overlap import touched_cells

CHUNK = 32  # objects a file
WAITING = 200  # files that may wait before a process rests
NEWER = 1.5  # ages are drawn as u^NEWER of the pool's, so newer objects more often
JUDGED, JUDGED_ROWS = 8, 24  # files that are held back until they are judged, objects of each

READ = (*(name for name in COLUMNS if name != "masks"), "voxels")  # columns that are trained on

Rows = dict[str, np.ndarray]


def make_files(worker: int, workers: int, first: int, folder: str, size: int, side: int) -> None:
    """Write files of ``CHUNK`` objects, numbers worker, worker + workers, ... without end.

    Args:
      first: number of the first object. size: pixels a side. side: voxels a side.
    """
    os.nice(10)
    keep_to_core(worker)
    settings = LayoutSettings(size, views=1, families=procedural.WORLDS["wide"])
    for number in itertools.count(worker, workers):
        while len(list(Path(folder).glob("*.npz"))) > WAITING:
            time.sleep(0.5)
        rows = []
        for index in range(first + number * CHUNK, first + (number + 1) * CHUNK):
            try:
                made = make_item(index, settings)
            except ValueError:  # one faulty object in many thousands
                continue
            if made is not None:
                rows.append({**made[1], "voxels": packed_voxels(made[0], side)})
        if rows:
            partial = Path(folder, f".{number}.part")
            with partial.open("wb") as file:
                np.savez(file, **{k: np.stack([r[k] for r in rows]) for k in READ})
            partial.rename(Path(folder, f"{number:07d}.npz"))


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
        count = len(rows["boxes"])
        place = (self.total + np.arange(count)) % self.capacity
        for name, values in rows.items():
            if name not in self._rows:
                self._rows[name] = np.zeros((self.capacity, *values.shape[1:]), values.dtype)
            self._rows[name][place] = values
        self.total += count

    def draw(self, rng: np.random.Generator, size: int) -> Rows:
        held = min(self.total, self.capacity)
        age = np.minimum((held * rng.random(size) ** NEWER).astype(np.int64), held - 1)
        place = (self.total - 1 - age) % self.capacity
        return {name: values[place] for name, values in self._rows.items()}


class Objects:
    """Objects that processes make, as a context: ``batch`` draws from the pool, ``unseen`` gives
    those that were not in it yet."""

    def __init__(self, processes: int, first: int, size: int, side: int, pool: Pool):
        self.pool = pool
        self._folder = tempfile.TemporaryDirectory(prefix="pool-")
        start = multiprocessing.get_context("spawn").Process
        given = (processes, first, self._folder.name, size, side)
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
                if len(rows["boxes"]) < JUDGED_ROWS or self._unseen.full():
                    self._add(rows)
                else:
                    self._unseen.put(rows)
            time.sleep(0.1)
