"""Supplement, open set: categories that are never trained on, beside those that are.

Command: uniart experiment open_set                             nano size
         uniart experiment open_set --size paper                needs what configs/paper.py needs, with records of: uniart prepare partnet-mobility
         ROOT --split open ... --out data-cache/partnet-open
What varies: the test objects, so nothing is paired: difference and share kept have intervals of two independent bootstraps over objects.
Expected (the paper, RS / AS): PSNR 28.52 / 23.77 seen, 22.31 / 19.05 unseen; Chamfer distance .0095 / .0376 seen, .0173 / .0501 unseen. Its text says that over
      85 % of the closed-set performance is kept "across all metrics"; its own figures are 78 to 80 % of PSNR and 55 to 75 % of Chamfer distance.
Nano: the shipped model as it is, nothing is trained: seven seen families, six unseen ones. seen_vae
  and unseen_vae are the truth's voxels through the UniArt VAE
      alone: what the representation and its code make of such objects, whatever a generator does. Seen families also differ from unseen ones in how hard
      they are.
Hardware and time, nano: one CPU core; sampling alone, about 8 s an object and arm.
Hardware and time, paper: one training of configs/paper.py on the open split; unknown, never run by us.
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
                config, (), "vae", Objects(unseen=True), init="nano", against="seen_vae"
            ),
        }
        return Experiment(arms, "seen", OBJECT_COLUMNS, seeds=1, count=70)
    config = load_config(CONFIGS / "paper.py")
    folder = "data-cache/partnet-open"
    data = dataclasses.replace(config.data, records=folder, validation=folder)
    config = dataclasses.replace(config, data=data)
    arms = {
        "seen": Arm(config, PAPER_STAGES, "object", Objects(records=folder, split="test")),
        "unseen": Arm(config, (), "object", Objects(records=folder, split="unseen"), of="seen"),
    }
    return Experiment(arms, "seen", OBJECT_COLUMNS, seeds=1, count=200)
