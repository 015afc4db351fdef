"""Layout network and structure flow trained on from a checkpoint, together, on one accelerator.

    python tools/train_pool.py --init nano --out OUT --processes 15 --seconds 1500

Worker processes make objects without end (``data.layouts.make_item``, one picture each, and the
voxels that the surface touches); host memory keeps the newest ``--capacity`` of them, and batches
are drawn from these, newer ones more often. So the accelerator never waits, and each object is
shown a few times only. Both networks take a step with every batch:

    layout      ``training.layout_loss``, on pictures whose light is changed a little
    structure   rectified flow of the structure latent, most of it at t = 1; besides, cross-entropy
                and Dice of what the structure VAE decodes of its x_0, and of what the refiner makes
                of that. Layouts are true, with errors (``data.layout_errors``), absent, or those
                that the layout network finds in the picture.

The learning rates hold for ``HOLD`` of the time and fall to zero at its end: it is the clock that
counts, not the steps, so this script does not resume. ``--deadline FILE`` holds another end
(seconds since the epoch) and may be changed on the way. OUT gets averaged weights every ``--save``
seconds.
The loss on objects that were not yet shown is said as they come. ``--tiny`` runs it on a CPU.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
import json
import multiprocessing
import os
import queue
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

HOLD = 0.45
CHUNK = 32  # objects a file
WAITING = 200  # files that may wait before a worker rests


# ------------------------------------------------------------------ making objects (no jax)


def make_files(worker: int, workers: int, first: int, folder: str, size: int) -> None:
    """Write files of ``CHUNK`` objects, numbers worker, worker + workers, ... without end."""
    from uniart_jax import procedural
    from uniart_jax.data.layouts import COLUMNS, LayoutSettings, make_item

    os.nice(10)
    settings = LayoutSettings(size, views=1, families=procedural.WORLDS["wide"])
    for number in itertools.count(worker, workers):
        while len(os.listdir(folder)) > WAITING:
            time.sleep(0.5)
        rows = []
        for index in range(first + number * CHUNK, first + (number + 1) * CHUNK):
            try:
                made = make_item(index, settings)
            except ValueError:
                continue
            if made is not None:
                rows.append({**made[1], "voxels": packed_voxels(made[0])})
        if rows:
            partial = Path(folder, f".{number}.part")
            with partial.open("wb") as file:
                np.savez(file, **{k: np.stack([r[k] for r in rows]) for k in (*COLUMNS, "voxels")})
            partial.rename(Path(folder, f"{number:07d}.npz"))


def packed_voxels(obj: Any, resolution: int = 32) -> np.ndarray:
    """[R^3 / 8] uint8, the bits of the voxels that an object's surface touches."""
    from uniart_jax.voxels.overlap import touched_cells

    corners = np.concatenate([part.mesh.vertices[part.mesh.faces] for part in obj.parts])
    cells = touched_cells((corners + 0.5) * resolution, resolution)[1]
    grid = np.zeros((resolution,) * 3, bool)
    grid[tuple(np.unique(cells, axis=0).T)] = True
    return np.packbits(grid.reshape(-1))


class Pool:
    """The newest objects, in host memory."""

    def __init__(self, capacity: int):
        self.capacity, self.total, self.rows = capacity, 0, {}

    def add(self, rows: dict[str, np.ndarray]) -> None:
        count = len(rows["boxes"])
        place = (self.total + np.arange(count)) % self.capacity
        for name, values in rows.items():
            if name not in self.rows:
                self.rows[name] = np.zeros((self.capacity, *values.shape[1:]), values.dtype)
            self.rows[name][place] = values
        self.total += count

    def draw(self, rng: np.random.Generator, size: int) -> dict[str, np.ndarray]:
        held = min(self.total, self.capacity)
        age = np.minimum((held * rng.random(size) ** 1.5).astype(np.int64), held - 1)
        place = (self.total - 1 - age) % self.capacity
        return {name: values[place] for name, values in self.rows.items()}


def read_files(folder: Path, into: queue.Queue, stop: threading.Event) -> None:
    while not stop.is_set():
        names = sorted(folder.glob("*.npz"))
        for path in names:
            with np.load(path, allow_pickle=False) as held:
                rows = {name: held[name] for name in held.files}
            path.unlink()
            rows["images"], rows["cameras"] = rows["images"][:, 0], rows["cameras"][:, 0]
            into.put(rows)
        if not names:
            time.sleep(0.2)


# ------------------------------------------------------------------ on the accelerator


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--init", default="nano")
    parser.add_argument("--out", required=True)
    parser.add_argument("--work", default="/tmp/pool", help="files that wait lie here")
    parser.add_argument("--processes", type=int, default=15)
    parser.add_argument("--seconds", type=float, default=1500)
    parser.add_argument("--deadline", default="")
    parser.add_argument("--first", type=int, default=200_000, help="number of the first object")
    parser.add_argument("--capacity", type=int, default=200_000)
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--begin-with", type=int, default=1024, help="objects before step 1")
    parser.add_argument("--rate", type=float, default=1.2e-3, help="of the layout network")
    parser.add_argument("--flow-rate", type=float, default=8e-4)
    parser.add_argument("--refine-channels", type=int, default=8)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--save", type=float, default=150)
    parser.add_argument("--tiny", action="store_true")
    given = parser.parse_args()
    if given.tiny:
        given.processes, given.batch, given.begin_with, given.capacity = 1, 4, 8, 64
    folder = Path(given.work)
    folder.mkdir(parents=True, exist_ok=True)
    start = multiprocessing.get_context("spawn").Process
    work = (given.processes, given.first, str(folder), 256)
    makers = [
        start(target=make_files, args=(i, *work), daemon=True) for i in range(given.processes)
    ]
    for maker in makers:
        maker.start()
    try:
        train(given, folder)
    finally:
        for maker in makers:
            maker.terminate()


class Run(NamedTuple):
    """A network's state while it trains."""

    params: Any
    moments: Any
    average: Any


def train(given: argparse.Namespace, folder: Path) -> None:
    import jax
    import jax.numpy as jnp
    from pool_losses import make_structure_loss, prepared

    from uniart_jax.models.network import build
    from uniart_jax.training.export import (
        checkpoint_folder,
        export_network,
        load_network,
        read_config,
        read_statistics,
        write_config,
    )
    from uniart_jax.training.layout_loss import make_layout_loss
    from uniart_jax.training.state import make_optimizer

    print(jax.devices(), jax.__version__, flush=True)
    init, replace = checkpoint_folder(given.init), dataclasses.replace
    base = read_config(init)
    model = base.model
    shipped = replace(
        base,
        model=replace(
            model,
            layout=replace(model.layout, repeats=given.repeats),
            structure_flow=replace(model.structure_flow, refine_channels=given.refine_channels),
        ),
    )
    # on a GPU JAX's own derivatives of shifted sums are the faster ones, and rows are short
    config = replace(shipped, model=replace(shipped.model, kernel="plain"))
    frozen = ("image_encoder", "structure_vae")
    nets = {n: build(n, config.model) for n in ("layout", "structure_flow", *frozen)}
    fixed = {n: load_network(init, n, nets[n].abstract()) for n in frozen}
    fixed = jax.device_put(fixed)
    statistics = read_statistics(init, "structure")
    begin = {
        "layout": load_network(init, "layout", nets["layout"].abstract()),
        "structure_flow": with_new_layers(nets["structure_flow"], init, load_network, model, build),
    }
    steady = {"schedule": "constant", "warmup_steps": 200}
    stages = {
        "layout": replace(base.layout, learning_rate=given.rate, **steady),
        "structure_flow": replace(base.structure_flow, learning_rate=given.flow_rate, **steady),
    }
    losses = {
        "layout": make_layout_loss(nets["layout"], config),
        "structure_flow": make_structure_loss(nets, config, statistics),
    }
    runs, updates = {}, {}
    for name in begin:
        params = jax.device_put(begin[name])
        optimizer = make_optimizer(stages[name])
        runs[name] = Run(params, optimizer.init(params), jax.tree.map(jnp.copy, params))
        updates[name] = make_update(losses[name], optimizer, 0.998)
    prepare = jax.jit(prepared)

    @jax.jit
    def judge(average, batch):
        batch = prepare(batch, jax.random.key(0), False)
        return losses["layout"](average, batch, jax.random.key(1))

    arriving: queue.Queue = queue.Queue(64)
    stop, pool = threading.Event(), Pool(given.capacity)
    threading.Thread(target=read_files, args=(folder, arriving, stop), daemon=True).start()
    while pool.total < given.begin_with:
        pool.add(arriving.get())
    print(f"{pool.total} objects; step 1", flush=True)
    rng, began = np.random.default_rng(1), time.time()
    batches: queue.Queue = queue.Queue(4)
    fresh: list[dict[str, np.ndarray]] = []

    def supply() -> None:
        while not stop.is_set():
            while not arriving.empty():
                rows = arriving.get()
                if len(fresh) < 8 and len(rows["boxes"]) >= min(24, given.batch):
                    fresh.append({k: v[: min(24, given.batch)] for k, v in rows.items()})
                pool.add(rows)
            batches.put(jax.device_put(pool.draw(rng, given.batch)))

    threading.Thread(target=supply, daemon=True).start()
    end = began + given.seconds
    saved, said, seen, log = began, began, 0, {}
    for step in itertools.count():
        now = time.time()
        if given.deadline and os.path.exists(given.deadline):
            end = float(Path(given.deadline).read_text())
        if now >= end:
            break
        factor = np.float32(min(1.0, (end - now) / ((end - began) * (1 - HOLD))))
        key = jax.random.fold_in(jax.random.key(7), step)
        batch = prepare(batches.get(), key, True)
        runs["layout"], found = updates["layout"](runs["layout"], batch, key, factor)
        given_weights = (*(fixed[n] for n in frozen), runs["layout"].average)
        runs["structure_flow"], more = updates["structure_flow"](
            runs["structure_flow"], batch, key, factor, given_weights
        )
        for name, value in {**found, **{f"s_{k}": v for k, v in more.items()}}.items():
            log.setdefault(name, []).append(value)
        seen += given.batch
        if step % 20 == 19:
            jax.block_until_ready(runs["structure_flow"].params)
        if step < 3 or now - said > 15:
            means = {k: round(float(np.mean(jax.device_get(v))), 4) for k, v in log.items()}
            while fresh:
                means.setdefault("fresh", []).append(
                    float(judge(runs["layout"].average, fresh.pop())[0])
                )
            if "fresh" in means:
                means["fresh"] = round(float(np.mean(means["fresh"])), 4)
            rate = seen / max(now - began, 1)
            state = f"{now - began:.0f} s, step {step + 1}, {rate:.0f} pictures/s"
            state += f", {pool.total} objects, {batches.qsize()} ready, rate x {factor:.2f}"
            print(f"{state}: {json.dumps(means)}", flush=True)
            said, log = time.time(), {}
        if time.time() - saved > given.save:
            write(given.out, shipped, runs, export_network, write_config)
            saved = time.time()
    write(given.out, shipped, runs, export_network, write_config)
    stop.set()
    print(f"done: {step} steps, {seen} pictures of {pool.total} objects", flush=True)


def write(out, config, runs, export_network, write_config) -> None:
    Path(out).mkdir(parents=True, exist_ok=True)
    write_config(out, config)
    for name, run in runs.items():
        export_network(out, name, run.average)


def with_new_layers(network, init, load_network, model, build) -> Any:
    """A structure flow's weights from a checkpoint; a refiner that it has not is drawn."""
    import jax

    old = load_network(init, "structure_flow", build("structure_flow", model).abstract())
    return jax.device_get(network.init(jax.random.key(3))) | old


def make_update(loss_fn, optimizer, decay):
    import jax
    import jax.numpy as jnp
    import optax

    @functools.partial(jax.jit, donate_argnums=0)
    def update(run, batch, key, factor, *frozen):
        (loss, metrics), grads = jax.value_and_grad(loss_fn, has_aux=True)(
            run.params, batch, key, *frozen
        )
        norm = optax.tree.norm(grads)
        fine = jnp.isfinite(loss) & jnp.isfinite(norm)
        changes, moments = optimizer.update(grads, run.moments, run.params)
        params = optax.apply_updates(run.params, jax.tree.map(lambda c: factor * c, changes))
        average = optax.incremental_update(params, run.average, 1 - decay)
        new = jax.tree.map(lambda a, b: jnp.where(fine, a, b), Run(params, moments, average), run)
        return new, {"loss": loss, "norm": norm, **metrics}

    return update


if __name__ == "__main__":
    main()
