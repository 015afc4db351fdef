"""How an asset is written: options that ``sample`` and ``export`` share."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

import tyro

from uniart_jax.export.formats import COLLISION_BUDGET, Collision, Format, Origin
from uniart_jax.export.printing.settings import PrintSettings


@dataclasses.dataclass(frozen=True)
class AssetOptions:
    """How an asset is written.

    Args:
        formats: What to write beside the URDF (default: all but stl; usd if usd-core is installed).
          stl: for printing, millimetres.
        size: Metres of the longest side, or a kind of thing ("oven") of usual size.
        density: kg / m^3 of all parts (default: 500, light wood).
        mass: kg of the whole object, instead of a density.
        collision: Collision shapes: boxes and hulls as close to the surface as the budget allows
          (merged); boxes alone; a hull a part; coacd's pieces (pip install 'uniart_jax[coacd]').
        collision_budget: Convex collision shapes of the whole object at most; 16 a part.
        friction: Dry friction: a factor for all joints (.5), or JOINT=VALUE for each that is meant
          (door_1_joint=2), N m or N.
        damping: Damping: a factor for all joints, or JOINT=VALUE for each that is meant, N m s /
          rad or N s / m.
        origin: Where 0 lies: on the floor below the middle of the object at rest, or in its middle.
        actuators: Give the MJCF a position actuator a joint.
        printing: With --formats stl: pieces with hinges and slides that print (docs/printing.md).
        print_size: Of --print: longest side of the assembled object, millimetres.
        clearance: Of --print: gap between parts that move, millimetres.
        print_wall: Of --print: thinner walls are told, millimetres.
    """

    formats: tuple[Format, ...] | None = None
    size: str | None = None
    density: float | None = None
    mass: float | None = None
    collision: Collision = "merged"
    collision_budget: int = COLLISION_BUDGET
    friction: tuple[str, ...] = ()
    damping: tuple[str, ...] = ()
    origin: Origin = "floor"
    actuators: bool = False
    printing: Annotated[bool, tyro.conf.arg(name="print")] = False
    print_size: float = PrintSettings.size
    clearance: float = PrintSettings.clearance
    print_wall: float = PrintSettings.wall

    def parsed(self) -> dict[str, Any]:
        """What ``export.asset.save_asset`` takes; ``size`` in metres, or None.

        Raises:
          ValueError: one that cannot be, or whose program is not installed.
        """
        from uniart_jax.export.budget import check_budget
        from uniart_jax.export.collision_kinds import check_collision
        from uniart_jax.export.mass import check_weights
        from uniart_jax.export.resistance import parse_resistance
        from uniart_jax.export.size import parse_size

        printing = self._print_settings()
        metres = parse_size(self.size) if self.size else None
        check_weights(self.density, self.mass)
        check_budget(self.collision_budget)
        check_collision(self.collision)
        return {
            "formats": self.formats,
            "size": metres,
            "density": self.density,
            "mass": self.mass,
            "collision": self.collision,
            "collision_budget": self.collision_budget,
            "friction": parse_resistance("friction", self.friction),
            "damping": parse_resistance("damping", self.damping),
            "origin": self.origin,
            "actuators": self.actuators,
            "printing": printing,
        }

    def _print_settings(self) -> PrintSettings | None:
        """What ``--print`` and its measures ask for; None without it."""
        settings = PrintSettings(self.print_size, self.clearance, self.print_wall)
        if self.printing and (self.formats is None or "stl" not in self.formats):
            raise ValueError("--print needs STL files: add --formats stl")
        if not self.printing and settings != PrintSettings():
            raise ValueError("--print-size, --clearance and --print-wall belong to --print: add it")
        return settings if self.printing else None


Output = Annotated[AssetOptions, tyro.conf.OmitArgPrefixes]
AS_USUAL = AssetOptions()
