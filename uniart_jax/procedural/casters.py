"""Wheels under furniture, on axles or in forks that turn about their feet."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Assembly, Shape, box, cylinder, turn, union


@dataclasses.dataclass(frozen=True)
class Caster:
    """A wheel without end from the floor to ``height``, metres.

    Attributes:
      radius, wide: of the wheel. along: its axle, "x" or "y". forks: it hangs in a fork that turns
        without end about the foot, else its axle is the foot's.
    """

    height: float
    radius: float
    wide: float
    along: str
    forks: bool
    metal: Material
    rubber: Material

    def add(self, asm: Assembly, root: int, feet: Iterable[tuple[float, float]]) -> None:
        """One under each foot (x, y)."""
        axis = "xy".index(self.along)
        tyre = 1.0 if self.forks else 0.96  # clear of the foot above it
        for x, y in feet:
            at = np.array([x, y, self.radius])
            parent = self._fork(asm, root, x, y, axis) if self.forks else root
            start = at.copy()
            start[axis] -= self.wide / 2
            wheel = cylinder(self.along, start, self.wide, tyre * self.radius, segments=18)
            joint = turn(at, np.eye(3)[axis])
            asm.add("wheel", Shape().add(wheel, self.rubber), parent, joint)

    def _fork(self, asm: Assembly, root: int, x: float, y: float, axis: int) -> int:
        radius, height, wide = self.radius, self.height, self.wide
        t = 0.16 * radius + 0.002
        cheeks = []
        for sign in (-1, 1):
            middle = np.array([x, y, (radius + height) / 2 - 0.001])
            middle[axis] += sign * (wide / 2 + 0.002 + t / 2)
            half = np.array([0.3 * radius, 0.3 * radius, (height - radius) / 2 - 0.001])
            half[axis] = t / 2
            cheeks.append(box(middle - half, middle + half))
        plate = np.array([0.3 * radius] * 2)
        plate[axis] = wide / 2 + 0.002 + t
        low = [x - plate[0], y - plate[1], 2 * radius + 0.002]
        cheeks.append(box(low, [x + plate[0], y + plate[1], height - 0.002]))
        shape = Shape().add(union(cheeks), self.metal)
        return asm.add("fork", shape, root, turn((x, y, 0), (0, 0, 1)))
