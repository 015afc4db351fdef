"""Which prediction is held against which reference: two folders of assets, matched by name.

    REF/<name>/object.urdf        a folder with any asset that ``load_object`` reads, or a single file REF/<name>.urdf (or an MJCF)
    REF/sets.json                 optional: {"<name>": "closed" or "open"}, for means of each set apart
    PRED/<name>/...               the same, or several samples of one object: PRED/<name>/sample-0/..., any sub-folders that are assets

As SINGAPO and DIPO lay them out: REF/<category>/<name>/ (and PRED/), and of a test run
PRED/<number>@<category>@<name>/<sample>/, once for each picture of the object.

REF may be one asset; PRED is then one too, holds one of that name, or holds ``sample-<i>`` of it.
Links that lead out of PRED or REF are not followed unless the caller allows it: a prediction could
be a link to its own reference.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import hashlib
import os
import pickle
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from trimesh.visual import TextureVisuals

from uniart_jax.objects.asset_files import FORMATS, IMAGES
from uniart_jax.objects.json_text import parse_json
from uniart_jax.objects.load import NAMES, find_asset, kind_of
from uniart_jax.objects.names import printable
from uniart_jax.objects.object import ArticulatedObject

SETS = "sets.json"
RESULTS = "settings.json"  # lies in a folder of results (``result_store.check_settings``)
SHARED = (*FORMATS, *IMAGES, ".mtl", ".bin")
MAX_BYTES = 16 * 2**20
SAMPLE = re.compile(r"(sample-)?\d+")  # folders that sample.py, SINGAPO and DIPO write
TEST_RUN = re.compile(r"\d+@.*@(?P<name>[^@]+)")  # SINGAPO's and DIPO's, one of each picture
OUTSIDE = "it is a link that leads out of its folder; --allow-outside follows it"


@dataclasses.dataclass(frozen=True)
class Missing:
    """Where a prediction should be and is none; ``why`` in one line."""

    why: str


# A file or folder, an object, or what makes one where it is needed (a function that workers can
# import, with its arguments).
Source = Path | ArticulatedObject | Callable[[], ArticulatedObject]
Predictions = Path | Mapping[str, Source | Sequence[Source]]


@dataclasses.dataclass(frozen=True)
class Pair:
    """A reference and what is predicted for it, at least one sample or what is missing."""

    name: str
    reference: Source
    samples: tuple[Source | Missing, ...]


def find_references(
    reference: Path | Mapping[str, Source], *, allow_outside: bool = False
) -> dict[str, Source]:
    """Name -> reference, sorted by name.

    Raises:
      FileNotFoundError: no such folder, or no asset in it. ValueError: two of one name, a link that
        leads out, or an object whose name is none.
    """
    if not isinstance(reference, Path):
        return {_checked(name): source for name, source in sorted(reference.items())}
    _check_exists(reference, "REF")
    if _is_one(reference, allow_outside):
        return {_own_name(reference): reference}
    found: dict[str, Source] = {}
    for name, path in _opened(reference, allow_outside):
        if not _may_read(path, reference, allow_outside):
            raise ValueError(f"reference '{name}' in {reference}: {OUTSIDE}")
        if not _is_asset(path, allow_outside):
            continue
        if name in found:
            raise ValueError(f"{reference}: two references are called '{name}'; rename one")
        found[name] = path
    if not found:
        raise FileNotFoundError(
            f"{reference}: no reference in it; it should be an asset, or hold a folder or a file "
            "NAME.urdf for each"
        )
    return dict(sorted(found.items()))


def find_pairs(
    predictions: Predictions,
    references: Mapping[str, Source],
    *,
    allow_outside: bool = False,
) -> tuple[list[Pair], list[str]]:
    """A pair for every reference, in their order, and the names of predictions that have none.

    Args:
      references: of ``find_references``.

    Raises:
      FileNotFoundError: no such folder. ValueError: nothing in it, or no name that a reference has.
    """
    names = list(references)
    if isinstance(predictions, Path):
        found = _predictions(predictions, names, allow_outside)
    else:
        found = {_checked(n): _as_samples(s) for n, s in predictions.items()}
    if found and not set(found) & set(names):
        raise ValueError(
            f"no prediction has a reference's name: predictions are called {_some(found)}, "
            f"references {_some(names)}"
        )
    absent = (Missing("there is no prediction of this name"),)
    pairs = [Pair(name, references[name], found.get(name) or absent) for name in names]
    return pairs, sorted(set(found) - set(names))


def read_sets(reference: Path, names: Sequence[str]) -> dict[str, str]:
    """Name -> "closed" or "open", as far as ``REF/sets.json`` says; empty where there is none.

    Raises:
      ValueError: it is not such a file, or knows none of the names.
    """
    file = reference / SETS
    if not file.is_file() or not _may_read(file, reference, False):
        return {}
    with file.open("rb") as opened:
        said = parse_json(opened.read(MAX_BYTES + 1), str(file), MAX_BYTES)
    if not isinstance(said, dict) or not set(map(str, said.values())) <= {"closed", "open"}:
        raise ValueError(f'{file}: it should map names of references to "closed" or "open"')
    sets = {tidy(name): value for name, value in said.items()}
    if not set(sets) & set(names):
        raise ValueError(f"{file}: it names none of the references ({_some(names)})")
    return {name: sets[name] for name in names if name in sets}


def tidy(name: str) -> str:
    """A file's name as text that can be compared and printed, whichever system wrote it (Unicode
    NFC)."""
    return printable(unicodedata.normalize("NFC", name), "?") or "_"


def check_out(out: Path, sources: Iterable[Source | Missing]) -> None:
    """Results may lie beside what is compared, or below it, but not among an asset's own files.

    Raises:
      ValueError: ``out`` is an asset's folder.
    """
    for source in sources:
        if isinstance(source, Path) and out.resolve() == _folder(source).resolve():
            raise ValueError(f"{out}: it holds an asset that is compared; choose another --out")


def fingerprint(source: Source | Missing, apart: Path | None = None) -> str:
    """Changes when the source does: sizes and times of all files in an asset's folder, the arrays
    of an object, a function's arguments.

    Args:
      apart: a folder of results, which is no part of an asset wherever it lies.
    """
    digest = hashlib.blake2b(digest_size=16)
    if isinstance(source, Missing):
        digest.update(source.why.encode())
    elif isinstance(source, Path):
        digest.update(repr(source.name if source.is_file() else "").encode())
        for name, size, time in _listing(_folder(source), apart):
            digest.update(f"{name!r} {size} {time}\n".encode("utf-8", "surrogateescape"))
    elif isinstance(source, ArticulatedObject):
        for piece in _arrays(source):
            digest.update(piece)
    else:
        digest.update(pickle.dumps(source, protocol=5))
    return digest.hexdigest()


def _folder(asset: Path) -> Path:
    return asset if asset.is_dir() else asset.parent


def _listing(folder: Path, apart: Path | None) -> Iterator[tuple[str, int, int]]:
    left_out = None if apart is None else apart.resolve()
    for where, inner, files in os.walk(folder):
        inner[:] = sorted(name for name in inner if (Path(where) / name).resolve() != left_out)
        for name in sorted(files):
            path = os.path.join(where, name)
            try:
                status = os.stat(path)
            except OSError:  # a link to nothing; its reader will say so
                continue
            yield os.path.relpath(path, folder), status.st_size, status.st_mtime_ns


def _arrays(obj: ArticulatedObject) -> Iterator[bytes]:
    yield repr((obj.scale, obj.category)).encode()
    for part in obj.parts:
        joint, visual = part.joint, part.mesh.visual
        yield repr((part.name, part.label, part.parent, joint.angle, joint.travel)).encode()
        arrays = [joint.origin, joint.direction, part.mesh.vertices, part.mesh.faces]
        if isinstance(visual, TextureVisuals):
            image = getattr(visual.material, "image", None)
            image = image or getattr(visual.material, "baseColorTexture", None)
            arrays += [visual.uv, visual.material.main_color, image]
        elif visual is not None and visual.kind is not None:
            arrays += [visual.vertex_colors if visual.kind == "vertex" else visual.face_colors]
        for array in arrays:
            if array is not None:
                yield np.ascontiguousarray(array).tobytes()


def _predictions(
    root: Path, names: list[str], allow_outside: bool
) -> dict[str, tuple[Source | Missing, ...]]:
    _check_exists(root, "PRED")
    if _is_one(root, allow_outside):
        if len(names) == 1:
            return {names[0]: (root,)}
        if root.is_file() or any((root / name).is_file() for name in NAMES):
            raise ValueError(
                f"{root} is one asset, but there are {len(names)} references; give REF/NAME"
            )
    found: dict[str, tuple[Source | Missing, ...]] = {}
    empty: dict[str, tuple[Source | Missing, ...]] = {}
    none = (Missing("its folder holds no asset"),)
    for given, path in _opened(root, allow_outside, names):
        samples = _samples(path, root, allow_outside)
        run = None if given in names else TEST_RUN.fullmatch(given)
        if run and run["name"] in names:  # a sample of each picture
            found[run["name"]] = (*found.get(run["name"], ()), *(samples or none))
            continue
        if given in found and samples:
            raise ValueError(f"{root}: two predictions are called '{given}'; rename one")
        if samples:
            found[given] = samples
        elif path.is_dir() and given in names:
            empty[given] = none
    found = empty | found
    if not found:
        raise ValueError(
            f"{root}: no prediction in it; it should be an asset, or hold a folder or a file "
            "NAME.urdf for each"
        )
    if len(names) == 1 and names[0] not in found and all(map(SAMPLE.fullmatch, found)):
        inner = sorted(found, key=_natural)
        return {names[0]: tuple(s for name in inner for s in found[name])}
    return found


def _samples(path: Path, root: Path, allow_outside: bool) -> tuple[Source | Missing, ...]:
    """What is predicted at ``path``: an asset, or several in its sub-folders."""
    if not _may_read(path, root, allow_outside):
        return (Missing(OUTSIDE),)
    if _is_asset(path, allow_outside):
        return (path,)
    if not path.is_dir():
        return ()
    found: list[Source | Missing] = []
    for inner in sorted(
        (p for p in path.iterdir() if _is_folder(p)), key=lambda p: _natural(p.name)
    ):
        if not _may_read(inner, root, allow_outside):
            found.append(Missing(f"{inner.name}: {OUTSIDE}"))
        elif _is_asset(inner, allow_outside):
            found.append(inner)
        elif SAMPLE.fullmatch(inner.name):  # a sample that failed is a failure
            found.append(Missing(f"{inner.name}: no asset in it"))
    return tuple(found)


def _children(root: Path) -> Iterator[tuple[str, Path]]:
    """Name and path of every folder, and of every file that may be an asset, sorted."""
    for path in sorted(root.iterdir()):
        if _is_folder(path):
            yield tidy(path.name), path
        elif path.suffix.lower() in (".urdf", ".mjcf", ".xml") and not path.name.startswith("."):
            yield tidy(path.stem), path


def _opened(
    root: Path, allow_outside: bool, names: Sequence[str] | None = None
) -> Iterator[tuple[str, Path]]:
    """``_children`` or, where none of them is an asset (has one of ``names``), what folders of
    categories hold."""

    def wanted(name: str, path: Path) -> bool:
        if names is not None:
            return name in names
        return _may_read(path, root, allow_outside) and _is_asset(path, allow_outside)

    children = sorted(_children(root), key=lambda child: _natural(child[0]))
    if any(wanted(*child) for child in children):
        yield from children
        return
    for name, path in children:
        inside = []
        if path.is_dir() and _may_read(path, root, allow_outside):
            inside = [child for child in _children(path) if child[1].is_dir() and wanted(*child)]
        yield from inside or [(name, path)]


def shared_files(root: Predictions, pairs: Sequence[Pair], out: Path) -> str:
    """A fingerprint of the meshes and textures that assets of a folder may share.

    Args:
      root: the folder. pairs: what of it is compared. out: a folder of results, which is none.

    Returns:
      Of what lies beside the assets, at any depth; "" where there is nothing, or no folder. What
      lies in another asset's own folder is not in it.
    """
    if not isinstance(root, Path) or not root.is_dir():
        return ""
    used = {s.resolve() for p in pairs for s in (p.reference, *p.samples) if isinstance(s, Path)}
    left_out, lines = out.resolve(), []

    def apart(folder: Path) -> bool:
        """Whether it is an asset's own folder (its comparison looks at it), or holds results."""
        real = folder.resolve()
        if real == left_out or real in used or folder.name.startswith("."):
            return True
        return (folder / RESULTS).is_file() or _is_asset(folder, True)

    for where, inner, files in os.walk(root):
        inner[:] = sorted(name for name in inner if not apart(Path(where) / name))
        for name in sorted(files):
            path = Path(where) / name
            if path.suffix.lower() in SHARED and path.exists():
                status = path.stat()
                at = os.path.relpath(path, root)
                lines.append(f"{at!r} {status.st_size} {status.st_mtime_ns}")
    return hashlib.blake2b("\n".join(lines).encode(), digest_size=16).hexdigest() if lines else ""


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.name.startswith(".")


def _is_asset(path: Path, allow_outside: bool) -> bool:
    """Whether somebody meant it as an asset, readable or not."""
    try:
        found = find_asset(path, allow_outside=allow_outside)
        if path.is_file() and path.suffix.lower() == ".xml":
            with path.open("rb") as file:
                return kind_of(file.read(MAX_BYTES), path) == "mjcf"
        return found.is_file()
    except FileNotFoundError:
        return False
    except (ValueError, OSError):  # its reader will say why
        return True


def _is_one(root: Path, allow_outside: bool) -> bool:
    """Whether ``root`` is an asset rather than a folder of them; a lone NAME.urdf beside folders of
    assets is one of several."""
    if root.is_file() or any((root / name).is_file() for name in NAMES):
        return True
    found = [p for _, p in _children(root) if _samples(p, root, allow_outside)]
    return len(found) == 1 and found[0].is_file()


def _own_name(root: Path) -> str:
    found = find_asset(root, allow_outside=True) if root.is_dir() else root
    return tidy(found.resolve().parent.name if found.name in NAMES else found.stem)


def _may_read(path: Path, root: Path, allow_outside: bool) -> bool:
    return allow_outside or path.resolve().is_relative_to(root.resolve())


def _check_exists(root: Path, what: str) -> None:
    if not root.exists():
        raise FileNotFoundError(f"{what} '{root}': no such file or folder")


def _checked(name: str) -> str:
    if not name or name in (".", "..") or re.search(r"[/\\\0]", name) or tidy(name) != name:
        raise ValueError(f"object {name!r}: its name should be one that a folder can have")
    return name


def _as_samples(source: Source | Sequence[Source]) -> tuple[Source | Missing, ...]:
    return tuple(source) if isinstance(source, Sequence) else (source,)


def _natural(name: str) -> list[str | int]:
    """Sorts sample-2 before sample-10."""
    return [int(t) if t.isdecimal() else t for t in re.split(r"(\d+)", name)]


def _some(names: Sequence[str] | Mapping[str, object]) -> str:
    some = sorted(names)[:3]
    return ", ".join(f"'{n}'" for n in some) + (", ..." if len(names) > 3 else "")
