"""Colours of meshes: reading them at surface points, and joining meshes without losing them.

In memory every colour is sRGB, as in the files people write, and textures have v up and repeat
(OBJ's convention; trimesh turns glTF's textures into it). What is computed with is linear RGB.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import SimpleMaterial

GRAY = (0.6, 0.6, 0.6)
POINTS_AT_ONCE = 1 << 15  # whose texels are looked up in one go: bounds the memory
MAX_ATLAS = 4096  # pixels on a side; larger sums of textures are shrunk
SWATCH = (
    3  # pixels on a side of a plain colour in an atlas: its middle is exact under bilinear sampling
)


def srgb_to_linear(srgb: np.ndarray) -> np.ndarray:
    """sRGB in [0, 1] to linear RGB in [0, 1] (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, dtype=np.float32)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear RGB to sRGB, both in [0, 1] (clipped)."""
    linear = np.clip(np.asarray(linear, dtype=np.float32), 0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


_LINEAR = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)  # of 8-bit sRGB


def corner_weights(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[n, 3] weights in [0, 1] of the corners of triangles [n, 3, 3] at points [n, 3] on them; a
    third each where a triangle has no area."""
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = trimesh.triangles.points_to_barycentric(triangles, points)
    return np.where(np.isfinite(weights).all(1, keepdims=True), np.clip(weights, 0, 1), 1 / 3)


def sample_color(mesh: trimesh.Trimesh, faces: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Linear RGB of surface points.

    Args:
      mesh: any mesh; without appearance it is gray.
      faces: [n] face indices.
      barycentric: [n, 3] weights of the face's three corners.

    Returns:
      [n, 3] float32 linear RGB in [0, 1]. Textures are sampled bilinearly with repeat wrapping,
      after linearisation.
    """
    faces = np.asarray(faces)
    visual = mesh.visual
    if isinstance(visual, TextureVisuals):
        factor, image = _material(visual.material)
        if image is None or visual.uv is None:
            return np.broadcast_to(srgb_to_linear(factor), (len(faces), 3)).astype(np.float32)
        gain, corners = srgb_to_linear(factor).astype(np.float32), np.asarray(visual.uv)
        triangles = np.asarray(mesh.faces)
        out = np.empty((len(faces), 3), np.float32)
        for begin in range(0, len(faces), POINTS_AT_ONCE):
            some = slice(begin, begin + POINTS_AT_ONCE)
            weight, corner = barycentric[some], corners[triangles[faces[some]]]
            out[some] = _bilinear(image, np.einsum("nk,nkc->nc", weight, corner)) * gain
        return out
    if visual.kind == "vertex":
        colors = _LINEAR[np.asarray(visual.vertex_colors)[:, :3]]
        return np.einsum("nk,nkc->nc", barycentric, colors[mesh.faces[faces]]).astype(np.float32)
    if visual.kind == "face":
        return _LINEAR[np.asarray(visual.face_colors)[:, :3]][faces]
    return np.broadcast_to(srgb_to_linear(np.array(GRAY)), (len(faces), 3)).astype(np.float32)


def gain_tables(gains: np.ndarray) -> np.ndarray:
    """[..., 3, 256] uint8: each 8-bit sRGB value after its linear value is multiplied by ``gains``
    [..., 3] and clipped."""
    linear = np.asarray(gains, np.float32)[..., None] * _LINEAR
    return np.rint(linear_to_srgb(linear) * 255).astype(np.uint8)


def _material(material) -> tuple[np.ndarray, np.ndarray | None]:
    """(sRGB factor [3] in [0, 1], sRGB image [h, w, 3] uint8 or None) of a trimesh material.

    An MTL's ``Kd`` beside a ``map_Kd`` is ignored, as most viewers do: exporters leave it at .8.
    """
    image = getattr(material, "baseColorTexture", None)
    factor = getattr(material, "baseColorFactor", None)
    if image is None:
        image = getattr(material, "image", None)
    if factor is None and image is None:
        factor = getattr(material, "diffuse", None)
    factor = np.ones(3) if factor is None else np.asarray(factor)[:3]
    if factor.dtype == np.uint8 or factor.max() > 1:
        factor = factor / 255.0
    if image is None:
        return factor.astype(np.float64), None
    image = image if image.mode == "RGB" else image.convert("RGB")
    return factor.astype(np.float64), np.asarray(image)


def _bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """[n, 3] linear RGB of an 8-bit sRGB image at uv (v up, repeat wrapping)."""
    height, width = image.shape[:2]
    x = np.mod(uv[:, 0], 1.0) * width - 0.5
    y = (1.0 - np.mod(uv[:, 1], 1.0)) * height - 0.5
    x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = x - x0, y - y0
    pixels = image.reshape(-1, 3)
    out = np.zeros((len(uv), 3), np.float32)
    for dy, wy in ((0, 1 - fy), (1, fy)):
        row = (y0 + dy) % height * width
        for dx, wx in ((0, 1 - fx), (1, fx)):
            texel = pixels.take(row + (x0 + dx) % width, axis=0)
            out += _LINEAR.take(texel) * (wx * wy).astype(np.float32)[:, None]
    return out


def merge_meshes(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Several meshes as one whose colours are theirs.

    Plain and per-face colours stay per face, per-vertex colours per vertex; as soon as one mesh has
    a texture all are packed into one atlas: images with a wrapped gutter, tiled as often as their
    UVs repeat, and a swatch for every plain colour. Only vertex colours beside a texture lose
    detail (one colour a face). Textures that sum up to more than 4096 x 4096 shrink.

    Raises:
      ValueError: no meshes.
    """
    if not meshes:
        raise ValueError("merge: there are no meshes")
    if len(meshes) == 1:
        return meshes[0]
    textures = [_texture(m) for m in meshes]
    if textures[0] is not None and all(_same_image(t, textures[0]) for t in textures):
        vertices, faces = _stack([m.vertices for m in meshes], [m.faces for m in meshes])
        uv = np.concatenate([m.visual.uv for m in meshes])
        material = SimpleMaterial(image=Image.fromarray(textures[0]))
        visual = TextureVisuals(uv=uv, material=material)
        return trimesh.Trimesh(vertices, faces, visual=visual, process=False)
    if any(t is not None for t in textures):
        return _merge_atlas(meshes, textures)
    if any(m.visual.kind == "vertex" for m in meshes):
        pieces = [_with_vertex_colors(m) for m in meshes]
        vertices, faces = _stack([p.vertices for p in pieces], [p.faces for p in pieces])
        colors = np.concatenate([p.visual.vertex_colors for p in pieces])
        return _colored(vertices, faces, vertex_colors=colors)
    vertices, faces = _stack([m.vertices for m in meshes], [m.faces for m in meshes])
    colors = np.concatenate([_face_colors(m) for m in meshes])
    return _colored(vertices, faces, face_colors=colors)


def _colored(vertices, faces, **colors) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.visual = ColorVisuals(mesh, **colors)
    return mesh


def _stack(vertices: list[np.ndarray], faces: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *[len(v) for v in vertices[:-1]]])
    faces = [f + start for f, start in zip(faces, starts, strict=True)]
    return np.concatenate(vertices), np.concatenate(faces)


def _texture(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """[h, w, 3] uint8 sRGB texture with the material's factor multiplied in, or None."""
    if not isinstance(mesh.visual, TextureVisuals) or mesh.visual.uv is None:
        return None
    factor, image = _material(mesh.visual.material)
    if image is not None and np.any(factor < 1):
        linear = _LINEAR[image] * srgb_to_linear(factor)
        image = np.round(linear_to_srgb(linear) * 255).astype(np.uint8)
    return image


def _same_image(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    return a is not None and b is not None and a.shape == b.shape and bool(np.array_equal(a, b))


def _face_colors(mesh: trimesh.Trimesh) -> np.ndarray:
    """[F, 4] uint8 sRGB; textures are not read, vertex colours are averaged."""
    visual = mesh.visual
    if isinstance(visual, TextureVisuals):
        color = np.append(_material(visual.material)[0], 1.0)
    elif visual.kind == "face":
        return np.asarray(visual.face_colors)
    elif visual.kind == "vertex":
        rgba = np.asarray(visual.vertex_colors)[mesh.faces]
        rgb = linear_to_srgb(_LINEAR[rgba[..., :3]].mean(1))
        return np.concatenate([np.round(rgb * 255).astype(np.uint8), rgba[:, :1, 3]], axis=1)
    else:
        color = np.array([*GRAY, 1.0])
    return np.tile(np.round(color * 255).astype(np.uint8), (len(mesh.faces), 1))


def _with_vertex_colors(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    if mesh.visual.kind == "vertex":
        return mesh
    colors = _face_colors(mesh)
    if len(np.unique(colors, axis=0)) == 1:
        return _colored(
            mesh.vertices, mesh.faces, vertex_colors=np.tile(colors[0], (len(mesh.vertices), 1))
        )
    faces = np.arange(3 * len(mesh.faces)).reshape(
        -1, 3
    )  # corners of differently coloured faces part
    return _colored(
        mesh.vertices[mesh.faces].reshape(-1, 3), faces, vertex_colors=np.repeat(colors, 3, axis=0)
    )


def _split(vertices: np.ndarray, faces: np.ndarray, key: np.ndarray) -> tuple[np.ndarray, ...]:
    """Vertices split where their faces' ``key`` [F, n] differ: (vertices, faces, source vertex, key
    of each vertex)."""
    corner = np.column_stack([faces.reshape(-1), np.repeat(key, 3, axis=0)])
    unique, inverse = np.unique(corner, axis=0, return_inverse=True)
    source = unique[:, 0]
    return vertices[source], inverse.reshape(-1, 3), source, unique[:, 1:]


def _merge_atlas(
    meshes: Sequence[trimesh.Trimesh], textures: list[np.ndarray | None]
) -> trimesh.Trimesh:
    # Each tile: an image; each piece: vertices, faces, which tile, and UVs in that tile's pixels
    # from its lower left.
    tiles: list[np.ndarray] = []
    tile_of: dict[bytes, int] = {}  # by their contents
    palette = {
        tuple(c)
        for m, t in zip(meshes, textures, strict=True)
        if t is None
        for c in np.unique(_face_colors(m)[:, :3], axis=0)
    }
    palette = {color: i for i, color in enumerate(sorted(palette))}
    side = int(np.ceil(np.sqrt(len(palette))))
    if palette:
        swatches = np.zeros((side * SWATCH, side * SWATCH, 3), np.uint8)
        for color, i in palette.items():
            row, column = divmod(i, side)
            low = swatches.shape[0] - (row + 1) * SWATCH  # rows count from below, as v does
            swatches[low : low + SWATCH, column * SWATCH : (column + 1) * SWATCH] = color
        tiles.append(swatches)
    pieces = []
    for mesh, texture in zip(meshes, textures, strict=True):
        faces = np.asarray(mesh.faces)
        if texture is None:
            index = np.array([palette[tuple(c)] for c in _face_colors(mesh)[:, :3]])
            vertices, faces, _, key = _split(mesh.vertices, faces, index[:, None])
            row, column = np.divmod(key[:, 0], side)
            pixels = (np.column_stack([column, row]) + 0.5) * SWATCH
            pieces.append((vertices, faces, 0, pixels / (side * SWATCH)))
            continue
        uv = np.nan_to_num(np.asarray(mesh.visual.uv, dtype=np.float64))
        shift = np.floor(uv[faces].min(1) + 1e-9)
        repeats = np.ceil((uv[faces] - shift[:, None]).max((0, 1)) - 1e-9).astype(int)
        vertices, faces, source, key = _split(mesh.vertices, faces, shift.astype(np.int64))
        image = _tiled(texture, np.maximum(repeats, 1))
        identity = hashlib.blake2b(image.data, digest_size=16).digest() + str(image.shape).encode()
        if identity not in tile_of:
            tile_of[identity] = len(tiles)
            tiles.append(image)
        pieces.append(
            (vertices, faces, tile_of[identity], (uv[source] - key) / np.maximum(repeats, 1))
        )
    atlas, boxes = _pack(tiles, fixed=1 if palette else 0)
    vertices, faces = _stack([p[0] for p in pieces], [p[1] for p in pieces])
    uv = np.concatenate([boxes[tile, :2] + local * boxes[tile, 2:] for _, _, tile, local in pieces])
    visual = TextureVisuals(uv=uv, material=SimpleMaterial(image=atlas))
    return trimesh.Trimesh(vertices, faces, visual=visual, process=False)


def _tiled(image: np.ndarray, repeats: np.ndarray) -> np.ndarray:
    """The image repeated (across, up); shrunk first if the result would be larger than an atlas."""
    room = MAX_ATLAS / 2 / np.maximum(repeats, 1)
    size = np.minimum([image.shape[1], image.shape[0]], np.maximum(np.floor(room), 1)).astype(int)
    if (size[0], size[1]) != (image.shape[1], image.shape[0]):
        image = np.asarray(Image.fromarray(image).resize((int(size[0]), int(size[1]))))
        repeats = np.minimum(repeats, MAX_ATLAS // 2)
    if repeats.max() > 1:
        image = np.tile(image, (int(repeats[1]), int(repeats[0]), 1))
    return np.ascontiguousarray(image)


def _pack(tiles: list[np.ndarray], fixed: int) -> tuple[Image.Image, np.ndarray]:
    """One image holding all tiles, and [n, 4] their (u, v, width, height) in it; the first
    ``fixed`` keep their size."""
    area = sum(t.shape[0] * t.shape[1] for t in tiles)
    shrink = min(1.0, np.sqrt(0.7 * MAX_ATLAS**2 / area))
    sizes = np.array([(tile.shape[1], tile.shape[0]) for tile in tiles])
    if shrink < 1:
        sizes[fixed:] = np.maximum((sizes[fixed:] * shrink).astype(int), 1)
    sizes += 2  # a gutter all around
    corners, width, height = _shelves(sizes)
    atlas = np.zeros((height, width, 3), np.uint8)
    for (x, y), (w, h), tile in zip(corners, sizes, tiles, strict=True):
        if tile.shape[:2] != (h - 2, w - 2):
            tile = np.asarray(Image.fromarray(tile).resize((int(w) - 2, int(h) - 2)))
        atlas[y : y + h, x : x + w] = np.pad(tile, ((1, 1), (1, 1), (0, 0)), mode="wrap")
    below = np.column_stack([corners[:, 0], height - corners[:, 1] - sizes[:, 1]])
    boxes = np.hstack([below + 1, sizes - 2]) / [width, height, width, height]
    return Image.fromarray(atlas), boxes


def _shelves(sizes: np.ndarray) -> tuple[np.ndarray, int, int]:
    """Upper left corners [n, 2] of rectangles laid in rows, highest first, and the sheet's width
    and height.

    trimesh.path.packing loses rectangles on some inputs.
    """
    width = max(int(sizes[:, 0].max()), int(np.ceil(np.sqrt(np.prod(sizes, axis=1).sum() * 1.1))))
    corners = np.zeros_like(sizes)
    x = y = row = 0
    for i in np.lexsort((np.arange(len(sizes)), -sizes[:, 1])):
        if x + sizes[i, 0] > width:
            x, y, row = 0, y + row, 0
        corners[i] = x, y
        x, row = x + int(sizes[i, 0]), max(row, int(sizes[i, 1]))
    return corners, width, y + row
