"""Cases of cupboards: frames, shelves, the fronts before their rooms, and what the rooms hold."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.procedural import joinery, materials
from uniart_jax.procedural.cabinet import Cell
from uniart_jax.procedural.joinery import Look
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Shape, box, cut, slide, tray


def opening(rng: np.random.Generator, wide: float = 0.25) -> float:
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

    def beside(self, cell: Cell, k: int) -> bool:
        """Whether a front lies beside a cell, at its left (k = 0) or right (k = 1)."""
        at, other = cell.y[1 - k], k
        return any(
            abs(c.y[other] - at) < 1e-6
            and c.kind not in ("open", "blank")
            and min(c.z[1], cell.z[1]) - max(c.z[0], cell.z[0]) > 1e-6
            for c in self.cells
        )

    def outer(self, cell: Cell) -> tuple[bool, bool]:
        """Whether a cell touches the left (+y) and right (-y) end."""
        return cell.y[1] > self.y[1] - 1e-6, cell.y[0] < self.y[0] + 1e-6


def carcass(rng, body: Shape, cab: Cabinet, look: Look, side: Material, edge: Material) -> None:
    """Sides, frame, shelves and dividers; lined with ``look.inside``."""
    skin = 0.003
    (y0, y1), (z0, z1) = cab.y, cab.z
    holes, gaps, boards = [], [], Shape()
    panes = look.face if look.glass is None else look.glass
    slabs = (look.inside, look.inside, look.face, panes)[rng.choice(4, p=[0.4, 0.2, 0.25, 0.15])]
    for cell in cab.cells:
        closed = cell.kind in ("blank", "false")
        a, b = cab.bay(cell, cab.stile)
        start = cab.plate - 1e-3
        if cell.kind == "false" and cab.inset and (b - a)[1:].min() > 0:  # stands in a pocket
            pocket = box([-0.1, *a[1:]], [look.thick, *b[1:]])
            holes.append(pocket)
            gaps.append(pocket)
            start = look.thick + 0.008
        if closed and not (cab.roofless and cell.z[1] > z1 - 1e-6):
            continue  # a room without an opening would be a hole in the solid
        lo, hi = cab.bay(cell, cab.wall)
        if (hi - lo).min() < 0.02:
            continue
        if not closed and (b - a)[1:].min() < 0.03:
            continue
        holes.append(box([start, *lo[1:]], hi))
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
    count = int(
        np.clip(rng.integers(0, 3) + (height > 0.9) + (height > 1.5), 0, height / least - 1)
    )
    back = max(0.05, float(rng.uniform(0.05, 0.3)) * cab.depth)
    start = back if cell.kind != "open" else cab.plate + float(rng.choice([0.001, 0.03]))
    for z in np.linspace(lo[2], hi[2], count + 2)[1:-1]:
        boards.add(box([start, lo[1], z - thick / 2], [hi[0], hi[1], z + thick / 2]), material)


def fronts(rng, body: Shape, cab: Cabinet, look: Look) -> list:
    """Fronts that stay go onto the body; what is returned adds the others to its part."""
    later = []
    swing, lift = opening(rng), "+z" if rng.random() < 0.75 else "-z"
    shallow, short = rng.random(2) < 0.3
    drawers = {
        "deep": float(rng.uniform(0.6, 0.88) if shallow else rng.uniform(0.88, 1.0)),
        "fill": float(rng.uniform(0.5, 0.95)),
        "travel": float(rng.uniform(0.45, 0.7) if short else rng.uniform(0.7, 0.97)),
    }
    plain = "slab" if look.panel in ("arched", "glass", "muntins", "planks", "split") else None
    if look.panel in ("glass", "muntins") and rng.random() < 0.5:
        plain = "shaker"
    pulls = 1.0 if rng.random() < 0.9 else 0.6  # share of doors that have theirs
    sides = rng.choice(["+y", "-y"], len(cab.cells))
    if rng.random() < 0.6:
        sides[:] = sides[0]
    across = look
    if rng.random() < 0.25:  # drawers' grain runs across
        face = look.face.along("y")
        accent = face if look.accent is look.face else look.accent
        across = dataclasses.replace(look, face=face, accent=accent)
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
            rear = hi + [0.0 if cab.inset else 0.0015, 0, 0]
            body.join(joinery.front(lo, rear, across, "+z", plain, bool(rng.random() < 0.15)))
        elif cell.kind == "drawer":
            later.append(
                _later(joinery.add_drawer, lo, hi, bay_lo, bay_hi, across, kind=plain, **drawers)
            )
        elif cell.kind == "flap":
            below = cell.z[1] < cab.z[1] - 1e-6 if lift == "+z" else cell.z[0] > cab.z[0] + 1e-6
            covered = cab.covered and lift == "+z"
            tight = cab.inset or below or covered
            angle = float(np.deg2rad(rng.uniform(75, 90 if covered else 110)))
            options = {"name": "flap", "tight": tight, "beyond": air + 0.004}
            later.append(_later(joinery.add_door, lo, hi, lift, angle, look, **options))
        elif cell.kind == "sliding":
            later += _sliding(rng, body, cab, look, lo, hi)
        elif cell.kind in ("door", "half", "double"):
            if cell.kind == "half":
                rest = (lo, hi + [0.0015, 0, 0]) if not cab.inset else (
                    np.array([0.0, *bay_lo[1:]]), np.array([look.thick, *bay_hi[1:]])
                )  # fmt: skip
                lo, hi, side, outer = _half(rng, body, cab, look, (lo, hi), rest, str(side))
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
                room = cell.kind != "half" and not cab.inset and not cab.beside(cell, k)
                tight = not free and (cab.walled[k] or not room)
                angle = swing
                if not free:
                    angle = min(swing, float(np.deg2rad(89 if cab.walled[k] else 105)))
                options = {"tight": tight, "beyond": air if free else 1.0}
                options["pulled"] = rng.random() < pulls
                later.append(_later(joinery.add_door, a, b, edge, angle, look, **options))
    return later


def _later(make, *args, **options):
    """A call of ``make`` that waits for its parent part."""
    return lambda asm, root: make(asm, root, *args, **options)


def _half(rng, body: Shape, cab: Cabinet, look: Look, span, room, side: str):
    """A door before a share of the room, hung at the case's outer edge; the rest stays open or has
    a board that looks like a second door, and may then carry the door.

    Args:
      span: corners of a front before the whole room. room: corners of a board that would fill it.
      side: the edge the door turns about where it may choose.

    Returns:
      The door's corners and hinged edge, and whether it touches the left and the right end.
    """
    (lo, hi), (start, end) = span, (room[0].copy(), room[1].copy())
    at = lo[1] + (hi[1] - lo[1]) * float(rng.uniform(0.42, 0.7))
    left = rng.random() < 0.5
    if left:
        lo, end[1] = np.array([lo[0], at + cab.seam, lo[2]]), at
    else:
        hi, start[1] = np.array([hi[0], at, hi[2]]), at + cab.seam
    board = rng.random() < 0.6
    if board:
        kind = look.panel if rng.random() < 0.6 else "slab"
        body.join(joinery.panel(start, end, look, kind))
    else:
        side = "+y" if left else "-y"
    return lo, hi, side, (left, not left)


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


def pull_outs(rng, cab: Cabinet, look: Look) -> list:
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


def open_rooms(rng, body: Shape, cab: Cabinet, look: Look, other: Material) -> list:
    """What open rooms hold: boards that pull out, and baskets, books and lattices that do not."""
    calls = []
    for cell in cab.cells:
        lo, hi = cab.bay(cell, max(cab.stile, cab.wall))
        lo[0] = cab.plate + 0.004
        size, wall = hi - lo, max(0.01, 1.2 * look.unit)
        if cell.kind != "open" or size[1] < 0.2 or size[2] < 0.15:
            continue
        pick = rng.random()
        floor = lo[2] + 0.0005
        tall = float(rng.uniform(0.25, 0.7)) * min(size[2], 0.2)
        if pick < 0.12:  # pulls out
            tall = max(2.2 * wall, float(rng.uniform(0.02, 0.12)))
            a, b = lo + [0, 0.006, 0.006], np.array([hi[0] - 0.01, hi[1] - 0.006, floor + tall])
            joint = slide((-1, 0, 0), float(rng.uniform(0.5, 0.85)) * (b[0] - a[0]))
            finish = look.inside if rng.random() < 0.5 else look.hardware
            shape = Shape().add(tray(a, b, wall), finish)
            calls.append(lambda asm, root, s=shape, j=joint: asm.add("tray", s, root, j, "drawer"))
        elif pick < 0.3:  # baskets or boxes side by side, that look like drawers
            count = int(np.clip(size[1] / rng.uniform(0.2, 0.4), 1, 4))
            finish = other
            for a, b in itertools.pairwise(np.linspace(lo[1], hi[1], count + 1)):
                solid = tray(
                    [lo[0] + 0.02, a + 0.012, floor], [hi[0] - 0.03, b - 0.012, floor + tall], wall
                )
                body.add(solid, finish)
        elif pick < 0.42:  # books
            y, tones = lo[1] + 0.01, [materials.plain(rng.uniform(0.1, 0.9, 3)) for _ in range(3)]
            while y < hi[1] - 0.08 and rng.random() < 0.93:
                thick = float(rng.uniform(0.02, 0.05))
                top = floor + tall * float(rng.uniform(0.7, 1.0))
                body.add(
                    box([lo[0] + 0.03, y, floor], [hi[0] - 0.05, y + thick, top]),
                    tones[rng.integers(3)],
                )
                y += thick + 0.002
    return calls


def end_panels(body: Shape, cab: Cabinet, look: Look) -> None:
    """Panels like doors on the sides, which do not move."""
    thick, margin = 0.6 * look.thick, 0.01
    y1, z = cab.y[1], cab.z
    start = look.thick + margin  # clear of doors that turn right round
    if cab.depth < 0.25 or look.panel in ("glass", "muntins"):
        return
    low, high = [0, start, z[0] + margin], [thick, cab.depth - margin, z[1] - margin]
    for sign in (1, -1):  # made facing -x; turned to face +y, or -y
        turn = np.eye(4)
        turn[:2, :2] = [[0, sign], [-sign, 0]]
        turn[:2, 3] = [0.0 if sign > 0 else cab.depth + start - margin, sign * (y1 + thick)]
        body.join(joinery.panel(low, high, look).moved(turn))
