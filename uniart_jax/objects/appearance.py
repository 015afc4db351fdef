"""Reading colours off a mesh, whatever form its visual takes: texture with UVs, face colours or vertex colours."""

from __future__ import annotations

import numpy as np
import trimesh

GRAY = (0.6, 0.6, 0.6)


def srgb_to_linear(srgb: np.ndarray) -> np.ndarray:
    """sRGB in [0, 1] to linear RGB in [0, 1] (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, dtype=np.float32)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear RGB to sRGB, both in [0, 1] (clipped)."""
    linear = np.clip(np.asarray(linear, dtype=np.float32), 0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def sample_color(mesh: trimesh.Trimesh, faces: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Linear RGB of surface points.

    Args:
      mesh: any mesh; without appearance it is gray.
      faces: [n] face indices.
      barycentric: [n, 3] weights of the face's three corners.

    Returns:
      [n, 3] float32 linear RGB in [0, 1]. Textures are sampled bilinearly with repeat wrapping.
    """
    faces = np.asarray(faces)
    visual = mesh.visual
    if isinstance(visual, trimesh.visual.TextureVisuals):
        factor, image = _material(visual.material)
        if image is None or visual.uv is None:
            return np.broadcast_to(srgb_to_linear(factor), (len(faces), 3)).astype(np.float32)
        uv = np.einsum("nk,nkc->nc", barycentric, np.asarray(visual.uv)[mesh.faces[faces]])
        return _bilinear(image, uv) * srgb_to_linear(factor).astype(np.float32)
    if visual.kind == "vertex":
        colors = srgb_to_linear(np.asarray(visual.vertex_colors)[:, :3] / 255.0)
        return np.einsum("nk,nkc->nc", barycentric, colors[mesh.faces[faces]]).astype(np.float32)
    if visual.kind == "face":
        return srgb_to_linear(np.asarray(visual.face_colors)[faces, :3] / 255.0).astype(np.float32)
    return np.broadcast_to(srgb_to_linear(np.array(GRAY)), (len(faces), 3)).astype(np.float32)


def _material(material) -> tuple[np.ndarray, np.ndarray | None]:
    """(sRGB factor [3], sRGB image [h, w, 3] in [0, 1] or None) of a trimesh material."""
    image = getattr(material, "baseColorTexture", None)
    factor = getattr(material, "baseColorFactor", None)
    if image is None:
        image = getattr(material, "image", None)
    if factor is None and image is None:
        factor = getattr(material, "diffuse", None)
    factor = np.ones(3) if factor is None else np.asarray(factor, dtype=np.float64)[:3]
    if factor.max() > 1:
        factor = factor / 255.0
    if image is None:
        return factor, None
    return factor, np.asarray(image.convert("RGB"), dtype=np.float32) / 255.0


def _bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """[n, 3] linear RGB of an sRGB image at uv (v up, repeat wrapping)."""
    height, width = image.shape[:2]
    x = np.mod(uv[:, 0], 1.0) * width - 0.5
    y = (1.0 - np.mod(uv[:, 1], 1.0)) * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    out = np.zeros((len(uv), 3), np.float32)
    for dy, wy in ((0, 1 - fy), (1, fy)):
        for dx, wx in ((0, 1 - fx), (1, fx)):
            texel = image[(y0 + dy) % height, (x0 + dx) % width]
            out += srgb_to_linear(texel) * (wx * wy)
    return out
