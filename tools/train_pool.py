"""Layout network and structure flow trained on from a checkpoint, together, on one accelerator.

    python tools/train_pool.py --init nano --out OUT --processes 15 --seconds 1500

Worker processes make objects without end (``data.layouts.make_item``, one picture each, and the
voxels that the surface touches); host memory keeps the newest ``--capacity`` of them, and batches
are drawn from these, newer ones more often. So the accelerator never waits, and each object is shown
a few times only. Both networks take a step with every batch:

    layout      ``training.layout_loss``, on pictures whose light is changed a little
    structure   rectified flow of the structure latent, most of it at t = 1; besides, cross-entropy
                and Dice of what the structure VAE decodes of its x_0, and of what the refiner makes
                of that. Layouts are true, with errors (``data.layout_errors``), absent, or those
                that the layout network finds in the picture.

The learning rates hold for ``HOLD`` of the time and fall to zero at its end: it is the clock that
counts, not the steps, so this script does not resume. ``--deadline FILE`` holds another end (seconds
since the epoch) and may be changed on the way. OUT gets averaged weights every ``--save`` seconds.
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
FOUND, ABSENT, EXACT = 0.4, 0.06, 0.35  # shares of the layouts that the structure flow is shown
LOST, MISTAKEN, MOVED = 0.12, 0.1, 0.012  # as in ``data.layout_errors``
WARP = 0.03
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
    nets = {n: build(n, config.model) for n in ("layout", "structure_flow", "structure_vae", "image_encoder")}  # fmt: skip
    fixed = {n: load_network(init, n, nets[n].abstract()) for n in ("structure_vae", "image_encoder")}  # fmt: skip
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
        frozen = (fixed["image_encoder"], fixed["structure_vae"], runs["layout"].average)
        runs["structure_flow"], more = updates["structure_flow"](
            runs["structure_flow"], batch, key, factor, frozen
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
            print(f"{now - began:.0f} s, step {step + 1}, {rate:.0f} pictures/s, {pool.total} objects, "
                  f"{batches.qsize()} ready, rate x {factor:.2f}: {json.dumps(means)}", flush=True)  # fmt: skip
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


def prepared(batch, key, train):
    """A drawn batch as both losses take it, half of it mirrored (``train``)."""
    import jax
    import jax.numpy as jnp

    from uniart_jax.voxels.joint_code import canonical

    keys = jax.random.split(key, 3)
    items = len(batch["boxes"])
    flip = jax.random.bernoulli(keys[0], 0.5, (items,)) & train

    def either(mirrored, plain):
        return jnp.where(flip.reshape(-1, *[1] * (plain.ndim - 1)), mirrored, plain)

    image = batch["images"]
    image = either(image[:, :, ::-1], image).astype(jnp.float32) / 255
    signs = jnp.array([-1, 1, -1, 1, -1, 1, -1, -1, -1], jnp.float32)
    codes, boxes = batch["codes"], batch["boxes"]
    turned = canonical(codes[..., jnp.array([0, 1, 2, 3, 4, 5, 6, 8, 7])] * signs, jnp) + 0.0
    cells = jnp.unpackbits(batch["voxels"], axis=-1)
    side = round(cells.shape[1] ** (1 / 3))
    cells = cells.reshape(items, side, side, side) > 0
    lit = relit(image, keys[1])
    return {
        "plain_image": image,
        "image": jnp.where(train, lit, image),
        "camera": either(batch["cameras"] * jnp.array([-1, 1, 1, 1, 1, -1, 1.0]), batch["cameras"]),
        "boxes": either(boxes * jnp.array([1, -1, 1, 1, 1, 1.0]), boxes),
        "codes": either(turned, codes),
        "parents": batch["parents"],
        "colors": batch["colors"],
        "part_counts": batch["part_counts"],
        "occupancy": either(cells[:, :, ::-1], cells),
    }


def relit(image, key):
    """Images [B, S, S, 3] in another light: half of them brighter or darker, tinted, of another gamma."""
    import jax
    import jax.numpy as jnp

    keys = jax.random.split(key, 4)
    shape = (len(image), 1, 1)
    gain = jnp.exp(0.12 * jax.random.normal(keys[0], (*shape, 1)))
    tint = jnp.exp(0.04 * jax.random.normal(keys[1], (*shape, 3)))
    gamma = jnp.exp(0.12 * jax.random.normal(keys[2], (*shape, 1)))
    other = jnp.clip(jnp.maximum(image, 1e-4) ** gamma * gain * tint, 0, 1)
    other = jnp.where(image > 0, other, 0)
    return jnp.where(jax.random.bernoulli(keys[3], 0.5, (*shape, 1)), other, image)


def make_structure_loss(nets, config, statistics):
    """``loss(params, batch, key, (image encoder's, structure VAE's, layout network's params))``."""
    import jax
    import jax.numpy as jnp

    from uniart_jax.flow.rectified import flow_loss, interpolate, predicted_sample, sample_times
    from uniart_jax.samplers import found_table
    from uniart_jax.training.found_layouts import choose
    from uniart_jax.training.losses import binary_cross_entropy, dice_loss
    from uniart_jax.training.objectives import occupancy_iou, summarize_flow

    flow, vae = nets["structure_flow"], nets["structure_vae"]
    mean, std = (jnp.asarray(s) for s in statistics)
    most, refines = config.model.grid.max_parts, config.model.structure_flow.refine_channels > 0

    def loss_fn(params, batch, key, frozen):
        encoder, vae_params, finder = jax.lax.stop_gradient(frozen)
        keys = jax.random.split(key, 8)
        image, items = batch["plain_image"], len(batch["boxes"])
        out = nets["layout"].apply(finder, image)
        found = found_table(out["parts"][-1], out["parents"], most)
        chosen = jax.random.bernoulli(keys[0], FOUND, (items,))
        layout = choose(chosen, found, tables_with_errors(batch, keys[1]))
        layout = jax.lax.stop_gradient(layout)
        small = image.reshape(items, 128, 2, 128, 2, 3).mean((2, 4))
        small = jnp.where(chosen[:, None, None, None], small, bent(small, keys[2]))
        seen = nets["image_encoder"].apply(encoder, small)
        latent = vae.apply(vae_params, batch["occupancy"], method="encode")[0]
        x0 = jax.lax.stop_gradient((latent - mean) / std)
        once = jax.random.bernoulli(keys[3], 0.8, (items,))
        t = jnp.where(once, 1.0, sample_times(keys[4], (items,), config.loss.time_mean, config.loss.time_std))  # fmt: skip
        noise = jax.random.normal(keys[5], x0.shape)
        x = interpolate(x0, noise, t)
        v = flow.apply(params, x, t, seen["tokens"], seen["volume"], layout=layout)
        loss, metrics = summarize_flow(
            flow_loss(v, x0, noise), v, x, x0, t, None, config.model.structure_flow.prediction
        )
        true = batch["occupancy"].astype(jnp.float32)
        guess = predicted_sample(x, v, t) * std + mean
        logits = vae.apply(vae_params, guess, method="decode")
        loss += binary_cross_entropy(logits, true).mean() + dice_loss(logits, true)
        metrics["iou"] = occupancy_iou(logits, true)
        if refines:
            given = (seen["pixels"][:, None], seen["camera"][:, None], layout)
            logits = flow.apply(params, jax.lax.stop_gradient(logits), *given, method="refine")
            loss += binary_cross_entropy(logits, true).mean() + dice_loss(logits, true)
            metrics["refined"] = occupancy_iou(logits, true)
        return loss, {k: v for k, v in metrics.items() if k in ("iou", "refined", "x0_error")}

    return loss_fn


def bent(image, key):
    """``data.layout_errors.bend`` of images [B, S, S, 3]."""
    import jax
    import jax.numpy as jnp
    from jax.scipy.ndimage import map_coordinates

    items, side = image.shape[:2]
    keys = jax.random.split(key, 2)
    strength = 0.5 * WARP * jax.random.uniform(keys[0], (items, 1, 1, 1)) * side
    shift = strength * jax.random.normal(keys[1], (items, 2, 5, 5))
    at = jnp.linspace(0, 4, side)
    weights = jnp.maximum(1 - jnp.abs(at[:, None] - jnp.arange(5)), 0)
    moved = jnp.einsum("si,bcij,tj->bcst", weights, shift, weights)
    places = moved + jnp.stack(jnp.meshgrid(jnp.arange(side), jnp.arange(side), indexing="ij"))
    one = lambda plane, place: map_coordinates(plane, list(place), order=1)  # noqa: E731
    return jax.vmap(jax.vmap(one, (-1, None), -1))(image, places)


def tables_with_errors(batch, key):
    """``data.layout_errors.with_errors`` of a batch, as a ``PartTable``."""
    import jax
    import jax.numpy as jnp

    from uniart_jax.voxels.part_table import PartTable

    keys = jax.random.split(key, 8)
    boxes, codes, parents, colors = (batch[k] for k in ("boxes", "codes", "parents", "colors"))
    items, most = parents.shape
    exact = jax.random.bernoulli(keys[0], EXACT / (1 - FOUND), (items, 1))
    strength = jnp.where(exact, 0, jax.random.uniform(keys[1], (items, 1), minval=0.3, maxval=1.0))
    absent = jax.random.bernoulli(keys[2], ABSENT / (1 - FOUND), (items, 1))
    real = jnp.arange(most) < batch["part_counts"][:, None]
    roots = parents == jnp.arange(most)
    lost = ~roots & (jax.random.uniform(keys[3], roots.shape) < LOST * strength)
    kept = real & ~lost & ~absent
    take = lambda rows, index: jnp.take_along_axis(rows, index, 1)  # noqa: E731
    for _ in range(6):  # a lost parent's children hang on its parent
        parents = jnp.where(take(lost, parents), take(parents, parents), parents)
    order = jnp.argsort(jnp.where(kept, jax.random.uniform(keys[4], kept.shape), 2), -1)
    place = jnp.argsort(order, -1)
    counts = kept.sum(-1)
    there = (jnp.arange(most) < counts[:, None])[..., None]
    lower, upper = boxes[..., :3] - boxes[..., 3:] / 2, boxes[..., :3] + boxes[..., 3:] / 2
    corners = jnp.concatenate([lower, upper], -1)
    moved = MOVED * strength[..., None] * jax.random.normal(keys[5], corners.shape)
    lower, upper = jnp.split(corners + moved, 2, -1)
    boxes = jnp.concatenate([(lower + upper) / 2, jnp.maximum(upper - lower, 0.004)], -1)
    wrong = ~roots & (jax.random.uniform(keys[6], roots.shape) < MISTAKEN * strength)
    other = jnp.concatenate([codes[..., :7], -codes[..., 8:9], -codes[..., 7:8]], -1)
    codes = jnp.where(wrong[..., None], other, codes)
    tinted = colors + 0.03 * strength[..., None] * jax.random.normal(keys[7], colors.shape)
    pick = lambda rows: jnp.where(there, take(rows, order[..., None]), 0)  # noqa: E731
    parents = jnp.where(there[..., 0], take(place, take(parents, order)), 0)
    return PartTable(
        pick(boxes), pick(codes), parents.astype(jnp.int32),
        pick(jnp.clip(tinted, 0, 1)), counts.astype(jnp.int32),
    )  # fmt: skip


if __name__ == "__main__":
    main()
