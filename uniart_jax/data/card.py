"""What a prepared folder holds, for people: ``data-card.md`` and ``contact-sheet.png``."""

from __future__ import annotations

import collections
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from uniart_jax.data.records import RecordSource
from uniart_jax.voxels.joint_code import decode_joint

MEASURED = 500  # records read for the ranges of the card
SHEET_OBJECTS = 24
SHEET_COLUMNS = 6
TILE = 128

Rows = Sequence[dict[str, str]]


def write_data_card(folder: str | Path, rows: Rows) -> Path:
    """Write ``data-card.md``: counts per family and joint type, refused share, voxel percentiles, ranges.

    Args:
      folder: a prepared folder, complete.
      rows: its manifest.
    """
    folder = Path(folder)
    good = [row for row in rows if not row["error"]]
    failed = [row for row in rows if row["error"]]
    joints = [_joints(row) for row in good]
    draws = len(good) + sum(int(row["refused"]) for row in rows)
    refused = sum(int(row["refused"]) for row in rows)
    lines = [
        "# Data card",
        "",
        f"{len(good)} records, {len(failed)} failed objects, "
        f"{refused} of {draws} drawn states refused ({refused / max(draws, 1):.1%}).",
        "Splits: " + _counts(row["split"] for row in good) + ".",
        "",
        "| family | records | failed | parts, mean | voxels, mean | joints |",
        "|---|---|---|---|---|---|",
    ]
    for family in dict.fromkeys(row["family"] for row in rows):
        mine = [row for row in good if row["family"] == family]
        bad = sum(row["family"] == family for row in failed)
        total = sum((_joints(row) for row in mine), collections.Counter())
        parts = np.mean([int(row["parts"]) for row in mine]) if mine else math.nan
        voxels = np.mean([int(row["voxels"]) for row in mine]) if mine else math.nan
        kinds = ", ".join(f"{name} {n}" for name, n in sorted(total.items()))
        lines.append(f"| {family} | {len(mine)} | {bad} | {parts:.1f} | {voxels:.0f} | {kinds} |")
    total = sum(joints, collections.Counter())
    lines += ["", "| joint type | joints | records with one |", "|---|---|---|"]
    lines += [
        f"| {name} | {n} | {sum(name in each for each in joints)} |"
        for name, n in sorted(total.items())
    ]
    if good:
        lines += [
            "",
            "| of records | 0 % | 10 % | 50 % | 90 % | 100 % |",
            "|---|---|---|---|---|---|",
        ]
        for name in ("voxels", "parts"):
            values = np.percentile([int(row[name]) for row in good], [0, 10, 50, 90, 100])
            lines.append(f"| {name} | " + " | ".join(f"{v:.0f}" for v in values) + " |")
        lines += ["", *_ranges(folder)]
    if failed:
        lines += ["", "Failures: " + _counts(row["error"] for row in failed) + "."]
    path = folder / "data-card.md"
    temporary = folder / ".data-card.md.tmp"
    temporary.write_text("\n".join(lines) + "\n")
    os.replace(temporary, path)
    return path


def _joints(row: dict[str, str]) -> collections.Counter:
    pairs = (item.split(":") for item in row["joints"].split())
    return collections.Counter({name: int(n) for name, n in pairs})


def _counts(names) -> str:
    return ", ".join(f"{name} {n}" for name, n in collections.Counter(names).most_common())


def _ranges(folder: Path) -> list[str]:
    """Table lines of joint spans and box sides over the first records, 5 to 95 %."""
    source = RecordSource(folder)
    spans: dict[str, list[float]] = collections.defaultdict(list)
    count = min(len(source), MEASURED)
    for index in range(count):
        record = source[index]
        spans["longest box side (units)"].extend(record.boxes[:, 3:].max(1))
        spans["shortest box side (units)"].extend(record.boxes[:, 3:].min(1))
        spans["parts with another's box within .05 (share)"].append(_near_boxes(record.boxes))
        for code, box in zip(record.codes, record.boxes, strict=True):
            joint = decode_joint(code, box[:3])
            if joint.rotates:
                spans[f"{joint.type} rotation (degrees)"].append(np.rad2deg(np.ptp(joint.angle)))
            if joint.travels:
                spans[f"{joint.type} travel (units)"].append(np.ptp(joint.travel))
    lines = [f"| over the first {count} records | 5 % | 50 % | 95 % |", "|---|---|---|---|"]
    for name, values in spans.items():
        low, middle, high = np.percentile(values, [5, 50, 95])
        lines.append(f"| {name} | {low:.3g} | {middle:.3g} | {high:.3g} |")
    return lines


def _near_boxes(boxes: np.ndarray) -> float:
    """Share of parts whose box lies within .05 of another part's: what makes segmentation hard."""
    corners = np.concatenate([boxes[:, :3] - boxes[:, 3:] / 2, boxes[:, :3] + boxes[:, 3:] / 2], 1)
    distance = np.abs(corners[:, None] - corners[None]).max(-1)
    np.fill_diagonal(distance, np.inf)
    return float((distance.min(1) < 0.05).mean()) if len(boxes) > 1 else 0.0


def write_contact_sheet(folder: str | Path, rows: Rows) -> Path | None:
    """Write ``contact-sheet.png``: the first objects at rest, each beside its open state with every part in its own colour.

    Objects are drawn again from the manifest's family and seed. None where every object failed.
    """
    from uniart_jax.procedural import generate
    from uniart_jax.render import Camera, fit, render

    folder = Path(folder)
    first = {(row["family"], int(row["seed"])): None for row in rows if not row["error"]}
    tiles = []
    for family, seed in list(first)[:SHEET_OBJECTS]:
        obj = generate(family, seed)
        views = []
        for q, part_colors in ((obj.rest(), False), (obj.open(), True)):
            shown = obj.shown_at(q).normalized()
            camera = fit(shown, Camera(np.deg2rad(-30), np.deg2rad(20), 35.0, 2.5))
            views.append(
                composite(render(shown, camera, size=TILE, part_colors=part_colors), background=1.0)
            )
        tiles.append(np.concatenate(views, axis=1))
    if not tiles:
        return None
    blank = np.ones_like(tiles[0])
    columns = min(SHEET_COLUMNS, len(tiles))
    tiles += [blank] * (-len(tiles) % columns)
    grid = [np.concatenate(tiles[i : i + columns], 1) for i in range(0, len(tiles), columns)]
    sheet = np.rint(np.concatenate(grid, 0) * 255).astype(np.uint8)
    path = folder / "contact-sheet.png"
    temporary = folder / ".contact-sheet.png"
    Image.fromarray(sheet).save(temporary)
    os.replace(temporary, path)
    return path


def composite(rgba: np.ndarray, background: float = 0.0) -> np.ndarray:
    """[..., 3] of straight-alpha [..., 4] in [0, 1] over a gray level, mixed in sRGB as image viewers do."""
    return rgba[..., :3] * rgba[..., 3:] + background * (1 - rgba[..., 3:])
