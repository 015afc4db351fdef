"""Tiny networks of all stages on hand-made records. Run as a program, one or several processes
train stages on fake devices and write what they end with:

python tiny_run.py FOLDER RUN STAGE… [--devices N --fsdp M] [--steps 5] [--encode BATCHES]
[--processes N --process I --port P] [--validation] [--pixels]

Records are in FOLDER/records. A stage trains in FOLDER/RUN/<stage>, a flow on the networks and
(without --encode, so many batches a shard) latents of FOLDER/base, and leaves
FOLDER/RUN/<stage>.npz, and the text of its compiled steps in FOLDER/RUN/<stage>-<i>.hlo.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import shutil
import sys
from pathlib import Path
from unittest import mock

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2]), str(HERE.parents[1] / "data")]

STAGES = ("image_encoder", "structure_vae", "uniart_vae", "structure_flow", "latent_flow")
MIN_SPLIT = 64  # of these networks' arrays: most are split


def make_records(folder: Path) -> None:
    """Twelve records for training and three for validation."""
    from hand_records import make_record, write_folder

    for name, seeds in (("records", range(12)), ("validation", range(20, 23))):
        (folder / name).mkdir(parents=True)
        write_folder(folder / name, [make_record(k, voxels=20 + 8 * (k % 12)) for k in seeds])


def make_config(folder: Path, steps: int = 5, **mesh):
    """Cubic windows, parts that are never cut, a convolutional stem: all plans whose shapes depend
    on the data."""
    from uniart_jax import config as c

    stage = c.StageConfig(
        steps=steps,
        batch_size=8,
        # the paper's; Adam makes up to this of the rounding in a gradient near zero
        learning_rate=1e-4,
        warmup_steps=1,
        log_every=1,
        evaluate_every=10**9,
        save_every=steps,
        ema_decay=0.9,
    )
    flow = c.FlowConfig(
        model_channels=16,
        num_blocks=1,
        num_heads=2,
        cond_channels=16,
        patch_size=2,
        volume_channels=4,
        volume_resolution=4,
    )
    return c.Config(
        name="tiny",
        model=c.ModelConfig(
            grid=c.GridConfig(8, 2, 8),
            image_encoder=c.ImageEncoderConfig(
                image_size=16,
                stem_stride=2,
                stem_channels=(8, 16),
                width=16,
                num_blocks=1,
                num_heads=2,
                volume_tokens=2,
                volume_blocks=1,
                volume_resolution=4,
                volume_channels=4,
                target_resolution=4,
                sketch_width=8,
            ),
            structure_vae=c.StructureVAEConfig(
                channels=(8, 16), latent_channels=4, num_res_blocks=1, num_res_blocks_middle=1
            ),
            uniart_vae=c.UniArtVAEConfig(
                width=16,
                num_blocks=2,
                num_heads=2,
                latent_channels=4,
                window=4,
                visual_channels=0,
                geometry_channels=8,
                articulation_channels=8,
            ),
            structure_flow=flow,
            latent_flow=dataclasses.replace(flow, io_channels=(8,)),
        ),
        data=c.DataConfig(records=str(folder / "records"), voxel_buckets=(64, 128)),
        loss=c.LossConfig(voxels_per_object=16),
        mesh=c.MeshConfig(min_split=MIN_SPLIT, **mesh),
        **dict.fromkeys(STAGES, stage),
        sample_structure=c.StructureSampleConfig(steps=1),
        sample_latent=c.LatentSampleConfig(steps=1),
    )


def with_pixels(model):
    """The latent flow's stem and what it reads off pictures as nano has them; the other networks as
    they are."""
    nano = {"stem": "patch", "io_channels": (), "voxel_channels": 8, "pixel_channels": 6}
    return dataclasses.replace(model, latent_flow=dataclasses.replace(model.latent_flow, **nano))


def train(config, name: str, folder: Path, run: str, latents: bool) -> None:
    """One stage in a workdir of its own; its last state, whole, to FOLDER/RUN/<stage>.npz, its
    programs to <stage>-<i>.hlo."""
    import jax
    import numpy as np
    from jax.experimental import multihost_utils

    from uniart_jax.models.network import flat_names
    from uniart_jax.stages import table, train_network, trainer
    from uniart_jax.training import distributed

    workdir = folder / run / name
    if table.STAGES[name].latent:
        # the first process looks: a later one would find what it has begun
        distributed.on_first_process(
            lambda: workdir.exists() or begin_flow(folder / "base", workdir, latents)
        )
    ends, steps = [], []

    def keeping(function, kept):
        def keep(*args, **options):
            kept.append(function(*args, **options))
            return kept[-1]

        return keep

    with mock.patch.multiple(
        train_network,
        run_stage=keeping(train_network.run_stage, ends),
        make_step=keeping(train_network.make_step, steps),
    ):
        trainer.run(config, [name], workdir)
    leaves = flat_names(ends[0])
    if config.mesh.fsdp > 1:
        assert any(not leaf.sharding.is_fully_replicated for leaf in leaves.values())
    if jax.process_count() > 1:
        leaves = {n: multihost_utils.process_allgather(v, tiled=True) for n, v in leaves.items()}
    if distributed.is_first():
        for i, program in enumerate(p for step in steps for p in step.compiled):
            (folder / run / f"{name}-{i}.hlo").write_text(program.call.as_text())
        np.savez(folder / run / f"{name}.npz", **{n: np.asarray(v) for n, v in leaves.items()})


def begin_flow(base: Path, workdir: Path, latents: bool) -> None:
    """Take the networks of a base's stages, and the latents that its first flow has encoded."""
    (workdir / "export").mkdir(parents=True)
    for name in STAGES[:3]:
        file = f"{name}.safetensors"
        shutil.copy(base / name / "export" / file, workdir / "export" / file)
    encoded = base / "structure_flow" / "latents"
    if latents and encoded.is_dir():
        shutil.copytree(encoded, workdir / "latents")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("run")
    parser.add_argument("stages", nargs="+")
    parser.add_argument("--devices", type=int, default=1)
    parser.add_argument("--fsdp", type=int, default=1)
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--encode", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--process", type=int, default=0)
    parser.add_argument("--port", type=int)
    parser.add_argument("--validation", action="store_true")
    parser.add_argument("--pixels", action="store_true", help="the latent flow as nano has it")
    args = parser.parse_args()
    os.environ["JAX_PLATFORMS"] = "cpu"
    # a few steps of tiny networks: compiling is what takes time
    cheap = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {cheap}"
    import jax

    jax.config.update("jax_num_cpu_devices", args.devices)
    from uniart_jax.precompute import encoding
    from uniart_jax.training import distributed

    if args.processes > 1:
        distributed.start(f"localhost:{args.port}", args.processes, args.process)
    config = make_config(args.folder, args.steps, fsdp=args.fsdp)
    if args.validation:
        data = dataclasses.replace(config.data, validation=str(args.folder / "validation"))
        config = dataclasses.replace(config, data=data)
    if args.pixels:
        config = dataclasses.replace(config, model=with_pixels(config.model))
    if args.encode:
        encoding.SHARD_BATCHES = args.encode
    with distributed.together():
        for name in args.stages:
            train(config, name, args.folder, args.run, latents=not args.encode)


if __name__ == "__main__":
    main()
