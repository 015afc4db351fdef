"""Layout network and structure flow trained on from a checkpoint, together, on one accelerator.

    python tools/train_pool.py --init nano --out OUT --processes 15 --seconds 1500

Worker processes make objects of the wide world without end (``pool_objects``), one picture and the
voxels that its surface touches each; host memory keeps the newest of them, and batches are drawn
from these, newer ones more often. So the accelerator never waits, and each object is shown a few
times only. Both networks take a step with every batch:

    layout      ``training.layout_loss``, on pictures whose light is changed a little
    structure   rectified flow of the structure latent, most of it at t = 1; besides, cross-entropy
                and Dice of what the structure VAE decodes of its x_0, and of what the refiner makes
                of that. Layouts are true, with errors (``data.layout_errors``), absent, or those
                that the layout network finds in the picture.

The learning rates hold for ``HOLD`` of the time and fall to zero at its end: the clock counts, not
the steps, so a run that was stopped is not resumed; ``--init OUT`` begins anew from its weights.
``--deadline FILE`` holds another end (seconds since the epoch) and may be changed on the way. OUT
is a checkpoint: the other networks of ``--init``, and averaged weights every ``--save`` seconds.
The layout network's loss on objects that it has not seen ("unseen") is said on the way.
``--tiny`` is for a CPU.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pool_objects import JUDGED_ROWS, Objects, Pool

HOLD = 0.45
DECAY = 0.998  # of the averaged weights
SAID = 15.0  # seconds between two lines
WARMUP = 200  # steps


class Run(NamedTuple):
    """A network's state while it trains."""

    params: Any
    moments: Any
    average: Any


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--init", default="nano", help="checkpoint to go on from")
    parser.add_argument("--out", required=True, help="checkpoint that is written")
    parser.add_argument("--processes", type=int, default=15, help="that make objects")
    parser.add_argument("--seconds", type=float, default=1500, help="from the first step on")
    parser.add_argument("--deadline", default="", help="file with the end, seconds since the epoch")
    parser.add_argument("--first", type=int, default=200_000, help="number of the first object")
    parser.add_argument("--capacity", type=int, default=200_000, help="objects in host memory")
    parser.add_argument("--batch", type=int, default=128, help="objects a step")
    parser.add_argument("--begin-with", type=int, default=1024, help="objects before step 1")
    parser.add_argument("--rate", type=float, default=1.2e-3, help="of the layout network")
    parser.add_argument("--flow-rate", type=float, default=8e-4, help="of the structure flow")
    parser.add_argument("--refine-channels", type=int, default=8, help="of the refiner, 0: none")
    parser.add_argument("--repeats", type=int, default=2, help="of the layout network's last layer")
    parser.add_argument("--save", type=float, default=150, help="seconds between two savings")
    parser.add_argument("--tiny", action="store_true", help="few objects, small batches")
    given = parser.parse_args()
    if given.tiny:
        given.processes, given.batch, given.begin_with, given.capacity = 1, 4, 8, 64
    train(given)


def train(given: argparse.Namespace) -> None:
    import jax  # the processes that make objects do without
    import jax.numpy as jnp
    from pool_losses import make_structure_loss, prepared

    from uniart_jax.models.checkpoint import Checkpoint
    from uniart_jax.models.checkpoint_files import write_config, write_network
    from uniart_jax.models.network import build
    from uniart_jax.training.layout_loss import make_layout_loss
    from uniart_jax.training.state import make_optimizer

    print(jax.devices(), jax.__version__, flush=True)
    init, replace = Checkpoint.find(given.init), dataclasses.replace
    base = init.config
    layout = replace(base.model.layout, repeats=given.repeats)
    flow = replace(base.model.structure_flow, refine_channels=given.refine_channels)
    shipped = replace(base, model=replace(base.model, layout=layout, structure_flow=flow))
    out = Path(given.out)
    shutil.copytree(init.folder, out, dirs_exist_ok=True)
    write_config(out, shipped)
    # on a GPU JAX's own derivatives of shifted sums are the faster ones, and rows are short
    config = replace(shipped, model=replace(shipped.model, kernel="plain"))
    frozen = ("image_encoder", "structure_vae")
    nets = {n: build(n, config.model) for n in ("layout", "structure_flow", *frozen)}
    fixed = {n: init.load(n) for n in frozen}
    fixed = jax.device_put(fixed)
    drawn = jax.device_get(nets["structure_flow"].init(jax.random.key(3)))  # of new layers
    begin = {
        "layout": init.load("layout", config.model),
        "structure_flow": drawn | init.load("structure_flow"),
    }
    layout_loss = make_layout_loss(nets["layout"], config)
    losses = {
        "layout": lambda params, batch, key: layout_loss(params, batch.layout, key),
        "structure_flow": make_structure_loss(nets, config, init.statistics("structure")),
    }
    rates = {"layout": given.rate, "structure_flow": given.flow_rate}
    runs, updates = {}, {}
    for name, params in begin.items():
        stage = replace(
            getattr(base, name),
            learning_rate=rates[name],
            schedule="constant",
            warmup_steps=WARMUP,
        )
        optimizer, params = make_optimizer(stage), jax.device_put(params)
        runs[name] = Run(params, optimizer.init(params), jax.tree.map(jnp.copy, params))
        updates[name] = make_update(losses[name], optimizer)
    prepare = jax.jit(prepared)

    @jax.jit
    def judge(average, batch):
        batch = prepared(batch, jax.random.key(0), False)
        return losses["layout"](average, batch, jax.random.key(1))[0]

    def save() -> None:
        for name, run in runs.items():
            write_network(out, name, run.average)

    rng, pool = np.random.default_rng(1), Pool(given.capacity)
    sizes = (config.model.layout.image_size, config.model.grid.resolution)
    with Objects(given.processes, given.first, *sizes, pool) as objects:
        objects.wait_for(1)
        batch = prepare(jax.device_put(objects.batch(rng, given.batch)), jax.random.key(0), True)
        weights = (*(fixed[n] for n in frozen), runs["layout"].average)
        updates = compile_both(updates, runs, batch, weights)
        objects.wait_for(given.begin_with)
        print(f"{pool.total} objects; step 1", flush=True)
        began = saved = said = time.time()
        end, seen, log = began + given.seconds, 0, {}
        following = jax.device_put(objects.batch(rng, given.batch))
        for step in itertools.count():
            now, end = time.time(), read_deadline(given.deadline, end)
            if now >= end:
                break
            factor = np.float32(min(1.0, (end - now) / ((end - began) * (1 - HOLD))))
            # keys of their own: what ``split`` gives for one key begins alike whatever the number
            keys = jax.random.split(jax.random.fold_in(jax.random.key(7), step), 3)
            batch = prepare(following, keys[0], True)
            runs["layout"], found = updates["layout"](runs["layout"], batch, keys[1], factor)
            weights = (*(fixed[n] for n in frozen), runs["layout"].average)
            runs["structure_flow"], more = updates["structure_flow"](
                runs["structure_flow"], batch, keys[2], factor, weights
            )
            following = jax.device_put(objects.batch(rng, given.batch))  # while these compute
            for name, value in {**found, **{f"s_{k}": v for k, v in more.items()}}.items():
                log.setdefault(name, []).append(value)
            seen += given.batch
            if step % 4 == 3:  # not many steps ahead of the device
                jax.block_until_ready(runs["structure_flow"].params)
            if step < 3 or now - said > SAID:
                objects.check()
                means = {k: round(float(np.mean(jax.device_get(v))), 4) for k, v in log.items()}
                unseen = [float(judge(runs["layout"].average, rows)) for rows in objects.unseen()]
                if unseen:
                    means[f"unseen ({len(unseen) * JUDGED_ROWS})"] = round(
                        float(np.mean(unseen)), 4
                    )
                line = f"{now - began:.0f} s, step {step + 1}, {pool.total} objects"
                print(f"{line}, rate x {factor:.2f}: {json.dumps(means)}", flush=True)
                said, log = time.time(), {}
            if time.time() - saved > given.save:
                save()
                saved = time.time()
        save()
    print(f"done: {step} steps, {seen} pictures of {pool.total} objects", flush=True)


def read_deadline(file: str, before: float) -> float:
    """The number in a file; ``before`` where there is none."""
    try:
        return float(Path(file).read_text())
    except (OSError, ValueError):
        return before


def compile_both(
    updates: dict[str, Any], runs: dict[str, Run], batch: Any, weights: tuple[Any, ...]
) -> dict[str, Any]:
    """The updates of both networks compiled for a batch, side by side."""
    import jax

    frozen = {"layout": (), "structure_flow": (weights,)}

    def compiled(name: str) -> Any:
        given = (runs[name], batch, jax.random.key(0), np.float32(1), *frozen[name])
        return updates[name].lower(*given).compile()

    with ThreadPoolExecutor() as threads:
        return dict(zip(updates, threads.map(compiled, updates), strict=True))


def make_update(loss_fn: Callable[..., Any], optimizer: Any) -> Callable[..., Any]:
    """Jitted (run, batch, key, factor of the learning rate, *frozen parameters) -> (run, metrics);
    a step that is not finite changes nothing. The run is donated."""
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
        average = optax.incremental_update(params, run.average, 1 - DECAY)
        new = jax.tree.map(lambda a, b: jnp.where(fine, a, b), Run(params, moments, average), run)
        return new, {"loss": loss, "norm": norm, **metrics}

    return update


if __name__ == "__main__":
    main()
