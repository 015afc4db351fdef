"""One motion of a part in PartNet-Mobility's two descriptions: carried into another frame,
compared, put into words.

Two descriptions of one motion differ by a gauge: (direction, lo, hi) ~ (-direction, -hi, -lo), a
turn's limits by whole turns, and the origin by any step along the axis.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.kinematics import rotation

ANGLE_TOLERANCE = float(np.deg2rad(0.5))
LENGTH_TOLERANCE = 2e-3  # the raw objects are about 2 long
TURN = 2 * np.pi


@dataclasses.dataclass(frozen=True)
class Freedom:
    """One way in which a part moves against its parent: a turn about a line or a travel."""

    turns: bool  # else it travels
    origin: np.ndarray  # [3]
    direction: np.ndarray  # [3], not always of length 1
    lo: float  # radians or lengths along the direction; infinite if unbounded
    hi: float

    def flipped(self) -> Freedom:
        """The same motion about the opposite direction."""
        return dataclasses.replace(self, direction=-self.direction, lo=-self.hi, hi=-self.lo)


def moved(freedom: Freedom, matrix: np.ndarray) -> Freedom:
    """A motion carried by a similarity; the length of its direction stays."""
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    factor = 1.0 if freedom.turns else scale
    return Freedom(
        freedom.turns,
        matrix[:3, :3] @ freedom.origin + matrix[:3, 3],
        matrix[:3, :3] @ freedom.direction / scale,
        freedom.lo * factor,
        freedom.hi * factor,
    )


def coordinate_at(freedom: Freedom, relative: np.ndarray) -> float | None:
    """The coordinate at which a motion carries things by ``relative`` [4, 4]; None if it never
    does."""
    axis = freedom.direction / np.linalg.norm(freedom.direction)
    motion = np.eye(4)
    if freedom.turns:
        skew = relative[:3, :3] - relative[:3, :3].T
        sine = float(axis @ [skew[2, 1], skew[0, 2], skew[1, 0]]) / 2
        s = float(np.arctan2(sine, (np.trace(relative[:3, :3]) - 1) / 2))
        motion[:3, :3] = rotation(axis, s)
        motion[:3, 3] = freedom.origin - motion[:3, :3] @ freedom.origin
    else:
        s = float(relative[:3, 3] @ axis)
        motion[:3, 3] = s * axis
    return s if np.allclose(motion, relative, atol=LENGTH_TOLERANCE) else None


def snapped(end: float, turns: bool) -> float:
    """A limit, 0 if a host meant to show the part there."""
    return 0.0 if abs(end) < (ANGLE_TOLERANCE if turns else LENGTH_TOLERANCE) else end


def near_zero(freedom: Freedom) -> Freedom:
    """A turn's limits less the whole turns that keep them from holding 0, or keep them farthest
    from it."""
    if not freedom.turns or not np.isfinite(freedom.hi - freedom.lo):
        return freedom
    if freedom.lo <= 1e-9 and freedom.hi >= -1e-9:
        return freedom
    middle = (freedom.lo + freedom.hi) / 2
    turns = TURN * np.round(middle / TURN)
    return dataclasses.replace(freedom, lo=freedom.lo - turns, hi=freedom.hi - turns)


def between(a: Freedom, b: Freedom) -> tuple[float, float]:
    """(degrees between the axes as lines, distance of a's origin from b's line; 0 for travels)."""
    axis, other = (d / max(float(np.linalg.norm(d)), 1e-12) for d in (b.direction, a.direction))
    angle = np.arctan2(np.linalg.norm(np.cross(axis, other)), abs(axis @ other))
    offset = a.origin - b.origin
    distance = float(np.linalg.norm(offset - (offset @ axis) * axis)) if a.turns else 0.0
    return float(np.rad2deg(angle)), distance


def agree(a: Freedom, b: Freedom) -> bool:
    """Whether two axes are one line (of travels: one direction)."""
    angle, distance = between(a, b)
    return angle <= np.rad2deg(ANGLE_TOLERANCE) and distance <= LENGTH_TOLERANCE


def same_limits(a: Freedom, b: Freedom) -> bool:
    """Whether two motions, directions aligned, have the same ends."""
    if not np.isfinite(a.hi - a.lo) or not np.isfinite(b.hi - b.lo):
        return bool(np.isfinite(a.hi - a.lo) == np.isfinite(b.hi - b.lo))
    tolerance = ANGLE_TOLERANCE if a.turns else LENGTH_TOLERANCE
    return max(abs(a.lo - b.lo), abs(a.hi - b.hi)) <= tolerance


def described(freedoms) -> str:
    """Motions in words: "fixed", "a hinge from 0 to 90 degrees"."""
    words = []
    for freedom in freedoms:
        kind, unit, factor = (
            ("hinge", " degrees", 180 / np.pi) if freedom.turns else ("slider", "", 1.0)
        )
        if not np.isfinite(freedom.hi - freedom.lo):
            words.append(f"a {kind} without limits")
        else:
            lo, hi = (round(v * factor, 4) + 0.0 for v in (freedom.lo, freedom.hi))
            words.append(f"a {kind} from {lo:.5g} to {hi:.5g}{unit}")
    return " and ".join(words) or "fixed"
