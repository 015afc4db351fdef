"""Hinges that print: knuckles of parent and child in turn along the axis, and a pin that snaps in.

Frame inside this file: z along the axis, 0 at the top of the first knuckle, the pin's head above.

    head | parent's knuckle | child's knuckle | parent's knuckle | barb
"""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.export.printing.settings import PrintSettings, UnprintableError
from uniart_jax.export.printing.solids import (
    axis_frame,
    block,
    box_of,
    one_piece,
    rod,
    turned,
    union,
    without_path,
)
from uniart_jax.objects.kinematics import Joint

LEAST_KNUCKLE, MOST_KNUCKLE = 2.5, 6.0  # length
REACHES = (0.5, 1.0, 2.0, 3.5, 6.0, 10.0)  # beyond the knuckle: how far an arm goes for its part
HEAD, BARB = 1.5, 2.2  # length of the pin's head and of its barb
SNAP = 0.35  # how far the barb stands out beyond its hole
SLIT = 0.8
TWO = 25.0  # of free edge between two hinges
MOST_LOST = 0.5  # of a part: a hinge that costs more is none


@dataclasses.dataclass(frozen=True)
class Fit:
    """A joint made printable; all solids stand assembled at rest.

    Attributes:
      kind: "pin hinge", "snap shaft", "slide" or "loose".
      parent, child: with what holds them together.
      pins: separate pieces.
      added: what of the parent is new and reaches out.
      keep: what other parts must stay out of.
      facts: measures in mm, plain JSON values.
      text: what to do when it is put together.
      joint: what is printed of it, mm; as it was unless ``note`` says otherwise.
      note: what is other than it was.
    """

    kind: str
    parent: Manifold
    child: Manifold
    pins: tuple[Manifold, ...]
    added: Manifold
    keep: Manifold
    facts: dict
    text: str
    joint: Joint
    note: str = ""


@dataclasses.dataclass(frozen=True)
class Around:
    """What else stands there: ``others`` can give way to a hinge but not to its pin's way in, and
    ``taken`` can to neither."""

    others: Manifold
    taken: Manifold

    def turned(self, matrix: np.ndarray) -> Around:
        return Around(turned(self.others, matrix), turned(self.taken, matrix))


def fit_hinge(
    parent: Manifold, child: Manifold, joint: Joint, around: Around, settings: PrintSettings
) -> Fit:
    """One or two pin hinges along the edge that both parts have near the axis.

    Args:
      parent, child: clear of each other along the whole range, at rest.
      joint: revolute or continuous, mm, 0 at rest.

    Raises:
      UnprintableError: no edge along the axis that is long enough, or no place where they hold.
    """
    frame = axis_frame(joint)
    back = np.linalg.inv(frame)
    near = rod(settings.knuckle + REACHES[-2], -1e4, 1e4)
    spans = []
    for solid, whose in ((parent, "its parent"), (child, "it")):
        local = turned(solid, back) ^ near
        if local.is_empty():
            raise UnprintableError(f"nothing of {whose} lies along the axis")
        spans.append(box_of(local)[:, 2])
    lo, hi = max(s[0] for s in spans), min(s[1] for s in spans)
    gap, least = settings.clearance, 3 * LEAST_KNUCKLE + 2 * settings.clearance
    if hi - lo < least:
        raise UnprintableError(
            f"only {max(hi - lo, 0):.1f} mm of an edge lie along the axis, "
            f"and knuckles need {least:.1f} mm"
        )
    margin = min(HEAD + 2 * gap, (hi - lo - least) / 2)
    knuckle = float(np.clip((hi - lo - 2 * margin - 2 * gap) / 3, LEAST_KNUCKLE, MOST_KNUCKLE))
    barrel = 3 * knuckle + 2 * gap
    ends = [(hi - margin, 1), (lo + margin, -1)]
    middle = (lo + hi) / 2
    other = [(middle + sense * barrel / 2, sense) for sense in (1, -1)]
    wanted = 2 if hi - lo >= 2 * barrel + TWO else 1
    pins, added, keeps, reasons = [], [], [], []
    for top, sense in [*ends, *other]:
        if len(pins) == wanted:
            break
        upright = np.diag([1.0, sense, sense, 1.0])
        upright[2, 3] = top
        place = frame @ upright
        here = np.linalg.inv(place)
        try:
            made = _barrel(
                turned(parent, here),
                turned(child, here),
                joint.transformed(here),
                around.turned(here),
                knuckle,
                settings,
            )
        except UnprintableError as error:
            reasons.append(str(error))
            continue
        parent, child, pin, new, keep = (turned(solid, place) for solid in made)
        pins.append(pin)
        added.append(new)
        keeps.append(keep)
        around = Around(around.others, union([around.taken, keep]))
    if not pins:
        raise UnprintableError("; ".join(dict.fromkeys(reasons)))
    long = HEAD + barrel + 2 * gap + BARB
    facts = {
        "hinges": len(pins),
        "pin_diameter": round(2 * settings.pin, 3),
        "hole_diameter": round(2 * (settings.pin + gap), 3),
        "knuckle_diameter": round(2 * settings.knuckle, 3),
        "knuckle_length": round(knuckle, 3),
        "pin_length": round(long, 3),
    }
    text = (
        f"hold the knuckles in line and push {'a pin' if len(pins) == 1 else 'the two pins'} in "
        "from outside until the barb clicks behind the last knuckle"
    )
    return Fit(
        "pin hinge", parent, child, tuple(pins), union(added), union(keeps), facts, text, joint
    )


def make_pin(knuckle: float, settings: PrintSettings) -> Manifold:
    """A pin for three knuckles: a head above 0, a split barb below the last, and a flat side (-y)
    to lie on."""
    gap, radius = settings.clearance, settings.pin
    low = -3 * knuckle - 2 * gap  # of the last knuckle
    tip = low - gap - BARB
    pin = union(
        [
            rod(radius, tip + 0.1, gap + HEAD),
            rod(radius + gap + 0.7, gap, gap + HEAD),
            rod(radius - 0.3, tip, low - gap, radius + gap + SNAP),
        ]
    )
    pin -= block([-SLIT / 2, -9, tip - 1], [SLIT / 2, 9, low + 1.2 * knuckle])
    return pin.trim_by_plane((0, 1, 0), -0.7 * radius)


def _barrel(
    parent: Manifold,
    child: Manifold,
    joint: Joint,
    around: Around,
    knuckle: float,
    settings: PrintSettings,
) -> tuple[Manifold, Manifold, Manifold, Manifold, Manifold]:
    """(parent, child, pin, what of the parent is new, what others keep out of) of one hinge below
    z = 0."""
    gap, outer = settings.clearance, settings.knuckle
    first, middle = (-knuckle, 0.0), (-2 * knuckle - gap, -knuckle - gap)
    last = (-3 * knuckle - 2 * gap, -2 * knuckle - 2 * gap)
    far = float(max(box_of(s)[1, 2] for s in (parent, child, around.others) if not s.is_empty()))
    way = rod(settings.pin + 2 * gap + 0.7, 0, max(far, 0) + HEAD + 2 * gap)
    for solid, what in ((around.others, "another part"), (around.taken, "another joint")):
        if (way ^ solid).volume() > 0.5:
            raise UnprintableError(f"{what} stands in the pin's way in")
    foot = rod(settings.pin + 2 * gap + SNAP, last[0] - 2 * gap - BARB, last[0])
    keep = rod(outer + gap, last[0] - 2 * gap - BARB, HEAD + 2 * gap)
    if (keep ^ around.taken).volume() > 0.5:
        raise UnprintableError("another joint is in its place")
    free = union([way, foot])
    around_child = rod(outer + gap, middle[0] - gap, middle[1] + gap)
    around_parent = union([rod(outer + gap, z[0] - gap, z[1] + gap) for z in (first, last)])
    base, moving = parent - free - around_child, child - free - around_parent
    if base.volume() < MOST_LOST * parent.volume() or moving.volume() < MOST_LOST * child.volume():
        raise UnprintableError("a hinge would be larger than what it holds")
    hole = rod(settings.pin + gap, last[0] - 1, 1)
    rings = [rod(outer, *z) for z in (first, last)]
    arms = [_arm(base, z, outer) for z in (first, last)]
    reach = float(max(np.abs(box_of(arm)[:, :2]).max() for arm in arms)) * 1.5 + 1
    swinging = moving ^ rod(reach, last[0] - gap, gap)
    back = dataclasses.replace(joint, angle=(-joint.angle[1], -joint.angle[0]))
    notched = without_path(moving, union(arms), back, gap)
    # Where the arms fit around the child's way it stays whole; else it is notched around theirs.
    for own, swung in (
        ([without_path(arm, swinging, joint, gap) for arm in arms], moving),
        (arms, notched),
    ):
        lever = _arm(swung, middle, outer)
        rest = without_path(base, lever, joint, gap)
        whole = one_piece(union([rest, *own, *rings]) - hole - free)
        swung = one_piece(union([swung, lever, rod(outer, *middle)]) - hole)
        if whole is not None and swung is not None:
            break
    if whole is None:
        raise UnprintableError("the knuckles would not stay with its parent")
    if swung is None:
        raise UnprintableError("a knuckle would not stay with it")
    return whole, swung, make_pin(knuckle, settings), union([*own, *rings]) - hole - free, keep


def _arm(body: Manifold, heights: tuple[float, float], outer: float) -> Manifold:
    """What joins the knuckle between two heights to the part, from as near as there is some."""
    ring = rod(outer, *heights)
    long = heights[1] - heights[0]
    for reach in REACHES:
        chunk = body ^ rod(outer + reach, *heights)
        if chunk.volume() >= 1.2 * long:
            return Manifold.batch_hull([ring, chunk])
    raise UnprintableError(f"a part is farther than {outer + REACHES[-1]:.0f} mm from the axis")
