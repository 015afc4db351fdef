"""Supplement, open set: categories that are never trained on, beside those that are.

Command: uniart experiment open_set [--size paper]; paper size needs what configs/paper.py needs,
    with records of: uniart prepare partnet-mobility ROOT --split open ...
    --out data-cache/partnet-open
What varies: the test objects, so nothing is paired (docs/experiments.md).
Expected (the paper, RS / AS): PSNR 28.52 / 23.77 seen, 22.31 / 19.05 unseen; Chamfer distance
    .0095 / .0376 seen, .0173 / .0501 unseen.
Nano: the shipped model as it is; seven seen families, six unseen ones.
Time, nano: one CPU core; sampling alone, about 8 s an object and arm.
Time, paper: one training of configs/paper.py on the open split; unknown, never run by us.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import OBJECT_COLUMNS, PAPER_STAGES, Arm, Experiment, Objects

CONFIGS = Path(__file__).parent.parent


def experiment(size: str) -> Experiment:
    if size == "nano":
        config = load_config(CONFIGS / "nano.py")
        arms = {
            "seen": Arm(config, (), "object", Objects(), init="nano"),
            "unseen": Arm(config, (), "object", Objects(unseen=True), init="nano"),
            "seen_vae": Arm(config, (), "vae", Objects(), init="nano"),
            "unseen_vae": Arm(
                config, (), "vae", Objects(unseen=True), init="nano", reference="seen_vae"
            ),
        }
        return Experiment(arms, "seen", OBJECT_COLUMNS, seeds=1, count=70)
    config = load_config(CONFIGS / "paper.py")
    folder = "data-cache/partnet-open"
    data = dataclasses.replace(config.data, records=folder, validation=folder)
    config = dataclasses.replace(config, data=data)
    arms = {
        "seen": Arm(config, PAPER_STAGES, "object", Objects(records=folder, split="test")),
        "unseen": Arm(config, (), "object", Objects(records=folder, split="unseen"), reuse="seen"),
    }
    return Experiment(arms, "seen", OBJECT_COLUMNS, seeds=1, count=200)
