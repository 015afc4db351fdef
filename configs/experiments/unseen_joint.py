"""Open-set articulation, taken at its word: a joint type that is never trained on.

Command: uniart experiment unseen_joint; not in the paper, so there is no paper size.
What varies: whether sliding parts (prismatic joints) are among the training records.
Expected: that the joint code carries over, if articulation is a continuum of screws rather than a
    list of types (docs/experiments.md).
Nano: the UniArt VAE of configs/nano.py for 450 steps of 4 objects, judged on its reconstruction of
    held-out objects that have a sliding part.
Time: one CPU core; 450 steps at .46 s on an idle one and 28 objects at 6 s, three arms, three
    seeds: an hour beside other work.
"""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import Arm, Experiment, Objects, Records

CONFIGS = Path(__file__).parent.parent
ALL = Records("data-cache/experiments-seen", count=2000)
SEEN = "data-cache/experiments-seen"
REST = Records("data-cache/experiments-no-prismatic", source=SEEN, leave_out="prismatic")
FEW = Records("data-cache/experiments-as-few", source=SEEN, leave_out="prismatic", matched=True)
ARMS = (("all", ALL, ""), ("as_few", FEW, "train"), ("without_prismatic", REST, "train"))
COLUMNS = (
    "part_recall",
    "type_accuracy",
    "parts_right",
    "axis_median",
    "range_iou",
    "pose_error",
    "rs_chamfer",
    "as_chamfer",
)


def experiment(size: str) -> Experiment:
    if size != "nano":
        raise ValueError(
            "experiment unseen_joint: it has no paper size, the paper has no such table"
        )
    base = load_config(CONFIGS / "nano.py")
    stage = dataclasses.replace(
        base.uniart_vae, steps=450, warmup_steps=50, ema_decay=0.99, save_every=100
    )
    arms = {}
    for name, records, split in ARMS:
        data = dataclasses.replace(
            base.data,
            records=records.folder,
            split=split,
            procedural=0,
            validation="",
            voxel_crop=1024,
        )
        # no layout for the decoder: what the latents hold is asked
        vae = dataclasses.replace(base.model.uniart_vae, layout_channels=0)
        model = dataclasses.replace(base.model, uniart_vae=vae)
        config = dataclasses.replace(base, model=model, data=data, uniart_vae=stage)
        arms[name] = Arm(config, ("uniart_vae",), "vae", Objects(joint_type="prismatic"))
    return Experiment(arms, "as_few", COLUMNS, seeds=3, count=28, records=(ALL, REST, FEW))
