"""``uniart reconstruct | convert | evaluate``: assets and checkpoints that exist already."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from uniart_jax.cli.arguments import Out, Overwrite, check_out


def reconstruct(
    asset: Annotated[Path, tyro.conf.Positional],
    /,
    out: Out,
    resolution: int = 32,
    subdivisions: int = 4,
    allow_outside: bool = False,
    overwrite: Overwrite = False,
) -> None:
    """Object -> voxels -> object without any network: what the representation itself can hold.

    Args:
        asset: A URDF file, or a folder with one.
        resolution: Voxels a side.
        subdivisions: Sub-cells a voxel side.
        allow_outside: Let the URDF name meshes outside its own folder.
    """
    check_out(out, overwrite, (asset,))
    if not 1 <= resolution <= 256 or not 1 <= subdivisions <= 8:
        raise ValueError(
            f"reconstruct: --resolution must be in 1..256 and --subdivisions in 1..8, got {resolution}, {subdivisions}"
        )
    from uniart_jax.evaluation.reconstruction import reconstruct_asset

    reconstruct_asset(
        asset, out, resolution, subdivisions, allow_outside=allow_outside, overwrite=overwrite
    )


def evaluate(
    what: Annotated[Literal["procedural", "representation"], tyro.conf.Positional],
    root: Annotated[Path | None, tyro.conf.Positional] = None,
    /,
    *,
    out: Out,
    checkpoint: str = "nano",
    count: int | None = None,
    records: Path | None = None,
    pictures: int = 16,
    unseen: bool = False,
    processes: int | None = None,
    allow_outside: bool = False,
) -> None:
    """Measure a checkpoint on held-out procedural objects (or the representation alone) and write a table and pictures.

    Args:
        what: "procedural": image to object. "representation": truth to voxels to object, no network.
        root: representation: a folder of assets, measured at 32 and 64 voxels a side, instead of procedural objects.
        checkpoint: As for sample.py.
        count: Held-out objects, seeds from 1,000,000 on (default 128), or assets (default all).
        records: Training records for the retrieval baseline; without them it is left out.
        pictures: How many objects are drawn.
        unseen: The families that are never trained on, instead of the trained ones.
        processes: Worker processes beside the networks' own (default: one a core, at most 8).
        allow_outside: representation: let assets name files outside their own folders.
    """
    for name, value in (("count", count), ("processes", processes)):
        if value is not None and value < 1:
            raise ValueError(f"evaluate: --{name} must be at least 1, got {value}")
    if out.exists() and not out.is_dir():
        raise ValueError(f"output '{out}': a file of that name exists; choose another --out")
    workers = processes or min(os.cpu_count() or 1, 8)
    if root is not None:
        if what != "representation":
            raise ValueError("evaluate: a folder of assets goes with 'representation'; it has no images")  # fmt: skip
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
            checkpoint, out, count=count or 128, records=records, pictures=pictures, **share
        )


def convert(
    kind: Annotated[Literal["trellis", "dinov2"], tyro.conf.Positional],
    path: Annotated[Path, tyro.conf.Positional],
    /,
    out: Annotated[Path, tyro.conf.arg(help="Folder to write; 'dinov2': the file, or its folder.")],
    overwrite: Overwrite = False,
) -> None:
    """Make a checkpoint of published weights, to sample with or to train on from. Nothing is downloaded and nothing unpickled.

    Args:
        kind: "trellis": a folder with <name>.json and <name>.safetensors, or with them in ckpts. "dinov2": a file of dinov2_vit{s,b,l}14_reg.
        path: The folder or file.
    """
    from uniart_jax.conversion import convert_dinov2_file, convert_trellis_folder

    (convert_trellis_folder if kind == "trellis" else convert_dinov2_file)(path, out, overwrite)
