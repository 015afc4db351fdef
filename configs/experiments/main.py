"""Table 1: image to object on test objects of the trained categories.

Command: uniart experiment main [--size paper]; paper size needs what configs/paper.py needs.
What varies: nothing; one model, judged after three pipeline stages (docs/experiments.md).
Expected (the paper, RS / AS): PSNR 28.52 / 23.77, Chamfer distance .0095 / .0376, OpenShape
    .1457 / .1176 (OpenShape: uniart evaluate PRED REF --openshape).
Nano: the shipped model as it is; nothing is trained.
Time, nano: one CPU core; sampling alone: 28 objects, three stages each, took 10 minutes.
Time, paper: that of configs/paper.py; unknown, never run by us. Other experiments of that size
    judge these networks again.
"""

from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import (
    OBJECT_COLUMNS,
    PAPER_STAGES,
    Arm,
    Experiment,
    Objects,
    PipelineStage,
)

CONFIGS = Path(__file__).parent.parent
PIPELINE_STAGES: dict[str, PipelineStage] = {
    "uniart": "object",
    "given_structure": "latent_flow",
    "vae": "vae",
}


def experiment(size: str) -> Experiment:
    if size == "nano":
        config = load_config(CONFIGS / "nano.py")
        arms = {name: Arm(config, (), at, init="nano") for name, at in PIPELINE_STAGES.items()}
        return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=1, count=70)
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    arms = {
        name: Arm(config, PAPER_STAGES if at == "object" else (), at, tests, reuse="" if at == "object" else "uniart")  # noqa: E501
        for name, at in PIPELINE_STAGES.items()
    }  # fmt: skip
    return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=1, count=200)
