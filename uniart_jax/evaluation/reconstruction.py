"""Object -> voxels -> object without any network: the representation's own ceiling."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

from uniart_jax.data.records import Record
from uniart_jax.evaluation.geometry import object_chamfer, part_iou
from uniart_jax.evaluation.parts import compare_parts, summarize
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.runtime.progress import messages
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.voxelize import voxelize


def reconstruct(
    obj: ArticulatedObject, resolution: int = 32, subdivisions: int = 4
) -> ArticulatedObject:
    """A normalised object through the voxels and back; scale and name kept.

    Raises:
      ValueError: two parts have the same box, or a part cannot be voxelised (``voxels``).
    """
    grid = voxelize(obj, resolution, subdivisions).gather()
    return assemble(grid, scale=obj.scale, name=obj.name)


def object_of_record(record: Record) -> ArticulatedObject:
    """The object that a training record stands for, assembled from its voxels."""
    scale = float(record.meta.get("scale", 1.0))
    return assemble(record.grid().gather(), scale=scale, name=str(record.meta.get("category", "")))


def score_reconstruction(obj: ArticulatedObject, copy: ArticulatedObject) -> dict[str, float]:
    """Chamfer distances at the shown and the open state, part overlap, and the part-level scores of
    ``copy`` against ``obj``."""
    scores = compare_parts(copy, obj)
    overlap = part_iou(copy, obj)
    return {
        "chamfer": object_chamfer(copy, obj),
        "chamfer_open": object_chamfer(copy, obj, copy.open(), obj.open()),
        "part_iou": float(overlap.mean()),
        "part_iou_worst": float(overlap.min()),
        **summarize([scores]),
    }


def reconstruct_asset(
    asset: Path,
    out: Path,
    resolution: int,
    subdivisions: int,
    *,
    allow_outside: bool = False,
    overwrite: bool = False,
) -> dict[str, float]:
    """``uniart reconstruct``: read an asset, send it through the voxels, write the copy and how far
    it is from the source.

    Writes the asset folder ``out`` with ``reconstruction.json`` in it, and prints one line a
    figure.
    """
    console = messages()
    with console.status(f"reading {asset}") as status:
        source = load_object(asset, allow_outside=allow_outside)
        obj = source.normalized()
        for line in obj.provenance:
            console.print(f"repaired: {line}", highlight=False)
        status.update(f"voxels at {resolution} x {subdivisions}")
        copy = reconstruct(obj, resolution, subdivisions)
        status.update("measuring")
        figures = score_reconstruction(obj, copy)
        status.update(f"writing {out}")
        copy = dataclasses.replace(copy, provenance=obj.provenance + copy.provenance)
        folder = copy.save(out, overwrite=overwrite)
        finite = {k: v if math.isfinite(v) else None for k, v in figures.items()}
        (folder / "reconstruction.json").write_text(json.dumps(finite, indent=2) + "\n")
    moving = "nothing moves"
    if figures["moving_parts"]:
        moving = f"parts right {figures['parts_right']:.2f}"
        if math.isfinite(figures["axis_median"]):  # NaN where no joint was found
            moving += f", axis {figures['axis_median']:.3f} deg"
    console.print(
        f"{len(obj.parts)} parts in, {len(copy.parts)} out; {moving}, Chamfer "
        f"{figures['chamfer']:.4f} (open {figures['chamfer_open']:.4f}), part IoU "
        f"{figures['part_iou']:.3f} -> {folder}",
        highlight=False,
    )
    return figures
