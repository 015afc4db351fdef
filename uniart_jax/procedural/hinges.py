"""Where doors turn and how far: hinges as they are made, and the room that a door needs."""

from __future__ import annotations

import numpy as np

# metres that the corner of a door beyond its axis may swing behind the door's rear face
AIR = 0.0015
_ANGLES = np.deg2rad(np.arange(90, 181, 2.0))

# axis about which what is hinged at an edge opens, of a front that looks along -x
OPENING = {"+y": (0, 0, -1), "-y": (0, 0, 1), "-z": (0, -1, 0), "+z": (0, 1, 0)}


def hang(rng: np.random.Generator, unit: float) -> dict[str, float]:
    """Where a maker puts hinges, and how far handles stand out: fields of ``fronts.FrontStyle``.

    Concealed hinges turn a door about its rear edge, knife hinges about a line within its thickness
    a little inside its edge, butt hinges about its outer front edge. ``unit``: one percent of the
    object's longest side, metres.
    """
    kind = rng.choice(3, p=[0.25, 0.4, 0.35])
    depth = (0.0, 1.0, float(rng.uniform(0.2, 0.9)))[kind]
    inset = 0.0 if kind == 0 else float(rng.choice([0.0, rng.uniform(0.2, 1.8)])) * unit
    stand = 1.0 if rng.random() < 0.5 else float(rng.uniform(0.6, 2.2))
    return {"axis_depth": depth, "axis_inset": inset, "stand": stand}


def opening(rng: np.random.Generator, wide: float = 0.3) -> float:
    """How far doors open, radians: right angles, a little more, or (a share ``wide``) right
    round."""
    if rng.random() < wide:
        return float(np.deg2rad(180 if rng.random() < 0.5 else rng.uniform(115, 178)))
    return float(np.deg2rad(90 if rng.random() < 0.55 else rng.uniform(80, 115)))


def place(thick: float, width: float, depth: float, inset: float) -> tuple[float, float]:
    """(metres behind a door's front face, metres inside its edge) of an axis that ``FrontStyle``'s
    ``axis_depth`` and ``axis_inset`` ask for, moved until a right angle is free of what the door
    closes.
    """
    into = 0.0 if depth == 0 else min(inset, 0.1 * width, 0.5 * thick)
    rear = max(thick * (1 - depth), min(into, 4e-3))
    into = min(into, float(np.sqrt(2 * AIR * rear + AIR**2)))  # its corner swings back by ``AIR``
    return thick - rear, into


def clear_angle(
    thick: float,
    behind: float,
    into: float,
    beyond: float,
    air: float = AIR,
    angles: np.ndarray = _ANGLES,
    points: tuple[int, int] = (12, 24),
) -> float:
    """How far a door can open, radians, before it meets what it closes; pi if it never does.

    Args:
      thick: of the door. behind, into: of its axis (``place``).
      beyond: how far past the door's hinged edge that reaches which it closes. air: how far behind
        the door it lies. Metres.
      angles: that are tried. points: along the door's edge and along each of its faces.
    """
    side = np.linspace(-behind, thick - behind, points[0])  # x to the rear, y past the edge
    edge = np.linspace(-4 * thick, into, points[1])
    x = np.concatenate([side, np.full(points[1], -behind), np.full(points[1], thick - behind)])
    y = np.concatenate([np.full(points[0], into), edge, edge])
    angles = angles[:, None]
    there = x * np.cos(angles) + y * np.sin(angles), y * np.cos(angles) - x * np.sin(angles)
    met = ((there[0] > thick - behind + air) & (there[1] < into + beyond + 1e-3)).any(1)
    return float(angles[max(int(met.argmax()) - 1, 0), 0]) if met.any() else float(np.pi)
