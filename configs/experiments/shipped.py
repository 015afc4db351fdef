"""Not in the paper: the shipped model beside weights shipped before, same objects, same noise.

Command: mkdir -p runs; git archive 02ff56e uniart_jax/pretrained | tar x -C runs
         uniart experiment shipped      (in a clone with its history: the weights before)
What varies: the weights and with them the flows' pixel_channels, of the structure flow also the
    camera that it sees through; UniArt VAE and structure VAE are the same in both. given: the true
    active voxels and the image.
Expected: now better. Nothing is trained; there is no paper size.
Time: one CPU core; sampling alone, about 6 s an object and arm: 80 minutes for six arms of 128
    objects, beside other work.
"""

from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import OBJECT_COLUMNS, Arm, Experiment, Objects, PipelineStage

CONFIGS = Path(__file__).parent.parent
BEFORE = "runs/uniart_jax/pretrained/nano"
SETS: dict[str, tuple[PipelineStage, bool]] = {
    "seen": ("object", False),
    "given": ("latent_flow", False),
    "unseen": ("object", True),
}


def experiment(size: str) -> Experiment:
    if size != "nano":
        raise ValueError("experiment shipped: it has no paper size, the paper ships no weights")
    config = load_config(CONFIGS / "nano.py")
    arms = {}
    for name, (stage, unseen) in SETS.items():
        tests = Objects(unseen=unseen)
        arms[f"{name}_before"] = Arm(config, (), stage, tests, init=BEFORE, reference="seen_before")
        arms[f"{name}_now"] = Arm(config, (), stage, tests, init="nano", reference=f"{name}_before")
    return Experiment(arms, "seen_before", OBJECT_COLUMNS, seeds=1, count=128)
