"""Cases divided into cells, and the fronts that close the cells: the body of storage furniture and
of desks' pedestals."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural.fronts import FrontStyle, add_door, add_drawer
from uniart_jax.procedural.hinges import opening
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, slide, tray


@dataclasses.dataclass(frozen=True)
class Cell:
    """A rectangle of the front and what fills it: 'door', 'double', 'flap', 'drawer', 'open',
    'blank' (a board that stays); in cupboards also 'sliding', 'false' (a front that stays) or
    'half' (one door before half of the room).

    ``trays``: pull-outs behind its doors; behind double doors an even number may stand in two
    columns.
    """

    y: tuple[float, float]
    z: tuple[float, float]
    kind: str
    trays: int = 0


def room_behind(
    y: tuple[float, float],
    z: tuple[float, float],
    sides: tuple[float, float],
    ends: tuple[float, float],
    x: tuple[float, float],
    wall: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the room behind a rectangle (y, z) of a front from ``x[0]`` to ``x[1]``: full
    walls at the case's ``sides`` and ``ends``, half a wall towards neighbours."""
    lo, hi = np.array([x[0], 0.0, 0.0]), np.array([x[1], 0.0, 0.0])
    for axis, (a, b), (first, last) in ((1, y, sides), (2, z, ends)):
        lo[axis] = a + (wall if a < first + 1e-6 else wall / 2)
        hi[axis] = b - (wall if b > last - 1e-6 else wall / 2)
    return lo, hi


@dataclasses.dataclass(frozen=True)
class Fit:
    """How fronts sit on their case: shared by all fronts of an object.

    Attributes:
      inset: fronts stand inside their bays, flush with the case; else they lie on it.
      seam: air between neighbouring fronts, metres.
      reveal: how much of the case shows around each front that lies on it, metres.
      swing: widest opening of doors, radians.
      fill: share of a bay's height that a drawer's box takes.
      pull: share of its depth by which a drawer opens.
      deep: share of its bay's depth that a drawer takes.
      centered: drawer handles in the middle of the front, else near its top.
      flap: hinge edge of flaps.
      alternate: which way doors on inner columns turn.
    """

    inset: bool
    seam: float
    reveal: float
    swing: float
    fill: float
    pull: float
    deep: float
    centered: bool
    flap: str
    alternate: bool

    @classmethod
    def draw(cls, rng: np.random.Generator, unit: float, wall: float) -> Fit:
        """A plausible fit; ``unit``: one percent of the object's longest side, ``wall``: of the
        case, metres."""
        reaches = ((0.45, 0.75), (0.75, 0.95), (0.93, 1.0))[rng.choice(3, p=[0.1, 0.38, 0.52])]
        return cls(
            inset=bool(rng.random() < 0.3),
            seam=max(0.003, float(rng.uniform(0.35, 0.9)) * unit),
            reveal=0.0 if rng.random() < 0.5 else float(rng.uniform(0.15, 0.45)) * wall,
            swing=opening(rng),
            fill=float(rng.uniform(0.5, 0.95)),
            pull=float(rng.uniform(0.45, 0.8) if rng.random() < 0.5 else rng.uniform(0.8, 0.97)),
            deep=float(rng.uniform(*reaches)),
            centered=bool(rng.random() < 0.7),
            flap=str(rng.choice(["+z", "-z"])),
            alternate=bool(rng.random() < 0.5),
        )


@dataclasses.dataclass(frozen=True)
class Case:
    """A hollow box with its front at x = ``front``, divided into cells (metres); ``covered``: a top
    lies over its front's upper edge."""

    y: tuple[float, float]
    z: tuple[float, float]
    front: float
    depth: float
    wall: float
    cells: tuple[Cell, ...]
    covered: bool = False

    @property
    def moving(self) -> int:
        """How many parts will move."""
        return sum(
            {"open": 0, "blank": 0, "double": 2}.get(c.kind, 1) + c.trays for c in self.cells
        )

    def bay(self, cell: Cell) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the room behind a cell (``room_behind``)."""
        x = (self.front, self.front + self.depth - self.wall)
        return room_behind(cell.y, cell.z, self.y, self.z, x, self.wall)

    def solid(self, rng: np.random.Generator) -> Manifold:
        """The case with its bays and shelves."""
        holes = [hole for cell in self.cells for hole in self._holes(rng, cell)]
        front, back = self.front, self.front + self.depth
        return cut(box([front, self.y[0], self.z[0]], [back, self.y[1], self.z[1]]), holes)

    def _holes(self, rng: np.random.Generator, cell: Cell) -> list[Manifold]:
        """What to cut from the case for a cell: its bay, left in pieces where shelves run."""
        if cell.kind == "blank":
            return []
        lo, hi = self.bay(cell)
        if (hi - lo).min() <= 0:  # lower than its walls: nothing is left to cut
            return []
        height, shelf, outside = hi[2] - lo[2], max(0.8 * self.wall, 0.016), self.front - 0.1
        count = 0
        if cell.kind in ("open", "door", "double") and not cell.trays:
            count = int(np.clip(rng.integers(0, 3) + (height > 0.9), 0, int(height / 0.25)))
        borders = np.linspace(lo[2], hi[2], count + 2)
        holes = []
        for i, (a, b) in enumerate(itertools.pairwise(borders)):
            a, b = a + (shelf / 2 if i else 0), b - (shelf / 2 if i < count else 0)
            holes.append(box([outside, lo[1], a], [hi[0], hi[1], b]))
        if (
            count and cell.kind != "open"
        ):  # shelves stand back behind fronts, clear of an inset door
            recess = max(0.06, float(rng.uniform(0.05, 0.3)) * self.depth)
            holes.append(box([outside, lo[1], lo[2]], [self.front + recess, hi[1], hi[2]]))
        return holes

    def add_fronts(
        self, rng: np.random.Generator, asm: Assembly, root: int, look: FrontStyle, fit: Fit
    ) -> None:
        """Add the doors, flaps and drawers of all cells as children of part ``root``."""
        fronts = [cell for cell in self.cells if cell.kind not in ("open", "blank")]
        if fit.inset and not all(self._fits(cell, look, fit) for cell in fronts):
            fit = dataclasses.replace(fit, inset=False, reveal=0.0)
        for i, cell in enumerate(self.cells):
            if cell.kind in ("open", "blank"):
                continue
            bay_lo, bay_hi = self.bay(cell)
            thick = look.thickness
            if fit.inset:
                air = self._air(cell, look)
                lo = np.array([self.front, bay_lo[1] + air, bay_lo[2] + air])
                hi = np.array([self.front + thick, bay_hi[1] - air, bay_hi[2] - air])
            else:
                air = fit.seam / 2 + fit.reveal
                lo = np.array([self.front - thick - 0.002, cell.y[0] + air, cell.z[0] + air])
                hi = np.array([self.front - 0.002, cell.y[1] - air, cell.z[1] - air])
            if cell.kind == "drawer":
                add_drawer(
                    asm, root, lo, hi, bay_lo, bay_hi, fit.pull, look, fill=fit.fill, depth=fit.deep, center=fit.centered,  # noqa: E501
                    kind="slab" if look.panel in ("glass", "slats") else None,
                )  # fmt: skip
            elif cell.kind == "flap":
                angle = opening(rng, 0.0 if self.covered or fit.inset else 0.1)
                tight = fit.inset or (self.covered and fit.flap == "+z")
                add_door(
                    asm, root, lo, hi, fit.flap, angle, look, name="flap", inset=tight, beyond=1.0
                )  # fmt: skip
            elif cell.kind == "double":
                middle, half = (lo[1] + hi[1]) / 2, fit.seam / 2
                for edge, a, b in (("+y", middle + half, hi[1]), ("-y", lo[1], middle - half)):
                    angle = self._swing(edge, cell, fit)
                    corners = [lo[0], a, lo[2]], [hi[0], b, hi[2]]
                    add_door(
                        asm, root, *corners, edge, angle, look, inset=fit.inset,
                        beyond=self._beyond(edge, cell, air),
                    )  # fmt: skip
            else:
                edge = self._hinge_edge(rng, cell, fit, i)
                angle = self._swing(edge, cell, fit)
                beyond = self._beyond(edge, cell, air)
                add_door(asm, root, lo, hi, edge, angle, look, inset=fit.inset, beyond=beyond)
            if cell.trays:
                self._add_trays(rng, asm, root, cell, look, fit)

    def _opening(self, cell: Cell) -> tuple[float, float]:
        """Width and height of a bay's opening, metres."""
        lo, hi = self.bay(cell)
        return float(hi[1] - lo[1]), float(hi[2] - lo[2])

    def _air(self, cell: Cell, look: FrontStyle) -> float:
        """Gap between a bay and a front inside it, metres: the far corner of what turns sweeps a
        wider arc."""
        smaller = max(min(self._opening(cell)), 1e-3)
        arc = 0.0 if cell.kind == "drawer" else look.thickness**2 / smaller
        return max(0.003, 0.3 * look.unit) + arc

    def _fits(self, cell: Cell, look: FrontStyle, fit: Fit) -> bool:
        """Whether the fronts of a cell have room inside its bay."""
        width, height = self._opening(cell)
        seam = fit.seam if cell.kind == "double" else 0.0
        return min(width - seam, height) > 2 * self._air(cell, look)

    def _add_trays(
        self,
        rng: np.random.Generator,
        asm: Assembly,
        root: int,
        cell: Cell,
        look: FrontStyle,
        fit: Fit,
    ) -> None:
        """Pull-outs behind the doors of a cell, one over the other or in two columns, deep ones or
        flat ones somewhere in their room."""
        lo, hi = self.bay(cell)
        wall = max(0.012, 1.55 * look.unit)
        lo = lo + [0.012 + (look.thickness if fit.inset else 0.0), 0.012, 0.008]
        hi = hi - [0.006, 0.012, 0.008]
        length = (hi[0] - lo[0]) * fit.deep
        columns = 2 if cell.kind == "double" and cell.trays % 2 == 0 and rng.random() < 0.7 else 1
        rows = np.linspace(lo[2], hi[2], cell.trays // columns + 1)
        sides = [(lo[1], hi[1])]
        if columns == 2:
            middle, free = (lo[1] + hi[1]) / 2, float(rng.uniform(0.006, 0.06))
            sides = [(lo[1], middle - free), (middle + free, hi[1])]
        flat = rng.random() < 0.5
        share = float(rng.uniform(0.05, 0.25) if flat else rng.uniform(0.3, 0.85))
        raised = float(rng.uniform(0.0, 0.6)) if flat else 0.0
        for (a, b), (left, right) in itertools.product(itertools.pairwise(rows), sides):
            foot = a + raised * (b - a)
            top = min(foot + max(2.5 * wall, share * (b - a)), b - 0.004)
            solid = tray([lo[0], left, foot], [lo[0] + length, right, top], wall)
            joint = slide((-1, 0, 0), fit.pull * length)
            asm.add("tray", Shape().add(solid, look.inside), root, joint, label="drawer")

    def _outer(self, cell: Cell) -> tuple[bool, bool]:
        """Whether a cell touches the case's left (+y) and right (-y) side."""
        return cell.y[1] > self.y[1] - 1e-6, cell.y[0] < self.y[0] + 1e-6

    def _hinge_edge(self, rng: np.random.Generator, cell: Cell, fit: Fit, index: int) -> str:
        """Hinges sit on the outer side of outer columns mostly, and anywhere on the others."""
        left, right = self._outer(cell)
        if left != right and rng.random() < 0.75:
            return "+y" if left else "-y"
        return "+y" if fit.alternate == (index % 2 == 0 or rng.random() < 0.5) else "-y"

    def _beyond(self, edge: str, cell: Cell, air: float) -> float:
        """How much of the case lies beyond a front's hinged edge."""
        return air if self._outer(cell)[0 if edge == "+y" else 1] else 1.0

    def _swing(self, edge: str, cell: Cell, fit: Fit) -> float:
        """Doors hinged on the outside of the case may open wide; others stop before they meet a
        neighbour."""
        outer = self._outer(cell)[0 if edge == "+y" else 1]
        return fit.swing if outer and not fit.inset else min(fit.swing, float(np.deg2rad(105)))
