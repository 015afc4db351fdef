"""Open set, the autoencoder: what lets a UniArt VAE pass on joints of unseen families?

Command: uniart experiment open_set_vae; not in the paper, so there is no paper size.
What varies: channels of a voxel's latent, 16 (as shipped) or 48 (wide); and whether, while
    training, half of the parts get a joint and a parent drawn anew (data.new_joints).
Expected: joints drawn anew help where there is room for them, and cost where there is none
    (docs/experiments.md says why).
Nano: the UniArt VAE of configs/nano.py from scratch, 1,200 steps of 4 objects.
Time: one CPU core; 1,200 steps at .35 s and twice 28 objects at 4 s, four arms: 45 minutes.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import (
    OBJECT_COLUMNS,
    Arm,
    Experiment,
    Objects,
    Records,
    trained_on,
)

CONFIGS = Path(__file__).parent.parent
RECORDS = Records("data-cache/experiments-seen", count=2000)
ARMS = (  # channels, share of joints drawn anew, held against
    ("narrow", 16, 0.0, ""),
    ("narrow_new_joints", 16, 0.5, "narrow"),
    ("wide", 48, 0.0, "narrow"),
    ("wide_new_joints", 48, 0.5, "wide"),
)


def experiment(size: str) -> Experiment:
    if size != "nano":
        raise ValueError(
            "experiment open_set_vae: it has no paper size, the paper has no such table"
        )
    base = load_config(CONFIGS / "nano.py")
    stage = dataclasses.replace(
        base.uniart_vae,
        steps=1200,
        learning_rate=1e-3,
        warmup_steps=50,
        ema_decay=0.99,
        save_every=200,
    )
    arms = {}
    for name, channels, share, against in ARMS:
        # no layout for the decoder: what the latents hold is asked
        vae = dataclasses.replace(
            base.model.uniart_vae, latent_channels=channels, layout_channels=0
        )
        model = dataclasses.replace(base.model, uniart_vae=vae)
        config = dataclasses.replace(base, model=model, uniart_vae=stage)
        config = trained_on(config, RECORDS, voxel_crop=1024, new_joints=share)
        arms[name] = Arm(config, ("uniart_vae",), "vae", Objects(unseen=True), reference=against)
    for name, *_, against in ARMS:
        seen = {"tests": Objects(), "reuse": name, "reference": f"{against or name}_seen"}
        arms[f"{name}_seen"] = dataclasses.replace(arms[name], stages=(), **seen)
    return Experiment(
        arms, "narrow", (*OBJECT_COLUMNS, "range_iou"), seeds=1, count=28, records=(RECORDS,)
    )
