"""``uniart evaluate``: figures of checkpoints, of the representation, of assets in simulators."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from uniart_jax.cli.arguments import Out


def evaluate(
    what: Annotated[Literal["procedural", "representation", "physics"], tyro.conf.Positional],
    root: Annotated[Path | None, tyro.conf.Positional] = None,
    /,
    *,
    out: Out,
    checkpoint: str | None = None,
    count: int | None = None,
    records: Path | None = None,
    pictures: int = 16,
    unseen: bool = False,
    processes: int | None = None,
    engines: tuple[Literal["mujoco", "pybullet"], ...] | None = None,
    allow_outside: bool = False,
) -> None:
    """Measure a checkpoint on held-out procedural objects, the representation alone, or assets in simulators; write tables and pictures.

    Args:
        what: "procedural": image to object. "representation": truth to voxels to object, no network. "physics": written as assets and driven in simulators.
        root: representation, physics: a folder of assets instead of procedural objects (representation: at 32 and 64 voxels a side).
        checkpoint: As for sample.py (default nano). physics: judge what it makes of held-out images; without one, the true objects.
        count: Held-out objects, seeds from 1,000,000 on (default 128; physics 200, of a checkpoint 64), or assets (default all).
        records: Training records for the retrieval baseline; without them it is left out.
        pictures: How many objects are drawn.
        unseen: The families that are never trained on, instead of the trained ones.
        processes: Worker processes beside the networks' own (default: one a core, at most 8).
        engines: physics: MuJoCo and, where it is installed, PyBullet by default.
        allow_outside: With ROOT: let assets name files outside their own folders.
    """
    for name, value in (("count", count), ("processes", processes)):
        if value is not None and value < 1:
            raise ValueError(f"evaluate: --{name} must be at least 1, got {value}")
    if out.exists() and not out.is_dir():
        raise ValueError(f"output '{out}': a file of that name exists; choose another --out")
    workers = processes or min(os.cpu_count() or 1, 8)
    if what == "physics":
        if records is not None or (root is not None and unseen):
            raise ValueError("evaluate physics: it takes no --records, and no --unseen with a folder of assets")  # fmt: skip
        from uniart_jax.evaluation.physics import evaluate_physics

        evaluate_physics(
            out,
            root=root,
            checkpoint=checkpoint,
            count=count,
            unseen=unseen,
            engines=engines,
            allow_outside=allow_outside,
            processes=workers,
        )
        return
    if root is not None:
        if what != "representation":
            raise ValueError("evaluate: a folder of assets goes with 'representation' or 'physics'; it has no images")  # fmt: skip
        from uniart_jax.evaluation.assets import evaluate_assets

        evaluate_assets(root, out, count=count, processes=workers, allow_outside=allow_outside)
        return
    from uniart_jax.evaluation import procedural
    from uniart_jax.pipeline import enable_compilation_cache

    enable_compilation_cache()
    share: dict[str, Any] = {
        "unseen": unseen,
        "processes": workers,
    }
    if what == "representation":
        procedural.evaluate_representation(out, count=count or 128, **share)
    else:
        procedural.evaluate_checkpoint(
            checkpoint or "nano",
            out,
            count=count or 128,
            records=records,
            pictures=pictures,
            **share,
        )
