"""Shapes made of pieces, solids with their materials.

Take ``shape_of`` where materials only touch, and ``merged`` to have it tidied or turned as well;
``trimmed`` where materials overlap and the one named first keeps its room; ``layered`` where each
single solid gives way to all before it, whatever their materials.
``disjoint`` gives what ``trimmed`` is made of, to be worked on further.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from manifold3d import Manifold

from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Shape, cut, tidy, union


def _groups(pieces: Iterable[tuple[Manifold, Material]]) -> dict[Material, list[Manifold]]:
    """The solids of each material, materials in the order in which they first come."""
    groups: dict[Material, list[Manifold]] = {}
    for solid, material in pieces:
        groups.setdefault(material, []).append(solid)
    return groups


def shape_of(pieces: Iterable[tuple[Manifold, Material]]) -> Shape:
    """A shape of solids and their materials."""
    shape = Shape()
    for solid, material in pieces:
        shape.add(solid, material)
    return shape


def disjoint(
    pieces: Iterable[tuple[Manifold, Material]], *, tidied: float = 0.0
) -> Iterator[tuple[Manifold, Material]]:
    """One solid a material; where materials overlap, the one that comes later gives way.
    ``tidied``: the tolerance to which each is tidied before it cuts those that follow, 0: not."""
    before: list[Manifold] = []
    for material, solids in _groups(pieces).items():
        solid = cut(union(solids), before)
        before.append(tidy(solid, tidied) if tidied else solid)
        yield before[-1], material


def trimmed(*pieces: tuple[Manifold, Material], tidied: float = 1e-5) -> Shape:
    """A shape of one tidy solid a material, as ``disjoint`` gives them."""
    return shape_of(disjoint(pieces, tidied=tidied))


def merged(pieces: Iterable[tuple[Manifold, Material]], yaw: float = 0.0) -> Shape:
    """Solids that touch or overlap, as one tidy solid a material, turned about z by ``yaw``
    degrees."""
    shape = Shape()
    for material, solids in _groups(pieces).items():
        shape.add(tidy(union(solids).rotate((0, 0, yaw))), material)
    return shape


def layered(pieces: Iterable[tuple[Manifold, Material]]) -> Shape:
    """Solids of which a later one gives way to the earlier ones."""
    out, before = [], None
    for solid, material in pieces:
        out.append((solid if before is None else solid - before, material))
        before = solid if before is None else before + solid
    return merged(out)
