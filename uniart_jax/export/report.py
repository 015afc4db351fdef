"""``report.json``: what an asset holds, for people and scripts.

Metres, kilograms, radians, in the frame of the files.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import uniart_jax
from uniart_jax.export.frames import joint_chain, joint_name, metric, moves
from uniart_jax.export.handles import Handle, handles, opening
from uniart_jax.export.physics import Body, Dynamics
from uniart_jax.objects.object import ArticulatedObject, Part


@dataclasses.dataclass(frozen=True)
class AsRead:
    """What an object was before it was placed for its files.

    Attributes:
      obj: with the names that are written, at its shown state.
      names: [K] that its parts had.
      shown: [K] the state that was shown, in written coordinates, object units.
    """

    obj: ArticulatedObject
    names: tuple[str, ...]
    shown: np.ndarray


def make_report(
    obj: ArticulatedObject,
    bodies: Sequence[Body],
    watertight: Sequence[bool],
    seed: int | None = None,
    checkpoint: str = "",
    notes: Sequence[str] = (),
    read: AsRead | None = None,
) -> dict:
    """The report (docs/files.md, "An asset on disk") as plain JSON values.

    Args:
      obj: the object as it is written, in object units.
      bodies, watertight: [K] of the exported parts.
      seed, checkpoint: what made the object; None and "" if it was not sampled.
      notes: what a written format cannot say, a line each; the object's own provenance stands
        before them.
      read: what was read, or sampled; default: the same as ``obj``.

    ``handle`` of a moving part: the ``point`` to hold, on ``part``; ``opens``: whether its
    coordinate grows (1) or falls (-1) on the way; ``opening``: the direction in which the point
    sets out; ``start_force`` newtons there start it, against ``friction`` and with ``damping``.
    ``rest`` maps every moving joint, by its name in the URDF, to its coordinate at rest, ``shown``
    to that of the state that was read. ``as_read`` is the part's name and joint in the object's own
    frame at that state. ``from_voxels``: whether the surfaces were found on voxels; ``load_object``
    reads it again. ``validation`` is absent until a physics engine has run.
    """
    if read is None:
        read = AsRead(obj, tuple(part.name for part in obj.parts), np.zeros(len(obj.parts)))
    parts = []
    held = handles(obj)
    for k, (part, body, closed, handle) in enumerate(
        zip(obj.parts, bodies, watertight, held, strict=True)
    ):
        source = read.obj.parts[k]
        parts.append(
            {
                "name": part.name,
                "parent": None if part.parent < 0 else obj.parts[part.parent].name,
                "type": None if part.parent < 0 else part.joint.type,
                **_joint(part, obj.scale),
                "further_joints": [
                    {
                        "name": link.name,
                        "type": link.part.joint.type,
                        **_joint(link.part, obj.scale),
                        **_resistance(link.dynamics),
                    }
                    for link in (joint_chain(part, body) if moves(part) else ())
                    if not link.first
                ],
                "as_read": {"name": read.names[k], **_joint(source, read.obj.scale)},
                "mass": float(body.mass),
                "watertight": bool(closed),
                "shapes": len(body.shapes),
                "volume_error": body.volume_error,
                "handle": None if handle is None else _handle(obj, k, handle, body),
            }
        )
    return {
        "category": obj.category,
        "from_voxels": obj.from_voxels,
        "parts": parts,
        "rest": _state(obj, obj.rest()),
        "shown": _state(obj, read.shown),
        "notes": [*obj.provenance, *notes],
        "scale": float(obj.scale),
        "seed": seed,
        "checkpoint": checkpoint,
        "version": uniart_jax.__version__,
    }


def _joint(part: Part, scale: float) -> dict:
    """Axis and spans of a part's joint, metres and radians; null for the root."""
    if part.parent < 0:
        return dict.fromkeys(("origin", "direction", "angle", "travel"))
    joint = part.joint
    return {
        "origin": [float(x * scale) for x in joint.origin],
        "direction": [float(x) for x in joint.direction],
        "angle": list(joint.angle),
        "travel": [t * scale for t in joint.travel],
    }


def _state(obj: ArticulatedObject, q: np.ndarray) -> dict[str, float]:
    """Moving joint -> its coordinate in ``q`` [K] (object units), radians or metres."""
    values = zip(obj.parts, metric(obj, q), strict=True)
    return {joint_name(part): float(value) for part, value in values if moves(part)}


def _handle(obj: ArticulatedObject, k: int, handle: Handle, body: Body) -> dict:
    """Where a hand holds a moving part, how it opens it and what that takes."""
    found = {
        "part": obj.parts[handle.part].name,
        "point": [float(x * obj.scale) for x in handle.point],
        "opens": handle.opens,
        "opening": [float(x) for x in opening(obj, k, handle)],
    }
    dynamics = body.dynamics
    if dynamics is None or dynamics.start is None:
        return found
    alone = "nothing: it falls" if dynamics.falls else "friction"
    holds = alone
    if dynamics.stiffness:
        spring = (
            "a spring" if dynamics.friction >= dynamics.left else "a spring, not in every state"
        )
        holds = f"{spring} in MJCF and USD; {alone} in URDF"
    started = {"start_force": float(dynamics.start)}
    return found | started | _resistance(dynamics) | {"held_by": holds}


def _resistance(dynamics: Dynamics) -> dict[str, float]:
    """Friction (N m, N), also where a format has no springs, and damping (N m s / rad, N s / m)."""
    return {
        "friction": float(dynamics.friction),
        "friction_urdf": float(dynamics.alone),
        "damping": float(dynamics.damping),
    }


def write_report(report: dict, path: Path) -> Path:
    """Write a report as indented JSON (no NaN or infinity)."""
    path.write_text(json.dumps(report, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return path
