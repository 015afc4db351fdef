"""Pictures to begin with: ``examples`` beside the package in a checkout; a wheel has them inside
(``pyproject.toml``, sources)."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
_INSIDE, _BESIDE = _PACKAGE / "examples", _PACKAGE.parent / "examples"


def example_pictures() -> list[Path]:
    """The renderings by name, then the photograph; empty where there are none."""
    folder = _INSIDE if _INSIDE.is_dir() else _BESIDE
    return [*sorted(folder.glob("images/*.png")), *folder.glob("photograph.jpg")]
