"""Layout network, structure flow and mask network, or some of them, trained on from a checkpoint,
together, on one accelerator; one of them also on a CPU.

    python tools/train_pool.py --init nano --out OUT --processes 13 --seconds 1500
    python tools/train_pool.py --init nano --out OUT --networks structure_flow --refine-every 4 \\
        --batch 24 --processes 1 --seconds 3600

Worker processes make objects of a world without end (``pool_objects``): a picture, what a
photograph of it would give (``data.photographs``), the voxels that its surface touches, and for
every third one a picture with its background. Host memory keeps the newest of them, and batches
are drawn from these, newer ones more often. So the accelerator never waits, and each object is
shown a few times only.

    layout      ``training.layout_loss``, on renders whose light is changed a little and on
                photographs; a step with every batch, of which one in ``--box-sets-every`` has
                legs, panels and boards (about half of a step's time)
    structure   rectified flow of the structure latent, most of it at t = 1; besides, cross-entropy
                and Dice of what the structure VAE decodes of its x_0, and of what the refiner makes
                of that (in one step of ``--refine-every``: on a CPU it is most of a step's time).
                Layouts are true, with errors (``data.layout_errors``), absent, or those that the
                layout network finds in the picture. With ``pixel_channels`` the camera is the true
                one with errors, the layout network's where the layout is, or the image encoder's
                where there is no layout. A step every ``--flow-every``
    mask        ``training.mask_loss``, on pictures with backgrounds; a step every ``--mask-every``

Each begins once it is compiled. The learning rates hold for ``HOLD`` of the time and fall to zero
at its end: the clock counts, not the steps, so a run that was stopped is not resumed; ``--init
OUT`` begins anew from its weights. ``--deadline FILE`` holds another end (seconds since the epoch)
and may be changed on the way. OUT is a checkpoint: the other networks of ``--init``, and averaged
weights every ``--save`` seconds. The layout network's loss on objects that it has not seen
("unseen") is said on the way where it is trained. ``--tiny`` is for a CPU.
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
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pool_objects import JUDGED_ROWS, Objects, Pool, Sizes

from uniart_jax.data.backdrop_pictures import picture_paths
from uniart_jax.procedural import WORLDS

HOLD = 0.45
DECAY = 0.998  # of the averaged weights
SAID = 15.0  # seconds between two lines
WARMUP = 200  # steps
NETWORKS = ("layout", "structure_flow", "mask")
FROZEN = ("image_encoder", "structure_vae")


class Update(NamedTuple):
    """``make_update`` of a network with one of its losses, and whether it is taken at a step."""

    network: str
    loss: str
    step: Any
    due: Callable[[int], bool]


class Run(NamedTuple):
    """A network's state while it trains."""

    params: Any
    moments: Any
    average: Any


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--init", default="nano", help="checkpoint to go on from")
    parser.add_argument("--out", required=True, help="checkpoint that is written")
    parser.add_argument(
        "--networks", nargs="+", choices=NETWORKS, default=NETWORKS, help="that are trained"
    )
    parser.add_argument("--processes", type=int, default=13, help="that make objects")
    parser.add_argument("--seconds", type=float, default=1500, help="from the first step on")
    parser.add_argument("--deadline", default="", help="file with the end, seconds since the epoch")
    parser.add_argument("--first", type=int, default=200_000, help="number of the first object")
    parser.add_argument("--world", choices=tuple(WORLDS), default="wide", help="of the objects")
    parser.add_argument("--backgrounds", default="", help="folder of pictures behind objects")
    parser.add_argument("--capacity", type=int, default=130_000, help="objects in host memory")
    parser.add_argument("--batch", type=int, default=128, help="objects a step")
    parser.add_argument("--begin-with", type=int, default=1024, help="objects before step 1")
    parser.add_argument("--rate", type=float, default=1.2e-3, help="of the layout network")
    parser.add_argument("--flow-rate", type=float, default=8e-4, help="of the structure flow")
    parser.add_argument("--mask-rate", type=float, default=1.2e-3, help="of the mask network")
    parser.add_argument(
        "--box-sets-every", type=int, default=1, help="steps for one with legs, panels and boards"
    )
    parser.add_argument("--flow-every", type=int, default=2, help="steps for one of the flow")
    parser.add_argument(
        "--refine-every", type=int, default=1, help="of the flow, for a refined one"
    )
    parser.add_argument("--mask-every", type=int, default=4, help="steps for one of the masks")
    parser.add_argument("--refine-channels", type=int, default=8, help="of the refiner, 0: none")
    parser.add_argument(
        "--pixel-channels", type=int, help="of the structure flow; if not given, as in --init"
    )
    parser.add_argument("--repeats", type=int, default=2, help="of the layout network's last layer")
    parser.add_argument("--save", type=float, default=150, help="seconds between two savings")
    parser.add_argument("--tiny", action="store_true", help="few objects, small batches")
    given = parser.parse_args()
    for name in ("box_sets_every", "flow_every", "refine_every", "mask_every"):
        if getattr(given, name) < 1:
            parser.error(f"--{name.replace('_', '-')} must be at least 1")
    if given.tiny:
        given.processes, given.batch, given.begin_with, given.capacity = 1, 4, 8, 64
    try:
        picture_paths(given.backgrounds)
    except ValueError as error:
        parser.error(str(error))
    train(given)


def train(given: argparse.Namespace) -> None:
    import jax  # the processes that make objects do without
    import jax.numpy as jnp
    from pool_losses import make_structure_loss, prepared, prepared_scenes

    from uniart_jax.models.checkpoint import Checkpoint
    from uniart_jax.models.checkpoint_files import write_config, write_network
    from uniart_jax.models.layout import SETS
    from uniart_jax.models.network import build
    from uniart_jax.training.layout_loss import make_layout_loss
    from uniart_jax.training.mask_loss import make_mask_loss
    from uniart_jax.training.state import frozen_mask, make_optimizer
    from uniart_jax.voxels.typed_batches import parts_of

    print(jax.devices(), jax.__version__, flush=True)
    init, replace = Checkpoint.find(given.init), dataclasses.replace
    base = init.config
    layout, flow = base.model.layout, base.model.structure_flow
    if "layout" in given.networks:
        layout = replace(layout, repeats=given.repeats)
    if "structure_flow" in given.networks:
        flow = replace(flow, refine_channels=given.refine_channels)
        if given.pixel_channels is not None:  # else as the checkpoint has it
            flow = replace(flow, pixel_channels=given.pixel_channels)
    shipped = replace(base, model=replace(base.model, layout=layout, structure_flow=flow))
    out = Path(given.out)
    shutil.copytree(init.folder, out, dirs_exist_ok=True)
    write_config(out, shipped)
    config = shipped
    if jax.default_backend() != "cpu":  # JAX's own derivatives of shifted sums are the faster ones
        config = replace(shipped, model=replace(shipped.model, kernel="plain"))
    nets = {n: build(n, config.model) for n in (*NETWORKS, *FROZEN)}
    fixed = jax.device_put({n: init.load(n) for n in (*FROZEN, "layout")})
    drawn = jax.device_get(nets["structure_flow"].init(jax.random.key(3)))  # of new layers
    begin = {
        "layout": init.load("layout", config.model),
        "structure_flow": drawn | init.load("structure_flow"),
        "mask": init.load("mask"),
    }
    some = replace(config, data=replace(config.data, box_sets_every=given.box_sets_every))
    layout_loss, mask_loss = make_layout_loss(nets["layout"], some), make_mask_loss(nets["mask"])
    unrefined = replace(config.model, structure_flow=replace(flow, refine_channels=0))
    losses = {
        "layout": lambda params, batch, key: layout_loss(params, batch.layout, key),
        "parts": lambda params, batch, key: layout_loss(params, parts_of(batch.layout), key),
        "mask": mask_loss,
        "structure_flow": make_structure_loss(nets, config, init.statistics("structure")),
        "unrefined": make_structure_loss(
            nets, replace(config, model=unrefined), init.statistics("structure")
        ),
    }
    rates = {"layout": given.rate, "structure_flow": given.flow_rate, "mask": given.mask_rate}
    runs: dict[str, Run] = {}
    updates: list[Update] = []
    for name in given.networks:
        stage = replace(
            getattr(base, name),
            learning_rate=rates[name],
            schedule="constant",
            warmup_steps=WARMUP,
        )
        optimizer, params = make_optimizer(stage), jax.device_put(begin[name])
        runs[name] = Run(params, optimizer.init(params), jax.tree.map(jnp.copy, params))
        for loss, due in due_steps(name, given).items():
            idle = [n for n in SETS if getattr(layout, n)] if loss == "parts" else []
            still = frozen_mask(params, (*stage.freeze, *idle))
            step = make_update(losses[loss], optimizer, still)
            updates.append(Update(name, loss, step, due))
    prepare, prepare_scenes = jax.jit(prepared), jax.jit(prepared_scenes)

    def loss_of_unseen(average, rows):
        batch = prepared(rows, jax.random.key(0), False)
        return losses["layout"](average, batch, jax.random.key(1))[0]

    def finder() -> Any:
        return runs["layout"].average if "layout" in runs else fixed["layout"]

    def frozen(name: str) -> list[Any]:
        """What a network's loss takes besides: the frozen networks and the layout network."""
        return [(*(fixed[n] for n in FROZEN), finder())] if name == "structure_flow" else []

    def save() -> None:
        for name, run in runs.items():
            write_network(out, name, run.average)

    rng, pool, scenes = np.random.default_rng(1), Pool(given.capacity), Pool(given.capacity // 2)
    model = config.model
    sizes = Sizes(model.layout.image_size, model.mask.image_size, model.grid.resolution)
    backs = given.backgrounds
    made = Objects(given.processes, given.first, sizes, pool, scenes, given.world, backs)
    with made as objects, ThreadPoolExecutor(len(runs) + 2) as threads:

        def ahead(step: int) -> Future[Any]:
            """The rows of a step, drawn and sent while steps before it compute."""
            masks = any(u.due(step) for u in updates if u.network == "mask")

            def draw() -> Any:
                rows = jax.device_put(objects.batch(rng, given.batch))
                return rows, jax.device_put(objects.scene_batch(rng, given.batch)) if masks else {}

            return threads.submit(draw)

        objects.wait_for(1)
        key = jax.random.key(0)
        rows, seen = ahead(0).result()
        batch = prepare(rows, key, True)
        programs = []
        for name, _, step, _ in updates:
            shown = prepare_scenes(seen, key) if name == "mask" else batch
            programs.append(threads.submit(compiled, step, runs[name], shown, *frozen(name)))
        judged = {
            k: jax.ShapeDtypeStruct((JUDGED_ROWS, *v.shape[1:]), v.dtype) for k, v in rows.items()
        }
        judge = None
        if "layout" in runs:
            judging = jax.jit(loss_of_unseen).lower(finder(), judged)
            judge = threads.submit(judging.compile)
        programs[0].result()
        objects.wait_for(given.begin_with)
        print(f"{pool.total} objects; step 1", flush=True)
        began = saved = said = time.time()
        end, counts, log = began + given.seconds, dict.fromkeys(runs, 0), {}
        following = ahead(0)
        for step in itertools.count():
            now, end = time.time(), read_deadline(given.deadline, end)
            if now >= end:
                break
            factor = np.float32(min(1.0, (end - now) / ((end - began) * (1 - HOLD))))
            # keys of their own: what ``split`` gives for one key begins alike whatever the number
            keys = jax.random.split(jax.random.fold_in(jax.random.key(7), step), 4)
            rows, seen = following.result()
            following = ahead(step + 1)
            batch = prepare(rows, keys[0], True)
            for (name, loss, _, due), program in zip(updates, programs, strict=True):
                if not (due(step) and program.done()):
                    continue
                shown = prepare_scenes(seen, keys[0]) if name == "mask" else batch
                key = keys[1 + NETWORKS.index(name)]
                runs[name], found = program.result()(runs[name], shown, key, factor, *frozen(name))
                counts[name] += 1
                for term, value in found.items():
                    log.setdefault(f"{loss[0]}_{term}", []).append(value)
            if step % 4 == 3:  # not many steps ahead of the device
                jax.block_until_ready(runs[updates[0].network].params)
            if step < 3 or now - said > SAID:
                objects.check()
                means = {k: round(float(np.mean(jax.device_get(v))), 4) for k, v in log.items()}
                held = objects.unseen() if judge is None or judge.done() else []
                if judge is not None and held:
                    unseen = [float(judge.result()(finder(), rows)) for rows in held]
                    means[f"unseen ({len(unseen) * JUDGED_ROWS})"] = round(
                        float(np.mean(unseen)), 4
                    )
                line = f"{now - began:.0f} s, steps {list(counts.values())}, {pool.total} objects"
                print(f"{line}, rate x {factor:.2f}: {json.dumps(means)}", flush=True)
                said, log = time.time(), {}
            if time.time() - saved > given.save:
                save()
                saved = time.time()
        save()
        following.result()
    print(f"done: steps {counts} of {given.batch}, {pool.total} objects", flush=True)


def due_steps(network: str, given: argparse.Namespace) -> dict[str, Callable[[int], bool]]:
    """When each loss of a network is taken, by the loss's name."""
    flow, refined = given.flow_every, given.flow_every * given.refine_every
    if network == "layout":
        sets = given.box_sets_every
        steps = {"layout": lambda step: step % sets == 0}
        return steps | ({"parts": lambda step: step % sets != 0} if sets > 1 else {})
    if network == "mask":
        return {"mask": lambda step: step % given.mask_every == 0}
    steps = {"structure_flow": lambda step: step % refined == 0}
    if given.refine_every > 1 and given.refine_channels:
        steps["unrefined"] = lambda step: step % flow == 0 and step % refined != 0
    return steps


def read_deadline(file: str, before: float) -> float:
    """The number in a file; ``before`` where there is none."""
    try:
        return float(Path(file).read_text())
    except (OSError, ValueError):
        return before


def compiled(update: Any, run: Run, batch: Any, *frozen: Any) -> Any:
    """An update compiled for a run and batches like these."""
    import jax

    given = (run, batch, jax.random.key(0), np.float32(1), *frozen)
    given = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), given)
    return update.lower(*given).compile()


def make_update(loss_fn: Callable[..., Any], optimizer: Any, frozen: Any) -> Callable[..., Any]:
    """Jitted (run, batch, key, factor of the learning rate, *frozen parameters) -> (run, metrics);
    a step that is not finite changes nothing. The run is donated."""
    import jax
    import jax.numpy as jnp
    import optax

    @functools.partial(jax.jit, donate_argnums=0)
    def update(run, batch, key, factor, *given):
        (loss, metrics), grads = jax.value_and_grad(loss_fn, has_aux=True)(
            run.params, batch, key, *given
        )
        norm = optax.tree.norm(grads)
        fine = jnp.isfinite(loss) & jnp.isfinite(norm)
        changes, moments = optimizer.update(grads, run.moments, run.params)
        changes = jax.tree.map(lambda c, kept: 0 * c if kept else factor * c, changes, frozen)
        params = optax.apply_updates(run.params, changes)
        average = optax.incremental_update(params, run.average, 1 - DECAY)
        new = jax.tree.map(lambda a, b: jnp.where(fine, a, b), Run(params, moments, average), run)
        return new, {"loss": loss, "norm": norm, **metrics}

    return update


if __name__ == "__main__":
    main()
