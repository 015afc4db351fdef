"""Folders that are complete or absent: made under another name beside their place, and swapped in
at the end."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from uniart_jax.runtime.files import check_local

MARKS = ("object.urdf", "report.json")  # what a folder must hold to be replaced


def check_target(
    folder: str | Path,
    overwrite: bool = False,
    inputs: Sequence[str | Path] = (),
    marks: Sequence[str] = MARKS,
) -> Path:
    """The folder that an asset may be written to, made absolute with links followed. Touches
    nothing.

    Args:
      overwrite: a folder that holds an asset may be replaced; no other that is not empty ever is.
      inputs: files that the asset is made from; a folder that holds one of them would take it
        along.
      marks: files one of which a folder must hold to be replaced.

    Raises:
      ValueError: the folder is a file or an address, holds the working or home directory or an
        input, is a file system's root, or is not empty and may not be replaced.
    """
    check_local(folder, "output")
    final = Path(folder).resolve()
    if final.exists() and not final.is_dir():
        raise ValueError(f"{folder}: it is a file; choose another --out")
    for name, find in (("working", Path.cwd), ("home", Path.home)):
        with contextlib.suppress(OSError, RuntimeError):  # there is none
            if find().resolve().is_relative_to(final):
                raise ValueError(f"{folder}: it holds the {name} directory; choose another --out")
    if os.path.ismount(final):
        raise ValueError(f"{folder}: it is the root of a file system; choose another --out")
    for path in inputs:
        if Path(path).resolve().is_relative_to(final):
            raise ValueError(f"{folder}: it holds the input {path}; choose another --out")
    if not final.is_dir() or not any(final.iterdir()):
        return final
    if not overwrite:
        raise ValueError(f"{folder}: the folder is not empty; choose another --out, or --overwrite")
    if not any((final / name).is_file() for name in marks):
        raise ValueError(
            f"{folder}: it is not empty and holds no asset or checkpoint ({' or '.join(marks)}), "
            "so it is not replaced; choose another --out"
        )
    return final


@contextlib.contextmanager
def complete_folder(
    folder: str | Path, overwrite: bool = False, marks: Sequence[str] = MARKS
) -> Iterator[Path]:
    """A temporary folder beside ``folder`` that takes its place when the block ends, and vanishes
    if the block fails.

    Raises:
      ValueError: ``check_target`` refuses ``folder``, before the block or after it, or it cannot be
        made.
    """
    final = check_target(folder, overwrite, marks=marks)
    made = _make_parents(final.parent, folder)
    try:
        try:
            work = Path(tempfile.mkdtemp(prefix=f".{final.name[:80]}.new-", dir=final.parent))
        except OSError as error:
            raise ValueError(f"{folder}: cannot write there ({error.strerror})") from None
        try:
            yield work
            mask = os.umask(0)
            os.umask(mask)
            work.chmod(0o777 & ~mask)  # mkdtemp makes it private
            check_target(folder, overwrite, marks=marks)  # minutes may have passed
            _swap(work, final)
        finally:
            shutil.rmtree(work, ignore_errors=True)
    except BaseException:
        for parent in reversed(made):
            with contextlib.suppress(OSError):  # not empty any more: somebody else's
                parent.rmdir()
        raise


def _make_parents(parent: Path, folder: str | Path) -> list[Path]:
    """Make ``parent``; the folders that did not exist before, outermost first."""
    missing = [p for p in (parent, *parent.parents) if not p.exists()]
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"{folder}: cannot make its parent folder ({error.strerror})") from None
    return missing[::-1]


def _swap(work: Path, final: Path) -> None:
    """Put ``work`` in the place of ``final``; an old folder is removed only when the new one
    stands."""
    if not final.exists():
        work.rename(final)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{final.name[:80]}.old-", dir=final.parent))
    try:
        final.rename(old / final.name)
        try:
            work.rename(final)
        except OSError:
            (old / final.name).rename(final)
            raise
    finally:
        if final.exists():
            shutil.rmtree(old, ignore_errors=True)
