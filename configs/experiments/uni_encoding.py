"""Table 2, uni-encoding: geometry and articulation aligned by part-wise attention, or stacked and put through one layer ("vanilla aggregation").

Command: uniart experiment uni_encoding                         nano size, what docs/experiments.md has
         uniart experiment uni_encoding --size paper            needs what configs/paper.py needs
What varies: model.uniart_vae.aggregation, uniart or concat. Both arms have one latent for geometry and articulation: the paper has no arm with
      two, and its text calls only the stacking "without uni-encoding".
Expected (the paper, RS / AS): PSNR 28.52 / 23.77 with, 23.75 / 21.37 without; Chamfer distance .0095 / .0376 with, .0149 / .0462 without.
Nano: beyond Table 3's twin (aggregation.py) a latent flow is trained on each arm's latents, and what it samples from an image, on the true active voxels,
      is judged. 1,000 objects; UniArt VAE 450 steps, latent flow 2,000, of 4 objects each; image encoder and structure VAE are the shipped model's.
Hardware and time, nano: one CPU core; 450 steps at .84 s, 2,000 at .13 s, and 1,000 objects to encode, two arms, three seeds.
Hardware and time, paper: two trainings of configs/paper.py; unknown, never run by us.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.config import Aggregation, Config
from uniart_jax.experiments.design import Arm, Experiment, Objects, Records

CONFIGS = Path(__file__).parent.parent
RECORDS = Records("data-cache/experiments-seen", count=1000)
KINDS: tuple[Aggregation, ...] = ("uniart", "concat")
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
    short = dict(warmup_steps=50, ema_decay=0.99, save_every=100)
    return dataclasses.replace(
        config,
        data=dataclasses.replace(
            config.data, records=RECORDS.folder, procedural=0, views=RECORDS.views, validation=""
        ),
        uniart_vae=dataclasses.replace(config.uniart_vae, steps=450, **short),
        latent_flow=dataclasses.replace(config.latent_flow, steps=2000, **short),
    )


def experiment(size: str) -> Experiment:
    if size == "nano":
        base = nano()
        arms = {
            kind: Arm(with_aggregation(base, kind), ("uniart_vae", "latent_flow"), "latent_flow", beside="nano")
            for kind in KINDS
        }  # fmt: skip
        return Experiment(arms, "uniart", COLUMNS, seeds=3, count=42, records=(RECORDS,))
    base = load_config(CONFIGS / "paper.py")
    tests = Objects(records=base.data.validation, split="test")
    stages = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
    arms = {kind: Arm(with_aggregation(base, kind), stages, "object", tests) for kind in KINDS}
    return Experiment(arms, "uniart", COLUMNS, seeds=1, count=200)
