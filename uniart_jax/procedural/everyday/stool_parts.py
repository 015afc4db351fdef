"""Parts of stools and stands: seats, legs, pedestals and their finishes. Lengths are in metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    cylinder,
    extrusion,
    hull,
    pipe,
    revolution,
    rounded,
    union,
)

Pieces = list[tuple[Manifold, Material]]


def draw_frame_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a frame: wood, steel, black or painted metal."""
    kind = rng.choice(4, p=[0.4, 0.26, 0.16, 0.18])
    if kind == 0:
        return materials.wood(rng)
    if kind == 1:
        return materials.metal(rng, brushed=False)
    return materials.dark(rng) if kind == 2 else plain(rng.uniform(0.1, 0.9, 3))


def draw_seat_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a seat: wood, leather, cloth or plastic of any colour."""
    kind = rng.choice(4, p=[0.4, 0.2, 0.28, 0.12])
    if kind == 0:
        return materials.wood(rng)
    if kind == 1:
        return plain(np.array([0.42, 0.26, 0.15]) * rng.uniform(0.4, 1.6))
    return plain(rng.uniform(0.08, 0.92, 3)) if kind == 2 else materials.dark(rng)


def seat_on(rng, plan: str, half: float, z: float, thick: float, main, trim) -> Pieces:
    """A seat about the z axis with its underside at ``z`` (metres): round, square, a saddle or a
    tractor seat."""
    if plan == "round":
        kind = str(rng.choice(["flat", "cushion", "dish"], p=[0.35, 0.45, 0.2]))
        board = 0.3 * thick
        if kind == "cushion":
            angle = np.linspace(-np.pi / 2, np.pi / 2, 7)
            r = 0.5 * (thick - board)
            rim = np.column_stack([half - r + r * np.cos(angle), board + r + r * np.sin(angle)])
            top = revolution(np.vstack([[[0, board]], rim, [[0, thick]]]), "z", [0, 0, z], 30)
            return [(top, main), (cylinder("z", [0, 0, z], board, 0.93 * half, segments=30), trim)]
        disc = cylinder("z", [0, 0, z], thick, 0.93 * half, half, 30)
        if kind == "dish":
            disc -= cylinder("z", [0, 0, z + 0.65 * thick], thick, 0.55 * half, 1.15 * half, 30)
        return [(disc, main)]
    wide = float(rng.uniform(0.85, 1.35)) if plan == "square" else 1.45
    corner = half * float(rng.uniform(0.1, 0.5))
    outline = rounded(1.8 * half, 1.8 * half * wide, corner)
    if plan == "square":
        board = extrusion(0.94 * outline, "z", [0, 0, z], 0.35 * thick)
        cushion = extrusion(outline, "z", [0, 0, z + 0.35 * thick], 0.65 * thick)
        return [(cushion, main), (board, trim)]
    solid = extrusion(outline, "z", [0, 0, z], 1.5 * thick)  # hollow between its two high sides
    radius = 2.0 * half * wide
    return [
        (solid - cylinder("x", [-1, 0, z + 0.7 * thick + radius], 2, radius, segments=64), main)
    ]


def _wire_ring(z: float, radius: float, wire: float, segments: int) -> Manifold:
    """A ring of round wire about the z axis at height ``z``."""
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    profile = np.column_stack([radius + wire * np.cos(angle), wire * np.sin(angle)])
    return revolution(profile, "z", [0, 0, z], segments)


def legs_under(rng, high: float, top: float, spread: float, r: float, finish, ring) -> Pieces:
    """Three or four legs (metres) from the floor to ``high``, with a ring or rails between them.
    They stand ``top`` from the axis at the top and ``spread`` at the floor."""
    count = int(rng.choice([3, 4], p=[0.35, 0.65]))
    start = np.pi / count if rng.random() < 0.5 else 0.0
    angles = start + 2 * np.pi * np.arange(count) / count
    way = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    square = rng.random() < 0.3
    pieces: Pieces = []
    for k in range(count):
        low, up = spread * way[k] + [0, 0, 0.0], top * way[k] + [0, 0, high]
        if square:
            ends = [[*(p + [dx, dy, 0])] for p in (low, up) for dx in (-r, r) for dy in (-r, r)]
            pieces.append((hull(np.array(ends)), finish))
        else:
            ends = [cylinder("z", low, 0.004, 0.8 * r, segments=12)]
            ends.append(cylinder("z", up - [0, 0, 0.004], 0.004, r, segments=12))
            pieces.append((Manifold.batch_hull(ends), finish))
    share = float(rng.uniform(0.22, 0.5))
    kind = str(rng.choice(["ring", "rails", "none"], p=[0.45, 0.4, 0.15]))
    at = spread + (top - spread) * share
    if kind == "ring":
        pieces.append((_wire_ring(share * high, at, 0.6 * r, 36), ring))
    elif kind == "rails":
        for k in range(count):
            lift = 0.06 * high * (k % 2) if count == 4 else 0.0
            a, b = (at * way[j] + [0, 0, share * high + lift] for j in (k, (k + 1) % count))
            pieces.append((pipe([a, b], 0.6 * r, 8), finish))
    return pieces


def pedestal(rng, high: float, size: float, r: float, finish, ring) -> Pieces:
    """A column (metres) on a disc, a dome, a trumpet, a square plate or a cross, often with a foot
    ring."""
    kind = str(rng.choice(["disc", "dome", "trumpet", "plate", "cross"]))
    pieces: Pieces = [(cylinder("z", [0, 0, 0.005], high - 0.005, r, segments=22), finish)]
    if kind == "disc":
        pieces.append((cylinder("z", [0, 0, 0], 0.02, size, 0.97 * size, 32), finish))
    elif kind == "plate":
        outline = rounded(1.8 * size, 1.8 * size, 0.2 * size)
        pieces.append((extrusion(outline, "z", [0, 0, 0], 0.018), finish))
    elif kind == "cross":
        for k in range(4):
            end = [size, 0, 0.9 * r]
            bar = pipe([[0, 0, 1.3 * r + 0.04], end], 0.8 * r, 10)
            foot = cylinder("z", [size, 0, 0], r, 0.7 * r, segments=12)
            pieces.append((union([bar, foot]).rotate((0, 0, 90 * k + 45)), finish))
    else:
        power = 1.0 if kind == "dome" else 3.0
        u = np.linspace(0, 1, 9)
        rise = 0.06 if kind == "dome" else 0.45 * high
        rim = np.column_stack([size + (1.04 * r - size) * u, 0.012 + rise * u**power])
        profile = np.vstack([[[0, 0], [size, 0]], rim, [[0, 0.012 + rise]]])
        pieces.append((revolution(profile, "z", [0, 0, 0], 32), finish))
    if rng.random() < 0.65 and high > 0.3:
        z, wire = high * float(rng.uniform(0.4, 0.65)), 0.011
        wide = size * float(rng.uniform(0.7, 1.0))
        pieces.append((_wire_ring(z, wide, wire, 32), ring))
        count = int(rng.choice([1, 2, 3, 4]))
        bar = pipe([[0, 0, z], [wide, 0, z]], 0.9 * wire, 8)
        start = float(rng.uniform(0, 360))
        pieces += [(bar.rotate((0, 0, start + 360 * k / count)), ring) for k in range(count)]
        pieces.append((cylinder("z", [0, 0, z - 0.025], 0.05, 1.25 * r, segments=20), ring))
    return pieces
