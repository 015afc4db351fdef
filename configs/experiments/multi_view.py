"""Supplement, multi-view conditioning: one, two or three images of the object at once.

Command: uniart experiment multi_view [--size paper]; paper size needs what configs/paper.py needs.
What varies: how many views are shown, and whether the flows have been trained on so many; the
    first view is the same in all arms, others drawn alike.
Expected (the paper, RS / AS, one -> "two or three" views): PSNR 28.52 / 23.77 -> 29.35 / 24.41,
    Chamfer distance .0095 / .0376 -> .0089 / .0334: a little better. The paper trains a variant.
Nano: the shipped model, shown 1, 2, 3 views; and both of its flows trained on for 200 steps with as
    many at once. On one core: 20 minutes to judge an arm (70 objects), 10 to train one.
Time, paper: two trainings of configs/paper.py beside that of main; never run by us.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.config import Config
from uniart_jax.experiments.design import (
    OBJECT_COLUMNS,
    PAPER_STAGES,
    Arm,
    Experiment,
    Objects,
    Records,
    trained_on,
)

CONFIGS = Path(__file__).parent.parent
NAMES = {1: "one_view", 2: "two_views", 3: "three_views"}
FLOWS = ("structure_flow", "latent_flow")
RECORDS = Records("data-cache/experiments-views", count=500, views=3)


def with_views(config: Config, views: int) -> Config:
    """The config whose flows are trained on so many views at once."""
    return dataclasses.replace(config, data=dataclasses.replace(config.data, condition_views=views))


def nano() -> Config:
    config = load_config(CONFIGS / "nano.py")
    changes = dict(steps=200, learning_rate=3e-4, warmup_steps=50, ema_decay=0.99, save_every=50)
    stages = {n: dataclasses.replace(getattr(config, n), **changes, batch_size=4) for n in FLOWS}
    return trained_on(dataclasses.replace(config, **stages), RECORDS)


def experiment(size: str) -> Experiment:
    if size == "nano":
        config = load_config(CONFIGS / "nano.py")
        arms = {name: Arm(config, (), "object", init="nano", views=n) for n, name in NAMES.items()}
        for n, name in NAMES.items():
            trained = with_views(nano(), n)
            arms[f"trained_{name}"] = Arm(trained, FLOWS, "object", init="nano", views=n)
        records = (RECORDS,)
        return Experiment(arms, "one_view", OBJECT_COLUMNS, seeds=1, count=70, records=records)
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    arms = {
        name: Arm(config, (), "object", tests, reuse="main/uniart", views=n)
        for n, name in NAMES.items()
    }
    for n in (2, 3):
        trained = with_views(config, n)
        arms[f"trained_{NAMES[n]}"] = Arm(trained, PAPER_STAGES, "object", tests, views=n)
    return Experiment(arms, "one_view", OBJECT_COLUMNS, seeds=1, count=200)
