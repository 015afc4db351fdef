"""Table 1: image to object on test objects of the trained categories.

Command: uniart experiment main                                 nano size, what docs/experiments.md has
         uniart experiment main --size paper                    needs what configs/paper.py needs
What varies: nothing; one model. Beside it, of the same networks, what comes back of the true voxels through the UniArt VAE alone (vae) and what the
      latent flow makes of the image on the true active voxels (given_structure): where quality is lost. Retrieval and other baselines on the same
      objects: uniart evaluate baselines.
Expected (the paper, RS / AS): PSNR 28.52 / 23.77, Chamfer distance .0095 / .0376, OpenShape .1457 / .1176 (OpenShape: uniart evaluate PRED REF --openshape).
Nano: the shipped model as it is; nothing is trained.
Hardware and time, nano: one CPU core; two networks' minutes of sampling, see docs/experiments.md. Paper: that of configs/paper.py; unknown, never run by us.
"""

from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import Arm, Experiment, Objects, Station

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
    "pivot",
    "pose_error",
)
STATIONS: dict[str, Station] = {"uniart": "object", "given_structure": "latent_flow", "vae": "vae"}


def experiment(size: str) -> Experiment:
    if size == "nano":
        config = load_config(CONFIGS / "nano.py")
        arms = {name: Arm(config, (), at, init="nano") for name, at in STATIONS.items()}
        return Experiment(arms, "uniart", COLUMNS, seeds=1, count=70)
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    stages = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
    arms = {
        name: Arm(config, stages if at == "object" else (), at, tests, of="" if at == "object" else "uniart")
        for name, at in STATIONS.items()
    }  # fmt: skip
    return Experiment(arms, "uniart", COLUMNS, seeds=1, count=200)
