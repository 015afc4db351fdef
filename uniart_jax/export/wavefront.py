"""Wavefront OBJ with indices of their own for positions and texture coordinates.

Texture seams then cut only the ``vt`` list: positions stay shared, and a closed mesh is closed for
whoever reads it. (Writers with one index for both, trimesh's among them, open every mesh along its
seams.)
"""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
import trimesh

from uniart_jax.export.atlas import Surface

CREASE = 40.0  # degrees between faces that a smooth surface may have
NORMAL = 2  # digits: a third of a degree, which nobody sees on a dull surface
MATERIAL_FILE = "material.mtl"
TEXTURE_FILE = "texture.png"
MATERIAL = f"""newmtl material
Ka 1 1 1
Kd 1 1 1
Ks 0 0 0
Ns 10
d 1
illum 1
map_Kd {TEXTURE_FILE}
"""


def write_material(folder: Path) -> None:
    """Write the one material that all parts share; its texture lies beside it."""
    (folder / MATERIAL_FILE).write_text(MATERIAL, encoding="utf-8")


def write_textured(surface: Surface, path: Path, scale: float) -> None:
    """Write a surface in metres (object units times ``scale``), object frame at the shown state,
    with ``MATERIAL``."""
    lines = [f"mtllib {MATERIAL_FILE}"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (surface.vertices * scale).tolist()]
    lines += [f"vt {u:.5f} {v:.5f}" for u, v in surface.uv.tolist()]
    normals, normal_faces = corner_normals(surface)
    lines += [f"vn {x:.4g} {y:.4g} {z:.4g}" for x, y, z in normals.tolist()]
    lines.append("usemtl material")
    corners = np.stack([surface.faces, surface.uv_faces, normal_faces], -1).reshape(-1, 9) + 1
    lines += ["f {}/{}/{} {}/{}/{} {}/{}/{}".format(*corner) for corner in corners.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def corner_normals(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Normals [n, 3], rounded, and the one of each face's corners [f, 3]: smooth where faces meet
    within ``CREASE``, sharp elsewhere.

    Without them MuJoCo smooths every edge, a box's too.
    """
    vertices, faces = np.asarray(surface.vertices, np.float64), np.asarray(surface.faces, np.int64)
    normals = np.nan_to_num(igl.per_corner_normals(vertices, faces, CREASE))
    unique, index = np.unique(np.round(normals, NORMAL) + 0.0, axis=0, return_inverse=True)
    return unique, index.reshape(-1, 3)


def write_plain(mesh: trimesh.Trimesh, path: Path) -> None:
    """Write a collision shape: bare triangles, in the mesh's own units."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(mesh.faces) + 1).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
