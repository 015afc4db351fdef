"""``view.html``: an asset in one file that any browser opens from disk, without a network.

The page holds everything: joints and collision shapes (JSON), the GLB and three.js
(``page_files/three.min.js``, made by ``tools/page_bundle``), both gzip in base64. Its policy (CSP)
lets nothing but its own two scripts run and nothing be fetched, whatever a part is called.
"""

from __future__ import annotations

import base64
import dataclasses
import gzip
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from uniart_jax.export.frames import moves
from uniart_jax.export.html_page import content_hash, fill
from uniart_jax.export.physics import Box, Shape
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.visual.render import FRONT_LEFT, PART_COLORS

SCRIPTS = ("model.js", "symbols.js", "stage.js", "panel.js")
DIGITS = 7  # significant ones of collision shapes
ON_AXIS = (
    0.15  # of its own radius: a part whose centre is nearer to the axis has no side that swings
)


def write_page(
    obj: ArticulatedObject, glb: Path, shapes: Sequence[Sequence[Shape]], path: Path
) -> Path:
    """Write the page.

    Args:
      obj: tree, joints and scale.
      glb: the object's GLB (``export.glb.write_glb``), taken in as it is, compressed.
      shapes: [K] collision shapes of each part, metres, object frame at the shown state.
      path: the .html file.

    Raises:
      ValueError: not shapes for each part.
    """
    if len(shapes) != len(obj.parts):
        raise ValueError(f"write_page: shapes of {len(shapes)} parts for {len(obj.parts)} parts")
    files = resources.files("uniart_jax.export") / "page_files"
    read = {f.name: f.read_text("utf-8") for f in files.iterdir() if f.is_file()}
    body = "\n".join(read[name] for name in SCRIPTS)
    page = f'\n(() => {{\n"use strict";\n{body}}})();\n'
    content = {
        "policy": _policy([read["three.min.js"], page], read["page.css"]),
        "style": read["page.css"],
        "asset": _json(page_data(obj, shapes)),
        "glb": _packed(glb.read_bytes()),
        "licence": "three.js: " + read["THREE_LICENSE.txt"].strip(),
        "three": _packed(read["three.min.js"].encode()),
        "page": page,
    }
    text = fill(read["template.html"], content)
    path.write_text(text, encoding="utf-8", newline="\n")  # the hashes are of "\n"
    return path


def page_data(obj: ArticulatedObject, shapes: Sequence[Sequence[Shape]]) -> dict:
    """What the page knows besides the meshes, as plain JSON values in metres and radians, object
    frame at the shown state.

    A moving part's joint has, besides what the GLB's extras hold, its coordinates at ``rest`` and
    ``open``, and where its symbol is drawn (``JointSymbol``).
    """
    rest, opened = obj.rest(), obj.open()
    parts = []
    for k, part in enumerate(obj.parts):
        joint = None
        if moves(part):
            unit = 1.0 if part.joint.rotates else obj.scale
            pitch_unit = obj.scale if part.joint.rotates else 1.0
            symbol = joint_symbol(part, float(opened[k] - rest[k]))
            joint = {
                "type": part.joint.type,
                "origin": _floats(part.joint.origin * obj.scale),
                "direction": _floats(part.joint.direction),
                "limits": _floats(np.array(part.joint.limits) * unit),
                "pitch": float(part.joint.pitch * pitch_unit),
                "rest": float(rest[k] * unit),
                "open": float(opened[k] * unit),
                "anchor": _floats(symbol.anchor * obj.scale),
                "reach": float(symbol.reach * obj.scale),
            }
        color = part_color(k)
        parts.append({"name": part.name, "parent": part.parent, "color": color, "joint": joint})
    return {
        "name": obj.name or "Articulated object",
        "size": _floats((obj.bounds[1] - obj.bounds[0]) * obj.scale),
        "view": {
            "from": _floats(FRONT_LEFT.position / FRONT_LEFT.distance),
            "fov": FRONT_LEFT.fov_degrees,
        },
        "parts": parts,
        "bodies": [[_shape(shape) for shape in of_part] for of_part in shapes],
    }


def part_color(k: int) -> str:
    """The plain colour of part ``k`` in every picture, as "#rrggbb" (sRGB)."""
    return "#" + bytes(np.round(PART_COLORS[k % len(PART_COLORS)] * 255).astype(np.uint8)).hex()


@dataclasses.dataclass(frozen=True)
class JointSymbol:
    """Where a joint's motion is drawn.

    Attributes:
      anchor: [3] a point of the part, object frame at the shown state: its way from limit to limit
        is the symbol's arc or segment.
      reach: half the part's length along the joint's direction; an axis is drawn so far to both
        sides, and a little beyond.
    """

    anchor: np.ndarray
    reach: float


def joint_symbol(part: Part, opening: float) -> JointSymbol:
    """The symbol of a moving part, in the units of its mesh.

    The anchor of a sliding part is in the middle of the side that goes first when it opens
    (``opening``: open minus rest). That of a turning part is level with its centre, out on the side
    where it lies; if it lies about the axis (a wheel, a knob), just outside it.
    """
    joint, center, size = part.joint, part.box[:3], part.box[3:]
    d = joint.direction
    reach = 0.5 * float(np.abs(d) @ size)
    if not joint.rotates:
        return JointSymbol(center + d * np.copysign(reach, opening), reach)
    foot = joint.origin + d * float(d @ (center - joint.origin))
    out = center - foot
    away = np.asarray(part.mesh.vertices) - joint.origin
    radius = float(np.linalg.norm(away - np.outer(away @ d, d), axis=1).max())
    distance = float(np.linalg.norm(out))
    if distance > ON_AXIS * radius:
        return JointSymbol(foot + out / distance * (0.5 * (distance + radius)), reach)
    side = np.cross(d, [0.0, 0.0, 1.0] if abs(d[2]) < 0.9 else [0.0, 1.0, 0.0])
    return JointSymbol(foot + side / np.linalg.norm(side) * (1.15 * radius), reach)


def _shape(shape: Shape) -> dict:
    if isinstance(shape, Box):
        return {
            "center": _short(shape.center),
            "size": _short(shape.size),
            "rotation": np.asarray(shape.rotation, dtype=float).tolist(),
        }
    return {
        "vertices": _short(shape.mesh.vertices),
        "faces": np.asarray(shape.mesh.faces).ravel().tolist(),
    }


def _floats(values) -> list[float]:
    return [float(v) for v in values]


def _short(values) -> list[float]:
    return [float(f"{v:.{DIGITS}g}") for v in np.asarray(values, dtype=float).ravel().tolist()]


def _json(data: dict) -> str:
    """JSON that can stand inside a <script> element: no character of it can end the element or
    begin a comment."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, mtime=0)).decode("ascii")


def _policy(scripts: Sequence[str], style: str) -> str:
    """Nothing runs but the given scripts, nothing is fetched but what the page itself holds (the
    GLB's textures are blobs)."""
    script_hashes = " ".join(map(content_hash, scripts))
    return (
        f"default-src 'none'; script-src {script_hashes}; style-src {content_hash(style)}; "
        "img-src data: blob:; connect-src blob:; base-uri 'none'; form-action 'none'"
    )
