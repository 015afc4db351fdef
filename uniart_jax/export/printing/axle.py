"""Knobs, wheels and pivots that print: a shaft on one part that snaps into a hole of the other.

Frame inside this file: z along the axis, from the part with the shaft to the part with the hole.
"""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.export.printing.hinge import Around, Fit
from uniart_jax.export.printing.settings import PrintSettings, UnprintableError
from uniart_jax.export.printing.solids import axis_frame, block, one_piece, rod, turned, union
from uniart_jax.objects.kinematics import Joint

LEAST_SHAFT, MOST_SHAFT = 1.5, 3.0  # radius
RIM = 0.4  # of the part with the shaft, around it
NECK = (0.8, 2.0)  # length of the hole that the barb stands behind
BARB = 1.6  # length
SNAP = 0.3  # how far the barb stands out beyond its hole
ROOT = 1.0  # how deep the shaft begins in its part
FAR = 10.0  # longest way from part to part
RAYS = 8
SOUND = 0.6  # of the ring that holds the barb


def fit_axle(
    parent: Manifold, child: Manifold, joint: Joint, around: Around, settings: PrintSettings
) -> Fit:
    """A shaft along the axis: on the child if it can be, else on the parent.

    Args:
      parent, child: clear of each other along the whole range, at rest.
      joint: revolute or continuous, mm.

    Raises:
      UnprintableError: no wall across the axis that would hold it.
    """
    frame, reasons = axis_frame(joint), []
    for on_child in (True, False):
        shaft, hole = (child, parent) if on_child else (parent, child)
        for sense in (1.0, -1.0):
            place = frame @ np.diag([1.0, sense, sense, 1.0])
            here = np.linalg.inv(place)
            try:
                made = _snap(turned(shaft, here), turned(hole, here), around.turned(here), settings)
            except UnprintableError as error:
                reasons.append(str(error))
                continue
            shaft, hole, stem, keep = (turned(solid, place) for solid in made[:4])
            parent, child = (hole, shaft) if on_child else (shaft, hole)
            text = (
                "press its shaft into the hole until the barb clicks"
                if on_child
                else "press it onto the shaft until the barb clicks"
            )
            new = Manifold() if on_child else stem
            return Fit("snap shaft", parent, child, (), new, keep, made[4], text, joint)
    raise UnprintableError("; ".join(dict.fromkeys(reasons)))


def _snap(
    shaft: Manifold, hole: Manifold, around: Around, settings: PrintSettings
) -> tuple[Manifold, Manifold, Manifold, Manifold, dict]:
    """(part with the shaft, part with the hole, shaft, what others keep out of, measures)."""
    gap = settings.clearance
    for radius in (float(r) for r in np.linspace(MOST_SHAFT, LEAST_SHAFT, 4)):
        ends = [span[-1][1] for span in _spans(shaft, radius + RIM)]
        if len(ends) == RAYS:
            break
    else:
        raise UnprintableError(
            f"a shaft of {2 * LEAST_SHAFT:.0f} mm, the thinnest that holds, does not fit on it"
        )
    root, face = min(ends), max(ends)
    walls = []
    for span in _spans(hole, radius + gap + SNAP / 2):
        ahead = [s for s in span if s[1] > face and s[0] >= root - 0.01]
        walls += ahead[:1]
    if len(walls) < RAYS:
        raise UnprintableError("there is no wall across its axis to hold a shaft")
    near, behind = max(w[0] for w in walls), min(w[1] for w in walls)
    if near - face > FAR:
        raise UnprintableError(f"the wall that would hold it is {near - face:.0f} mm away")
    if behind - near < NECK[0]:
        raise UnprintableError(
            f"the wall across its axis is {max(behind - near, 0):.1f} mm thick, "
            f"and a shaft needs {NECK[0]} mm"
        )
    neck = near + float(np.clip(behind - near - BARB - 2 * gap, *NECK))
    tip = neck + gap + BARB
    bore = rod(radius + gap, root - 0.01, neck + 0.01)
    pocket = rod(radius + gap + SNAP + gap, neck, tip + gap)
    keep = rod(radius + 2 * gap + SNAP, face, tip + gap)
    if (keep ^ around.taken).volume() > 0.5:
        raise UnprintableError("another joint is in its place")
    whole = one_piece(hole - bore - pocket)
    if whole is None:
        raise UnprintableError("its hole would cut a part in two")
    ring = rod(radius + gap + SNAP, near, neck) - rod(radius + gap, near - 1, neck + 1)
    if (ring ^ whole).volume() < SOUND * ring.volume():
        raise UnprintableError("the wall across its axis is too small to hold a shaft")
    stem = union(
        [
            rod(radius, root - ROOT, tip - 0.1),
            rod(radius + gap + SNAP, neck + gap, tip, radius - 0.3),
        ]
    )
    slit = max(0.7, 0.4 * radius)
    stem -= block([-slit / 2, -9, face + 0.2], [slit / 2, 9, tip + 1])
    made = one_piece(union([shaft, stem]))
    if made is None:
        raise UnprintableError("the shaft would not stay with its part")
    facts = {
        "shaft_diameter": round(2 * radius, 3),
        "hole_diameter": round(2 * (radius + gap), 3),
        "barb_diameter": round(2 * (radius + gap + SNAP), 3),
        "shaft_length": round(tip - face, 3),
    }
    return made, whole, stem, keep, facts


def _spans(solid: Manifold, radius: float) -> list[list[tuple[float, float]]]:
    """Of the rays along z at this radius that meet the solid: the heights between which each is
    inside, from below."""
    found = []
    for angle in np.arange(RAYS) * 2 * np.pi / RAYS + 0.1:
        x, y = float(radius * np.cos(angle)), float(radius * np.sin(angle))
        hits = solid.ray_cast((x, y, -1e3), (x, y, 1e3))
        z = sorted(float(hit.position[2]) for hit in hits)
        if len(z) >= 2:
            found.append(list(zip(z[::2], z[1::2], strict=False)))
    return found
