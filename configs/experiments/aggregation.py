"""Table 3: how geometry and articulation meet before the UniArt VAE's encoder.

Command: uniart experiment aggregation [--size paper]; paper size needs what configs/paper.py needs.
What varies: model.uniart_vae.aggregation, and what belongs to it (docs/experiments.md).
Expected (the paper, generated objects, RS / AS): PSNR and Chamfer distance: uniart 28.52 / 23.77,
    .0095 / .0376; self_attention 25.33 / 22.04, .0148 / .0457; residual 20.92 / 18.62,
    .0170 / .0499; pooling 20.37 / 17.23, .0176 / .0493; concat (Table 2) 23.75 / 21.37,
    .0149 / .0462.
Time, nano: one CPU core beside other work; five arms, three seeds, each trained and judged in ten
    minutes. Paper: four trainings of configs/paper.py beside that of main; never run by us.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.config import Config
from uniart_jax.data.geometric_features import CHANNELS as GEOMETRIC_CHANNELS
from uniart_jax.experiments.design import (
    OBJECT_COLUMNS,
    PAPER_STAGES,
    Arm,
    Experiment,
    Objects,
    Records,
    trained_on,
    with_aggregation,
)

CONFIGS = Path(__file__).parent.parent
KINDS = ("uniart", "self_attention", "residual", "pooling", "concat")
RECORDS = Records("data-cache/experiments-seen", count=2000, part_features="geometric")


def nano() -> Config:
    config = load_config(CONFIGS / "nano.py")
    stage = dataclasses.replace(
        config.uniart_vae, steps=500, warmup_steps=50, ema_decay=0.99, save_every=100
    )
    # no layout for the decoder: what the latents hold is asked
    # part features, so that voxels of one part differ in what the aggregation takes together
    vae = dataclasses.replace(
        config.model.uniart_vae,
        part_segment=0,
        layout_channels=0,
        part_feature_channels=GEOMETRIC_CHANNELS,
    )
    model = dataclasses.replace(config.model, uniart_vae=vae)
    config = dataclasses.replace(config, model=model, uniart_vae=stage)
    return trained_on(config, RECORDS, voxel_crop=1024)


def experiment(size: str) -> Experiment:
    if size == "nano":
        arms = {kind: Arm(with_aggregation(nano(), kind), ("uniart_vae",), "vae") for kind in KINDS}
        return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=3, count=28, records=(RECORDS,))
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    arms = {"uniart": Arm(config, (), "object", tests, reuse="main/uniart")}
    for kind in KINDS[1:]:
        arms[kind] = Arm(with_aggregation(config, kind), PAPER_STAGES, "object", tests)
    return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=1, count=200)
