"""Bottles, jars and flasks: a hollow body and a cap on a screw, right- or left-handed, of one to
several turns."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    loft,
    pipe,
    revolution,
    rounded,
    screw,
    tidy,
    union,
)

# height up to the neck in metres; radius, of it; neck, of the radius; shoulder, of the height
_KINDS = {
    "water": ((0.14, 0.26), (0.14, 0.21), (0.36, 0.5), 0.75),
    "wine": ((0.22, 0.3), (0.12, 0.16), (0.36, 0.44), 0.62),
    "jar": ((0.07, 0.17), (0.26, 0.55), (0.78, 0.9), 0.92),
    "flask": ((0.18, 0.28), (0.13, 0.19), (0.62, 0.85), 0.9),
    "square": ((0.1, 0.2), (0.18, 0.28), (0.36, 0.55), 0.8),
}


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A bottle, metres, its cap screwed home."""
    kind = str(rng.choice(list(_KINDS), p=[0.3, 0.14, 0.24, 0.18, 0.14]))
    height, radius, neck, shoulder, rise = _proportions(rng, kind)
    tall = height + rise  # of the body, neck included
    unit = max(tall, 2 * radius) / 100
    wall = max(1.8 * unit, 0.0025)
    skin, accent = _skin(rng, kind), materials.paint(rng)
    neck = max(neck, 3.2 * wall)

    asm, body = Assembly(), Shape()
    if kind == "square":
        side = 2 * radius
        bulge = float(rng.uniform(0.08, 0.4)) * radius
        outer = rounded(side, side * float(rng.uniform(0.65, 1.0)), bulge)
        inner = outer * (1 - 2 * wall / np.ptp(outer, 0))
        ring = np.column_stack(
            [np.cos(t := np.linspace(0, 2 * np.pi, 24, endpoint=False)), np.sin(t)]
        )
        solid = union(
            [loft(outer, outer, 0, shoulder), loft(outer, ring * neck, shoulder - 1e-4, height)]
        )
        solid += cylinder("z", [0, 0, height - 0.002], rise + 0.002, neck, segments=24)
        hollow = [
            loft(inner, inner, wall, shoulder - 0.3 * wall),
            loft(inner, ring * (neck - wall), shoulder - 0.35 * wall, height - 0.2 * wall),
            cylinder("z", [0, 0, height - 1.5 * wall], 1.0, neck - wall, segments=24),
        ]
        half = np.ptp(outer, 0) / 2
        solid = cut(solid, hollow)
    else:
        outline = _outline(rng, kind, height, radius, neck, shoulder)
        profile = np.vstack([[[0, 0]], outline, [[neck, tall], [0, tall]]])
        inside = np.vstack(
            [[[0, wall]], _inset(outline, wall), [[neck - wall, 2 * tall], [0, 2 * tall]]]
        )
        solid = cut(
            revolution(profile, "z", [0, 0, 0], 32), (revolution(inside, "z", [0, 0, 0], 32),)
        )
        half = np.array([radius, radius])
    lo, hi = 0.16 * shoulder, float(rng.uniform(0.5, 0.86)) * shoulder
    if rng.random() < 0.7 and kind != "flask":  # a label, let into the wall
        band = box([-1, -1, lo], [1, 1, hi])
        core = box(
            [-half[0] + 0.5 * wall, -half[1] + 0.5 * wall, -1],
            [half[0] - 0.5 * wall, half[1] - 0.5 * wall, 2],
        )
        if kind != "square":
            core = cylinder(
                "z",
                [0, 0, -1],
                3,
                0.9 * radius if kind == "water" else radius - 0.5 * wall,
                segments=32,
            )
        label = (solid ^ band) - core
        stripe = box([-1, -1, lo + 0.38 * (hi - lo)], [1, 1, lo + 0.62 * (hi - lo)])
        if not label.is_empty():
            body.add(tidy(label - stripe), accent)
            body.add(tidy(label ^ stripe), materials.paint(rng))
            solid = solid - label
    elif kind == "flask":
        foot = solid ^ box([-1, -1, -1], [1, 1, 0.12 * shoulder])
        body.add(foot, accent)
        solid = solid - foot
    body.add(tidy(solid), skin)
    if (kind == "flask" and rng.random() < 0.6) or (kind == "jar" and rng.random() < 0.15):
        reach, r = radius + float(rng.uniform(0.3, 0.5)) * radius, max(1.6 * unit, 0.004)
        a, b = 0.25 * shoulder, 0.8 * shoulder
        y = radius - 0.4 * wall
        loop = pipe(
            [
                [0, -y, a],
                [0, -reach, a + 0.1 * (b - a)],
                [0, -reach, b - 0.1 * (b - a)],
                [0, -y, b],
            ],
            r,
        )
        loop = cut(loop, (cylinder("z", [0, 0, 0], 1, radius, segments=32),))
        body.add(loop, materials.dark(rng) if rng.random() < 0.6 else accent)
    root = asm.add("body", body)
    _cap(rng, asm, root, kind, height, rise, neck, unit)
    return asm.object()


def _proportions(rng, kind: str):
    """Height up to the neck, radius, neck radius, height of the shoulder, height of the neck:
    metres."""
    *ranges, shoulder = _KINDS[kind]
    height, slim, neck = (rng.uniform(*r) for r in ranges)
    radius = slim * height
    rise = float(np.clip(rng.uniform(0.09, 0.14) * height, 0.012, 0.03))
    return float(height), float(radius), float(neck * radius), float(shoulder * height), rise


def _skin(rng, kind: str) -> Material:
    """Glass, plastic or steel."""
    if kind == "flask":
        return materials.metal(rng, brushed=False) if rng.random() < 0.5 else materials.paint(rng)
    if rng.random() < 0.5:
        tints = [(0.2, 0.34, 0.2), (0.4, 0.22, 0.08), (0.62, 0.76, 0.85), (0.75, 0.86, 0.8)]
        tint = np.array(tints[int(rng.integers(4))]) * rng.uniform(0.75, 1.15)
        return plain(np.clip(tint, 0, 1))
    return materials.white_plastic(rng) if rng.random() < 0.4 else materials.paint(rng)


def _outline(rng, kind: str, height, radius, neck, shoulder) -> np.ndarray:
    """[n, 2] of (radius, z) from the floor's edge up to the neck's foot."""
    base = 0.06 * radius if kind == "jar" else 0.12 * radius
    points = [[radius - base, 0.0], [radius, base]]
    if kind == "water":
        grip = float(rng.uniform(0.86, 1.0))
        for z, r in ((0.3, 1.0), (0.42, grip), (0.52, grip), (0.64, 1.0)):
            points.append([r * radius, z * height])
    points.append([radius, shoulder])
    steps = np.linspace(0, 1, 6)[1:]
    soft = kind in ("water", "wine") or rng.random() < 0.5
    for t in steps:
        s = 0.5 - 0.5 * np.cos(np.pi * t) if soft else t
        points.append([radius + (neck - radius) * s, shoulder + (height - shoulder) * t])
    return np.array(points)


def _inset(outline: np.ndarray, wall: float) -> np.ndarray:
    """The outline drawn in by ``wall`` along its normals; its first point on the floor's upper
    side."""
    steps = np.diff(outline, axis=0)
    normals = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1)[:, None]
    smooth = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    smooth /= np.linalg.norm(smooth, axis=1)[:, None]
    inner = outline + wall * smooth
    inner[0] = [max(outline[0, 0] - 0.6 * wall, wall), wall]
    inner[:, 0] = np.maximum(np.minimum(inner[:, 0], outline[:, 0] - 0.8 * wall), 0.3 * wall)
    inner[:, 1] = np.maximum.accumulate(np.maximum(inner[:, 1], wall))
    inner[-1, 0] = outline[-1, 0] - wall
    return inner


def _cap(rng, asm: Assembly, root: int, kind, height, rise, neck, unit) -> int:
    """The cap over the neck, with ridges or wings and a mark, so that one sees it turn."""
    air, wall = 0.5 * unit, max(1.8 * unit, 0.0022)
    inner, outer = neck + air, neck + air + wall
    low = height + 0.12 * rise
    roof = height + rise + air
    high = roof + max(2.2 * unit, 0.003) * float(rng.uniform(1, 2.2))
    if kind in ("flask", "wine") and rng.random() < 0.6:
        high += float(rng.uniform(0.2, 0.8)) * neck
    finish = materials.hardware(rng) if kind in ("flask", "jar", "wine") else materials.paint(rng)
    if rng.random() < 0.3:
        finish = materials.dark(rng)
    turns = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    style = str(rng.choice(["ridges", "hexagon", "plain", "wings"], p=[0.45, 0.15, 0.2, 0.2]))
    if style == "wings" and kind in ("flask", "jar"):  # thumb wings belong to small caps
        style = "ridges"
    if style == "ridges":
        teeth = int(rng.integers(10, 20))
        r = outer + 0.6 * unit * (np.cos(teeth * turns) > 0)
    elif style == "hexagon":
        local = np.mod(turns, np.pi / 3) - np.pi / 6
        r = outer / np.cos(local)
    else:
        r = np.full(96, outer)
    outline = np.column_stack([r * np.cos(turns), r * np.sin(turns)])
    solid = extrusion(outline, "z", [0, 0, low], high - low)
    if style == "wings":
        reach = outer + float(rng.uniform(0.4, 0.8)) * neck
        for s in (0, np.pi):
            wing = box(
                [0.9 * outer, -1.2 * unit, low + 0.25 * (high - low)], [reach, 1.2 * unit, high]
            )
            solid = solid + wing.rotate((0, 0, np.rad2deg(s)))
    solid = solid - cylinder("z", [0, 0, low - 1], 1 + roof - low, inner, segments=32)
    cap = Shape().add(solid, finish)
    mark = plain((0.95, 0.95, 0.95)) if finish.color[1] < 0.5 else plain((0.12, 0.12, 0.14))
    w = max(1.2 * unit, 0.14 * outer)
    cap.add(box([-0.85 * outer, -w, high], [-0.1 * outer, w, high + 0.9 * unit]), mark)
    if kind == "flask" and rng.random() < 0.5:  # a carrying loop
        r = 1.1 * unit
        z = high + max(0.9 * neck, 5 * unit)
        loop = pipe(
            [
                [0, -0.7 * outer, high - r],
                [0, -0.6 * outer, z],
                [0, 0.6 * outer, z],
                [0, 0.7 * outer, high - r],
            ],
            r,
        )
        cap.add(
            cut(
                loop,
                (
                    box([-1, -1, 0], [1, 1, high]),
                    box([-0.9 * outer, -w, high], [-0.05 * outer, w, high + unit]),
                ),
            ),
            finish.darker(0.9),
        )
    count = float(rng.uniform(1.5, 4.5)) if kind != "jar" else float(rng.uniform(0.75, 2.5))
    travel = max((roof - low) * float(rng.uniform(1.0, 1.3)), 0.012)
    joint = screw((0, 0, height), (0, 0, 1), count, travel, left_handed=bool(rng.random() < 0.35))
    return asm.add("cap", cap, root, joint)
