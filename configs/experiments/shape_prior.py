"""Table 2, 3D prior: training that begins with weights that know 3D shapes, or from scratch.

Command: uniart experiment shape_prior [--size paper]; paper size needs what configs/paper.py needs.
What varies: what the networks begin with. Paper size: TRELLIS's weights, or drawn at random
    (DINOv2, frozen, in both). Nano: the structure flow alone (docs/experiments.md).
Expected (the paper, RS / AS): PSNR 28.52 / 23.77 with, 13.24 / 11.76 without; Chamfer distance
    .0095 / .0376 with, .0572 / .0763 without.
Time, nano: one CPU core; 300 steps of 16 objects and 300 objects to encode, two arms, three seeds:
    38 minutes beside other work.
Time, paper: one training of configs/paper.py beside that of main; unknown, never run by us.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.config import Config
from uniart_jax.experiments.design import (
    PAPER_STAGES,
    Arm,
    Experiment,
    Objects,
    Records,
    trained_on,
)

CONFIGS = Path(__file__).parent.parent
UNKNOWN = (
    "toilet",
    "laptop",
    "trash_can",
    "bottle",
    "swivel_chair",
    "scissors",
    "faucet",
    "box",
    "sliding_window",
    "door",
)
RECORDS = Records("data-cache/experiments-unseen", families=UNKNOWN, count=300)


def nano() -> Config:
    config = load_config(CONFIGS / "nano.py")
    stage = dataclasses.replace(
        config.structure_flow,
        steps=300,
        learning_rate=5e-4,
        warmup_steps=50,
        ema_decay=0.99,
        save_every=50,
    )
    return trained_on(dataclasses.replace(config, structure_flow=stage), RECORDS)


def experiment(size: str) -> Experiment:
    if size == "nano":
        config, stages, tests = nano(), ("structure_flow",), Objects(unseen=True)
        arms = {
            "prior": Arm(config, stages, "structure", tests, init="nano"),
            "scratch": Arm(config, stages, "structure", tests, other_networks_from="nano"),
            "prior_alone": Arm(config, (), "structure", tests, init="nano"),
        }
        columns = ("structure_iou",)
        return Experiment(arms, "prior", columns, seeds=3, count=70, records=(RECORDS,))
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    scratch = dataclasses.replace(config, init="")
    arms = {
        "prior": Arm(config, (), "object", tests, reuse="main/uniart"),
        "scratch": Arm(scratch, PAPER_STAGES, "object", tests, other_networks_from=config.init),
    }
    columns = ("rs_psnr", "as_psnr", "rs_chamfer", "as_chamfer", "parts_right", "pose_error")
    return Experiment(arms, "prior", columns, seeds=1, count=200)
