"""PartField's features on voxels: what it is given, and how what it writes is carried over
(nv-tlabs/PartField, ``partfield/dataloader.py`` and ``model_trainer_pvcnn_only_demo.py``, read at
50d56ce). Its weights are non-commercial and need CUDA, so it runs by itself; here are only files.

    uniart features RECORDS --export-points DIR       one point cloud a record, DIR/<name>.ply
    python partfield_inference.py … result_name NAME dataset.data_path DIR is_pc True
    uniart features RECORDS --part-features exp_results/NAME

PartField moves its input to p' = (p - c) 1.8 / s, with c and s the centre and the longest side of
the bounding box. For an input called ``<name>`` it writes

    part_feat_<name>_0.npy         [n, 448] at the n points of a cloud
    part_feat_<name>_0_batch.npy   [n, 448] at the n faces (or vertices) of a mesh
    feat_pca_<name>_0.ply          the points or the mesh that these rows belong to, as p'; for a mesh ``input_<name>_0.ply`` too

A part's feature depends on where the part is, so every record, which shows its object at a state of
its own, has its own file. Meshes of one's own can take the place of the clouds if they show the
same: the record's state, its axes (z up, front -x), its name; scale and centre do not matter.
"""  # noqa: E501

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

import numpy as np
import scipy.spatial
import trimesh

from uniart_jax.data.columns import half
from uniart_jax.data.records import Record
from uniart_jax.runtime.files import complete
from uniart_jax.voxels.grid import SDF_CLIP, subcell_offsets

CHANNELS = 448
POINTS = 100_000  # that PartField takes of a mesh
ENDS = 1 << 16  # bytes at each end of a file that tell it from another
REACH = 0.9  # of its frame's box
NEAR = 0.87  # sub-cells: half the diagonal, so that a cell nearer than this may hold surface


def input_name(shard: int, row: int, record_id: str) -> str:
    """The name of a record's file: unique, and without the dots and slashes that PartField cuts
    off."""
    return f"{shard:05d}-{row:05d}-{re.sub(r'[^A-Za-z0-9_-]', '_', record_id)}"


def surface_points(record: Record, limit: int = POINTS) -> np.ndarray:
    """[n, 3] float32 points on the shown surface, object units: centres of the sub-cells that it
    crosses, at most ``limit`` of them at even distances."""
    voxel, cell = np.nonzero(np.abs(record.sdf) <= int(NEAR / SDF_CLIP * 127))
    if len(voxel) > limit:
        chosen = np.linspace(0, len(voxel) - 1, limit).astype(int)
        voxel, cell = voxel[chosen], cell[chosen]
    places = record.coords[voxel] + subcell_offsets(record.subdivisions)[cell]
    return (places / record.resolution - 0.5).astype(np.float32)


def write_points(path: Path, points: np.ndarray) -> None:
    """A binary PLY of points [n, 3]; complete or absent."""
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    lines += [f"property float {axis}" for axis in "xyz"] + ["end_header", ""]
    with complete(path) as temporary:
        temporary.write_bytes("\n".join(lines).encode() + points.astype("<f4").tobytes())


def result_digest(folder: Path, name: str) -> str:
    """Digest of the size and both ends of what PartField wrote for the input ``name``.

    Raises:
      FileNotFoundError: it has no such file.
    """
    path = _first(folder, f"part_feat_{name}_0.npy", f"part_feat_{name}_0_batch.npy")
    total = hashlib.sha256(str(path.stat().st_size).encode())
    with path.open("rb") as file:
        total.update(file.read(ENDS))
        file.seek(-min(ENDS, path.stat().st_size), os.SEEK_END)
        total.update(file.read(ENDS))
    return total.hexdigest()[:16]


def read_partfield(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """What PartField wrote for the input ``name``.

    Returns:
      points [n, 3] in its frame, and features [n, 448].

    Raises:
      FileNotFoundError: it has no such file. ValueError: other channels, not as many rows as
        points, not finite, damaged.
    """
    path = _first(folder, f"part_feat_{name}_0.npy", f"part_feat_{name}_0_batch.npy")
    shape_path = _first(folder, f"feat_pca_{name}_0.ply", f"input_{name}_0.ply")
    try:
        features = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(
            f"'{path}': not an array that can be read ({error}); run PartField again"
        ) from None
    if features.ndim != 2 or features.shape[1] != CHANNELS or features.dtype.kind != "f":
        raise ValueError(
            f"'{path}': {features.dtype} {list(features.shape)}, but PartField's features are "
            f"float [n, {CHANNELS}]"
        )
    if not np.isfinite(features).all():
        raise ValueError(f"'{path}': holds values that are not finite; run PartField again")
    try:
        shape = trimesh.load(shape_path, process=False)
    except Exception as error:  # trimesh raises many kinds on damaged files
        raise ValueError(
            f"'{shape_path}': cannot be read ({str(error) or type(error).__name__})"
        ) from None
    vertices = np.asarray(getattr(shape, "vertices", np.zeros((0, 3))), np.float64)
    faces = np.asarray(getattr(shape, "faces", np.zeros((0, 3), int)))
    if len(features) == len(faces):
        points = vertices[faces].mean(1)
    elif len(features) == len(vertices):
        points = vertices
    else:
        raise ValueError(
            f"'{path}': {len(features)} features, but '{shape_path.name}' has {len(faces)} faces "
            f"and {len(vertices)} points; they are not of one run"
        )
    if not len(points) or not np.abs(points).max() <= 1.1 * REACH:
        raise ValueError(f"'{shape_path}': not in PartField's frame, a box of +-{REACH}")
    return points, features


def on_voxels(record: Record, points: np.ndarray, features: np.ndarray) -> np.ndarray:
    """[V, 448] float16: each voxel has the feature of the point nearest to its centre.

    Args:
      points, features: of ``read_partfield``.

    Raises:
      ValueError: a feature is too large for half precision.
    """
    own = surface_points(record)
    low, high = own.min(0).astype(np.float64), own.max(0).astype(np.float64)
    placed = points * ((high - low).max() / (2 * REACH)) + (low + high) / 2
    centers = (record.coords + 0.5) / record.resolution - 0.5
    _, nearest = scipy.spatial.cKDTree(placed).query(centers)
    return half(features[nearest], str(record.meta.get("id")), "part_feature")


def _first(folder: Path, *names: str) -> Path:
    for name in names:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(
        f"'{folder}': neither {' nor '.join(names)}; run PartField on what --export-points writes, "
        "and give the folder of its results"
    )
