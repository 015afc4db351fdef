"""What is true of a print: gaps, freedom to move, what holds it, and walls too thin to print."""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.export.convex_split import triangles
from uniart_jax.export.printing.build import Print, PrintedJoint
from uniart_jax.export.printing.clear import ENOUGH
from uniart_jax.export.printing.settings import PrintSettings
from uniart_jax.export.printing.solids import axis_frame, turned
from uniart_jax.objects.kinematics import Joint

STATES = 9  # along a range
TOUCH = 1e-3  # mm^3: less is rounding
PULL = 3.0  # clearances that a part is pulled by to see what holds it
SAMPLES = 3000  # points of a piece whose wall is measured
FACING = -0.8  # cosine between two sides of a wall
SPOT = 0.5  # mm^2: less is an edge, not a wall


@dataclasses.dataclass(frozen=True)
class Walls:
    """Of one piece, mm.

    Attributes:
      thinnest: that was found, hardware left out; None where two sides never face each other.
      thin: mm^2 of surface above walls that are thinner than is asked for.
      where: [3] middle of these, assembled; None if there are none.
    """

    thinnest: float | None
    thin: float
    where: np.ndarray | None


@dataclasses.dataclass(frozen=True)
class Held:
    """Of one joint.

    Attributes:
      gap: mm between child and parent at rest, at most twice the clearance.
      meets: coordinates at which child and parent run into each other.
      along, across, pins: whether something stops the child when it is pulled out along the axis,
        moved off the axis, and the pins along theirs, at every state tried.
    """

    gap: float
    meets: tuple[float, ...]
    along: bool
    across: bool
    pins: bool


def states(joint: Joint, count: int = STATES) -> np.ndarray:
    """[count] coordinates from end to end."""
    return np.linspace(*joint.limits, count)


def solids_of(made: Print, joint: PrintedJoint) -> tuple[Manifold, Manifold, list[Manifold]]:
    """(parent, child, pins) of a joint as they are printed, assembled at rest."""
    first = {}
    for piece in made.pieces:
        if piece.parts:
            first.setdefault(piece.leader, piece.solid)
    return first[joint.parent], first[joint.child], list(joint.fit.pins)


def held(made: Print, joint: PrintedJoint) -> Held:
    """Try a joint along its range by boolean intersection."""
    gap, motion = made.settings.clearance, joint.joint
    parent, child, pins = solids_of(made, joint)
    fixed = [parent, *pins]
    meets = []
    for q in states(motion):
        moved = turned(child, motion.motion(q))
        if any((moved ^ solid).volume() > TOUCH for solid in fixed):
            meets.append(round(float(q), 5))
    axis = axis_frame(motion)[:3].T[:3]  # x, y, z in rows
    pull = PULL * gap
    along, across = True, True
    for q in states(motion, 3):
        moved = turned(child, motion.motion(q))

        def stopped(way, moved=moved):
            return any((moved.translate(tuple(way)) ^ s).volume() > TOUCH for s in fixed)

        across &= all(stopped(side * axis[k] * pull) for k in (0, 1) for side in (1, -1))
        if motion.rotates:
            along &= all(stopped(side * axis[2] * pull) for side in (1, -1))
    if not motion.rotates:
        end = turned(child, motion.motion(motion.limits[1]))
        along = (end.translate(tuple(motion.direction * pull)) ^ parent).volume() > TOUCH
    fast = all(
        (pin.translate(tuple(side * axis[2] * pull)) ^ parent).volume() > TOUCH
        for pin in pins
        for side in (1, -1)
    )
    near = min(child.min_gap(solid, 2 * gap) for solid in (parent, *pins))
    return Held(float(near), tuple(meets), bool(along), bool(across), fast)


def touching(made: Print) -> list[tuple[str, str, float]]:
    """Pairs of pieces that are nearer at rest than ``ENOUGH`` of the clearance, and how near."""
    least, found = ENOUGH * made.settings.clearance, []
    for n, one in enumerate(made.pieces):
        for two in made.pieces[n + 1 :]:
            if one.leader == two.leader and one.parts and two.parts:
                continue  # to be glued
            near = float(one.solid.min_gap(two.solid, least))
            if near < least:
                found.append((one.name, two.name, near))
    return found


def walls(solid: Manifold, hardware: Manifold, settings: PrintSettings) -> Walls:
    """How thick the walls of a piece are: from points spread over its surface straight in, to a
    face that looks the other way."""
    vertices, faces = triangles(solid)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    points, of = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
    normals = np.asarray(mesh.face_normals)[of]
    locations, rays, hit = mesh.ray.intersects_location(
        points - 1e-3 * normals, -normals, multiple_hits=False
    )
    facing = np.einsum("ij,ij->i", np.asarray(mesh.face_normals)[hit], normals[rays]) < FACING
    starts, ends = points[rays[facing]], locations[facing]
    if not hardware.is_empty():
        made = trimesh.Trimesh(*triangles(hardware), process=False)
        own = made.contains(starts) | made.contains(ends)
        starts, ends = starts[~own], ends[~own]
    if not len(starts):
        return Walls(None, 0.0, None)
    thick = np.linalg.norm(starts - ends, axis=1)
    thin = thick < settings.wall - 0.02
    share = float(mesh.area) / SAMPLES
    if thin.sum() * share < SPOT or thin.sum() < 3:
        kept = np.sort(thick)[2:] if len(thick) > 3 else thick
        return Walls(float(max(kept.min(), min(settings.wall, thick.max()))), 0.0, None)
    where = np.median((starts[thin] + ends[thin]) / 2, axis=0)
    return Walls(float(np.sort(thick[thin])[2]), float(thin.sum() * share), where)
