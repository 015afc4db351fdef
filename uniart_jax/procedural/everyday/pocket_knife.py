"""Folding knives, razors and cutters with a sliding blade. Pliers and other small tools of the
family are in ``pliers`` and ``small_tools``."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import pliers, small_tools
from uniart_jax.procedural.poses import pose
from uniart_jax.procedural.shapes import (
    PartSpec,
    Shape,
    assembled,
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
    slide,
    tidy,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A small tool in metres, closed.

    It is made in a frame (u along it, v across, w through its layers), then turned to lie or stand.
    """
    kinds = (
        _folding,
        _cutter,
        small_tools.clippers,
        small_tools.ruler,
        small_tools.punch,
        pliers.pliers,
        pliers.tongs,
        pliers.peg,
    )
    share = [0.3, 0.13, 0.08, 0.08, 0.1, 0.12, 0.12, 0.07]
    make = kinds[rng.choice(len(kinds), p=share)]
    turned = pose(rng, lying=make in (small_tools.punch, small_tools.clippers))
    return assembled(make(rng), turned)


def _scale(rng: np.random.Generator, length: float, high: float) -> np.ndarray:
    """The side view (u, v) of a handle scale: blunt or round ends, at times tapered or waved for
    the fingers."""
    u = np.linspace(-1, 1, 31)
    power, taper = float(rng.uniform(3, 9)), float(rng.uniform(-0.12, 0.12))
    wave = float(rng.choice([0.0, rng.uniform(0.03, 0.1)]))
    end = np.maximum(1 - np.abs(u) ** power, 0) ** (2 / power)
    top = 0.5 * high * end * 0.94
    low = -0.5 * high * end * (1 + taper * u + wave * np.sin(float(rng.uniform(5, 10)) * u))
    return np.vstack([np.column_stack([u, top]), np.column_stack([u, low])[-2:0:-1]]) * [
        length / 2,
        1,
    ]


def _blade(rng: np.random.Generator, long: float, edge: float, back: float) -> CrossSection:
    """The side view of a blade from its pivot at 0 towards -u, its edge down: knives, saws,
    drivers, bottle openers."""
    kind = rng.choice(
        ["drop", "spear", "sheep", "saw", "driver", "opener"], p=[0.3, 0.2, 0.2, 0.1, 0.1, 0.1]
    )
    tips = {
        "drop": [[0.72, -edge], [0.9, -0.5 * edge], [1, 0.5 * back], [0.7, back]],
        "spear": [[0.7, -edge], [1, 0.2 * back], [0.72, back]],
        "sheep": [[0.97, -edge], [1, -0.5 * edge], [0.84, back]],
        "driver": [[0.8, -0.6 * edge], [1, -0.1 * edge], [1, 0.8 * back], [0.8, back]],
        "opener": [[0.75, -edge], [0.95, -0.6 * edge], [0.95, 0.9 * back], [0.75, back]],
        "saw": [[s, -edge * (1 - 0.5 * (k % 2))] for k, s in enumerate(np.linspace(0.2, 0.95, 16))]
        + [[0.95, back]],
    }[str(kind)]
    points = np.array([[0.03, -0.7 * edge], [0.15, -edge], *tips, [0.03, back]])
    flat = CrossSection([points * [-long, 1]])
    flat = flat if flat.area() > 0 else CrossSection([points[::-1] * [-long, 1]])
    if kind == "opener":
        flat -= CrossSection.circle(0.6 * edge, 14).translate((-0.72 * long, -0.9 * edge))
    return flat


def _folding(rng: np.random.Generator) -> list[PartSpec]:
    """Two scales with one to four blades in layers between them, pivoted at either end. Razors have
    a tail."""
    length = float(rng.uniform(0.07, 0.15))
    unit, count = length / 100, int(rng.choice([1, 2, 3, 4], p=[0.42, 0.23, 0.2, 0.15]))
    razor = count == 1 and rng.random() < 0.25
    high = float(rng.uniform(13, 17) if razor else rng.uniform(17, 29)) * unit
    air, layer = 0.35 * unit, float(rng.uniform(2.6, 4.2)) * unit
    thick, tang = float(rng.uniform(2.8, 6)) * unit, float(rng.uniform(0.28, 0.34)) * high
    pivot = length / 2 - float(rng.uniform(0.42, 0.6)) * high
    inner = count * (layer + air) + air
    tone, steel = small_tools.draw_grip_finish(rng), materials.metal(rng, brushed=False)
    flat = _scale(rng, length, high)
    scales = union([extrusion(flat, "z", [0, 0, w], thick) for w in (-thick, inner)])
    ends = [1 if k % 2 == 0 else -1 for k in range(count)]
    limits = [
        pivot - air if 1 in ends else length,
        pivot - air if -1 in ends else length,
    ]
    spine = extrusion(flat, "z", [0, 0, 0], inner)
    far = -0.55 * pivot if razor else limits[0]
    spine ^= box([-limits[1], -high, -1], [far, -tang - air, 1])
    handle = Shape()
    if rng.random() < 0.4 and not razor:  # bolsters of metal at the ends
        x = float(rng.uniform(0.28, 0.42)) * length
        ends_only = union(
            [box([s * x - (s < 0), -1, -1], [s * x + (s > 0), 1, 1]) for s in (-1, 1)]
        )
        handle.add(tidy(scales ^ ends_only), steel).add(tidy(scales - ends_only), tone)
        handle.add(spine, steel if rng.random() < 0.5 else tone.darker(0.7))
    else:
        handle.add(tidy(scales), tone).add(spine, steel)
    rivet = float(rng.uniform(0.1, 0.2)) * high
    spots = [-pivot, pivot] + ([0.0] if rng.random() < 0.4 else [])
    caps = [
        cylinder("z", [x, 0, w], 0.8 * unit, rivet, segments=14)
        for x in spots
        for w in (-thick - 0.8 * unit, inner + thick)
    ]
    handle.add(union(caps), materials.hardware(rng))
    parts: list[PartSpec] = [("handle", handle, -1, None)]
    for k, end in enumerate(ends):
        long = (pivot + length / 2) * float(
            rng.uniform(0.86, 0.97) if k < 1 else rng.uniform(0.6, 0.95)
        )
        back = 0.47 * high + float(rng.uniform(1.2, 5)) * unit
        outline = _blade(rng, long, 0.9 * tang, back) + CrossSection.circle(tang, 20)
        if razor:
            tail = np.array(
                [
                    [0, -0.5 * tang],
                    [0.22 * length, 0.2 * tang],
                    [0.24 * length, 0.9 * tang],
                    [0, 0.8 * tang],
                ]
            )
            outline += CrossSection([tail])
        outline = outline if end > 0 else outline.mirror((1, 0))
        low = air + k * (layer + air)
        solid = Manifold.extrude(outline, layer).translate((end * pivot, 0, low))
        joint = hinge((end * pivot, 0, 0), (0, 0, -end), np.pi * float(rng.uniform(0.9, 1)))
        parts.append(("blade", Shape().add(tidy(solid), steel), 0, joint))
    return parts


def _cutter(rng: np.random.Generator) -> list[PartSpec]:
    """A hollow grip, and a blade with a thumb piece that slides in its slot; at times a clamping
    wheel."""
    length = float(rng.uniform(0.11, 0.19))
    unit, air = length / 100, 0.35 * length / 100
    high, thick = float(rng.uniform(11, 21)) * unit, float(rng.uniform(8, 13)) * unit
    blade, wide = float(rng.uniform(2.2, 3)) * unit, float(rng.uniform(0.5, 0.7)) * high / 2
    outline = rounded(length, high, float(rng.uniform(0.1, 0.5)) * high)
    lean = float(rng.uniform(0, 0.3))
    front = np.clip(2 * outline[:, 0] / length, 0, 1)
    outline = outline * np.column_stack([np.ones(len(outline)), 1 - lean * front])
    wide = min(wide, 0.85 * (1 - lean) * high / 2)
    a, b = float(rng.uniform(-0.34, -0.2)) * length, float(rng.uniform(0.25, 0.38)) * length
    slot, mid = 2.2 * unit, 0.15 * thick
    body = extrusion(outline, "z", [0, 0, -thick / 2], thick)
    body -= box([-0.44 * length, -wide - air, mid - air], [length, wide + air, mid + blade + air])
    body -= box([a, -slot - air, mid], [b, slot + air, 1])
    tone, other, dark = (
        small_tools.draw_grip_finish(rng),
        small_tools.draw_grip_finish(rng),
        materials.dark(rng),
    )
    share = float(rng.uniform(-0.2, 0.35)) * length
    mouth = box([share, -1, -1], [1, 1, 1])
    shape = Shape().add(tidy(body ^ mouth), other).add(tidy(body - mouth), tone)
    tip, proud = length / 2 + float(rng.uniform(0.5, 5)) * unit, float(rng.uniform(0, 1.6)) * wide
    steel = box([-0.42 * length, -wide, mid], [tip, wide, mid + blade]) ^ extrusion(
        np.array(
            [[-1, -1], [tip, -1], [tip, -wide], [tip - proud, wide], [tip - proud, 1], [-1, 1]]
        ),
        "z",
        [0, 0, -1],
        2,
    )
    stem = float(rng.uniform(9, 15)) * unit
    roof = thick / 2 + air
    thumb = box([a + air, -slot, mid + blade], [a + stem, slot, roof + unit])
    pad = float(rng.uniform(0.5, 0.85)) * high / 2
    thumb += box([a - unit, -pad, roof], [a + stem + unit, pad, roof + 2.5 * unit])
    for x in np.linspace(a, a + stem - 2 * unit, int(rng.integers(2, 5))):
        thumb += box([x, -pad, roof + unit], [x + 1.6 * unit, pad, roof + 4.5 * unit])
    moving = Shape().add(steel, materials.metal(rng, brushed=False)).add(tidy(thumb), dark)
    parts: list[PartSpec] = [("grip", shape, -1, None)]
    parts.append(("blade", moving, 0, slide((1, 0, 0), b - a - stem - 2 * air)))
    if rng.random() < 0.35 and a > -0.28 * length:
        r = min(0.42 * high, 5.5 * unit)
        wheel = cylinder(
            "z", [-0.41 * length, 0, thick / 2 + 0.3 * unit], 4.5 * unit, r, segments=10
        )
        joint = turn((-0.41 * length, 0, 0), (0, 0, 1))
        parts.append(("wheel", Shape().add(wheel, dark), 0, joint))
    return parts
