"""``report.json``: what an asset holds, for people and scripts. Metres, kilograms, radians, object frame at the shown state."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import uniart_jax
from uniart_jax.export.frames import joint_name
from uniart_jax.export.handles import Handle, handles
from uniart_jax.export.physics import Body
from uniart_jax.objects.object import ArticulatedObject


def make_report(
    obj: ArticulatedObject,
    bodies: Sequence[Body],
    watertight: Sequence[bool],
    seed: int | None = None,
    checkpoint: str = "",
    notes: Sequence[str] = (),
) -> dict:
    """The report (docs/architecture.md, "What a user types") as plain JSON values.

    Args:
      obj: the object, in object units.
      bodies, watertight: [K] of the exported parts.
      seed, checkpoint: what made the object; None and "" if it was not sampled.
      notes: what a written format cannot say, a line each; the object's own provenance stands before them.

    ``handle`` of a moving part: the ``point`` to hold, on ``part``; ``opens``: whether its
    coordinate grows (1) or falls (-1) on the way; ``start_force`` newtons there start it. ``rest``
    maps every moving joint, by its name in the URDF, to its coordinate at rest. ``validation`` is
    absent until a physics engine has run.
    """
    parts = []
    held = handles(obj)
    for part, body, closed, handle in zip(obj.parts, bodies, watertight, held, strict=True):
        joint = None if part.parent < 0 else part.joint
        parts.append(
            {
                "name": part.name,
                "parent": None if joint is None else obj.parts[part.parent].name,
                "type": None if joint is None else joint.type,
                "origin": None if joint is None else [float(x * obj.scale) for x in joint.origin],
                "direction": None if joint is None else [float(x) for x in joint.direction],
                "angle": None if joint is None else list(joint.angle),
                "travel": None if joint is None else [t * obj.scale for t in joint.travel],
                "mass": float(body.mass),
                "watertight": bool(closed),
                "shapes": len(body.shapes),
                "volume_error": body.volume_error,
                "handle": None if handle is None else _handle(obj, handle, body),
            }
        )
    rest = {}
    for part, q in zip(obj.parts, obj.rest(), strict=True):
        if part.parent >= 0 and part.joint.type != "fixed":
            rest[joint_name(part)] = float(q if part.joint.rotates else q * obj.scale)
    return {
        "category": obj.category,
        "parts": parts,
        "rest": rest,
        "notes": [*obj.provenance, *notes],
        "scale": float(obj.scale),
        "seed": seed,
        "checkpoint": checkpoint,
        "version": uniart_jax.__version__,
    }


def _handle(obj: ArticulatedObject, handle: Handle, body: Body) -> dict:
    """Where a hand holds a moving part, how it opens it and what that takes."""
    found = {
        "part": obj.parts[handle.part].name,
        "point": [float(x * obj.scale) for x in handle.point],
        "opens": handle.opens,
    }
    dynamics = body.dynamics
    if dynamics is None or dynamics.start is None:
        return found
    holds = "friction"
    if dynamics.stiffness:
        alone = "nothing: it falls" if dynamics.falls else "friction"
        holds = f"a spring in MJCF and USD; {alone} in URDF"
    elif dynamics.falls:
        holds = "nothing: it falls"
    return found | {
        "start_force": float(dynamics.start),
        "friction": float(dynamics.friction),
        "friction_urdf": float(dynamics.alone),
        "held_by": holds,
    }


def write_report(report: dict, path: Path) -> Path:
    """Write a report as indented JSON (no NaN or infinity)."""
    path.write_text(json.dumps(report, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return path
