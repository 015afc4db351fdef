"""How much of a training run's time is not the jitted step: input, sending, logging, saving, at
``configs/nano.py``'s size on this machine.

    python benchmarks/step_overhead.py [uniart_vae latent_flow] [--records data-cache/nano]
    [--objects 64] [--steps 100] [--rounds 3] [--out out/bench]

The loop is ``training.loop.run_stage`` as ``train.py`` runs it (Grain pipelines, logs, asynchronous
Orbax saves), after everything is compiled; beside it, in turns, the bare step on the same batches,
made and sent before.

- ``overhead``: 1 - (seconds of the bare steps) / (seconds of the loop), each round by itself; the
  median, ``least`` and ``most`` of the rounds. On a CPU the pipeline also takes cores from the
  step, and this counts it. The saves of a round that begin between its first and last measured step
  are more than a
  run has: the time that they hold the loop up is taken out, and that of as many as the config's
    ``save_every`` makes is put in. What a save writes behind
  the loop's back stays in, so a run's overhead is rather less.
- ``starved``: the share of steps that were dispatched when the device had already finished the one
  before; those after a log or a save are.

Gate: overhead <= 5 %. Without ``--records``, ``--objects`` procedural ones are made in a temporary
folder; the flow stands on the shipped model's encoder and VAEs.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from results import report

from uniart_jax.config import NETWORKS, Config, load_config
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build
from uniart_jax.precompute.encoding import encode_all
from uniart_jax.stages import STAGES
from uniart_jax.stages.train_network import make_put, make_step, stage_batches
from uniart_jax.stages.trainer import check_workdir
from uniart_jax.training.checkpoints import Checkpoints
from uniart_jax.training.loop import run_stage
from uniart_jax.training.sharding import make_mesh
from uniart_jax.training.state import create_state, make_optimizer


def nano(records: Path) -> Config:
    config = load_config("nano")
    data = dataclasses.replace(config.data, records=str(records), validation="", procedural=0)
    return dataclasses.replace(config, data=data)


class Watched:
    """A train step that notes when it is dispatched, and whether and when the step before was done
    by then."""

    def __init__(self, step: Any):
        self._step, self._last = step, None
        self.marks: list[tuple[float, bool]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._step, name)

    def __call__(self, state: Any, batch: Any, key: Any) -> Any:
        ready = self._last is None or self._last.is_ready()
        self.marks.append((time.perf_counter(), ready))
        state, metrics = self._step(state, batch, key)
        self._last = metrics["loss"]
        return state, metrics


class WatchedCheckpoints(Checkpoints):
    """Notes when saving began, and how long it held the loop up."""

    def __init__(self, *args: Any, **more: Any):
        super().__init__(*args, **more)
        self.held: list[tuple[float, float]] = []

    def save(self, *args: Any, wait: bool = False, **more: Any) -> None:
        begin = time.perf_counter()
        super().save(*args, **more)
        self.held.append((begin, time.perf_counter() - begin))
        if wait:
            self.wait()


def in_run(
    times: list[float], held: list[tuple[float, float]], save_every: int
) -> tuple[float, float]:
    """Seconds of the loop between dispatches ``times`` [n + 1] as a run has them that saves every
    ``save_every`` steps, and of a save.

    Args:
      held: (when it began, how long it held the loop up) of each save; those outside of ``times``
        are not in them.
    """
    inside = [seconds for begin, seconds in held if times[0] <= begin < times[-1]]
    save = statistics.mean(inside) if inside else 0.0
    return times[-1] - times[0] - sum(inside) + save * (len(times) - 1) / save_every, save


def measure(name: str, config: Config, workdir: Path, steps: int, rounds: int) -> dict[str, Any]:
    own, stage, latents = STAGES[name], getattr(config, name), {}
    if own.latent:
        needed = [n for n in NETWORKS if not STAGES[n].latent]
        check_workdir(config, workdir)
        Checkpoint.find("nano").copy_networks(needed, Checkpoint.of_workdir(workdir).folder)
        latents = encode_all(config, workdir)
    network, mesh = build(name, config.model), make_mesh(config.mesh)
    optimizer = make_optimizer(stage)
    bare = make_step(own, network, optimizer, config, workdir, mesh, latents)
    put = make_put(own, mesh, config.model)
    key = jax.random.key(0)
    loops, bares, idles, saves, each = [], [], [], [], []
    for round_ in range(rounds + 1):  # the first one compiles
        batches, seen = iter(stage_batches(own, config, workdir)), []

        class Kept:
            def __next__(self, batches=batches, seen=seen):
                seen.append(next(batches))
                return seen[-1]

            get_state, set_state = batches.get_state, batches.set_state

        this = dataclasses.replace(
            stage, steps=steps + 2, save_every=steps // 2, evaluate_every=10**9
        )
        state = create_state(network.init, optimizer, key, mesh)
        watched = Watched(bare)
        folder = workdir / f"round-{name}-{round_}"
        with WatchedCheckpoints(folder / "checkpoints") as checkpoints:
            run_stage(
                name,
                state=state,
                train_step=watched,
                batches=Kept(),
                put=put,
                key=key,
                checkpoints=checkpoints,
                stage=this,
                workdir=folder,
            )
        sent = [jax.block_until_ready(put(batch)) for batch in seen]
        state = create_state(network.init, optimizer, key, mesh)
        begin = 0.0
        for i, batch in enumerate(sent[:-1]):
            if i == 1:
                jax.block_until_ready(state)
                begin = time.perf_counter()
            state, metrics = bare(state, batch, key)
            metrics["loss"].block_until_ready()
        alone = time.perf_counter() - begin
        # marks 1 .. steps + 1 enclose ``steps`` steps of the loop
        times = [t for t, _ in watched.marks[1 : steps + 2]]
        if round_:
            loop, save = in_run(times, checkpoints.held, stage.save_every)
            loops.append(loop)
            saves.append(save)
            each.append(np.diff(times))
            bares.append(alone)
            idles.append(sum(ready for _, ready in watched.marks[2 : steps + 2]) / steps)
            print(
                f"{name}: loop {loop / steps:.3f} s a step, bare {alone / steps:.3f}, starved "
                f"{idles[-1]:.2f}, a save {saves[-1]:.2f}",
                flush=True,
            )
    overheads = [1 - alone / loop for alone, loop in zip(bares, loops, strict=True)]
    alone, loop, save = (statistics.median(v) for v in (bares, loops, saves))
    return {
        "stage": name,
        "steps": steps,
        "step s": alone / steps,
        "loop s": loop / steps,
        "median step of the loop s": float(np.median(each)),
        "longest step of the loop s": float(np.max(each)),
        "overhead": statistics.median(overheads),
        "least": min(overheads),
        "most": max(overheads),
        "starved": statistics.median(idles),
        "a save s": save,
        "programs": len(bare.compiled),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stages", nargs="*", default=["uniart_vae", "latent_flow"])
    parser.add_argument("--records", type=Path)
    parser.add_argument("--objects", type=int, default=64)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        records = arguments.records
        if records is None:
            records = Path(temporary) / "records"
            prepare_procedural(records, arguments.objects, views=2, processes=os.cpu_count() or 1)
        for name in arguments.stages:
            workdir = Path(temporary) / name
            rows.append(measure(name, nano(records), workdir, arguments.steps, arguments.rounds))
    report("step_overhead", rows, arguments.out)


if __name__ == "__main__":
    main()
