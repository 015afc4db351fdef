"""The asset folder: everything that a person or a simulator needs of one articulated object, complete or absent.

object.urdf   meshes/<part>.obj, material.mtl, texture.png, <part>_collision*.obj   object.glb
preview.png   motion.gif   report.json
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from uniart_jax.export.atlas import make_atlas
from uniart_jax.export.collision import collision_pieces
from uniart_jax.export.glb import write_glb
from uniart_jax.export.preview import (
    choose_view,
    read_image,
    with_meshes,
    write_motion,
    write_preview,
)
from uniart_jax.export.report import make_report, write_report
from uniart_jax.export.wavefront import (
    TEXTURE_FILE,
    write_material,
    write_plain,
    write_textured,
)
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.urdf import mesh_inertial, write_urdf

MARKS = ("object.urdf", "report.json")  # what a folder must hold to be replaced


def save_asset(
    obj: ArticulatedObject,
    folder: str | Path,
    *,
    image: str | Path | np.ndarray | Image.Image | None = None,
    seed: int | None = None,
    checkpoint: str = "",
    overwrite: bool = False,
    motion: bool = True,
) -> Path:
    """Write an object as a folder that simulators load as it is. Metres (by ``obj.scale``), kilograms, radians, shown state.

    Args:
      obj: any articulated object.
      folder: where to; made with its parents. It appears complete or not at all.
      image: the picture that the object was made from, shown beside it in ``preview.png``.
      seed, checkpoint: what made the object, for the report.
      overwrite: replace a folder that holds an asset; the old one stands until the new one is complete.
      motion: also write ``motion.gif`` (if anything moves).

    Returns:
      The folder.

    Raises:
      ValueError: ``check_target`` refuses the folder, it cannot be made, or ``image`` cannot be read.
    """
    inputs = [image] if isinstance(image, str | Path) else []
    check_target(folder, overwrite, inputs)
    picture = None if image is None else read_image(image)
    with complete_folder(folder, overwrite) as target:
        _write(obj, target, picture, seed, checkpoint, motion)
    return Path(folder)


def _write(
    obj: ArticulatedObject,
    folder: Path,
    image: Image.Image | None,
    seed: int | None,
    checkpoint: str,
    motion: bool,
) -> None:
    meshes = folder / "meshes"
    meshes.mkdir()
    atlas = make_atlas(obj)
    atlas.texture.save(meshes / TEXTURE_FILE, compress_level=3)
    write_material(meshes)
    visual_files, collision_files, inertials, watertight = [], [], [], []
    for name, surface in zip(_file_names(obj), atlas.surfaces, strict=True):
        write_textured(surface, meshes / f"{name}.obj", obj.scale)
        visual_files.append([f"meshes/{name}.obj"])
        solid = surface.mesh
        pieces = collision_pieces(solid)
        files = []
        for i, piece in enumerate(pieces):
            path = meshes / f"{name}_collision{i}.obj"
            write_plain(piece.vertices, piece.faces, path, obj.scale)
            files.append(f"meshes/{path.name}")
        collision_files.append(files)
        watertight.append(solid.is_watertight)
        inertials.append(mesh_inertial(solid, obj.scale))
    write_urdf(
        obj,
        folder,
        visual_files,
        collision_files=collision_files,
        inertials=inertials,
    )
    textured = [surface.textured(atlas.texture) for surface in atlas.surfaces]
    write_glb(obj, textured, folder / "object.glb")
    shown = with_meshes(obj, textured).normalized()
    view = choose_view(shown, image)
    write_preview(shown, folder / "preview.png", image, view)
    if motion:
        write_motion(shown, folder / "motion.gif", view)
    masses = [mass for mass, _, _ in inertials]
    write_report(make_report(obj, masses, watertight, seed, checkpoint), folder / "report.json")


def _file_names(obj: ArticulatedObject) -> list[str]:
    """[K] file stems of the parts: their names as far as every file system and parser takes them, told apart where need be."""
    stems: list[str] = []
    for part in obj.parts:
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", part.name).strip("_")[:80] or "part"
        name, count = stem, 1
        while name.lower() in {s.lower() for s in stems}:
            count += 1
            name = f"{stem}_{count}"
        stems.append(name)
    return stems


def check_target(
    folder: str | Path,
    overwrite: bool = False,
    inputs: Sequence[str | Path] = (),
    marks: Sequence[str] = MARKS,
) -> Path:
    """The folder that an asset may be written to, made absolute with links followed. Touches nothing.

    Args:
      overwrite: a folder that holds an asset may be replaced; no other that is not empty ever is.
      inputs: files that the asset is made from; a folder that holds one of them would take it along.
      marks: files one of which a folder must hold to be replaced.

    Raises:
      ValueError: the folder is a file, holds the working or home directory or an input, is a file system's root, or is not empty
        and may not be replaced.
    """
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
            f"{folder}: it is not empty and holds no asset or checkpoint ({' or '.join(marks)}), so it is not replaced; choose another --out"
        )
    return final


@contextlib.contextmanager
def complete_folder(
    folder: str | Path, overwrite: bool = False, marks: Sequence[str] = MARKS
) -> Iterator[Path]:
    """A temporary folder beside ``folder`` that takes its place when the block ends, and vanishes if the block fails.

    Raises:
      ValueError: ``check_target`` refuses ``folder``, before the block or after it, or it cannot be made.
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
    """Put ``work`` in the place of ``final``; an old folder is removed only when the new one stands."""
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
