"""Random shown states: what makes many training samples of one object (the paper's random joint
states)."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.clearance import Clearance
from uniart_jax.objects.object import ArticulatedObject

REST_SHARE = 0.4
ATTEMPTS = 8


def sample_state(
    obj: ArticulatedObject, rng: np.random.Generator, clearance: Clearance | None = None
) -> ArticulatedObject:
    """The object shown at a random state, normalised again.

    With probability .4 the rest state; else each joint by itself is at rest with probability one
    half, or anywhere within its limits; drawn again where parts run into one another
    (``objects.clearance``), the rest state if that never ends. Coordinates are measured from the
    new shown state, so ``lo <= 0 <= hi`` holds for every joint.

    Args:
      clearance: of this object, where many states are drawn.
    """
    rest = obj.rest()
    at_rest = rng.random() < REST_SHARE
    for _ in range(ATTEMPTS):
        q = rest.copy()
        for k, part in enumerate(obj.parts):
            moves = part.parent >= 0 and part.joint.type != "fixed"
            stay, drawn = rng.random() < 0.5, rng.random()
            if moves and not at_rest and not stay:
                lo, hi = part.joint.limits
                q[k] = lo + drawn * (hi - lo)
        if at_rest:
            break
        clearance = clearance or Clearance(obj)
        if clearance.collision(q) is None:
            return obj.shown_at(q).normalized()
    return obj.shown_at(rest).normalized()
