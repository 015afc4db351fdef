"""What moves of an object, in words: "1 hinge, 2 knobs"."""

from __future__ import annotations

from uniart_jax.export.naming import KINDS, is_knob
from uniart_jax.objects.object import ArticulatedObject

ORDER = ("hinge", "knob", "slider", "screw")


def moving_words(obj: ArticulatedObject) -> str:
    """How many parts move and how, as ``export.naming`` calls them; "no moving part" of none."""
    kinds = [
        "knob" if is_knob(obj, k) else KINDS[part.joint.type]
        for k, part in enumerate(obj.parts)
        if part.joint.type != "fixed"
    ]
    counts = [(kinds.count(kind), kind) for kind in ORDER if kind in kinds]
    return ", ".join(counted(n, kind) for n, kind in counts) or "no moving part"


def counted(number: int, what: str) -> str:
    """ "1 part", "2 parts"."""
    return f"{number} {what}{'' if number == 1 else 's'}"
