"""Where the files of ``configs/`` are: beside the package in a checkout, inside it in a wheel.

The wheel's copy is made when it is built (``pyproject.toml``, sources); there is one source.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
_INSIDE, _BESIDE = _PACKAGE / "configs", _PACKAGE.parent / "configs"
CONFIGS = _INSIDE if _INSIDE.is_dir() else _BESIDE


def find_file(name: str | Path, kind: str, folder: Path) -> Path:
    """The Python file that a name means: a path as it is, or the name of a file in ``folder``.

    Args:
      kind: "config" or "experiment", for the message.

    Raises:
      FileNotFoundError: neither; the names that there are, are listed.
    """
    path = Path(name)
    if path.suffix == ".py" and path.is_file():
        return path
    named = folder / f"{name}.py"
    if path.name == str(name) and named.is_file():
        return named
    known = ", ".join(sorted(file.stem for file in folder.glob("*.py"))) or "none here"
    raise FileNotFoundError(
        f"{kind} '{name}': no such file; give a .py file, or a name of these: {known}"
    )


def run_file(path: Path) -> object:
    """What ``config()`` of a file gives, the user's own code; None where it defines none.

    Raises:
      ValueError: the file is not Python, or it fails.
    """
    spec = importlib.util.spec_from_file_location("uniart_config", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"config '{path}': not a Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        return module.config() if hasattr(module, "config") else None
    except Exception as error:
        raise ValueError(f"config '{path}': {type(error).__name__}: {error}") from error
