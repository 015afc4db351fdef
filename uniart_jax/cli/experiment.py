"""``uniart experiment``: the paper's tables, each as one command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro


def experiment(
    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME|FILE")],
    /,
    *,
    size: Literal["nano", "paper"] = "nano",
    seeds: int | None = None,
    count: int | None = None,
    arms: tuple[str, ...] = (),
    out: Path | None = None,
) -> None:
    """Train each arm of an experiment, judge it on held-out objects, and write OUT/table.md. Goes
    on where it was stopped.

    Args:
        name: Of configs/experiments (main, aggregation, ...), or such a file; its header says what
          varies, what to expect and how long it takes.
        size: nano: on procedural objects, on a laptop. paper: on PartNet-Mobility, with what
          configs/paper.py asks for.
        seeds: Trainings of each arm (default: the experiment's own).
        count: Test objects (default: the experiment's own).
        arms: Only these; one whose networks another arm trains needs that one too, or trained
          before.
        out: Where everything goes (default: runs/experiments/NAME, with -paper at that size). Arms
          that another experiment has too are trained in its folder beside.
    """
    from uniart_jax.experiments.design import find_experiment, folder_name, load_experiment
    from uniart_jax.experiments.run import run_experiment
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    for option, value in (("seeds", seeds), ("count", count)):
        if value is not None and value < 1:
            raise ValueError(f"experiment: --{option} must be at least 1, got {value}")
    enable_compilation_cache()
    folder = out or Path("runs/experiments") / folder_name(find_experiment(name), size)
    run_experiment(load_experiment(name, size), folder, seeds=seeds, count=count, arms=arms)
