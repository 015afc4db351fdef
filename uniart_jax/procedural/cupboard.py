"""Kitchen base, wall and tall cabinets, wardrobes, hutches and shelf frames: fronts that hardly
show their gaps, and much that looks as if it moved and does not."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import finishes, joinery, materials, real_finishes
from uniart_jax.procedural.cabinet import Cell
from uniart_jax.procedural.cupboard_case import (
    Cabinet,
    carcass,
    end_panels,
    fronts,
    open_rooms,
    opening,
    pull_outs,
)
from uniart_jax.procedural.cupboard_plans import HUNG, KINDS, plan
from uniart_jax.procedural.joinery import Look
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    union,
)

MAX_MOVING = 8


def board(rng: np.random.Generator) -> Material:
    """A finish for cupboards: wood with a strong grain, plain wood, or paint."""
    pick = rng.random()
    if pick < 0.24:
        return real_finishes.strong_wood(rng)
    if pick < 0.52:
        return veneer(rng)
    if pick < 0.66:
        return finishes.wood(rng)
    if pick < 0.7:
        return real_finishes.speckled(rng)
    return finishes.varied(rng, materials.paint(rng), gray=0.4, chroma=(0.7, 1.3), gain=(0.9, 1.15))


def veneer(rng: np.random.Generator) -> Material:
    """Even wood with a fine grain, from pale maple to nearly black; fronts of one sheet."""
    wood = real_finishes.strong_wood(rng)
    rgb = np.array(wood.color) * rng.uniform(0.9, 1.1)
    fine = rng.normal(0, rng.uniform(0.02, 0.09), (1, 64)) + rng.normal(0, 0.02, (64, 64))
    fine = fine + np.repeat(rng.normal(0, rng.uniform(0.0, 0.05), (8, 64)), 8, axis=0)
    image = (np.clip(rgb * (1 + fine[..., None]), 0, 0.996) * 255 + 0.5).astype(np.uint8)
    red, green, blue = (float(c) for c in np.clip(rgb, 0, 0.996))
    return Material((red, green, blue), image, wood.grain, float(rng.uniform(0.2, 1.0)))


def _pale(rng: np.random.Generator) -> Material:
    """What carcasses are made of: pale birch or white melamine."""
    if rng.random() < 0.55:
        return materials.plain(np.array([0.93, 0.83, 0.64]) * rng.uniform(0.8, 1.06))
    return finishes.white_plastic(rng)


def style(rng: np.random.Generator, unit: float, hung: bool, tall: bool) -> Look:
    """Fronts of one cupboard."""
    face = board(rng)
    if face.image is not None and rng.random() < 0.3:
        face = face.along("y" if face.grain == "z" else "z")
    pane = real_finishes.tinted_glass(rng)
    second = (face, face, face.darker(float(rng.uniform(0.6, 1.1))), board(rng), pane)
    glass = (pane, materials.glass(rng), None)[rng.choice(3, p=[0.64, 0.16, 0.2])]
    axis = rng.choice(3, p=[0.12, 0.38, 0.5])
    high = float(rng.uniform(0.05, 0.25) if hung else rng.uniform(0.75, 0.95))
    if tall or rng.random() < 0.15:
        high = float(rng.uniform(0.3, 0.7))
    panels = [0.33, 0.2, 0.15, 0.06, 0.04, 0.04, 0.06, 0.05, 0.04, 0.03]
    pulls = [0.24, 0.1, 0.17, 0.18, 0.04, 0.07, 0.2]
    return Look(
        panel=str(rng.choice(joinery.PANELS, p=panels)),
        pull=str(rng.choice(joinery.PULLS, p=pulls)),
        face=face,
        accent=second[rng.choice(5, p=[0.46, 0.28, 0.12, 0.08, 0.06])],
        glass=glass,
        hardware=materials.hardware(rng),
        inside=_pale(rng),
        thick=max(float(rng.uniform(0.015, 0.026)), float(rng.uniform(1.4, 1.9)) * unit),
        unit=unit,
        frame=max(float(rng.uniform(0.04, 0.09)), 2.5 * unit),
        length=float(rng.uniform(0.12, 0.5) if rng.random() < 0.65 else rng.uniform(0.6, 0.95)),
        thin=max(float(rng.uniform(0.008, 0.016)), 0.7 * unit),
        stand=max(float(rng.uniform(0.02, 0.045)), float(rng.uniform(1.6, 4.5)) * unit),
        turned=bool(rng.random() < 0.22),
        high=high,
        centred=bool(rng.random() < 0.65),
        axis_depth=(0.0, 1.0, float(rng.uniform(0.5, 0.95)))[axis],
        axis_inset=float(rng.choice([0.0, rng.uniform(0.2, 1.8)])) * unit,
        barrels=bool(rng.random() < 0.25),
    )


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A cupboard, metres, closed."""
    names = list(KINDS)
    kind = names[rng.choice(len(names), p=[k[-1] for k in KINDS.values()])]
    width, height, depth = (float(rng.uniform(*r)) for r in KINDS[kind][:3])
    unit = max(width, height, depth) / 100
    look = style(rng, unit, kind in HUNG, kind in ("tall", "wardrobe", "hutch"))
    if kind == "hutch" and look.panel not in ("glass", "muntins") and rng.random() < 0.6:
        look = dataclasses.replace(look, panel=str(rng.choice(["glass", "muntins"])))
    if kind == "corner":
        return _corner(rng, width, height, look)
    if kind == "frame":
        return _shelf_frame(rng, width, height, depth, look)
    low = _foot(rng, kind, height)
    roofless = kind == "base" and rng.random() < 0.5
    top = 0.0
    if kind in ("base", "low", "bench") and not roofless and rng.random() < 0.6:
        top = max(float(rng.uniform(0.018, 0.045)), 1.5 * unit)
    crown = float(rng.uniform(0.02, 0.07)) if kind == "hutch" or (
        kind in ("tall", "wardrobe", "wall") and rng.random() < 0.2) else 0.0  # fmt: skip
    z = (low, height - top - crown)
    y = (-width / 2, width / 2)
    for _ in range(50):
        cells = tuple(plan(rng, kind, width / 2, z, unit))
        framed = rng.random() < 0.4
        wall = max(float(rng.uniform(0.015, 0.022)), 1.3 * unit)
        stile = max(float(rng.uniform(0.03, 0.05)), wall) if framed else wall
        over = rng.random() < 0.55
        cab = Cabinet(
            y, z, depth, wall, 0.018 if framed else 0.002, stile,
            reveal=0.0 if over else float(rng.uniform(0.06, 0.48)) * stile,
            seam=float(rng.uniform(*((0.001, 0.003) if rng.random() < 0.75 else (0.003, 0.008)))),
            inset=bool(rng.random() < 0.14) and not any(c.kind == "sliding" for c in cells),
            cells=cells, roofless=roofless, covered=top + crown > 0,
            walled=(kind in ("base", "wall") and rng.random() < 0.06, False),
        )  # fmt: skip
        if 1 <= cab.moving <= MAX_MOVING:
            break
    if kind == "base" and all(c.kind == "drawer" for c in cab.cells):
        depth *= float(rng.uniform(1.0, 1.5))
        cab = dataclasses.replace(cab, depth=depth)
    side = look.face if rng.random() < 0.62 else (_pale(rng) if rng.random() < 0.5 else board(rng))
    edge = look.face if cab.plate > 0.01 or rng.random() < 0.6 else look.inside
    asm, body = Assembly(), Shape()
    carcass(rng, body, cab, look, side, edge)
    _stand(rng, body, kind, low, width, depth, unit, look, side)
    front = -look.thick - 0.003
    if top:
        slab = (real_finishes.speckled, real_finishes.strong_wood, materials.stone, board)[
            rng.integers(4)
        ](rng)
        slab = look.face if rng.random() < 0.4 else slab
        lip, ends = float(rng.uniform(-0.002, 0.03)), float(rng.choice([0.0, rng.uniform(0, 0.03)]))
        lo, hi = [front - lip, y[0] - ends, z[1] + 0.003], [depth, y[1] + ends, height]
        body.add(box(lo, hi), slab.along("y"))
    if crown:
        out = float(rng.uniform(0.005, 0.05))
        lo, hi = [front - out, y[0] - out, z[1] + 0.003], [depth, y[1] + out, height]
        body.add(box(lo, hi), look.face.along("y"))
    if cab.walled[0]:
        more = rng.uniform(0, 0.12, 3)
        lo, hi = [front - 0.3 * more[0], y[1], 0], [depth + more[1], y[1] + 0.018, height + more[2]]
        body.add(box(lo, hi), side)
    later = fronts(rng, body, cab, look)
    trays = pull_outs(rng, cab, look) if kind in ("base", "tall") and rng.random() < 0.18 else []
    trays += open_rooms(rng, body, cab, look, board(rng))
    if not cab.walled[0] and rng.random() < 0.12:
        end_panels(body, cab, look)
    root = asm.add("body", body)
    for call in later:
        call(asm, root)
    if len(later) + len(trays) <= MAX_MOVING:
        for call in trays:
            call(asm, root)
    return asm.object()


def _foot(rng, kind: str, height: float) -> float:
    """Height of the case's floor above the ground."""
    if kind in HUNG:
        return 0.0
    if kind == "bench":
        return float(rng.uniform(0.4, 0.65)) * height
    if kind == "base":
        return float(rng.uniform(0.08, 0.14))
    return float(rng.choice([0.0, rng.uniform(0.04, 0.12), rng.uniform(0.1, 0.2)]))


def _stand(rng, body: Shape, kind: str, low: float, width, depth, unit, look: Look, side) -> None:
    """A toe kick, a plinth or legs from the ground to the case."""
    if low < 0.01:
        return
    half = width / 2
    if kind == "bench" or (kind in ("low", "hutch") and rng.random() < 0.5):
        r = max(0.018, 1.2 * unit)
        finish = look.face if rng.random() < 0.6 else look.hardware
        for x, y in itertools.product((r, depth - r), (r - half, half - r)):
            body.add(box([x - r, y - r, 0], [x + r, y + r, low]), finish)
        if kind == "bench" and rng.random() < 0.7:  # a shelf near the ground
            z = low * float(rng.uniform(0.15, 0.4))
            body.add(
                box([2 * r, -half + 0.001, z], [depth - 0.001, half - 0.001, z + 0.02]), finish
            )
        return
    back = float(rng.uniform(0.0, 0.02) if rng.random() < 0.3 else rng.uniform(0.05, 0.1))
    ends = 0.0 if rng.random() < 0.6 else float(rng.uniform(0, 0.03))
    finish = (look.face, side, look.face.darker(0.5), materials.dark(rng))[rng.integers(4)]
    body.add(box([back, -half + ends, 0], [depth - ends, half - ends, low]), finish.along("y"))


def _corner(rng, width: float, height: float, look: Look) -> ArticulatedObject:
    """A cabinet for a corner of the room: five sides, its front across the corner."""
    half, wall = width / 2, max(0.016, 1.3 * look.unit)
    wing = float(rng.uniform(0.5, 0.9)) * width  # of the sides beside the front, seen from ahead
    reach = half + wing
    outline = np.array([[0, -half], [wing, -reach], [wing + reach, 0], [wing, reach], [0, half]])
    low = float(rng.choice([0.0, rng.uniform(0.06, 0.12)]))
    asm, body = Assembly(), Shape()
    solid = extrusion(outline, "z", [0, 0, low], height - low)
    inner = np.array([[-0.1, -half + 2 * wall], [wall, -half + 2 * wall],
                      [wing, -reach + 2.5 * wall], [wing + reach - 2.5 * wall, 0],
                      [wing, reach - 2.5 * wall], [wall, half - 2 * wall],
                      [-0.1, half - 2 * wall]])  # fmt: skip
    tall = height - wall if rng.random() < 0.6 else height + 1
    room = extrusion(inner, "z", [0, 0, low + wall], tall - low - wall)
    rail = box([0.001, wall - half, height - 2 * wall], [2 * wall, half - wall, height - 0.0005])
    side = look.face if rng.random() < 0.5 else look.inside
    body.add(union([cut(solid, [room]), rail]), side)
    for z in np.linspace(low, height, int(rng.integers(2, 4)) + 1)[1:-1]:
        shelf = extrusion(inner + [0.2, 0] * (inner[:, :1] < 0), "z", [0, 0, z], wall)
        body.add(shelf, look.inside)
    if low:
        foot = outline * 0.96 + [0.06, 0]
        body.add(extrusion(foot, "z", [0, 0, 0], low), side.darker(0.6))
    root = asm.add("body", body)
    edge = "+y" if rng.random() < 0.5 else "-y"
    front, top = -look.thick - 0.0015, height - 0.003
    start = low + 0.003
    if rng.random() < 0.25:  # two doors over each other
        middle = low + (height - low) * float(rng.uniform(0.35, 0.65))
        spans = [(start, middle - 0.0015), (middle + 0.0015, top)]
    else:
        spans = [(start, top)]
    angle = min(opening(rng), float(np.deg2rad(120)))
    for a, b in spans:
        lo, hi = [front, -half + 0.002, a], [-0.0015, half - 0.002, b]
        joinery.add_door(asm, root, lo, hi, edge, angle, look, beyond=0.002)
    return asm.object()


def _shelf_frame(rng, width: float, height: float, depth: float, look: Look) -> ArticulatedObject:
    """Shelves between posts, with a box of drawers or a box with doors somewhere among them."""
    half, r = width / 2, max(0.011, 0.9 * look.unit)
    asm, body = Assembly(), Shape()
    metal = look.hardware if rng.random() < 0.6 else look.face
    ends = (r, depth - r) if rng.random() < 0.6 else (depth / 2,)
    for x, y in itertools.product(ends, (r - half, half - r)):
        if rng.random() < 0.5:
            body.add(box([x - r, y - r, 0], [x + r, y + r, height]), metal)
        else:
            body.add(cylinder("z", [x, y, 0], height, r, segments=12), metal)
    count = int(rng.integers(4, 7))
    levels = np.linspace(0.05 * height, height * float(rng.uniform(0.9, 0.98)), count)
    filled = int(rng.integers(0, count - 1))
    thick = max(0.016, 1.1 * look.unit)
    y = (-half + 2 * r + 0.001, half - 2 * r - 0.001)
    for z in levels:
        body.add(
            box([0.0013, y[0] - 0.5 * r, z], [depth - 0.0013, y[1] + 0.5 * r, z + thick]),
            look.face.along("y"),
        )
    z = (float(levels[filled] + thick + 0.0005), float(levels[filled + 1] - 0.0005))
    if rng.random() < 0.5:
        z = (z[0], z[0] + 0.6 * (z[1] - z[0]))
    fill = str(rng.choice(["drawers", "door", "double", "flap"], p=[0.6, 0.15, 0.15, 0.1]))
    n = int(np.clip((z[1] - z[0]) / (9 * look.unit), 1, 2))
    cells = (Cell(y, z, fill),)
    if fill == "drawers":
        borders = np.linspace(*z, n + 1)
        cells = tuple(
            Cell(y, (float(a), float(b)), "drawer") for a, b in itertools.pairwise(borders)
        )
    wall = max(0.014, 1.2 * look.unit)
    cab = Cabinet(
        y,
        (z[0], z[1] - 0.003),
        depth * 0.97,
        wall,
        0.002,
        wall,
        0.0,
        0.003,
        False,
        cells,
        covered=True,
        walled=(True, True),
    )
    cells = tuple(dataclasses.replace(c, z=(c.z[0], min(c.z[1], cab.z[1]))) for c in cells)
    cab = dataclasses.replace(cab, cells=cells)
    carcass(rng, body, cab, look, look.face, look.face)
    later = fronts(rng, body, cab, look)
    root = asm.add("body", body)
    for call in later:
        call(asm, root)
    return asm.object()
