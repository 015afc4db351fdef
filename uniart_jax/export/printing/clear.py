"""What bodies lose so that they keep clear of each other, and how much that is. Millimetres."""

from __future__ import annotations

from collections.abc import Sequence

from manifold3d import Manifold

from uniart_jax.export.printing.settings import PrintSettings
from uniart_jax.export.printing.solids import CRUMB, TRIFLE, grown, without_path
from uniart_jax.objects.kinematics import Joint

ENOUGH = 0.9  # of the clearance
MUCH = 0.02  # of a body: more that is cut away is told


def cleared(
    bodies: dict[int, Manifold],
    above: dict[int, int],
    joints: Sequence[Joint],
    parts: Sequence,
    failed: dict[int, str],
    settings: PrintSettings,
) -> tuple[dict[int, Manifold], list[tuple[int, int]]]:
    """The solids with a gap around each at rest, and around its whole path in its parent; and
    (mover, what was cut for it) of each cut. A cut that would leave nothing is not made: the joint
    that asks for it is put into ``failed``."""
    bodies, cuts = apart(bodies, above, parts, failed, settings)
    for k, up in above.items():
        if k in failed:
            continue
        free = _cut(bodies[up], without_path(bodies[up], bodies[k], joints[k], settings.clearance))
        if is_crumb(free):
            failed[k] = f"on its way nothing would be left of '{parts[up].name}'"
        elif free is not bodies[up]:
            bodies[up] = free
            cuts.append((k, up))
    return bodies, cuts


def apart(
    bodies: dict[int, Manifold],
    above: dict[int, int],
    parts: Sequence,
    failed: dict[int, str],
    settings: PrintSettings,
) -> tuple[dict[int, Manifold], list[tuple[int, int]]]:
    """The solids with a gap around each at rest, parents and children left as they are; and the
    cuts, as ``cleared`` has them."""
    bodies, gap, keys, cuts = dict(bodies), settings.clearance, sorted(bodies), []
    for n, i in enumerate(keys):
        for j in keys[n + 1 :]:
            if above.get(j) == i or bodies[i].min_gap(bodies[j], gap) >= ENOUGH * gap:
                continue
            free = _cut(bodies[j], bodies[j] - grown(bodies[i], gap))
            if is_crumb(free):
                k, other = (j, i) if j in above else (i, j)
                failed[k] = f"it stands where '{parts[other].name}' is"
                continue
            bodies[j] = free
            cuts.append((i, j))
    return bodies, cuts


def _cut(before: Manifold, after: Manifold) -> Manifold:
    """``after`` without small pieces that the cut left; ``before`` itself if none was made."""
    if before.volume() - after.volume() < TRIFLE**3:
        return before
    pieces = sorted(after.decompose(), key=lambda p: -p.volume())
    if len(pieces) > 1 and sum(p.volume() for p in pieces[1:]) < MUCH * before.volume():
        return pieces[0]
    return after


def is_crumb(solid: Manifold) -> bool:
    """Whether no piece of it is large enough to be printed."""
    return max((p.volume() for p in solid.decompose()), default=0.0) <= CRUMB


def losses(
    whole: dict[int, Manifold],
    left: dict[int, Manifold],
    cuts: Sequence[tuple[int, int]],
    parts: Sequence,
) -> list[str]:
    """A line for each body of which much was cut away, whatever it was cut for."""
    lines = []
    for k, solid in whole.items():
        lost = (solid - left[k]).volume() / solid.volume()
        if lost > MUCH:
            movers = dict.fromkeys(mover for mover, block in cuts if block == k)
            who = ", ".join("it" if m == k else f"'{parts[m].name}'" for m in movers)
            lines.append(
                f"{lost:.0%} of '{parts[k].name}' were cut away so that {who or 'it'} can move"
            )
    return lines
