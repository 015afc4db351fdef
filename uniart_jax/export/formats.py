"""What an asset folder can be written as."""

from __future__ import annotations

import importlib.util
from typing import Literal, get_args

Format = Literal["urdf", "mjcf", "glb", "page", "usd", "stl"]
Origin = Literal["floor", "centre"]
Collision = Literal["merged", "coacd", "boxes", "hull"]
COLLISION_BUDGET = 64  # convex collision shapes of an object, unless another number is asked for
FORMATS: tuple[Format, ...] = get_args(Format)
COLLISIONS: tuple[Collision, ...] = get_args(Collision)
ORIGINS: tuple[Origin, ...] = get_args(Origin)


def default_formats() -> tuple[Format, ...]:
    """All but files for printing; USD where usd-core is installed."""
    usd = importlib.util.find_spec("pxr") is not None
    return tuple(f for f in FORMATS if f != "stl" and (f != "usd" or usd))
