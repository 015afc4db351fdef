"""Open set, the autoencoder's side: what lets a UniArt VAE pass on the joints of families that it has never seen? Not in the paper.

Command: uniart experiment open_set_vae
What varies: channels of a voxel's latent, 16 (the shipped model's) or 48 (wide); and whether, while training, half of the parts get a joint and a parent drawn anew
      (``data.new_joints``): the paper's "synthetic articulation parameter sampling", without its "within physically valid ranges", since the mesh is not asked; voxels, boxes and all else stay. Each arm is judged twice, on unseen
      families and (``_seen``) on those that it was trained on.
Expected: of unseen families the shipped UniArt VAE gives hardly a moving part back right (``open_set``, unseen_vae), though every joint is written into
      the voxels that it reads: it has learned seven families' joints. A voxel says 21 numbers of joint and boxes beside its surface, more than 16
      channels would seem to carry, unless most of them follow from the rest. So joints drawn anew should help where there is room for them, and cost where there is none.
Nano: the UniArt VAE of configs/nano.py from scratch, 1,200 steps of 4 objects with 1,024 voxels drawn of each, on 2,000 objects of the seven seen families. The
      rate is 1e-3, not nano's 2e-3: at that one a training of wide_new_joints lost the joints' type and limits (docs/experiments.md).
Paper size: none; the paper has no such table.
Hardware and time, nano: one CPU core; 1,200 steps at .35 s and twice 28 objects at 4 s, four arms: 45 minutes.
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
        raise ValueError("experiment open_set_vae: it has no paper size, the paper has no such table")  # fmt: skip
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
        arms[name] = Arm(config, ("uniart_vae",), "vae", Objects(unseen=True), against=against)
    for name, *_, against in ARMS:
        seen = {"tests": Objects(), "of": name, "against": f"{against or name}_seen"}
        arms[f"{name}_seen"] = dataclasses.replace(arms[name], stages=(), **seen)
    return Experiment(
        arms, "narrow", (*OBJECT_COLUMNS, "range_iou"), seeds=1, count=28, records=(RECORDS,)
    )
