"""Wavefront OBJ with indices of their own for positions and texture coordinates.

Texture seams then cut only the ``vt`` list: positions stay shared, and a closed mesh is closed for whoever reads it. (Writers with one
index for both, trimesh's among them, open every mesh along its seams.)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from uniart_jax.export.atlas import Surface

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
    """Write a surface in metres (object units times ``scale``), object frame at the shown state, with ``MATERIAL``."""
    lines = [f"mtllib {MATERIAL_FILE}"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (surface.vertices * scale).tolist()]
    lines += [f"vt {u:.6f} {v:.6f}" for u, v in surface.uv.tolist()]
    lines.append("usemtl material")
    corners = np.stack([surface.faces, surface.uv_faces], -1).reshape(-1, 6) + 1
    lines += [f"f {a}/{s} {b}/{t} {c}/{u}" for a, s, b, t, c, u in corners.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_plain(vertices: np.ndarray, faces: np.ndarray, path: Path, scale: float) -> None:
    """Write bare triangles in metres, object frame at the shown state."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (vertices * scale).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(faces) + 1).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
