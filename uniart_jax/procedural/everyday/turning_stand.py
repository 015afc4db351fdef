"""Low stands that turn: lazy Susans, turntables for jars, cake stands with a dome."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.stool_parts import draw_frame_finish
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import trimmed
from uniart_jax.procedural.shapes import (
    Assembly,
    ball,
    box,
    cylinder,
    extrusion,
    revolution,
    rounded,
    slide,
    tube,
    turn,
)

Z = (0, 0, 1)
EXTRAS = ("none", "tier", "dome", "jars", "grip")


def turning_stand(rng: np.random.Generator) -> ArticulatedObject:
    """A plate in metres that turns on a foot: one or two tiers, a rim, a knob or a handle, a dome
    that lifts off."""
    r = float(rng.uniform(0.12, 0.24))
    steel, tone = materials.metal(rng, brushed=False), plain(rng.uniform(0.15, 0.95, 3))
    white = materials.white_plastic(rng)
    finish = (materials.wood(rng), white, steel, materials.stone(rng), tone)[rng.integers(5)]
    foot = finish if rng.random() < 0.5 else draw_frame_finish(rng)
    tall = rng.random() < 0.55
    neck = r * float(rng.uniform(0.35, 0.9)) if tall else r * float(rng.uniform(0.06, 0.15))
    size = r * float(rng.uniform(0.5, 0.8))
    asm = Assembly()
    if tall:
        u = np.linspace(0, 1, 10)
        waist = size * float(rng.uniform(0.15, 0.4))
        curve = waist + (size - waist) * (1 - u) ** float(rng.uniform(2, 4))
        curve += 0.3 * size * np.clip(u - 0.7, 0, 1)
        line = np.column_stack([curve, 0.08 * neck + 0.92 * neck * u])
        stem = revolution(np.vstack([[[0, 0], [size, 0]], line, [[0, neck]]]), "z", [0, 0, 0], 30)
    elif rng.random() < 0.3:
        stem = extrusion(rounded(1.7 * size, 1.7 * size, 0.2 * size), "z", [0, 0, 0], neck)
    else:
        stem = cylinder("z", [0, 0, 0], neck, size, 0.9 * size, 32)
    root = asm.add("foot", trimmed((stem, foot)))
    z, thick = neck + 0.0015 * (1 + 4 * r), r * float(rng.uniform(0.05, 0.1))
    plan = str(rng.choice(["round", "square"], p=[0.8, 0.2]))
    plate = cylinder("z", [0, 0, z], thick, 0.97 * r, r, 40)
    if plan == "square":
        plate = extrusion(rounded(1.75 * r, 1.75 * r, 0.25 * r), "z", [0, 0, z], thick)
    pieces, rim = [(plate, finish)], rng.random() < 0.5 and plan == "round"
    top, high = z + thick, r * float(rng.uniform(0.06, 0.25))
    if rim:
        band = tube("z", [0, 0, top - 0.001], high, 0.98 * r, 0.93 * r, 40)
        pieces.append((band, finish if rng.random() < 0.6 else draw_frame_finish(rng)))
    extra = str(rng.choice(EXTRAS, p=[0.12, 0.24, 0.36, 0.14, 0.14]))
    if extra == "tier":
        rise, small = r * float(rng.uniform(0.5, 0.9)), r * float(rng.uniform(0.55, 1.0))
        post = cylinder("z", [0, 0, top - 0.001], rise + 0.002, 0.07 * r)
        upper = cylinder("z", [0, 0, top + rise], thick, 0.97 * small, small, 36)
        knob = ball([0, 0, top + rise + thick + 0.08 * r], 0.12 * r, 16)
        pieces += [(upper, finish), (post, foot), (knob, foot)]
    elif extra == "grip":  # dividers and a ring to carry it by
        for k in range(int(rng.integers(3, 7))):
            fin = box([0, -0.02 * r, top - 0.001], [0.93 * r, 0.02 * r, top + 0.2 * r])
            pieces.append((fin.rotate((0, 0, 60 * k)), finish))
        pieces.append((cylinder("z", [0, 0, top - 0.001], 0.6 * r, 0.06 * r), foot))
        pieces.append(
            (tube("x", [-0.04 * r, 0, top + 0.72 * r], 0.08 * r, 0.18 * r, 0.1 * r), foot)
        )
    elif extra == "jars":
        for k in range(int(rng.integers(2, 5))):
            tone = plain(rng.uniform(0.1, 0.9, 3))
            jar = cylinder(
                "z", [0.55 * r, 0, top - 0.001], r * float(rng.uniform(0.25, 0.7)), 0.22 * r
            )
            pieces.append((jar.rotate((0, 0, 85 * k + float(rng.uniform(0, 12)))), tone))
    table = asm.add("plate", trimmed(*pieces), root, turn((0, 0, 0), Z))
    if extra == "dome":
        _add_dome(rng, asm, table, r, top, foot)
    return asm.object()


def _add_dome(rng, asm: Assembly, table: int, r: float, top: float, knob_finish: Material) -> None:
    """Add a clear or metal dome that lifts off a plate of radius ``r``."""
    wide, tone = r * float(rng.uniform(0.78, 0.9)), materials.glass(rng)
    if rng.random() < 0.3:
        tone = materials.metal(rng, brushed=False)
    rise = r * float(rng.uniform(0.5, 1.0))
    straight = float(rng.uniform(0, 0.5)) * rise
    angle = np.linspace(0, np.pi / 2, 8)
    line = np.column_stack([np.cos(angle), np.sin(angle)])
    outer = [0, straight] + line * [wide, rise - straight]
    inner = [0, straight] + line * [wide - 0.03 * r, rise - straight - 0.03 * r]
    profile = np.vstack([[[wide, 0]], outer, inner[::-1], [[wide - 0.03 * r, 0]]])
    shell = revolution(profile, "z", [0, 0, top + 0.002], 34)
    shell += cylinder("z", [0, 0, top + 0.98 * rise], 0.1 * r, 0.05 * r, segments=14)
    knob = ball([0, 0, top + rise + 0.14 * r], 0.1 * r, 14)
    asm.add("dome", trimmed((shell, tone), (knob, knob_finish)), table, slide(Z, 1.2 * rise))
