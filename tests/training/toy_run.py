"""A toy stage for the tests: a two-layer network, Grain batches with their order recorded. Run as a
program it trains in its own process:

python toy_run.py WORKDIR STEPS SAVE_EVERY [--devices N --fsdp M] [--accumulate N] [--slow SECONDS]
[--nan STEP] [--out FILE] [--processes N --process I --port P] [--fail STEP] [--width W]
"""

from __future__ import annotations

import argparse
import functools
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("workdir", type=Path)
    parser.add_argument("steps", type=int)
    parser.add_argument("save_every", type=int)
    parser.add_argument("--devices", type=int, default=1)
    parser.add_argument("--fsdp", type=int, default=1)
    parser.add_argument("--accumulate", type=int, default=1)
    parser.add_argument("--slow", type=float, default=0.0)
    parser.add_argument("--nan", type=int, default=-1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--process", type=int, default=0)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--fail", type=int, default=-1)
    parser.add_argument("--width", type=int, default=16)
    return parser.parse_args()


def init(key, width=16):
    import jax
    import jax.numpy as jnp

    first, second = jax.random.split(key)
    return {
        "blocks": {
            0: {"kernel": jax.random.normal(first, (4, width)) / 2, "bias": jnp.zeros(width)}
        },
        "out": {"kernel": jax.random.normal(second, (width, 8)) / width**0.5, "bias": jnp.zeros(8)},
    }


def loss_fn(params, batch, key):
    import jax
    import jax.numpy as jnp

    block, out = params["blocks"][0], params["out"]
    x = batch["x"] + 0.1 * jax.random.normal(key, batch["x"].shape)
    y = jnp.tanh(x @ block["kernel"] + block["bias"]) @ out["kernel"] + out["bias"]
    loss = jnp.mean((y - batch["y"]) ** 2)
    return loss, {"error": jnp.sqrt(loss)}


def make_batches(seen=None, nan_at=(), slow=0.0, share=slice(None), fail_at=-1):
    import grain
    import numpy as np

    rng = np.random.default_rng(0)
    xs = rng.normal(size=(40, 4)).astype(np.float32)
    weights = rng.normal(size=(4, 8)).astype(np.float32)

    def item(index):
        return {"x": xs[index], "y": np.tanh(xs[index] @ weights), "index": np.int32(index)}

    dataset = grain.MapDataset.range(40).seed(3).shuffle().repeat().map(item).batch(8)
    few = grain.ReadOptions(num_threads=1, prefetch_buffer_size=2)  # of 500 batches by default
    iterator = iter(dataset.to_iter_dataset(few))

    class Recorded:
        count = 0

        def __iter__(self):
            return self

        def __next__(self):
            batch = {name: value[share] for name, value in next(iterator).items()}
            time.sleep(slow)
            if seen is not None:
                seen.append(batch["index"].tolist())
            self.count += 1
            if self.count == fail_at:
                raise ValueError("record 17 is damaged")
            if self.count in nan_at:
                batch["y"] = batch["y"] * np.nan
            return batch

        get_state = staticmethod(iterator.get_state)
        set_state = staticmethod(iterator.set_state)

    return Recorded()


def make_stage(steps: int, save_every: int, **changes):
    from uniart_jax.config import StageConfig

    settings = {
        "steps": steps, "save_every": save_every, "batch_size": 8, "learning_rate": 1e-2, "warmup_steps": 1, "log_every": 1,  # noqa: E501
        "evaluate_every": 10**9, "keep_checkpoints": 3, "ema_decay": 0.9,
    }  # fmt: skip
    return StageConfig(**{**settings, **changes})


@functools.cache
def program(stage, fsdp):
    """Mesh, optimizer and step; made once for all runs of a process, since compiling is most of a
    toy run's time."""
    from uniart_jax.config import MeshConfig
    from uniart_jax.training.sharding import make_mesh
    from uniart_jax.training.state import make_optimizer
    from uniart_jax.training.step import make_train_step

    optimizer = make_optimizer(stage)
    step = make_train_step(
        loss_fn,
        optimizer,
        stage.ema_decay,
        accumulate=stage.accumulate,
        skip=stage.skip_not_finite > 0,
    )
    return make_mesh(MeshConfig(fsdp=fsdp)), optimizer, step


def train(workdir, stage, batches, *, fsdp=1, width=16, **options):
    import jax

    from uniart_jax.config import ModelConfig
    from uniart_jax.training.checkpoints import Checkpoints
    from uniart_jax.training.loop import run_stage
    from uniart_jax.training.microbatches import in_parts
    from uniart_jax.training.sharding import put_batch
    from uniart_jax.training.state import create_state

    # With a constant rate the number of steps says only when to stop.
    assert stage.schedule == "constant" and stage.steps > stage.warmup_steps
    kept = {k: getattr(stage, k) for k in ("warmup_steps", "accumulate", "skip_not_finite")}
    shared = make_stage(100, 1, **kept)
    mesh, optimizer, train_step = program(shared, fsdp)
    with Checkpoints(workdir / "checkpoints" / "toy", keep=stage.keep_checkpoints) as checkpoints:
        return run_stage(
            "toy",
            state=create_state(
                functools.partial(init, width=width),
                optimizer,
                jax.random.key(0),
                mesh,
                min_split=1,
            ),
            train_step=train_step,
            batches=batches,
            put=in_parts(functools.partial(put_batch, mesh=mesh), stage.accumulate, ModelConfig()),
            key=jax.random.key(1),
            checkpoints=checkpoints,
            stage=stage,
            workdir=workdir,
            **options,
        )


def main() -> None:
    args = parse()
    os.environ["JAX_PLATFORMS"] = "cpu"
    import jax
    import numpy as np
    from absl import flags

    flags.FLAGS.mark_as_parsed()
    jax.config.update("jax_num_cpu_devices", args.devices)
    from uniart_jax.training import distributed

    share = slice(None)
    if args.processes > 1:
        jax.config.update("jax_cpu_collectives_implementation", "gloo")
        distributed.start(f"localhost:{args.port}", args.processes, args.process)
        size = 8 // args.processes
        share = slice(args.process * size, (args.process + 1) * size)
    from uniart_jax.models.checkpoint_files import write_network
    from uniart_jax.models.network import flat_names
    from uniart_jax.training import sharding

    batches = make_batches(nan_at=[args.nan], slow=args.slow, share=share, fail_at=args.fail)
    stage = make_stage(args.steps, args.save_every, accumulate=args.accumulate)
    with distributed.together():
        state = train(args.workdir, stage, batches, fsdp=args.fsdp, width=args.width)
    if args.fsdp > 1:
        assert not state.params["out"]["kernel"].sharding.is_fully_replicated
    if args.out:
        mesh = state.step.sharding.mesh
        whole = jax.jit(lambda tree: tree, out_shardings=sharding.replicated(mesh))
        np.savez(args.out, **{k: np.asarray(v) for k, v in flat_names(whole(state)).items()})
        write_network(args.workdir / "export", "toy", state.ema, "float32")


if __name__ == "__main__":
    main()
