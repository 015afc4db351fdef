"""Supplement, open set: categories that are never trained on, beside those that are.

Command: uniart experiment open_set                             nano size, what docs/experiments.md has
         uniart experiment open_set --size paper                needs what configs/paper.py needs, with records of: uniart prepare partnet-mobility
         ROOT --split open ... --out data-cache/partnet-open
What varies: the test objects.
Expected (the paper, RS / AS): PSNR 28.52 / 23.77 seen, 22.31 / 19.05 unseen; Chamfer distance .0095 / .0376 seen, .0173 / .0501 unseen. Its text says that over
      85 % of the closed-set performance is kept "across all metrics"; its own figures are 78 to 80 % of PSNR and 55 to 75 % of Chamfer distance.
Nano: the shipped model as it is, nothing is trained: seven seen families, ten unseen ones. seen_vae and unseen_vae are the truth's voxels through the UniArt VAE
      alone: what the representation and its code make of such objects, whatever a generator does.
Hardware and time, nano: one CPU core; sampling alone, see docs/experiments.md. Paper: one training of configs/paper.py; unknown, never run by us.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import Arm, Experiment, Objects

CONFIGS = Path(__file__).parent.parent
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
        arms = {
            "seen": Arm(config, (), "object", Objects(), init="nano"),
            "unseen": Arm(config, (), "object", Objects(unseen=True), init="nano"),
            "seen_vae": Arm(config, (), "vae", Objects(), init="nano"),
            "unseen_vae": Arm(config, (), "vae", Objects(unseen=True), init="nano"),
        }
        return Experiment(arms, "seen", COLUMNS, seeds=1, count=70)
    config = load_config(CONFIGS / "paper.py")
    folder = "data-cache/partnet-open"
    data = dataclasses.replace(config.data, records=folder, validation=folder)
    config = dataclasses.replace(config, data=data)
    stages = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
    arms = {
        "seen": Arm(config, stages, "object", Objects(records=folder, split="test")),
        "unseen": Arm(config, (), "object", Objects(records=folder, split="unseen"), of="seen"),
    }
    return Experiment(arms, "seen", COLUMNS, seeds=1, count=200)
