"""Kitchen base, wall and tall cabinets, wardrobes, hutches and shelf frames: fronts that hardly
show their gaps, and much that looks as if it moved and does not."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import finishes, joinery, materials, real_finishes
from uniart_jax.procedural.cupboard_plans import HUNG, KINDS, Cell, plan
from uniart_jax.procedural.joinery import Look
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    slide,
    tray,
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
    second = (face, face, face.darker(float(rng.uniform(0.6, 1.1))), board(rng))
    axis = rng.choice(3, p=[0.35, 0.4, 0.25])
    high = float(rng.uniform(0.05, 0.25) if hung else rng.uniform(0.75, 0.95))
    if tall or rng.random() < 0.15:
        high = float(rng.uniform(0.3, 0.7))
    panels = [0.34, 0.2, 0.15, 0.06, 0.04, 0.05, 0.06, 0.05, 0.05]
    pulls = [0.24, 0.1, 0.17, 0.18, 0.04, 0.07, 0.2]
    return Look(
        panel=str(rng.choice(joinery.PANELS, p=panels)),
        pull=str(rng.choice(joinery.PULLS, p=pulls)),
        face=face,
        accent=second[rng.choice(4, p=[0.5, 0.3, 0.12, 0.08])],
        glass=real_finishes.tinted_glass(rng) if rng.random() < 0.8 else materials.glass(rng),
        hardware=materials.hardware(rng),
        inside=_pale(rng),
        thick=max(float(rng.uniform(0.015, 0.026)), float(rng.uniform(1.4, 1.9)) * unit),
        unit=unit,
        frame=max(float(rng.uniform(0.04, 0.09)), 2.5 * unit),
        length=float(rng.uniform(0.12, 0.5) if rng.random() < 0.65 else rng.uniform(0.6, 0.95)),
        thin=max(float(rng.uniform(0.008, 0.016)), 0.7 * unit),
        stand=max(float(rng.uniform(0.02, 0.045)), 1.6 * unit),
        turned=bool(rng.random() < 0.22),
        high=high,
        centred=bool(rng.random() < 0.65),
        axis_depth=(0.0, 1.0, float(rng.uniform(0.2, 0.9)))[axis],
        axis_inset=float(rng.choice([0.0, rng.uniform(0.2, 1.8)])) * unit,
        barrels=bool(rng.random() < 0.25),
    )


def _angle(rng: np.random.Generator, wide: float = 0.25) -> float:
    """How far doors open: a right angle, a little more, or right round."""
    if rng.random() < wide:
        return float(np.deg2rad(180 if rng.random() < 0.6 else rng.uniform(115, 178)))
    return float(np.deg2rad(90 if rng.random() < 0.6 else rng.uniform(85, 110)))


@dataclasses.dataclass(frozen=True)
class Cabinet:
    """A case with its front at x = 0 (metres).

    Attributes:
      y, z: its extent. depth, wall: of the case. plate: thickness of the frame before it.
      stile: width of that frame, at least ``wall``. reveal: how much of it fronts leave free.
      seam: air between fronts. inset: fronts stand inside the frame.
      roofless: open at the top, as those are that go under a worktop. covered: a board lies over
        the fronts' upper edge.
      walled: a panel stands before the fronts at its left, right end.
    """

    y: tuple[float, float]
    z: tuple[float, float]
    depth: float
    wall: float
    plate: float
    stile: float
    reveal: float
    seam: float
    inset: bool
    cells: tuple[Cell, ...]
    roofless: bool = False
    covered: bool = False
    walled: tuple[bool, bool] = (False, False)

    @property
    def moving(self) -> int:
        """How many fronts will move."""
        still = {"open": 0, "blank": 0, "false": 0, "double": 2, "sliding": 2}
        return sum(still.get(c.kind, 1) for c in self.cells)

    def bay(self, cell: Cell, wall: float) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the room behind a cell: full walls outside, half a wall to neighbours."""
        lo, hi = [0.0] * 3, [self.depth - self.wall, 0.0, 0.0]
        for axis, (a, b), (first, last) in ((1, cell.y, self.y), (2, cell.z, self.z)):
            lo[axis] = a + (wall if a < first + 1e-6 else wall / 2)
            hi[axis] = b - (wall if b > last - 1e-6 else wall / 2)
        return np.array(lo), np.array(hi)

    def outer(self, cell: Cell) -> tuple[bool, bool]:
        """Whether a cell touches the left (+y) and right (-y) end."""
        return cell.y[1] > self.y[1] - 1e-6, cell.y[0] < self.y[0] + 1e-6


def _carcass(rng, body: Shape, cab: Cabinet, look: Look, side: Material, edge: Material) -> None:
    """Sides, frame, shelves and dividers; lined with ``look.inside``."""
    skin = 0.003
    (y0, y1), (z0, z1) = cab.y, cab.z
    holes, gaps, boards = [], [], Shape()
    slabs = (look.inside, look.inside, look.face, look.glass)[rng.choice(4, p=[0.4, 0.2, 0.25, 0.15])]
    for cell in cab.cells:
        closed = cell.kind in ("blank", "false")
        if closed and not (cab.roofless and cell.z[1] > z1 - 1e-6):
            continue  # a room without an opening would be a hole in the solid
        lo, hi = cab.bay(cell, cab.wall)
        if (hi - lo).min() < 0.02:
            continue
        a, b = cab.bay(cell, cab.stile)
        if not closed and (b - a)[1:].min() < 0.03:
            continue
        holes.append(box([cab.plate - 1e-3, *lo[1:]], hi))
        if not closed:
            gaps.append(box([-0.1, *a[1:]], [cab.plate + 0.1, *b[1:]]))
        if cell.kind in ("door", "double", "half", "open", "sliding", "flap"):
            _shelves(rng, boards, cab, cell, lo, hi, slabs)
    block = box([cab.plate, y0 + skin, z0], [cab.depth, y1 - skin, z1])
    if cab.roofless:
        rail = float(rng.uniform(0.04, 0.11))
        roof = [cab.depth - rail, y1 - cab.wall, z1 + 1]
        holes.append(box([rail, y0 + cab.wall, z1 - 1.5 * cab.wall], roof))
    body.add(cut(block, holes), look.inside)
    for a, b in ((y0, y0 + skin), (y1 - skin, y1)):
        body.add(box([cab.plate, a, z0], [cab.depth, b, z1]), side)
    if not cab.roofless:
        body.add(box([cab.plate, y0, z1], [cab.depth, y1, z1 + skin]), side.along("y"))
    head = z1 + (0.0 if cab.roofless else skin)
    body.add(cut(box([0, y0, z0], [cab.plate, y1, head]), gaps), edge)
    body.join(boards)


def _shelves(rng, boards: Shape, cab: Cabinet, cell: Cell, lo, hi, material) -> None:
    """Shelves of one room; they stand back behind fronts."""
    height = hi[2] - lo[2]
    thick = max(0.8 * cab.wall, 0.014)
    least = 0.15 if cell.kind == "open" else 0.25
    count = int(np.clip(rng.integers(0, 3) + (height > 0.9) + (height > 1.5), 0, height / least - 1))
    back = max(0.05, float(rng.uniform(0.05, 0.3)) * cab.depth)
    start = back if cell.kind != "open" else cab.plate + float(rng.choice([0.001, 0.03]))
    for z in np.linspace(lo[2], hi[2], count + 2)[1:-1]:
        boards.add(box([start, lo[1], z - thick / 2], [hi[0], hi[1], z + thick / 2]), material)


def _fronts(rng, asm: Assembly, body: Shape, cab: Cabinet, look: Look) -> list:
    """Fronts that stay go onto the body; what is returned adds the others to its part."""
    later = []
    swing, lift = _angle(rng), "+z" if rng.random() < 0.75 else "-z"
    drawers = {"deep": float(rng.uniform(0.6, 1.0)), "fill": float(rng.uniform(0.5, 0.95)),
               "travel": float(rng.uniform(0.45, 0.95))}  # fmt: skip
    plain = "slab" if look.panel in ("arched", "glass", "muntins", "planks") else None
    if look.panel in ("glass", "muntins") and rng.random() < 0.5:
        plain = "shaker"
    sides = rng.choice(["+y", "-y"], len(cab.cells))
    if rng.random() < 0.6:
        sides[:] = sides[0]
    for cell, side in zip(cab.cells, sides, strict=True):
        bay_lo, bay_hi = cab.bay(cell, cab.stile)
        if cab.inset:
            a, b = cab.bay(cell, cab.stile)
            air = max(0.002, cab.seam / 2) + look.thick**2 / (2 * float((b - a)[1:].min()))
            lo, hi = a + [0, air, air], b - [0, air, air]
            lo[0], hi[0] = 0.0, look.thick
            bay_lo[0] = look.thick
        else:
            air = cab.seam / 2 + cab.reveal
            lo = np.array([-look.thick - 0.0015, cell.y[0] + air, cell.z[0] + air])
            hi = np.array([-0.0015, cell.y[1] - air, cell.z[1] - air])
        if (hi - lo).min() < 0.01:
            continue
        outer = cab.outer(cell)
        if cell.kind == "false":
            body.join(joinery.front(lo, hi + [0.0 if cab.inset else 0.0015, 0, 0], look, "+z", plain,
                                    bool(rng.random() < 0.15)))  # fmt: skip
        elif cell.kind == "drawer":
            later.append(_later(joinery.add_drawer, lo, hi, bay_lo, bay_hi, look, kind=plain, **drawers))
        elif cell.kind == "flap":
            below = cell.z[1] < cab.z[1] - 1e-6 if lift == "+z" else cell.z[0] > cab.z[0] + 1e-6
            tight = cab.inset or below or (cab.covered and lift == "+z")
            angle = float(np.deg2rad(rng.uniform(75, 110)))
            options = {"name": "flap", "tight": tight, "beyond": air}
            later.append(_later(joinery.add_door, lo, hi, lift, angle, look, **options))
        elif cell.kind == "sliding":
            later += _sliding(rng, body, cab, look, lo, hi)
        elif cell.kind in ("door", "half", "double"):
            if cell.kind == "half":
                lo, hi, outer = _half(rng, body, cab, look, lo, hi, str(side), outer)
            if sum(outer) == 1 and rng.random() < 0.8 and cell.kind == "door":
                side = "+y" if outer[0] else "-y"
            doors = [(str(side), lo, hi)]
            if cell.kind == "double":
                middle = (lo[1] + hi[1]) / 2
                doors = [("+y", np.array([lo[0], middle + cab.seam / 2, lo[2]]), hi),
                         ("-y", lo, np.array([hi[0], middle - cab.seam / 2, hi[2]]))]  # fmt: skip
            for edge, a, b in doors:
                k = 0 if edge == "+y" else 1
                free = outer[k] and not cab.inset and not cab.walled[k]
                angle = swing if free else min(swing, float(np.deg2rad(95 if cab.walled[k] else 105)))
                options = {"tight": not free, "beyond": air}
                later.append(_later(joinery.add_door, a, b, edge, angle, look, **options))
    return later


def _later(make, *args, **options):
    """A call of ``make`` that waits for its parent part."""
    return lambda asm, root: make(asm, root, *args, **options)


def _half(rng, body: Shape, cab: Cabinet, look: Look, lo, hi, side: str, outer):
    """A door before a share of the room; the rest stays open or has a board that looks like a
    second door."""
    share = float(rng.uniform(0.42, 0.7))
    at = lo[1] + (hi[1] - lo[1]) * share
    one, two = (lo, np.array([hi[0], at, hi[2]])), (np.array([lo[0], at + cab.seam, lo[2]]), hi)
    left = rng.random() < 0.5
    door, rest = (two, one) if left else (one, two)
    if rng.random() < 0.6:
        kind = look.panel if rng.random() < 0.6 else "slab"
        body.join(joinery.panel(rest[0], rest[1] + [0.0 if cab.inset else 0.0015, 0, 0], look, kind))
    return door[0], door[1], ((outer[0], False) if left else (False, outer[1]))


def _sliding(rng, body: Shape, cab: Cabinet, look: Look, lo, hi) -> list:
    """Two doors, one before the other, between rails; sometimes one of them is fixed."""
    over, thick, air = float(rng.uniform(0.015, 0.05)), look.thick, 0.002
    middle, rail = (lo[1] + hi[1]) / 2, max(0.012, 1.2 * look.unit)
    near = lo[0] - thick - air
    for z in (lo[2] - 0.002, hi[2] + 0.002 - rail):
        body.add(box([near - air, cab.y[0], z], [0, cab.y[1], z + rail]), look.face.along("y"))
    lo, hi = lo + [0, 0, rail], hi - [0, 0, rail]
    still, slim = (int(rng.integers(2)) if rng.random() < 0.3 else -1), dataclasses.replace(
        look, pull=str(rng.choice(["none", "none", "square"])), stand=0.8 * thick
    )  # fmt: skip
    calls, before = [], bool(rng.random() < 0.5)
    for k, (a, b) in enumerate(((middle - over, hi[1]), (lo[1], middle + over))):
        x = near if (k == 0) == before else lo[0]
        a_lo, a_hi = np.array([x, a, lo[2]]), np.array([x + thick, b, hi[2]])
        shape = joinery.front(a_lo, a_hi, slim, "+y" if k == 0 else "-y", None, x == near)
        travel = (hi[1] - lo[1]) - (b - a) - 0.002
        joint = slide((0, -1 if k == 0 else 1, 0), travel * float(rng.uniform(0.8, 1.0)))
        if k == still:
            joint = None
            body.join(shape)
        else:
            calls.append(lambda asm, root, s=shape, j=joint: asm.add("door", s, root, j))
    return calls


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A cupboard, metres, closed."""
    names = list(KINDS)
    kind = names[rng.choice(len(names), p=[k[-1] for k in KINDS.values()])]
    width, height, depth = (float(rng.uniform(*r)) for r in KINDS[kind][:3])
    unit = max(width, height, depth) / 100
    look = style(rng, unit, kind in HUNG, kind in ("tall", "wardrobe", "hutch"))
    if kind == "hutch" and look.panel not in ("glass", "muntins") and rng.random() < 0.6:
        look = dataclasses.replace(look, panel=str(rng.choice(["glass", "muntins"])))
    special = {"corner": _corner, "frame": _shelf_frame}
    if kind in special:
        return special[kind](rng, width, height, depth, look)
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
            reveal=0.0 if over else float(rng.uniform(0.1, 0.8)) * (stile if framed else wall) * 0.6,
            seam=float(rng.uniform(0.001, 0.003) if rng.random() < 0.75 else rng.uniform(0.003, 0.008)),
            inset=bool(rng.random() < 0.14) and not any(c.kind == "sliding" for c in cells),
            cells=cells, roofless=roofless, covered=top + crown > 0,
            walled=(kind in ("base", "wall") and rng.random() < 0.06, False),
        )  # fmt: skip
        if 1 <= cab.moving <= MAX_MOVING:
            break
    if cab.inset:
        look = dataclasses.replace(look, barrels=look.barrels and cab.inset)
    side = look.face if rng.random() < 0.62 else (_pale(rng) if rng.random() < 0.5 else board(rng))
    edge = look.face if cab.plate > 0.01 or rng.random() < 0.6 else look.inside
    asm, body = Assembly(), Shape()
    _carcass(rng, body, cab, look, side, edge)
    _stand(rng, body, kind, low, width, depth, unit, look, side)
    front = -look.thick - 0.003
    if top:
        slab = (real_finishes.speckled, real_finishes.strong_wood, materials.stone, board)[rng.integers(4)](rng)
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
    later = _fronts(rng, asm, body, cab, look)
    trays = _trays(rng, cab, look) if kind in ("base", "tall") and rng.random() < 0.18 else []
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
            if rng.random() < 2:
                body.add(box([x - r, y - r, 0], [x + r, y + r, low]), finish)
        if kind == "bench" and rng.random() < 0.7:  # a shelf near the ground
            z = low * float(rng.uniform(0.15, 0.4))
            body.add(box([2 * r, -half + 0.001, z], [depth - 0.001, half - 0.001, z + 0.02]), finish)
        return
    back = float(rng.uniform(0.0, 0.02) if rng.random() < 0.3 else rng.uniform(0.05, 0.1))
    ends = 0.0 if rng.random() < 0.6 else float(rng.uniform(0, 0.03))
    finish = (look.face, side, look.face.darker(0.5), materials.dark(rng))[rng.integers(4)]
    body.add(box([back, -half + ends, 0], [depth - ends, half - ends, low]), finish.along("y"))


def _trays(rng, cab: Cabinet, look: Look) -> list:
    """Pull-outs on the floors of rooms behind doors, one or two beside each other."""
    calls = []
    for cell in cab.cells:
        if cell.kind not in ("door", "double") or cell.z[1] - cell.z[0] < 0.3:
            continue
        lo, hi = cab.bay(cell, max(cab.stile, cab.wall))
        wall = max(0.012, 1.4 * look.unit)
        x = (look.thick if cab.inset else 0.0) + 0.012
        tall = float(rng.uniform(0.05, 0.12))
        edges = [lo[1], hi[1]]
        if cell.kind == "double" and rng.random() < 0.7:
            edges = [lo[1], (lo[1] + hi[1]) / 2, hi[1]]
        base = lo[2] + 0.006 + float(rng.choice([0.0, 0.02]))
        length = (hi[0] - x) * float(rng.uniform(0.8, 0.97))
        for a, b in itertools.pairwise(edges):
            solid = tray([x, a + 0.012, base], [x + length, b - 0.012, base + tall], wall)
            joint = slide((-1, 0, 0), length * float(rng.uniform(0.6, 0.9)))
            shape = Shape().add(solid, look.inside)
            calls.append(lambda asm, root, s=shape, j=joint: asm.add("tray", s, root, j, "drawer"))
    return calls


def _corner(rng, width: float, height: float, depth: float, look: Look) -> ArticulatedObject:
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
    rail = box([0, -half, height - 2 * wall], [2 * wall, half, height])
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
    angle = min(_angle(rng), float(np.deg2rad(120)))
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
        body.add(box([0, y[0] - 0.5 * r, z], [depth, y[1] + 0.5 * r, z + thick]), look.face.along("y"))
    z = (float(levels[filled] + thick + 0.0005), float(levels[filled + 1] - 0.0005))
    if rng.random() < 0.5:
        z = (z[0], z[0] + 0.6 * (z[1] - z[0]))
    fill = str(rng.choice(["drawers", "door", "double", "flap"], p=[0.6, 0.15, 0.15, 0.1]))
    n = int(np.clip((z[1] - z[0]) / (9 * look.unit), 1, 2))
    cells = (Cell(y, z, fill),)
    if fill == "drawers":
        borders = np.linspace(*z, n + 1)
        cells = tuple(Cell(y, (float(a), float(b)), "drawer") for a, b in itertools.pairwise(borders))
    wall = max(0.014, 1.2 * look.unit)
    cab = Cabinet(y, (z[0], z[1] - 0.003), depth * 0.97, wall, 0.002, wall, 0.0, 0.003, False, cells, covered=True)
    cells = tuple(dataclasses.replace(c, z=(c.z[0], min(c.z[1], cab.z[1]))) for c in cells)
    cab = dataclasses.replace(cab, cells=cells)
    _carcass(rng, body, cab, look, look.face, look.face)
    later = _fronts(rng, asm, body, cab, look)
    root = asm.add("body", body)
    for call in later:
        call(asm, root)
    return asm.object()
