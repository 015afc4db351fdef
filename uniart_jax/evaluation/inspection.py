"""One training record as a picture: what networks see of it, what its voxels say, and every joint
by name and number."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from uniart_jax.data.records import Record
from uniart_jax.evaluation.reconstruction import object_of_record
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.diagram import over, picture
from uniart_jax.visual.render import PART_COLORS, Camera, fit
from uniart_jax.voxels.joint_code import decode_joint

TILE = 256
LINE = 18
VIEWS = 4  # stored views that are drawn
INK = (40, 42, 50)


def recorded_joints(record: Record) -> list[Joint]:
    """[K] joints that a record's codes say, of each part to its parent."""
    return [decode_joint(c, b[:3]) for c, b in zip(record.codes, record.boxes, strict=True)]


def describe(joint: Joint) -> str:
    """A joint's kind, axis and limits for people: degrees and object units."""
    if joint.type == "fixed":
        return "fixed"
    spans = []
    if joint.rotates:
        spans.append("{:.0f}..{:.0f} deg".format(*np.rad2deg(joint.angle)))
    if joint.travels:
        spans.append("{:.3f}..{:.3f}".format(*joint.travel))
    axis = " ".join(f"{x:+.2f}" for x in joint.direction)
    return f"{joint.type:<10} axis ({axis}) {', '.join(spans)}"


def part_lines(record: Record) -> list[str]:
    """One line a part: number, parent, share of the voxels, joint."""
    share = np.bincount(record.voxel_part, minlength=len(record.boxes)) / len(record.voxel_part)
    lines = []
    for k, joint in enumerate(recorded_joints(record)):
        parent = "root" if record.parents[k] == k else f"on {record.parents[k]}"
        lines.append(f"{k:>3} {parent:<6} {share[k]:>5.1%}  {describe(joint)}")
    return lines


def draw_record(record: Record, obj: ArticulatedObject | None = None) -> Image.Image:
    """Views in the first row; shown, rest and open states with axes in the second; the parts in
    their colours below.

    Args:
      obj: the record's object, if it is assembled already.
    """
    obj = object_of_record(record) if obj is None else obj
    views = [over(np.asarray(view, np.float32) / 255) for view in record.images[:VIEWS]]
    states = {"shown": obj.coordinates(None), "rest": obj.rest(), "open": obj.open()}
    bounds = [obj.mesh(q).bounds for q in states.values()]
    corners = np.stack([np.min(bounds, 0)[0], np.max(bounds, 0)[1]])
    camera = fit(corners, Camera(np.deg2rad(-30), np.deg2rad(20), 35.0, 2.5))
    tiles = {
        name: picture(obj, camera, TILE, q, parts=True, axes=True) for name, q in states.items()
    }
    lines = part_lines(record)
    width = TILE * max(len(views), len(tiles))
    sheet = Image.new("RGB", (width, 2 * (TILE + LINE) + LINE * (len(lines) + 2)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=13)
    title = (
        f"{record.meta.get('id', '')}: {len(record.coords)} voxels at {record.resolution}, "
        f"{len(lines)} parts"
    )
    draw.text((6, 2), title, fill=INK, font=font)
    for i, view in enumerate(views):
        sheet.paste(view.resize((TILE, TILE), Image.Resampling.BICUBIC), (i * TILE, LINE))
    top = TILE + LINE
    for i, (name, tile) in enumerate(tiles.items()):
        sheet.paste(tile, (i * TILE, top + LINE))
        draw.text((i * TILE + 6, top + 2), name, fill=INK, font=font)
    top += TILE + LINE + LINE // 2
    for k, line in enumerate(lines):
        color = tuple(int(255 * c) for c in PART_COLORS[k % len(PART_COLORS)])
        draw.rectangle((8, top + k * LINE + 3, 20, top + k * LINE + 14), fill=color)
        draw.text((26, top + k * LINE), line, fill=INK, font=font)
    return sheet
