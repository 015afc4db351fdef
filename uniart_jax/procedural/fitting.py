"""Whether a part may join a tree of parts: it must touch its parent, look unlike the others, and
move without running into them."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import union

AIR = 0.003  # between a part and what it moves on; the root's longest side is about 1
CLEAR = 2e-4  # of the smaller part's volume, an overlap that is none


@dataclasses.dataclass
class Piece:
    """A part while the tree grows: its seat (corners of its main solid), all solids by material,
    parent and joint."""

    lo: np.ndarray
    hi: np.ndarray
    solids: list[tuple[Manifold, Material]]
    parent: int
    joint: Joint

    @property
    def solid(self) -> Manifold:
        return union([s for s, _ in self.solids])


@dataclasses.dataclass
class Candidate:
    """A part that may be added: ``cut`` is taken from its parent and ``add`` put onto it where it
    is."""

    piece: Piece
    cut: Manifold | None = None
    add: Manifold | None = None


def host_with(pieces: list[Piece], solids: list[Manifold], found: Candidate) -> Piece | None:
    """The candidate's parent as it will be; None where the candidate cannot be added.

    It must touch its parent, be told apart from all parts by its box, and on its whole way, and on
    those of all parts that carry it, run into nothing; nor may others run into it.
    """
    piece, body = found.piece, found.piece.solid
    parent = piece.parent
    corners = np.array(body.bounding_box())
    if (piece.hi - piece.lo).min() < 0.02 or np.abs(corners).max() > 1.3:
        return None
    if any(np.abs(np.array(s.bounding_box()) - corners).max() < 0.04 for s in solids):
        return None
    host, rest = pieces[parent], [s for n, s in enumerate(solids) if n != parent]
    children = [n for n, p in enumerate(pieces) if p.parent == parent]
    if found.cut is not None:
        if any((found.cut ^ s).volume() > 0 for s in rest):
            return None
        cut = [(s - found.cut, m) for s, m in host.solids]
        host = dataclasses.replace(host, solids=cut)
        if len(host.solid.decompose()) != len(solids[parent].decompose()):
            return None
        if any(host.solid.min_gap(solids[n], 1.0) > 3 * AIR for n in children):
            return None
    carried = body
    if found.add is not None:
        if any(_shared(found.add, s) > CLEAR for s in rest):
            return None
        host = dataclasses.replace(host, solids=[*host.solids, (found.add, host.solids[0][1])])
        carried = body + found.add
    others = [host.solid if n == parent else s for n, s in enumerate(solids)]
    if any(_shared(body, s) > CLEAR for s in others):
        return None
    if body.min_gap(others[parent], 1.0) > 3 * AIR:
        return None
    if not _free(piece.joint, body, others, parent):
        return None
    chain = []
    k = parent
    while pieces[k].parent >= 0:
        chain.append(k)
        beside = [s for n, s in enumerate(others) if not _below(pieces, n, k)]
        own = sum(not _below(pieces, n, k) for n in range(pieces[k].parent))
        if not _free(pieces[k].joint, carried, beside, own):
            return None
        k = pieces[k].parent
    for n, other in enumerate(pieces):
        if n and n not in chain:
            strict = 1 if n in children else -1
            if not _free(
                other.joint, solids[n], [body, *([found.add] if found.add else [])], strict
            ):
                return None
    return host


def _below(pieces: list[Piece], n: int, k: int) -> bool:
    """Whether part n is k or hangs on it."""
    while n > k:
        n = pieces[n].parent
    return n == k


def _free(joint: Joint, body: Manifold, others: list[Manifold], parent: int) -> bool:
    """Whether a body runs into nothing along a joint's way; least of all into
    ``others[parent]``."""
    low, high = joint.limits
    far = high if high > -low else low
    shares = (
        (0.1, 0.25, 0.5, 0.75, 1.0)
        if joint.type != "continuous"
        else (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0)
    )
    for share in shares:
        there = body.transform(joint.motion(share * far)[:3])
        for n, other in enumerate(others):
            if _shared(there, other) > (CLEAR if n == parent else 0.02):
                return False
    return True


def _shared(a: Manifold, b: Manifold) -> float:
    """Volume of the intersection relative to the smaller solid."""
    one, two = a.bounding_box(), b.bounding_box()
    if any(one[n] >= two[n + 3] or two[n] >= one[n + 3] for n in range(3)):
        return 0.0
    return (a ^ b).volume() / min(a.volume(), b.volume())
