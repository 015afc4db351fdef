"""What was found in a picture, in words: "1 hinge, 2 knobs"."""

from __future__ import annotations

from pathlib import Path

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
    return ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for n, kind in counts) or "no moving part"


def closing_line(obj: ArticulatedObject, folder: Path) -> str:
    """What was found, and what to open to move it."""
    page = folder / "view.html"
    moves = any(part.joint.type != "fixed" for part in obj.parts)
    look = f"open {page} in a browser" + (": a slider for every joint" if moves else "")
    return f"found: {moving_words(obj)}" + (f"; {look}" if page.is_file() else "")
