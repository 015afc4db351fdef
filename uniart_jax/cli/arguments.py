"""What the commands share: options that several have, user errors as one line, and a look at the output folder before any work."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import tyro

Out = Annotated[Path, tyro.conf.arg(help="Folder to write.")]
Overwrite = Annotated[
    bool, tyro.conf.arg(help="Replace OUT if it is not empty (swapped at the end).")
]


def guarded(command: Callable[[], int | None]) -> int:
    """Run a command; user errors become one line and exit code 2, Ctrl-C becomes 130."""

    def show(message, category, filename, lineno, file=None, line=None):
        if issubclass(category, UserWarning):
            print(f"warning: {message}", file=sys.stderr)

    warnings.showwarning = show
    try:
        return command() or 0
    except (ValueError, OSError, ArithmeticError, MemoryError) as error:
        message = " ".join(str(error).split()) or type(error).__name__
        print(f"error: {message}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130


def check_out(folder: Path, overwrite: bool, inputs: tuple[Path, ...] = ()) -> None:
    """Refuse, before any work, an output folder that cannot be written or that holds an input.

    Raises:
      ValueError: it or a parent is a file, or it is not empty and may not be replaced.
    """
    from uniart_jax.export.asset import check_target

    for place in (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            raise ValueError(f"output '{place}': a file of that name exists; choose another --out")
    check_target(folder, overwrite, inputs=inputs)


def shard_numbers(text: str) -> tuple[int, int]:
    """ "i/n" as two numbers."""
    number, slash, of = text.partition("/")
    if not (slash and number.isdecimal() and of.isdecimal() and int(number) < int(of)):
        raise ValueError(f"--shard must be i/n with i in 0..n-1, got '{text}'")
    return int(number), int(of)
