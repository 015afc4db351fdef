"""``uniart evaluate``: predictions against references, and figures of checkpoints, of the
representation, of assets in simulators."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from uniart_jax.cli.arguments import Out

OWN = ("baselines", "procedural", "layout", "representation", "physics")
Engines = tuple[Literal["mujoco", "pybullet"], ...]
Samples = Literal["mean", "best", "first"]
Front = Literal["-x", "+x", "-y", "+y"]


def evaluate(
    what: Annotated[
        str,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="PRED|baselines|procedural|layout|representation|physics"),
    ],
    root: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[REF|ROOT]")] = None,
    /,
    *,
    out: Out,
    samples: Samples | None = None,
    only: tuple[str, ...] | None = None,
    openshape: Path | None = None,
    checkpoint: str | None = None,
    count: int | None = None,
    records: Path | None = None,
    library: Path | None = None,
    pictures: int | None = None,
    pred: Path | None = None,
    cache: Path | None = None,
    unseen: bool = False,
    families: tuple[str, ...] = (),
    first_seed: int | None = None,
    backgrounds: bool = False,
    processes: int | None = None,
    engines: Engines | None = None,
    allow_outside: bool = False,
    front: Front | None = None,
    ref_front: Front | None = None,
) -> None:
    """Hold anybody's predictions against references: uniart evaluate PRED REF --out DIR. Writes
    metrics.json, table.md, report.html.

    PRED and REF are folders of assets (URDF, MJCF, object.json, nap.npz) matched by name, or one
    asset each; PRED/NAME may hold several samples.
    Or measure a checkpoint on held-out procedural objects, beside retrieval and controls
    (baselines) or stage by stage of the pipeline (procedural), its layouts (layout), the
    representation alone, or assets in simulators (physics).

    Args:
        what: A folder of predictions, or one of the five words baselines, procedural, layout,
          representation, physics; a folder of such a name is given as ./physics.
        root: The references. representation, physics, layout: a folder of assets instead of
          procedural objects (representation: at 32 and 64 voxels a side).
        samples: PRED REF: how several samples of an object count (default: mean; best: by pose
          error).
        only: PRED REF: these figures of surface, articulation, pose_error, singapo, appearance,
          openshape, physics.
        openshape: PRED REF, baselines: OpenShape's converted weights; without them that figure is
          not computed.
        checkpoint: As for sample.py (default nano). physics: judge what it makes of held-out
          images; without one, the true objects.
        count: Held-out objects, or those from --first-seed on (default 128; physics 200, of a
          checkpoint 64), or assets (default all).
        records: Training records for the retrieval baseline; without them it is left out.
        library: baselines: a folder of assets to retrieve from (PartNet-Mobility's, any URDFs).
        pictures: procedural: how many objects are drawn (default 16).
        pred: layout: a folder of layouts <index>.json instead of a checkpoint's.
        cache: layout ROOT: where the assets' pictures are kept for the next run (default
          OUT/objects).
        unseen: The families that are never trained on, instead of the trained ones.
        families: layout, procedural: these families of objects, in turn (docs/data.md).
        first_seed: layout, procedural: of the first object, in place of 1,000,000. To choose
          weights or rules by, give one from 900,000 on: validation objects, which nothing is
          trained on either.
        backgrounds: layout: each object in front of a random background, cut out of it as a
          photograph is.
        processes: Worker processes beside the networks' own (default: one a core, at most 8).
        engines: physics: MuJoCo and, where it is installed, PyBullet by default.
        allow_outside: Let assets name files outside their own folders. PRED REF: also follow links
          that lead out of them.
        front: PRED REF, --library: which way predictions or assets face (default -x), as prepare's.
        ref_front: PRED REF: the same of references.
    """
    for name, value in (("count", count), ("processes", processes)):
        if value is not None and value < 1:
            raise ValueError(f"evaluate: --{name} must be at least 1, got {value}")
    if out.exists() and not out.is_dir():
        raise ValueError(f"output '{out}': a file of that name exists; choose another --out")
    workers = processes or min(os.cpu_count() or 1, 8)
    if what not in OWN:
        _refuse(
            "PRED REF",
            checkpoint=checkpoint,
            count=count,
            records=records,
            library=library,
            pictures=pictures,
            pred=pred,
            cache=cache,
            unseen=unseen,
            families=families,
            first_seed=first_seed,
            backgrounds=backgrounds,
            engines=engines,
        )
        _compare(
            Path(what),
            root,
            out,
            samples=samples or "mean",
            only=only,
            openshape=openshape,
            processes=workers,
            allow_outside=allow_outside,
            front=front or "-x",
            ref_front=ref_front or "-x",
        )
        return
    _refuse(what, samples=samples, only=only, ref_front=ref_front)
    if unseen:
        _refuse(f"{what} --unseen", families=families)
    if families:
        from uniart_jax.procedural import check_families

        check_families(families)
    if what != "baselines":
        _refuse(what, library=library)
    if library is None:
        _refuse(what, front=front)
    if what == "layout":
        _refuse(what, records=records, pictures=pictures, openshape=openshape, engines=engines)
        if root is None:
            _refuse(what, allow_outside=allow_outside, cache=cache)
        else:
            _refuse(f"{what} ROOT", unseen=unseen, families=families, first_seed=first_seed)
        from uniart_jax.evaluation.layout import evaluate_layout

        evaluate_layout(
            checkpoint or "nano", out, root=root, count=count, unseen=unseen, families=families,
            pred=pred, cache=cache, allow_outside=allow_outside, processes=workers,
            backgrounds=backgrounds, first_seed=first_seed,
        )  # fmt: skip
        return
    _refuse(what, pred=pred, cache=cache, backgrounds=backgrounds)
    if what != "procedural":
        _refuse(what, families=families, first_seed=first_seed)
    if what == "baselines":
        _refuse(what, pictures=pictures, engines=engines)
        if library is None:
            _refuse(f"{what} without --library", allow_outside=allow_outside)
        if root is not None:
            raise ValueError(
                "evaluate baselines: it takes no folder; REF are held-out procedural objects"
            )
        from uniart_jax.evaluation.baselines import evaluate_baselines
        from uniart_jax.evaluation.library import find_assets
        from uniart_jax.runtime.compilation_cache import enable_compilation_cache

        assets = []
        if library is not None:
            assets = find_assets(library, front=front or "-x", allow_outside=allow_outside)
        enable_compilation_cache()
        evaluate_baselines(
            checkpoint or "nano",
            out,
            records=records,
            library=assets,
            count=count or 128,
            unseen=unseen,
            openshape=openshape,
            processes=workers,
        )
        return
    _refuse(what, openshape=openshape)
    if what == "physics":
        if records is not None or (root is not None and unseen):
            raise ValueError(
                "evaluate physics: it takes no --records, and no --unseen with a folder of assets"
            )
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
            raise ValueError(
                "evaluate: a folder of assets goes with 'representation' or 'physics'; it has no "
                "images"
            )
        from uniart_jax.evaluation.assets import evaluate_assets

        evaluate_assets(root, out, count=count, processes=workers, allow_outside=allow_outside)
        return
    from uniart_jax.evaluation import procedural
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

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
            pictures=16 if pictures is None else pictures,
            families=families,
            first_seed=first_seed,
            **share,
        )


def _refuse(what: str, **options: Any) -> None:
    """Options that belong to the other uses of the command."""
    for name, value in options.items():
        if value:
            raise ValueError(f"evaluate {what}: it takes no --{name.replace('_', '-')}")


def _compare(predictions: Path, references: Path | None, out: Path, **options: Any) -> None:
    if references is None:
        kinds = ", ".join(OWN)
        why = "give the references too: uniart evaluate PRED REF --out DIR"
        if not predictions.exists():
            why = f"no such folder, and none of {kinds}"
        raise ValueError(f"evaluate '{predictions}': {why}")
    from uniart_jax.evaluation.compare import compare

    name = predictions.resolve().name or "predictions"
    compare({name: predictions}, references, out, **options)
