"""Random shown states: what makes many training samples of one object (the paper's random joint states)."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject

REST_SHARE = 0.4


def sample_state(obj: ArticulatedObject, rng: np.random.Generator) -> ArticulatedObject:
    """The object shown at a random state, normalised again.

    With probability .4 the rest state; else each joint by itself is at rest with probability one half, or anywhere within
    its limits. Coordinates are measured from the new shown state, so ``lo <= 0 <= hi`` holds for every joint.
    """
    rest = obj.rest()
    at_rest = rng.random() < REST_SHARE
    q = rest.copy()
    for k, part in enumerate(obj.parts):
        moves = part.parent >= 0 and part.joint.type != "fixed"
        stay, drawn = rng.random() < 0.5, rng.random()
        if moves and not at_rest and not stay:
            lo, hi = part.joint.limits
            q[k] = lo + drawn * (hi - lo)
    return obj.shown_at(q).normalized()
