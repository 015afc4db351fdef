"""What a prepared folder holds, for people: ``data-card.md`` and ``contact-sheet.png``."""

from __future__ import annotations

import collections
import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from uniart_jax.data.folder import Settings
from uniart_jax.data.records import RecordSource
from uniart_jax.data.sources import entry_of, load_entry
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.runtime.files import complete, write_text
from uniart_jax.visual.diagram import picture
from uniart_jax.visual.render import Camera, fit
from uniart_jax.voxels.joint_code import decode_joint

MEASURED = 500  # records read for the ranges of the card
SHEET_OBJECTS = 24
SHEET_COLUMNS = 6
TILE = 160
CAPTION = 14
KINDS = 20  # of repairs and of errors that are listed

Rows = Sequence[dict[str, str]]


def write_data_card(folder: str | Path, rows: Rows) -> Path:
    """Write ``data-card.md``: ``data_card`` of a prepared folder, complete."""
    path = Path(folder) / "data-card.md"
    write_text(path, data_card(folder, rows) + "\n")
    return path


def data_card(folder: str | Path, rows: Rows) -> str:
    """Counts per category, split and joint type, refused share, voxel percentiles, ranges, repairs
    and errors by kind, as Markdown.

    Args:
      folder: a prepared folder.
      rows: its manifest.
    """
    folder = Path(folder)
    good = [row for row in rows if not row["error"]]
    failed = [row for row in rows if row["error"]]
    joints = [_joints(row) for row in good]
    refused = sum(int(row["refused"]) for row in rows)
    draws = len(good) + refused
    objects = {row["object"] for row in rows}
    lost = {row["object"] for row in failed}
    lines = [
        "# Data card",
        "",
        f"{len(good)} records of {len(objects)} objects; {len(lost)} objects failed at least once; "
        f"{refused} of {draws} drawn states refused ({refused / max(draws, 1):.1%}).",
        "Records by split: " + _counts(row["split"] for row in good) + ".",
        "",
        "| category | records | failed | parts, mean | voxels, mean | joints |",
        "|---|---|---|---|---|---|",
    ]
    for category in dict.fromkeys(row["category"] for row in rows):
        mine = [row for row in good if row["category"] == category]
        bad = sum(row["category"] == category for row in failed)
        total = sum((_joints(row) for row in mine), collections.Counter())
        parts = np.mean([int(row["parts"]) for row in mine]) if mine else math.nan
        voxels = np.mean([int(row["voxels"]) for row in mine]) if mine else math.nan
        kinds = ", ".join(f"{name} {n}" for name, n in sorted(total.items()))
        lines.append(
            f"| {category or '-'} | {len(mine)} | {bad} | {parts:.1f} | {voxels:.0f} | {kinds} |"
        )
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
    repaired: dict[str, set[str]] = collections.defaultdict(set)
    for row in rows:
        for repair in filter(None, row["repairs"].split(" | ")):
            repaired[_kind(repair)].add(row["object"])
    if repaired:
        lines += ["", "| repair | objects |", "|---|---|"]
        by_count = sorted(repaired.items(), key=lambda item: (-len(item[1]), item[0]))
        lines += [f"| {kind} | {len(names)} |" for kind, names in by_count[:KINDS]]
    if failed:
        lines += ["", "| error | records |", "|---|---|"]
        lines += [f"| {kind} | {n} |" for kind, n in error_kinds(failed)[:KINDS]]
    return "\n".join(lines)


def error_kinds(rows: Rows) -> list[tuple[str, int]]:
    """Errors without names and numbers, the most frequent first."""
    return collections.Counter(_kind(row["error"]) for row in rows if row["error"]).most_common()


def _kind(line: str) -> str:
    line = re.sub(r"^\S*[/\\]\S*: ", "", line)  # the file
    line = re.sub(r"'[^']*'(, '[^']*')*", "'...'", line)
    return re.sub(r"(?<!\w)-?\d[\d.,]*(?!\w)", "#", line).replace("|", "/")


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


def write_contact_sheet(folder: str | Path, rows: Rows, settings: Settings) -> Path | None:
    """Write ``contact-sheet.png``: objects of all categories in turn, at rest, and open with every
    part in its own colour and the joints' axes drawn.

    The objects are made again from their sources; one that cannot be is left out. None where there
    is none.
    """
    groups: dict[str, dict[str, dict[str, str]]] = collections.defaultdict(dict)
    for row in rows:
        if not row["error"]:
            groups[row["category"]].setdefault(row["object"], row)
    turns = itertools.zip_longest(*(each.values() for each in groups.values()))
    tiles = []
    for row in itertools.islice(filter(None, itertools.chain(*turns)), SHEET_OBJECTS):
        try:
            obj = load_entry(entry_of(row, settings), settings)
            tiles.append(_tile(obj.normalized(), row["category"] or row["object"]))
        except Exception:
            continue
    if not tiles:
        return None
    width, height = tiles[0].size
    columns = min(SHEET_COLUMNS, len(tiles))
    lines = -(-len(tiles) // columns)
    sheet = Image.new("RGB", (columns * width, lines * height), "white")
    for i, tile in enumerate(tiles):
        sheet.paste(tile, (i % columns * width, i // columns * height))
    path = Path(folder) / "contact-sheet.png"
    with complete(path) as temporary:
        sheet.save(temporary, format="png")
    return path


def _tile(obj: ArticulatedObject, title: str) -> Image.Image:
    rest, opened = obj.rest(), obj.open()
    camera = Camera(np.deg2rad(-30), np.deg2rad(20), 35.0, 2.5)
    tile = Image.new("RGB", (2 * TILE, TILE + CAPTION), "white")
    corners = np.stack([obj.mesh(q).bounds for q in (rest, opened)])
    camera = fit(np.stack([corners[:, 0].min(0), corners[:, 1].max(0)]), camera)
    tile.paste(picture(obj, camera, TILE, rest), (0, CAPTION))
    tile.paste(picture(obj, camera, TILE, opened, parts=True, axes=True), (TILE, CAPTION))
    ImageDraw.Draw(tile).text((4, 1), title[:40], fill="black")
    return tile
