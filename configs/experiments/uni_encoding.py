"""Table 2, uni-encoding: part-wise attention, or stacking and one layer ("vanilla aggregation").

Command: uniart experiment uni_encoding [--size paper]; paper size needs what configs/paper.py
    needs.
What varies: model.uniart_vae.aggregation, uniart or concat, and with it the number of parameters.
Expected (the paper, RS / AS): PSNR 28.52 / 23.77 with, 23.75 / 21.37 without; Chamfer distance
    .0095 / .0376 with, .0149 / .0462 without.
Nano: a UniArt VAE and a latent flow for each arm (docs/experiments.md).
Time, nano: one CPU core; 450 and 1,500 steps, and 2,000 objects to encode, two arms, three seeds:
    40 minutes a training beside other work.
Time, paper: none beside those of main and aggregation, which are judged again; unknown, never run
    by us.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.config import Config
from uniart_jax.experiments.design import (
    OBJECT_COLUMNS,
    Arm,
    Experiment,
    Objects,
    Records,
    trained_on,
    with_aggregation,
)

CONFIGS = Path(__file__).parent.parent
RECORDS = Records("data-cache/experiments-seen", count=2000)
KINDS = ("uniart", "concat")


def nano() -> Config:
    config = load_config(CONFIGS / "nano.py")
    # no layout for the decoder: what the latents hold is asked
    vae = dataclasses.replace(config.model.uniart_vae, part_segment=0, layout_channels=0)
    short = dict(warmup_steps=50, ema_decay=0.99, save_every=100)
    config = dataclasses.replace(
        config,
        model=dataclasses.replace(config.model, uniart_vae=vae),
        uniart_vae=dataclasses.replace(config.uniart_vae, steps=450, **short),
        latent_flow=dataclasses.replace(config.latent_flow, steps=1500, **short),
    )
    return trained_on(config, RECORDS, voxel_crop=1024)


def experiment(size: str) -> Experiment:
    if size == "nano":
        base = nano()
        arms = {
            kind: Arm(with_aggregation(base, kind), ("uniart_vae", "latent_flow"), "latent_flow", other_networks_from="nano")  # noqa: E501
            for kind in KINDS
        }  # fmt: skip
        return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=3, count=28, records=(RECORDS,))
    base = load_config(CONFIGS / "paper.py")
    tests = Objects(records=base.data.validation, split="test")
    arms = {
        kind: Arm(with_aggregation(base, kind), (), "object", tests, reuse=trained)
        for kind, trained in zip(KINDS, ("main/uniart", "aggregation/concat"), strict=True)
    }
    return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=1, count=200)
