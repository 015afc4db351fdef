"""Names that strangers gave: made fit for files, tables and terminals, and told apart."""

from __future__ import annotations

from collections.abc import Iterable

MAX_NAME = 80


class Numbered:
    """Gives each name once: the second 'door' is 'door_2'. Linear in the number of names."""

    def __init__(self, taken: Iterable[str] = ()):
        self.taken = set(taken)
        self._last: dict[str, int] = {}

    def __call__(self, name: str, limit: int | None = None) -> str:
        """``name``, or it with the first number that is free; at most ``limit`` characters where
        one is given."""
        fresh = name
        while fresh in self.taken:
            self._last[name] = self._last.get(name, 1) + 1
            suffix = f"_{self._last[name]}"
            fresh = (name if limit is None else name[: limit - len(suffix)]) + suffix
        self.taken.add(fresh)
        return fresh


def printable(text: str, instead: str = "_") -> str:
    """Without line breaks, control and format characters and lone surrogates: what UTF-8 and XML
    can hold and a terminal shows."""
    return "".join(c if c.isprintable() else instead for c in " ".join(text.split()))


def one_line(text: str) -> str:
    """A message that can be printed, without line breaks, at most 500 characters."""
    text = printable(str(text)[:10_000], "?")
    return text if len(text) <= 500 else text[:497] + "..."


def clean(name: str) -> str:
    """A name that can be printed, at most ``MAX_NAME`` characters."""
    return printable(name[: 4 * MAX_NAME])[:MAX_NAME].strip()
