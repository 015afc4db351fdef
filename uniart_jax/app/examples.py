"""Pictures and tables to begin with: ``examples`` beside the package in a checkout; a wheel has
them inside (``pyproject.toml``, sources)."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
_INSIDE, _BESIDE = _PACKAGE / "examples", _PACKAGE.parent / "examples"


def example_pictures() -> list[Path]:
    """The renderings by name, then the photograph; empty where there are none."""
    folder = _folder()
    return [*sorted(folder.glob("images/*.png")), *folder.glob("photograph.jpg")]


def example_tables() -> list[Path]:
    """Layouts that objects are made of without a picture, by name; empty where there are none."""
    return sorted(_folder().glob("layouts/*.json"))


def _folder() -> Path:
    return _INSIDE if _INSIDE.is_dir() else _BESIDE
