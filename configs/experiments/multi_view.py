"""Supplement, multi-view conditioning: one, two or three images of the object at once.

Command: uniart experiment multi_view [--size paper]; paper size needs what configs/paper.py needs.
What varies: how many views are shown; the first is the same in all arms, others drawn alike.
Expected (the paper, RS / AS, one -> "two or three" views): PSNR 28.52 / 23.77 -> 29.35 / 24.41,
    Chamfer distance .0095 / .0376 -> .0089 / .0334: a little better. The paper trains a variant for
    it; here nothing is trained for it (docs/experiments.md).
Nano: the shipped model as it is. Time: one CPU core; sampling alone, about 8 s an object and arm.
Time, paper: sampling alone once main's networks are trained (it trains them otherwise); unknown,
    never run by us.
"""

from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import OBJECT_COLUMNS, Arm, Experiment, Objects

CONFIGS = Path(__file__).parent.parent
NAMES = {1: "one_view", 2: "two_views", 3: "three_views"}


def experiment(size: str) -> Experiment:
    if size == "nano":
        config = load_config(CONFIGS / "nano.py")
        arms = {name: Arm(config, (), "object", init="nano", views=n) for n, name in NAMES.items()}
        return Experiment(arms, "one_view", OBJECT_COLUMNS, seeds=1, count=70)
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    arms = {
        name: Arm(config, (), "object", tests, of="main/uniart", views=n)
        for n, name in NAMES.items()
    }
    return Experiment(arms, "one_view", OBJECT_COLUMNS, seeds=1, count=200)
