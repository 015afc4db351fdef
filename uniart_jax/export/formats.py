"""What an asset folder can be written as."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from uniart_jax.export.atlas import Surface
    from uniart_jax.export.physics import Body
    from uniart_jax.objects.object import ArticulatedObject

Format = Literal["urdf", "mjcf", "glb", "page", "usd", "stl"]
Origin = Literal["floor", "centre"]
Collision = Literal["merged", "coacd", "boxes", "hull"]
COLLISION_BUDGET = 64  # convex collision shapes of an object, unless another number is asked for
FORMATS: tuple[Format, ...] = get_args(Format)
COLLISIONS: tuple[Collision, ...] = get_args(Collision)
ORIGINS: tuple[Origin, ...] = get_args(Origin)


# What simulators read beside the URDF: format -> the module of this folder whose ``write_asset``
# takes a ``Parts`` and returns what the format cannot say, a line each.
SIMULATORS: dict[Format, str] = {"mjcf": "mjcf", "usd": "usd"}


@dataclasses.dataclass(frozen=True)
class Parts:
    """What an asset's files for simulators are written of.

    Attributes:
      obj: as it is placed. folder: of the asset; the files below lie in it already.
      surfaces, bodies: [K] of the parts. visual_files: [K] OBJ of each part; hull_files: [K] OBJ of
        each part's hulls, metres, object frame.
      texture: image of all visual meshes. actuators: a position actuator a joint is asked for.
    """

    obj: ArticulatedObject
    folder: Path
    surfaces: Sequence[Surface]
    bodies: Sequence[Body]
    visual_files: Sequence[str]
    hull_files: Sequence[Sequence[str]]
    texture: str
    actuators: bool = False


def default_formats() -> tuple[Format, ...]:
    """All but files for printing; USD where usd-core is installed."""
    usd = importlib.util.find_spec("pxr") is not None
    return tuple(f for f in FORMATS if f != "stl" and (f != "usd" or usd))
