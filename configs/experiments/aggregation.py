"""Table 3: how geometry and articulation meet before the UniArt VAE's encoder.

Command: uniart experiment aggregation                          nano size, what docs/experiments.md has
         uniart experiment aggregation --size paper             needs what configs/paper.py needs
What varies: model.uniart_vae.aggregation, nothing else: part-wise UniArt attention, self-attention over windows, residual (articulation
      added to geometry), pooling over the part, and concat (the "vanilla aggregation" of Table 2, whose other row this is).
Expected (the paper, generated objects, RS / AS PSNR and RS / AS Chamfer distance): uniart 28.52 / 23.77, .0095 / .0376; self_attention 25.33 / 22.04,
      .0148 / .0457; residual 20.92 / 18.62, .0170 / .0499; pooling 20.37 / 17.23, .0176 / .0493; concat (Table 2) 23.75 / 21.37, .0149 / .0462.
Nano: the UniArt VAE of configs/nano.py for 600 steps of 4 objects, judged on its reconstruction of held-out objects: the first station at which
      an aggregation can matter, and not the paper's, which is image to object. Its decoder is told nothing of parts, so what the front loses is lost.
      A limit of the twin: linear_path, a linear layer past the trunk, lets each voxel's own attributes through whatever the aggregation.
Hardware and time, nano: one CPU core; 600 steps at .84 s on an idle one, five arms, three seeds.
Hardware and time, paper: five trainings of configs/paper.py (8 x A100 each); unknown, never run by us.
"""

import dataclasses
from pathlib import Path
from typing import get_args

from uniart_jax.cli import load_config
from uniart_jax.config import Aggregation, Config
from uniart_jax.experiments.design import Arm, Experiment, Objects, Records

CONFIGS = Path(__file__).parent.parent
RECORDS = Records("data-cache/nano", count=12_000, views=4)  # those of configs/nano.py
COLUMNS = (
    "rs_psnr",
    "as_psnr",
    "rs_chamfer",
    "as_chamfer",
    "part_recall",
    "parts_right",
    "part_count",
    "axis_median",
    "pivot",
    "pose_error",
)


def with_aggregation(config: Config, kind: Aggregation) -> Config:
    vae = dataclasses.replace(config.model.uniart_vae, aggregation=kind)
    return dataclasses.replace(config, model=dataclasses.replace(config.model, uniart_vae=vae))


def nano() -> Config:
    config = load_config(CONFIGS / "nano.py")
    stage = dataclasses.replace(
        config.uniart_vae, steps=600, warmup_steps=50, ema_decay=0.99, save_every=100
    )
    data = dataclasses.replace(config.data, procedural=0, validation="")  # made by RECORDS
    return dataclasses.replace(config, data=data, uniart_vae=stage)


def experiment(size: str) -> Experiment:
    if size == "nano":
        base, stages, station, tests = nano(), ("uniart_vae",), "vae", Objects()
    else:
        base = load_config(CONFIGS / "paper.py")
        stages = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
        station, tests = "object", Objects(records=base.data.validation, split="test")
    return Experiment(
        arms={
            kind: Arm(with_aggregation(base, kind), stages, station, tests)
            for kind in get_args(Aggregation)
        },
        reference="uniart",
        columns=COLUMNS,
        seeds=3 if size == "nano" else 1,
        count=42 if size == "nano" else 200,
        records=(RECORDS,) if size == "nano" else (),
    )
