"""Supplement, multi-view conditioning: one, two or three images of the object at once.

Command: uniart experiment multi_view                           nano size, what docs/experiments.md has
         uniart experiment multi_view --size paper              needs what configs/paper.py needs
What varies: how many views are shown; the first is the same in all arms, the others are drawn as it was.
Expected (the paper, RS / AS, one -> "two or three" views): PSNR 28.52 / 23.77 -> 29.35 / 24.41, Chamfer distance .0095 / .0376 -> .0089 / .0334: a little better.
      The paper trains a variant for it. Here nothing is trained for it: image tokens stand side by side, volumes are averaged (docs/paper.md), so the
      networks see a condition that they were not trained on.
Nano: the shipped model as it is.
Hardware and time, nano: one CPU core; sampling alone, see docs/experiments.md. Paper: one training of configs/paper.py; unknown, never run by us.
"""

from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import Arm, Experiment, Objects

CONFIGS = Path(__file__).parent.parent
NAMES = {1: "one_view", 2: "two_views", 3: "three_views"}
COLUMNS = (
    "rs_psnr",
    "as_psnr",
    "rs_chamfer",
    "as_chamfer",
    "part_recall",
    "parts_right",
    "part_count",
    "type_accuracy",
    "axis_median",
    "pose_error",
)


def experiment(size: str) -> Experiment:
    if size == "nano":
        config = load_config(CONFIGS / "nano.py")
        arms = {name: Arm(config, (), "object", init="nano", views=n) for n, name in NAMES.items()}
        return Experiment(arms, "one_view", COLUMNS, seeds=1, count=70)
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    stages = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
    arms = {
        name: Arm(config, stages if n == 1 else (), "object", tests, of="" if n == 1 else "one_view", views=n)
        for n, name in NAMES.items()
    }  # fmt: skip
    return Experiment(arms, "one_view", COLUMNS, seeds=1, count=200)
