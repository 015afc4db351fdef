"""What ``sample`` and ``layout`` say: what was found in a picture, and what to open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from uniart_jax.export.words import moving_words
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.kind import Kind
from uniart_jax.voxels.layout import Layout

GUESSED = 0.35  # below it .24 of the moving parts of validation objects are right


def certainty_line(layout: Layout | None) -> str:
    """How sure the parts are; nothing where that is not known."""
    if layout is None or layout.certainty is None:
        return ""
    line = f"certainty {layout.certainty:.2f}, the share of moving parts expected to be right"
    guess = "; low: the model may not know such a thing"
    return line + (guess if layout.certainty < GUESSED else "")


def say_again(say: Callable[[str], None], name: str) -> Callable[[str], None]:
    """What says that a vision-language model is asked again, and why."""
    return lambda problem: say(f"{name}: asking again: {problem}")


def closing_line(kind: Kind, obj: ArticulatedObject, folder: Path) -> str:
    """What was found ("an oven-like object: 1 hinge, 2 knobs"), and what to open to move it."""
    page = folder / "view.html"
    moves = any(part.joint.type != "fixed" for part in obj.parts)
    look = f"open {page} in a browser" + (": a slider for every joint" if moves else "")
    return f"found: {kind}: {moving_words(obj)}" + (f"; {look}" if page.is_file() else "")
