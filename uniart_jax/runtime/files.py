"""Files that are complete or absent: written under another name beside their place, which they take
at the end. All are of file systems: an address of a bucket is refused."""

from __future__ import annotations

import contextlib
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

# of ``gs://bucket``; pathlib makes one slash of two. A drive has one letter.
_REMOTE = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):/+")


def check_local(path: str | Path, what: str) -> None:
    """Refuse the address of a bucket, of which a folder ``gs:`` would be made here.

    Args:
      what: which setting it is, for the message.

    Raises:
      ValueError: ``path`` begins as an address does.
    """
    if found := _REMOTE.match(str(path)):
        address = f"{found[1]}://{str(path)[found.end() :]}"
        raise ValueError(
            f"{what} '{address}': an address is no folder; mount the bucket (gcsfuse, Filestore) "
            "and give its folder"
        )


def _place() -> str:
    """Where the numbers of processes are counted: containers may share their host's name."""
    try:
        numbers = os.readlink("/proc/self/ns/pid")
    except OSError:
        numbers = ""
    return re.sub(r"[^A-Za-z0-9]+", "_", socket.gethostname() + numbers)


_HOST = _place()


def temporary_path(path: Path) -> Path:
    """The name of a file of this process until it is complete: no other process, here or elsewhere,
    has the same."""
    return path.with_name(f".{path.name}.{_HOST}-{os.getpid()}.tmp")


@contextlib.contextmanager
def complete(path: Path) -> Iterator[Path]:
    """The name to write a file under, which gets its own if nothing was raised."""
    temporary = temporary_path(path)
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """A text in UTF-8; lines end as they do in ``text``."""
    with complete(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def sweep(folder: Path) -> None:
    """Remove what processes of this machine, or container, that are gone left half-written; what
    others are writing stays."""
    for path in folder.glob(f".*.{_HOST}-*.tmp"):
        number = path.name.removesuffix(".tmp").rpartition("-")[2]
        if number.isdecimal() and not _alive(int(number)):
            path.unlink(missing_ok=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
