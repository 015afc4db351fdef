"""Where objects come from: procedural generators, PartNet-Mobility, or any folder of assets. Each
object is an ``Entry``, made when it is needed."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from uniart_jax.data.folder import Settings
from uniart_jax.objects.facing import faced
from uniart_jax.objects.object import ArticulatedObject

HEAD_BYTES = 1 << 16
META_BYTES = 1 << 20


@dataclasses.dataclass(frozen=True)
class Entry:
    """An object that is not made yet.

    Attributes:
      key: names it in its folder of records; no two are equal.
      category: for people, tables and splits; no network sees it.
      split: train, test, ... (``data.splits``).
      seed: of a procedural object, else -1.
      path: of an asset, relative to ``Settings.root``.
    """

    key: str
    category: str
    split: str = ""
    seed: int = -1
    path: str = ""

    def generator(self, *stream: int) -> np.random.Generator:
        """Random numbers of this object: of its seed or, for an asset, of its key, so that other
        objects of a folder do not matter."""
        own = self.seed
        if own < 0:
            own = int.from_bytes(hashlib.blake2b(self.key.encode(), digest_size=8).digest(), "big")
        return np.random.default_rng([own, *stream])


class ProceduralEntries(Sequence[Entry]):
    """Object k is drawn from family k mod F with seed start_seed + k: every prefix is balanced."""

    def __init__(self, families: Sequence[str], start_seed: int, count: int):
        self.families, self.start_seed, self.number = tuple(families), start_seed, count

    def __len__(self) -> int:
        return self.number

    def __getitem__(self, index):
        from uniart_jax import procedural

        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(self.number))]
        if not 0 <= index < self.number:
            raise IndexError(index)
        family, seed = self.families[index % len(self.families)], self.start_seed + index
        split = "held-out" if seed >= procedural.HELD_OUT_SEED else "train"
        return Entry(f"{family}-{seed:07d}", family, split, seed)


def find_entries(root: str | Path, source: str) -> list[Entry]:
    """The assets below a folder, sorted by path; their splits are not set.

    Args:
      source: "partnet-mobility": every folder with a ``mobility.urdf``. "urdf": every folder or
        file that ``load_object`` takes.

    Raises:
      FileNotFoundError: no such folder, or nothing in it.
    """
    root = Path(root)
    if not root.is_dir():
        raise FileNotFoundError(f"prepare: '{root}': no such folder")
    paths: list[Path] = []
    seen = {os.path.realpath(root)}
    for folder, inner, files in os.walk(root, followlinks=True):
        inner[:] = [n for n in sorted(inner) if _first_time(os.path.join(folder, n), seen)]
        found = _assets(Path(folder), sorted(files), source)
        paths += found
        if found == [Path(folder)]:
            inner.clear()  # what lies below belongs to the asset
    included = {name for path in paths if path.suffix == ".xml" for name in _included(path)}
    paths = [path for path in paths if path.resolve() not in included]
    if not paths:
        what = "mobility.urdf" if source == "partnet-mobility" else "URDF, MJCF or object.json"
        raise FileNotFoundError(f"prepare: '{root}': no {what} in it or below it")
    entries = []
    for path in sorted(paths):
        relative = path.relative_to(root)
        key = relative.as_posix() if relative.parts else root.resolve().name
        category = clean(_category(path, relative))[:80]
        entries.append(Entry(clean(key), category, path=relative.as_posix()))
    return entries


def clean(text: str) -> str:
    """Text that any file can hold: without lone surrogates (names of files that are not UTF-8) and
    control characters."""
    text = text.encode("utf-8", "replace").decode()
    return "".join(c if c.isprintable() else " " for c in text)


def _first_time(folder: str, seen: set[str]) -> bool:
    """Links are followed, each folder once."""
    real = os.path.realpath(folder)
    new = real not in seen
    seen.add(real)
    return new


def _assets(folder: Path, files: list[str], source: str) -> list[Path]:
    """What of a folder is an asset: the folder, if one description in it is meant, or each of
    several files."""
    if source == "partnet-mobility":
        return [folder] if "mobility.urdf" in files else []
    if {"object.urdf", "mobility.urdf", "object.json"} & {*files}:
        return [folder]
    described = [name for name in files if name.endswith(".urdf")]
    described += [n for n in files if n.endswith(".xml") and _is_mjcf(folder / n)]
    return [folder / name for name in described]


def _is_mjcf(path: Path) -> bool:
    return re.search(rb"<mujoco[\s>]", _head(path, HEAD_BYTES)) is not None


def _head(path: Path, count: int) -> bytes:
    """The first bytes of a file; none where it is no file or cannot be read: its reader will say
    so."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(count)
    except OSError:
        return b""


def _included(path: Path) -> list[Path]:
    """Files that an MJCF includes: parts of it, not assets of their own."""
    names = re.findall(rb"<include\s[^>]*file=[\"']([^\"'\0]+)", _head(path, META_BYTES))
    return [(path.parent / name.decode(errors="replace")).resolve() for name in names]


def _category(path: Path, relative: Path) -> str:
    """What the asset's ``meta.json`` says (PartNet-Mobility), else the folder of assets that it
    stands in, if that is not the root."""
    meta = path / "meta.json"
    try:
        said = json.loads(_head(meta, META_BYTES) or b"{}")
        if isinstance(said, dict) and isinstance(said.get("model_cat"), str):
            return said["model_cat"]
    except (ValueError, RecursionError):  # the reader of the object will say so
        pass
    return relative.parts[0] if len(relative.parts) > 1 else ""


def entry_of(row: Mapping[str, str], settings: Settings) -> Entry:
    """The entry that a manifest's row came from."""
    key, seed, root = row["object"], int(row["seed"] or -1), Path(settings.root)
    alone = key == root.resolve().name and not (root / key).exists()
    return Entry(
        key, row["category"], row["split"], seed, "" if seed >= 0 else "." if alone else key
    )


def load_entry(entry: Entry, settings: Settings) -> ArticulatedObject:
    """The object, in metres or normalised, with one joint a part: what codes hold.

    Raises:
      ValueError, FileNotFoundError: it cannot be made; one line.
    """
    if settings.source == "procedural":
        from uniart_jax import procedural

        return procedural.generate(entry.category, entry.seed)
    from uniart_jax.objects.load import load_object

    path = Path(settings.root) / entry.path
    obj = load_object(path, allow_outside=settings.allow_outside).single_jointed()
    return faced(obj, settings.front)
