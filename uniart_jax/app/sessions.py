"""Whose files are whose: a folder for every session of the page, removed when the session ends.

    ROOT/<hash>/<name>        uploads, put there by Gradio under the hash of their content
    ROOT/sessions/<secret>/   what was made for one session

Two sessions that upload the same file share it; it goes with the last of them. A page that does not
say that it is left, and a file that no page ever named, go after a time (``sweep``).
"""

from __future__ import annotations

import contextlib
import secrets
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

SECRET = 16  # bytes of a folder's name, which nobody can guess
POLL = 0.05  # seconds between two looks at whether work has stopped
# seconds
SWEEP = 60.0  # between two sweeps
UNCLAIMED = 600.0  # an uploaded file stays that no session has named
UNUSED = 24 * 3600.0  # a session stays of which nothing is heard
LATE = 5.0  # after a page was left its last requests may still come


class Session:
    """One opened page. ``closed`` becomes True when it is left; what works for it should stop.

    Attributes:
      folder: its own, made on first use. uploads: files that it brought. looked: what the page
        keeps of the picture that is shown, followed: of the table (anything).
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.uploads: set[Path] = set()
        self.looked: Any = None
        self.followed: Any = None
        self.closed = False
        self.works = 0
        self.runs = 0
        self.used = time.monotonic()


class Sessions:
    """All opened pages, by Gradio's name for them.

    Args:
      root: the folder for everything, already there. Files in it when ``keep_present`` is called
        are nobody's and stay until ``close_all``.
    """

    def __init__(self, root: Path):
        self.root = root.resolve()
        self.made = self.root / "sessions"
        self.made.mkdir(exist_ok=True)
        self._open: dict[str, Session] = {}
        self._holding: set[Session] = set()  # open ones, and closed ones whose work goes on
        self._left: dict[str, tuple[float, Session]] = {}  # name -> when, for LATE seconds
        self._kept: frozenset[Path] = frozenset()
        self._lock = threading.Lock()

    def keep_present(self) -> None:
        """Files that are there now (the examples) are never removed with a session."""
        self._kept = frozenset(path for path in self.root.rglob("*") if path.is_file())

    def of(self, name: str) -> Session:
        """The session of that name; a new one where there is none. Of one that was closed a moment
        ago, the closed one: what its page asked for last must not open it again."""
        with self._lock:
            now = time.monotonic()
            self._left = {n: left for n, left in self._left.items() if now - left[0] < LATE}
            if name in self._left:
                return self._left[name][1]
            if name not in self._open:
                self._open[name] = Session(self.made / secrets.token_hex(SECRET))
                self._holding.add(self._open[name])
            self._open[name].used = now
            return self._open[name]

    def all(self) -> list[Session]:
        """Those that are open."""
        with self._lock:
            return list(self._open.values())

    def take(self, session: Session, payload: Any) -> Path:
        """The uploaded file that a page names, from now on the session's; removed at once if that
        is closed.

        Args:
          payload: what Gradio's frontend sends for a picture: {"path", …}.

        Raises:
          ValueError: it is none, or lies outside the folder of uploads.
          FileNotFoundError: it is gone.
        """
        path = payload.get("path") if isinstance(payload, dict) else None
        if not isinstance(path, str):
            raise ValueError("no picture: drop one on the page, or pick an example")
        file = Path(path).resolve()
        if not file.is_relative_to(self.root) or file.is_relative_to(self.made):
            raise ValueError("the picture is not one that was uploaded to this page")
        if not file.is_file():
            raise FileNotFoundError(f"{file.name}: it is not here any more; upload it again")
        with self._lock:
            session.uploads.add(file)
            self._holding.add(session)  # also one that was closed a moment ago
            gone = session.closed and not session.works
        if gone:
            self._remove(session)
        return file

    def fresh(self, session: Session, kind: str) -> Path:
        """An empty folder of the session for what is made next; what was made of that kind
        ("object", "picture") before goes."""
        with self._lock:
            session.runs += 1
            folder = session.folder / f"{kind}-{session.runs}"
        if session.folder.is_dir():
            for old in session.folder.glob(f"{kind}-*"):
                shutil.rmtree(old, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder

    @contextlib.contextmanager
    def working(self, session: Session) -> Iterator[None]:
        """While the block runs, the session's files stay even if it is closed."""
        with self._lock:
            session.works += 1
            self._holding.add(session)
        try:
            yield
        finally:
            with self._lock:
                session.works -= 1
                done = session.closed and not session.works
            if done:
                self._remove(session)

    def close(self, name: str) -> None:
        """A page was left: its files are removed, at once or when what works for it has stopped."""
        with self._lock:
            session = self._leave(name)
        if session is not None and not session.works:
            self._remove(session)

    def sweep(self, unclaimed: float = UNCLAIMED, unused: float = UNUSED) -> None:
        """Close sessions of which nothing was heard for ``unused`` seconds, and remove uploads that
        are older than ``unclaimed`` seconds and no session's, as of a page that was closed before
        it could name them."""
        now = time.monotonic()
        with self._lock:
            silent = [
                name
                for name, session in self._open.items()
                if now - session.used > unused and not session.works
            ]
            closed = [self._leave(name) for name in silent]
        for session in filter(None, closed):
            self._remove(session)
        old = [
            file
            for file in self.root.glob("*/*")
            if file.parent != self.made and _age(file) > unclaimed
        ]
        with self._lock:
            held = self._kept.union(*(session.uploads for session in self._holding))
            for file in old:
                if file not in held:
                    _discard(file)

    def close_all(self, patience: float = 10.0) -> None:
        """Close every session and remove ``root``; work that is going on gets so many seconds to
        stop."""
        with self._lock:
            sessions = list(self._open.values())
            self._open.clear()
            for session in sessions:
                session.closed = True
        end = time.monotonic() + patience
        while any(session.works for session in sessions) and time.monotonic() < end:
            time.sleep(POLL)
        shutil.rmtree(self.root, ignore_errors=True)

    def _leave(self, name: str) -> Session | None:
        """Marks a session as closed; under the lock."""
        session = self._open.pop(name, None)
        if session is not None:
            session.closed = True
            self._left[name] = time.monotonic(), session
        return session

    def _remove(self, session: Session) -> None:
        shutil.rmtree(session.folder, ignore_errors=True)
        with self._lock:
            self._holding.discard(session)
            held = self._kept.union(*(other.uploads for other in self._holding))
            for file in session.uploads - held:
                _discard(file)
            session.uploads = set()


def _age(file: Path) -> float:
    """Seconds since a file came where it is; 0 of what is none."""
    with contextlib.suppress(OSError):
        found = file.stat()
        if stat.S_ISREG(found.st_mode):
            return time.time() - max(found.st_mtime, found.st_ctime)
    return 0.0


def _discard(file: Path) -> None:
    file.unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # the folder of another file, too
        file.parent.rmdir()
