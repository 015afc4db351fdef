"""Reading objects of NAP (Lei et al. 2023), as ``tools/export_nap.py`` writes them in NAP's own
environment: NAP keeps pickled graphs, and nothing is unpickled here.

    nap.npz       parents [K] int (-1: root) · plucker [K, 6] · rotation [K, 2] · travel [K, 2] ·
                  boxed [K] bool (optional: parts that had no mesh)
    part-<k>.ply  the surface of part k

All stands in one frame with every coordinate at 0, y up and front +z; it is turned to z up and
front -x, as SINGAPO's. ``plucker`` is (l, p x l) of the line through p along l, by which positive
coordinates move the part against its parent; ``rotation`` (radians) and ``travel`` are the ranges
about and along it, which NAP draws independently (its ``sample_pcl.py``). So a part has up to two
joints along one line. Codes and figures take the one
screw that makes both in proportion (``several_joints``), as NAP's own pictures show them.

A range shorter than .003 is none: the threshold by which NAP's ``arti_viz_utils.py`` tells types.
Files of others keep turns down to .1 degree, but these ranges are a diffusion model's own numbers
(``get_G_from_VE`` copies them as they are): of a drawer the turn is nearly 0, never 0, and below
.17 degrees it says nothing.
"""

from __future__ import annotations

import io
import zipfile
import zlib

import numpy as np

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.robot import MAX_NUMBER, MAX_PARTS, Geometry, Link, RawJoint, Robot
from uniart_jax.objects.singapo import BASE

NAME = "nap.npz"
LEAST_RANGE = 3e-3  # radians, or NAP's units of length
DAMAGED = (  # what numpy and zipfile raise on files that are none
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    EOFError,
    KeyError,
    TypeError,
    NotImplementedError,
)
MAX_ARRAYS = 64 * 2**20  # bytes, unpacked
SHAPES = {"parents": (), "plucker": (6,), "rotation": (2,), "travel": (2,)}


def read_nap(data: bytes, files: AssetFiles) -> Robot:
    """Links and joints of a ``nap.npz``, z up, front -x.

    Args:
      data: the file.
      files: where its meshes lie.

    Raises:
      ValueError: not such a file, or numbers that are no joints; one line, without the file's name.
    """
    arrays = _arrays(data)
    parents, boxed = arrays["parents"], arrays.get("boxed", np.zeros(len(arrays["parents"]), bool))
    robot = Robot("", {}, [], [], radians=True)
    names = [f"part_{k}" for k in range(len(parents))]
    lines = [_line(row, name) for row, name in zip(arrays["plucker"], names, strict=True)]
    for k, name in enumerate(names):
        point, direction = lines[k] if parents[k] >= 0 else (np.zeros(3), np.zeros(3))
        own = np.eye(4)
        own[:3, 3] = -point
        shape = Geometry("mesh", np.ones(3), own @ BASE, f"part-{k}.ply")
        robot.links[name] = Link(name, [shape], [])
        if boxed[k]:
            robot.notes.append(f"link '{name}': it had no mesh; shown by its box")
        if parents[k] < 0:
            continue
        above = names[parents[k]]
        frame = np.eye(4)
        frame[:3, 3] = point - (lines[parents[k]][0] if parents[parents[k]] >= 0 else 0)
        ranges = {
            kind: (float(arrays[key][k].min()), float(arrays[key][k].max()))
            for key, kind in (("travel", "prismatic"), ("rotation", "revolute"))
            if np.ptp(arrays[key][k]) > LEAST_RANGE
        }
        if len(ranges) == 2:
            between = f"{name}_travel"
            robot.links[between] = Link(between, [], [])
            slide = ranges.pop("prismatic")
            robot.joints.append(
                RawJoint(between, "prismatic", above, between, frame, direction, slide, None)
            )
            above, frame = between, np.eye(4)
        kind, limits = next(iter(ranges.items()), ("fixed", None))
        robot.joints.append(RawJoint(name, kind, above, name, frame, direction, limits, None))
    return robot


def _arrays(data: bytes) -> dict[str, np.ndarray]:
    """The arrays of the file, checked; lengths agree and numbers are finite."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
        if size > MAX_ARRAYS:
            raise ValueError(f"its arrays have more than {MAX_ARRAYS // 2**20} MiB")
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files if key in (*SHAPES, "boxed")}
    except DAMAGED as error:
        raise ValueError(f"it is not an npz that can be read: {error}") from None
    if missing := [key for key in SHAPES if key not in arrays]:
        raise ValueError(
            f"not an object of NAP: it has no array '{missing[0]}' (tools/export_nap.py writes it)"
        )
    count = arrays["parents"].size
    if not 0 < count <= MAX_PARTS:
        raise ValueError(f"it lists {count:,} parts; there should be 1 to {MAX_PARTS:,}")
    for key, shape in {**SHAPES, "boxed": ()}.items():
        array = arrays.get(key)
        if array is None:
            continue
        kinds = {"parents": "iu", "boxed": "b"}.get(key, "f")
        if array.shape != (count, *shape) or array.dtype.kind not in kinds:
            raise ValueError(
                f"array '{key}' should be {list((count, *shape))} of kind '{kinds}', got "
                f"{list(array.shape)} {array.dtype}"
            )
        if kinds == "f" and not (np.abs(array) <= MAX_NUMBER).all():
            raise ValueError(f"array '{key}' holds numbers that are not finite")
    parents = arrays["parents"].astype(np.int64)
    if ((parents < -1) | (parents >= count)).any():
        raise ValueError(f"array 'parents' names a part that is not there (0 to {count - 1})")
    return {
        key: a.astype(np.float64) if a.dtype.kind == "f" else a for key, a in arrays.items()
    } | {"parents": parents}


def _line(plucker: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(the point nearest the origin, direction) [3] of a line, z up; a direction 0 stays 0."""
    length = float(np.linalg.norm(plucker[:3]))
    if length < 1e-9:
        return np.zeros(3), np.zeros(3)
    direction, moment = plucker[:3] / length, plucker[3:] / length
    return BASE[:3, :3] @ np.cross(direction, moment), BASE[:3, :3] @ direction
