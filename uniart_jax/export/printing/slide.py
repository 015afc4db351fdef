"""Slides that print: ribs on the child's flanks run in grooves of the parent, which end before it
falls out.

Frame inside this file: z is the way that opens, y the other horizontal direction, if there is one.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.export.printing.hinge import Around, Fit
from uniart_jax.export.printing.settings import PrintSettings, UnprintableError
from uniart_jax.export.printing.solids import block, box_of, grown, one_piece, turned, union
from uniart_jax.objects.kinematics import Joint

RIB = 3.0  # length along the slide without its ramp, and height across
RAMP = 2.0  # length
BITE = 1.0  # how far a rib stands in the parent's wall
ROOT = 0.8  # how deep a rib begins in the child
STOP = 2.0  # of the parent's wall that must stand before a rib's farthest place
FAR = 8.0  # widest gap between flank and wall that a rib bridges
SOUND = 0.7  # of the stop that must be there
LEAST = 0.4  # of the travel that must be left
WAYS = 16  # directions around the slide that are tried
PLACES = (0.0, -0.25, 0.25, -0.4, 0.4)  # across a flank, shares of its width


def fit_slide(
    parent: Manifold, child: Manifold, joint: Joint, around: Around, settings: PrintSettings
) -> Fit:
    """Ribs and grooves on opposite sides, as far as there are walls for them.

    Args:
      parent, child: clear of each other along the whole range, at rest.
      joint: prismatic, mm, travel from 0 at rest up.

    Raises:
      UnprintableError: no wall of the parent beside the child.
    """
    place = slide_frame(joint)
    here = np.linalg.inv(place)
    travel = joint.travel[1] - joint.travel[0]
    outer, inner, near = turned(parent, here), turned(child, here), around.turned(here)
    full = travel
    found: list[tuple[float, Manifold]] = []
    for angle in _order():
        if len(found) == 2 or (found and np.cos(angle - found[0][0]) > -0.9):
            continue  # only across from the first
        for share in PLACES:
            made = _rib(outer, inner, angle, share, travel, near, settings)
            if made is not None:
                outer, inner, rib, travel = made
                found.append((angle, rib))
                break
    if not found:
        raise UnprintableError("no wall of its parent stands beside it to hold it")
    ribs = union(rib for _, rib in found)
    facts = {"ribs": len(found), "bite": BITE, "travel": round(travel, 3)}
    joint = dataclasses.replace(joint, travel=(0.0, travel))
    note = (
        ""
        if full - travel < 0.5
        else f"it opens {travel:.0f} of {full:.0f} mm, and is stopped there"
    )
    text = "push it in from where it opens until its ribs click into their grooves"
    keep = grown(ribs, settings.clearance)
    outer, inner, keep = (turned(solid, place) for solid in (outer, inner, keep))
    return Fit("slide", outer, inner, (), Manifold(), keep, facts, text, joint, note)


def slide_frame(joint: Joint) -> np.ndarray:
    """[4, 4] from the frame of this file to the joint's."""
    z = joint.direction * (1.0 if joint.travel[1] > 0 else -1.0)
    up = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    y = np.cross(up, z)
    y /= np.linalg.norm(y)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([np.cross(y, z), y, z])
    return matrix


def _order() -> list[float]:
    """Angles about z, from the horizontal ones to the upright ones, each beside its opposite."""
    half = np.arange(WAYS // 2) * 2 * np.pi / WAYS
    half = sorted(half, key=lambda a: (round(-abs(np.sin(a)), 6), a))
    return [float(a + turn) for a in half for turn in (0.0, np.pi)]


def _rib(
    parent: Manifold,
    child: Manifold,
    angle: float,
    share: float,
    travel: float,
    around: Around,
    settings: PrintSettings,
) -> tuple[Manifold, Manifold, Manifold, float] | None:
    """(parent, child, rib, travel that is left) with a rib towards ``angle``; None where it would
    not hold."""
    gap = settings.clearance
    turn = about_z(-angle)  # the direction becomes x
    outer, inner, taken = (turned(s, turn) for s in (parent, child, around.taken))
    lo, hi = box_of(inner)
    middle = (lo[1] + hi[1]) / 2 + share * (hi[1] - lo[1])
    column = block([(lo[0] + hi[0]) / 2, middle - RIB / 2, lo[2] - 1], [1e3, middle + RIB / 2, 1e3])
    flank = inner ^ column
    if flank.is_empty():
        return None
    rear = box_of(flank)[0, 2]
    start, ahead = rear + RAMP, rear + RAMP + RIB
    root = inner ^ block(
        [(lo[0] + hi[0]) / 2, middle - RIB / 2, start], [1e3, middle + RIB / 2, ahead]
    )
    if root.is_empty():
        return None
    side = box_of(root)[1, 0]
    across = [middle - RIB / 2 - gap, middle + RIB / 2 + gap]
    farthest = ahead + travel + gap + STOP
    wall = outer ^ block([side - 0.01, across[0], rear], [side + FAR, across[1], farthest])
    if wall.is_empty():
        return None
    end = box_of(wall)[1, 2] - gap - STOP
    if end < ahead + LEAST * travel:
        return None
    travel = end - ahead
    top = box_of(wall ^ block([-1e3, across[0], end + gap], [1e3, across[1], end + gap + STOP]))
    if not np.isfinite(top).all() or (top[1] <= top[0]).any():
        return None
    face = top[0, 0]
    stop = block([face, across[0], end + gap], [face + BITE, across[1], end + gap + STOP])
    if (stop ^ outer).volume() < SOUND * stop.volume():
        return None
    foot, crown = side - ROOT, face + BITE
    slope = [block([foot, middle - RIB / 2, start], [crown, middle + RIB / 2, ahead])]
    slope += [block([foot, middle - RIB / 2, rear], [side + 0.05, middle + RIB / 2, start])]
    rib = Manifold.batch_hull(slope)
    room = Manifold.batch_hull([grown(rib, gap), grown(rib, gap).translate((0, 0, travel))])
    if (room ^ taken).volume() > 0.5:
        return None
    whole, swung = one_piece(outer - room), one_piece(union([inner, rib]))
    if whole is None or swung is None:
        return None
    back = np.linalg.inv(turn)
    return turned(whole, back), turned(swung, back), turned(rib, back), float(travel)


def about_z(angle: float) -> np.ndarray:
    """[4, 4] turn about z."""
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return matrix
