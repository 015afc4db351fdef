"""Supplement, adaptive Euler and Heun: quality against cost of the solvers of both flows.

Command: uniart experiment solvers [--size paper]; paper size needs what configs/paper.py needs.
What varies: how both flows are solved, Euler or Heun, in fixed steps or adaptive at two tolerances;
    the noise is the same in all arms. Cost: network calls of both flows together (at guidance 1;
    above, each is a pass of twice the batch).
Expected: the supplement offers adaptive solvers without figures. Of a flow that was trained to be
    near its mean in few steps, no gain over few fixed ones.
Nano: the shipped model. Time: one CPU core; sampling alone, about 8 s an object and arm.
Time, paper: sampling alone once main's networks are trained (it trains them otherwise); unknown,
    never run by us.
"""

from pathlib import Path
from typing import Any

from uniart_jax.cli import load_config
from uniart_jax.experiments.design import Arm, Experiment, Objects

CONFIGS = Path(__file__).parent.parent
FIXED = {
    f"{solver}_{n}": {"solver": solver, "steps": n}
    for solver, numbers in (("euler", (1, 2, 4, 8)), ("heun", (2, 4)))
    for n in numbers
}
ADAPTIVE = {
    f"{solver}_adaptive_{t:g}": {"solver": solver, "adaptive": True, "tolerance": t}
    for solver in ("euler", "heun")
    for t in (0.3, 0.1)
}
SOLVERS: dict[str, dict[str, Any]] = FIXED | ADAPTIVE
COLUMNS = (
    "velocities",
    "rs_psnr",
    "rs_chamfer",
    "as_chamfer",
    "part_recall",
    "parts_right",
    "type_accuracy",
    "pose_error",
)


def experiment(size: str) -> Experiment:
    if size == "nano":
        config = load_config(CONFIGS / "nano.py")
        arms = {
            name: Arm(config, (), "object", init="nano", sampling=options)
            for name, options in SOLVERS.items()
        }
        return Experiment(arms, "euler_4", COLUMNS, seeds=1, count=42)
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    arms = {
        name: Arm(config, (), "object", tests, reuse="main/uniart", sampling=options)
        for name, options in SOLVERS.items()
    }
    return Experiment(arms, "euler_4", COLUMNS, seeds=1, count=200)
