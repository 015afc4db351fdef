"""Several joints between a part and its parent, where only one can be: in codes.

Files keep every joint (``Part.outer``, ``Part.inner``). A turn and a travel along one line that are
both bounded become one screw that makes both in proportion; of all else the largest motion is left.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uniart_jax.objects.kinematics import Joint

PARALLEL = 1e-4  # sine of the angle between two directions that count as one

Ends = tuple[float, float]


def one_joint(outer: Sequence[Joint], joint: Joint, inner: Sequence[Joint]) -> Joint:
    """The joint that a code holds of a part.

    Args:
      outer, joint, inner: the part's joints; ``joint`` is the one with the largest motion.

    Returns:
      ``joint``, or, of a bounded turn and a bounded travel along parallel axes, the screw.
    """
    joints = (*outer, joint, *inner)
    if sorted(j.type for j in joints) != ["prismatic", "revolute"]:
        return joint
    slide, turn = sorted(joints, key=lambda j: j.rotates)
    found = proportional(turn.direction, turn.angle, slide.direction, slide.travel)
    if found is None:
        return joint
    return Joint(turn.origin, turn.direction, *found, min(turn.dead_zone, slide.dead_zone))


def proportional(
    turn: np.ndarray, angle: Ends, slide: np.ndarray, travel: Ends
) -> tuple[Ends, Ends] | None:
    """A turn spread over a travel in proportion; the travel keeps its ends.

    Both open together: where the middles of the two ranges lie on opposite sides of 0, what turns
    one way travels the other, and the screw is left-handed.

    Args:
      turn, slide: [3] unit directions.
      angle, travel: their ends, radians and any length; neither without a span.

    Returns:
      (angle, travel) at both ends, the lower angle first, about and along ``turn``; None if the two
      are not parallel.
    """
    if np.linalg.norm(np.cross(turn, slide)) >= PARALLEL:
        return None
    lo, hi = sorted(float(t * np.sign(turn @ slide)) for t in travel)
    rate = abs(angle[1] - angle[0]) / (hi - lo)
    if (angle[0] + angle[1]) * (lo + hi) < 0:
        return (-hi * rate, -lo * rate), (hi, lo)
    return (lo * rate, hi * rate), (lo, hi)


def lowering(name: str, chain: Sequence[Joint], left: Joint) -> str:
    """What became of the joints of part ``name``, for people."""
    if left.type == "screw" and all(joint.type != "screw" for joint in chain):
        how = "its independent turn and travel were lowered to one proportional screw"
    else:
        how = f"of its {len(chain)} joints the one with the largest motion was left"
    return f"joints of '{name}': {how}"
