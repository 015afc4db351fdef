"""``uniart evaluate``: predictions against references, and figures of checkpoints, of the
representation, of assets in simulators."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import tyro

from uniart_jax.cli.arguments import Out, check_options

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
    ask: str | None = None,
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
        ask: layout: a command that asks a vision-language model, as of `uniart layout`; it is shown
          <index>.png, and its answers count instead of the checkpoint's layouts.
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
    asked = _given(dict(locals()))
    for name, value in (("count", count), ("processes", processes)):
        if value is not None and value < 1:
            raise ValueError(f"evaluate: --{name} must be at least 1, got {value}")
    if out.exists() and not out.is_dir():
        raise ValueError(f"output '{out}': a file of that name exists; choose another --out")
    use = what if what in OWN else "PRED REF"
    check_options("evaluate", use, asked, {name: one.takes for name, one in USES.items()})
    _check_folder(use, asked, library if use == "baselines" else root)
    if unseen and families:
        raise ValueError(f"evaluate {use} --unseen: it takes no --families")
    if families:
        from uniart_jax.procedural import check_families

        check_families(families)
    workers = processes or min(os.cpu_count() or 1, 8)
    if use == "PRED REF":
        _compare(Path(what), root, out, workers, **asked)
    else:
        USES[use].run(root, out, workers, **asked)


def _given(options: dict[str, Any]) -> dict[str, Any]:
    """Those of a command line's options that say anything, without what all uses take."""
    shared = ("what", "root", "out", "processes")
    return {
        name: value
        for name, value in options.items()
        if name not in shared and value is not None and value is not False and value != ()
    }


def _check_folder(use: str, asked: Collection[str], folder: Path | None) -> None:
    """Refuse options that go only with a folder of assets, or only without one."""
    name = "--library" if use == "baselines" else "ROOT"
    where, wrong = f"{use} {name}", USES[use].without_folder
    if folder is None:
        where, wrong = f"{use} without {name}", USES[use].with_folder
    for option in asked:
        if option in wrong:
            raise ValueError(f"evaluate {where}: it takes no --{option.replace('_', '-')}")


def _compare(
    predictions: Path, references: Path | None, out: Path, processes: int, **options: Any
) -> None:
    if references is None:
        kinds = ", ".join(OWN)
        why = "give the references too: uniart evaluate PRED REF --out DIR"
        if not predictions.exists():
            why = f"no such folder, and none of {kinds}"
        raise ValueError(f"evaluate '{predictions}': {why}")
    from uniart_jax.evaluation.compare import compare

    name = predictions.resolve().name or "predictions"
    compare({name: predictions}, references, out, processes=processes, **options)


def _baselines(
    root: Path | None,
    out: Path,
    processes: int,
    *,
    checkpoint: str = "nano",
    count: int = 128,
    records: Path | None = None,
    library: Path | None = None,
    unseen: bool = False,
    openshape: Path | None = None,
    front: Front = "-x",
    allow_outside: bool = False,
) -> None:
    if root is not None:
        raise ValueError(
            "evaluate baselines: it takes no folder; REF are held-out procedural objects"
        )
    from uniart_jax.evaluation.baselines import evaluate_baselines
    from uniart_jax.evaluation.library import find_assets
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    assets = []
    if library is not None:
        assets = find_assets(library, front=front, allow_outside=allow_outside)
    enable_compilation_cache()
    evaluate_baselines(
        checkpoint,
        out,
        records=records,
        library=assets,
        count=count,
        unseen=unseen,
        openshape=openshape,
        processes=processes,
    )


def _procedural(
    root: Path | None,
    out: Path,
    processes: int,
    *,
    checkpoint: str = "nano",
    **options: Any,
) -> None:
    if root is not None:
        raise ValueError(
            "evaluate: a folder of assets goes with 'representation' or 'physics'; it has no images"
        )
    from uniart_jax.evaluation.procedural import evaluate_checkpoint
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    enable_compilation_cache()
    evaluate_checkpoint(checkpoint, out, processes=processes, **options)


def _layout(
    root: Path | None, out: Path, processes: int, *, checkpoint: str = "nano", **options: Any
) -> None:
    from uniart_jax.evaluation.layout import evaluate_layout

    evaluate_layout(checkpoint, out, root=root, processes=processes, **options)


def _representation(
    root: Path | None, out: Path, processes: int, *, count: int | None = None, **options: Any
) -> None:
    if root is not None:
        from uniart_jax.evaluation.assets import evaluate_assets

        evaluate_assets(root, out, count=count, processes=processes, **options)
        return
    from uniart_jax.evaluation.procedural import evaluate_representation
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    enable_compilation_cache()
    evaluate_representation(out, count=count or 128, processes=processes, **options)


def _physics(root: Path | None, out: Path, processes: int, **options: Any) -> None:
    from uniart_jax.evaluation.physics import evaluate_physics

    evaluate_physics(out, root=root, processes=processes, **options)


class _Use(NamedTuple):
    """One use of the command.

    Attributes:
      run: (ROOT or REF, output folder, worker processes, **options that are given).
      takes: its options. with_folder: those of them that go only with a folder of assets (ROOT; of
        baselines --library). without_folder: those that go only without.
    """

    run: Callable[..., None]
    takes: tuple[str, ...]
    with_folder: tuple[str, ...] = ()
    without_folder: tuple[str, ...] = ()


HELD_OUT = ("unseen", "families", "first_seed")  # which held-out objects
USES = {
    "PRED REF": _Use(
        _compare, ("samples", "only", "openshape", "allow_outside", "front", "ref_front")
    ),
    "baselines": _Use(
        _baselines,
        (
            *("checkpoint", "count", "records", "unseen", "openshape"),
            *("library", "front", "allow_outside"),
        ),
        with_folder=("front", "allow_outside"),
    ),
    "procedural": _Use(_procedural, ("checkpoint", "count", "records", "pictures", *HELD_OUT)),
    "layout": _Use(
        _layout,
        ("checkpoint", "count", "pred", "ask", "backgrounds", "cache", "allow_outside", *HELD_OUT),
        with_folder=("cache", "allow_outside"),
        without_folder=HELD_OUT,
    ),
    "representation": _Use(
        _representation,
        ("count", "unseen", "allow_outside"),
        with_folder=("allow_outside",),
        without_folder=("unseen",),
    ),
    "physics": _Use(
        _physics,
        ("checkpoint", "count", "unseen", "engines", "allow_outside"),
        with_folder=("allow_outside",),
        without_folder=("unseen",),
    ),
}
OWN = [name for name in USES if name != "PRED REF"]
