"""What moves of an object, in words: "1 door, 2 knobs"."""

from __future__ import annotations

from uniart_jax.export.part_kinds import ORDER, part_kinds
from uniart_jax.objects.object import ArticulatedObject


def moving_words(obj: ArticulatedObject) -> str:
    """How many parts move and what they are (``part_kinds``); "no moving part" of none."""
    found = zip(part_kinds(obj), obj.parts, strict=True)
    kinds = [kind for kind, part in found if part.joint.type != "fixed"]
    counts = [(kinds.count(kind), kind) for kind in ORDER if kind in kinds]
    return ", ".join(counted(n, kind) for n, kind in counts) or "no moving part"


def counted(number: int, what: str) -> str:
    """ "1 part", "2 parts"."""
    return f"{number} {what}{'' if number == 1 else 's'}"
