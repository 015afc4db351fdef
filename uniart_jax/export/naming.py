"""What parts are called where nobody gave them a name: by what they are (``part_kinds``).

`base`, `door_1`, `drawer_1`, `knob_1`, `hinge_1`, each kind counted from the top left
of the front, row by row, as one reads.
"""

from __future__ import annotations

import dataclasses
import re

from uniart_jax.export.part_kinds import part_kinds
from uniart_jax.objects.names import Numbered, clean
from uniart_jax.objects.object import ArticulatedObject, bounds_at

BASE = "base"
MADE_UP = re.compile(
    r"\s*|(?:link|part|mesh|geom|object|obj|node|piece)[ _.-]*\d*|(?:body|l|p|b)?[ _.-]*\d+",
    re.IGNORECASE,
)  # names that a program counted out, or none


def is_made_up(name: str) -> bool:
    """Whether a part's name tells nothing of it: ``link_3``, ``part 2``, nothing at all."""
    return MADE_UP.fullmatch(name) is not None


def named(obj: ArticulatedObject) -> ArticulatedObject:
    """The object with names that say something.

    A name that somebody gave is kept. In the place of a made-up one (``is_made_up``) stands the
    part's label, numbered where several have the same; without a label the root is ``base`` and
    other parts are called what they are (``part_kinds``), with a number.
    """
    given = [None if is_made_up(part.name) else part.name for part in obj.parts]
    taken = Numbered(name for name in given if name is not None)
    names = dict(enumerate(given))
    kinds = part_kinds(obj)
    counts: dict[str, int] = {}
    for k in reading_order(obj):
        part = obj.parts[k]
        if names[k] is not None:
            continue
        if clean(part.label):
            names[k] = taken(clean(part.label))
        elif part.parent < 0:
            names[k] = taken(BASE)
        else:
            names[k] = _counted(kinds[k], counts, taken)
    parts = [dataclasses.replace(p, name=names[k] or p.name) for k, p in enumerate(obj.parts)]
    return dataclasses.replace(obj, parts=tuple(parts))


def _counted(kind: str, counts: dict[str, int], taken: Numbered) -> str:
    """The next free ``<kind>_<number>``."""
    while True:
        counts[kind] = counts.get(kind, 0) + 1
        name = f"{kind}_{counts[kind]}"
        if name not in taken.taken:
            return taken(name)


def reading_order(obj: ArticulatedObject) -> list[int]:
    """The root, then the parts at rest as one reads the front (which is at -x): rows from the top,
    each from the left, +y. A row goes down as far as the part with its highest middle."""
    boxes = bounds_at(obj, obj.rest())
    middle = boxes.mean(1)
    left = sorted(range(1, len(obj.parts)), key=lambda k: (-middle[k, 2], -middle[k, 1], k))
    order = [0]
    while left:
        floor = boxes[left[0], 0, 2]
        row = [k for k in left if middle[k, 2] >= floor]
        order += sorted(row, key=lambda k: (-middle[k, 1], -middle[k, 2], k))
        left = [k for k in left if k not in row]
    return order
