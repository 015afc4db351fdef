"""Wall plates of one to four gangs with rockers, toggles, dials, sliders, push buttons and sockets
under flaps. Breaker boxes and isolators are in ``switch_boxes``."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.switch_boxes import breaker_box, isolator
from uniart_jax.procedural.everyday.switch_controls import CONTROLS, draw_finish, rounded_block
from uniart_jax.procedural.pieces import shape_of
from uniart_jax.procedural.shapes import Assembly, Shape, cut, cylinder, tidy

KINDS = tuple(CONTROLS)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A switch on a wall at x = 0, in metres, off and closed."""
    kind = rng.choice(["plate", "breaker_box", "isolator"], p=[0.68, 0.18, 0.14])
    return {"plate": _plate, "breaker_box": breaker_box, "isolator": isolator}[str(kind)](rng)


def _plate(rng: np.random.Generator) -> ArticulatedObject:
    """A plate with gangs in a row or a column, flush or on a box that stands on the wall."""
    count = int(rng.choice([1, 2, 3, 4], p=[0.42, 0.3, 0.16, 0.12]))
    column = rng.random() < 0.4
    size = float(rng.uniform(0.055, 0.075))  # of a gang's insert
    tall = size * float(rng.choice([1.0, rng.uniform(1.2, 1.7)]))
    if column:
        tall = size
    pitch = (tall if column else size) * float(rng.uniform(1.06, 1.25))
    rim = size * float(rng.uniform(0.12, 0.35))
    width, height = size + 2 * rim, tall + 2 * rim
    if column:
        height += (count - 1) * pitch
    else:
        width += (count - 1) * pitch
    thick = size * float(rng.uniform(0.12, 0.2) if rng.random() < 0.6 else rng.uniform(0.35, 0.8))
    corner = size * float(rng.uniform(0.02, 0.25))
    face = draw_finish(rng)
    insert = face if rng.random() < 0.6 else draw_finish(rng)
    accent = face.darker(0.75) if rng.random() < 0.5 else draw_finish(rng)
    if accent.color == insert.color:
        accent = insert.darker(0.8)
    body, asm = Shape(), Assembly()
    deep = max(thick, 0.45 * size)  # the box in the wall behind it
    solid, front = _plate_block(rng, width, height, corner, thick, rim, size, deep)
    weights = np.array([0.24, 0.1, 0.14, 0.13, 0.09, 0.1, 0.06, 0.14])
    kinds = [KINDS[rng.choice(8, p=weights)] for _ in range(count)]
    if rng.random() < 0.45:
        kinds = [kinds[0]] * count
    if set(kinds) == {"socket"}:
        kinds[0] = "rocker"
    seed, holes, later = int(rng.integers(2**31)), [], []
    same = rng.random() < 0.7
    tone = {kind: (insert if rng.random() < 0.7 else accent) for kind in KINDS}
    for k, kind in enumerate(kinds):
        off = (k - (count - 1) / 2) * pitch
        at = np.array([front, 0.0, -off]) if column else np.array([front, off, 0.0])
        own = np.random.default_rng(seed if same else seed + k)
        cuts, fixed, parts = CONTROLS[kind](own, at, size, tall, deep, tone[kind], accent)
        if kind == "flap" and column and k:  # clear of the control above it
            name, pieces, joint = parts[0]
            angle = (0.0, min(joint.angle[1], float(np.deg2rad(95))))
            parts = [(name, pieces, dataclasses.replace(joint, angle=angle))]
        holes += cuts
        later.append((fixed, parts))
    body.add(tidy(cut(solid, holes)), face)
    for fixed, _ in later:
        for one, material in fixed:
            body.add(one, material if material is not face else face.darker(0.97))
    if rng.random() < 0.3 and rim > 0.2 * size and not column:  # screws
        for z in (-1, 1):
            at = [-thick - 0.03 * size, 0, z * (height / 2 - 0.4 * rim)]
            screw = cylinder("x", at, 0.12 * size, 0.045 * size, segments=12)
            body.add(screw - solid, materials.metal(rng, brushed=False))
    root = asm.add("plate", body)
    for _, parts in later:
        for name, pieces, joint in parts:
            asm.add(name, shape_of(pieces), root, joint)
    return asm.object()


def _plate_block(rng, width, height, corner, thick, rim, size, deep) -> tuple[Manifold, float]:
    """A plate with its box in the wall, and the plane x of its front."""
    solid = rounded_block(width, height, corner, -thick, 0, 0, 0)
    if rng.random() < 0.5:  # a bevelled edge
        raised = rounded_block(
            width - 0.5 * rim, height - 0.5 * rim, corner, -thick - 0.08 * size, 0, 0, 0
        )
        solid += raised
        front = -thick - 0.08 * size
    else:
        front = -thick
    back = front + deep + 0.12 * size
    w, h = width - 1.2 * rim, height - 1.2 * rim
    return solid + rounded_block(w, h, corner, front, back, 0, 0), front
