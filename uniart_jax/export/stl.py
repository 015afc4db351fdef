"""STL: one closed part a file, **in millimetres**, as the parts are; ``export.printing`` makes them
fit to print.

STL names no unit; slicers take millimetres. Each part stands as it does at rest, alone, lying on z
= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from uniart_jax.export.atlas import Surface
from uniart_jax.export.frames import check_lengths
from uniart_jax.objects.names import printable
from uniart_jax.objects.object import ArticulatedObject

MILLIMETRES = 1000.0  # a metre
MIN_VOLUME = 1e-3  # mm^3: a sheet folded onto itself is closed, but no solid
HEADER_BYTES = 80


def write_stl(
    obj: ArticulatedObject, folder: Path, surfaces: Sequence[Surface], stems: Sequence[str]
) -> tuple[str, ...]:
    """Write ``<stem>.stl`` (binary, millimetres) for every part that is closed.

    Args:
      obj: tree, joints and scale.
      folder: where to; made if need be.
      surfaces: [K] of the parts, object frame and units, shown state.
      stems: [K] file names without suffix.

    Returns:
      The parts that were left out because they are not closed, a line each.

    Raises:
      ValueError: lists that do not fit the parts.
    """
    check_lengths("write_stl", obj, surfaces=surfaces, stems=stems)
    folder.mkdir(parents=True, exist_ok=True)
    notes = []
    moved = obj.forward_kinematics(obj.rest())
    for part, surface, matrix, stem in zip(obj.parts, surfaces, moved, stems, strict=True):
        vertices = trimesh.transform_points(surface.vertices, matrix)
        vertices *= obj.scale * MILLIMETRES
        vertices[:, 2] -= vertices[:, 2].min()
        solid = closed_solid(vertices, surface.faces)
        if solid is None:
            notes.append(f"STL: part '{part.name}' is not closed and was left out")
        else:
            (folder / f"{stem}.stl").write_bytes(stl_bytes(solid, part.name))
    return tuple(notes)


def closed_solid(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh | None:
    """The solid as it will be read, its places rounded to STL's floats; None if that is not
    closed."""
    places, inverse = np.unique(vertices.astype(np.float32), axis=0, return_inverse=True)
    faces = np.asarray(inverse).reshape(-1)[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]  # edges shorter than rounding
    solid = trimesh.Trimesh(places, faces, process=False)
    if not len(faces) or not solid.is_watertight or not solid.is_winding_consistent:
        return None
    with np.errstate(all="ignore"):  # a flat mesh has no centre of mass
        volume = float(solid.volume)
    if volume < 0:
        solid.invert()
    return solid if abs(volume) > MIN_VOLUME else None


def stl_bytes(solid: trimesh.Trimesh, name: str) -> bytes:
    """A binary STL that says its unit and part."""
    return _header(name) + trimesh.exchange.stl.export_stl(solid)[HEADER_BYTES:]


def _header(name: str) -> bytes:
    """A binary STL's: free text, but not 'solid', by which readers tell text files."""
    text = f"uniart_jax, unit: millimetre, part: {printable(name)}"
    return text.encode("ascii", "replace")[:HEADER_BYTES].ljust(HEADER_BYTES)
