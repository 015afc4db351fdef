"""What a person chooses of a print, and the measures that follow from it. Millimetres."""

from __future__ import annotations

import dataclasses
import math

LEAST_SIZE, MOST_SIZE = 20.0, 2000.0
LEAST_CLEARANCE, MOST_CLEARANCE = 0.05, 2.0
LEAST_WALL, MOST_WALL = 0.2, 10.0


@dataclasses.dataclass(frozen=True)
class PrintSettings:
    """Of a whole print, millimetres.

    Attributes:
      size: longest side of the object at rest.
      clearance: gap between parts that move against each other; .3 suits most printers that melt
        filament, .15 resin.
      wall: thinner walls are told, and the walls of knuckles are as thick.

    Raises:
      ValueError: a measure that cannot be.
    """

    size: float = 150.0
    clearance: float = 0.3
    wall: float = 1.2

    def __post_init__(self):
        for flag, value, lo, hi in (
            ("--print-size", self.size, LEAST_SIZE, MOST_SIZE),
            ("--clearance", self.clearance, LEAST_CLEARANCE, MOST_CLEARANCE),
            ("--print-wall", self.wall, LEAST_WALL, MOST_WALL),
        ):
            if not (math.isfinite(value) and lo <= value <= hi):
                raise ValueError(f"{flag} {value:g}: it must be between {lo:g} and {hi:g} mm")

    @property
    def pin(self) -> float:
        """Radius of a hinge's pin."""
        return min(3.0, max(1.2, self.size / 120))

    @property
    def knuckle(self) -> float:
        """Outer radius of a hinge's knuckles."""
        return self.pin + self.clearance + self.wall


class UnprintableError(ValueError):
    """Why a joint cannot be printed here, in words that follow "because"."""
