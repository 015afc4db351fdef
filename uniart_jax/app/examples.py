"""Pictures to begin with: ``examples/images`` beside the package in a checkout; a wheel has them
inside (``pyproject.toml``, sources)."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
_INSIDE, _BESIDE = _PACKAGE / "example_images", _PACKAGE.parent / "examples" / "images"


def example_pictures() -> list[Path]:
    """The PNG files, by name; empty where there are none."""
    folder = _INSIDE if _INSIDE.is_dir() else _BESIDE
    return sorted(folder.glob("*.png"))
