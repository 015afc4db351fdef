"""One texture for a whole object: simplified parts, xatlas charts over all of them, colours baked
from any visual.

Network output arrives as marching cubes with some 10^5 faces and a colour per vertex. Each closed
part is simplified by manifold3d, which cannot open a surface; xatlas (github.com/jpcy/xatlas) lays
the charts of all parts into one square (surfaces too rough for it get a chart for every triangle);
every texel is carried to the nearest point of the *source* surface and takes its colour, so that
detail survives the simplification.
"""

from __future__ import annotations

import dataclasses
import itertools

import igl
import manifold3d
import numpy as np
import trimesh
import xatlas
from PIL import Image
from scipy import ndimage

from uniart_jax.export.closing import closed, faces_an_edge, is_bounded
from uniart_jax.export.picture_colors import Picture, paint
from uniart_jax.export.voxel_boxes import is_rough
from uniart_jax.objects.appearance import corner_weights, linear_to_srgb, sample_color
from uniart_jax.objects.object import ArticulatedObject

TEXTURE_SIZE = 1024  # texels a side, about: xatlas picks the exact size
FACE_BUDGET = 10_000  # faces of all parts together
ROUGH_TEXTURE = 768  # of what a network makes
# Fractions of the object's longest side, tried in turn until the budget is met: from 1/8 of a
# sub-cell at 128^3 to 2 sub-cells.
TOLERANCES = tuple(2.0 ** (k / 2) / 1024 for k in range(9))
OPENED = 2  # faces that an open surface's count as, which is given a second side
TOUCH = 1e-5  # of the longest side: how far vertices in one place, of two sheets, are drawn apart
PADDING = 3  # texels between charts
ROUGH_EDGES = 16_000  # fewer edges are no trouble, however sharp: those of ``FACE_BUDGET`` faces
MANY_EDGES = 40_000  # more take it long, however smooth
LARGEST = 5  # doublings of a square of texels, for large triangles among small ones
ROUGH_ANGLE = 0.6  # radians between the faces of a sharp edge
ROUGH_SHARE = 0.35  # of edges that are sharp


@dataclasses.dataclass(frozen=True)
class Surface:
    """A part's exported surface: geometry and texture coordinates with indices of their own, as OBJ
    has them.

    Attributes:
      vertices: [v, 3] float64, no two in the same place; object frame at the shown state, object
        units.
      faces: [f, 3] into ``vertices``; closed.
      uv: [t, 2] in [0, 1], v up.
      uv_faces: [f, 3] into ``uv``.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    uv_faces: np.ndarray

    @property
    def mesh(self) -> trimesh.Trimesh:
        """The geometry alone."""
        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    def textured(self, texture: Image.Image) -> trimesh.Trimesh:
        """The surface as a renderer wants it: a vertex for each pair of position and texture
        coordinate."""
        pairs = np.stack([self.faces.ravel(), self.uv_faces.ravel()], 1)
        unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
        mesh = trimesh.Trimesh(self.vertices[unique[:, 0]], inverse.reshape(-1, 3), process=False)
        material = trimesh.visual.material.PBRMaterial(
            name="material", baseColorTexture=texture, metallicFactor=0.0, roughnessFactor=0.8
        )
        mesh.visual = trimesh.visual.TextureVisuals(uv=self.uv[unique[:, 1]], material=material)
        return mesh


@dataclasses.dataclass(frozen=True)
class Atlas:
    """[K] surfaces, in the order of the object's parts, over one sRGB texture.

    Attributes:
      surfaces: closed, all of them.
      unclosed: [K] the same before open ones were given a thickness: what their collision shapes
        and masses are made of.
    """

    surfaces: tuple[Surface, ...]
    texture: Image.Image
    unclosed: tuple[trimesh.Trimesh, ...]


def make_atlas(
    obj: ArticulatedObject, size: int | None = None, picture: Picture | None = None
) -> Atlas:
    """Simplify, close, unwrap and bake every part of ``obj`` into one atlas of about ``size``
    texels a side.

    By default 1,024 texels, 768 where the surface is bumpy all over (``voxel_boxes.is_rough``),
    whose noise is no detail and would be most of the folder.
    ``picture``: of the shown state, whose colours are taken where it shows the object
    (``export.picture_colors``).
    """
    sources = [part.mesh for part in obj.parts]
    side = float((obj.bounds[1] - obj.bounds[0]).max())
    rough = is_rough(obj)
    size = size or (ROUGH_TEXTURE if rough else TEXTURE_SIZE)
    simple = simplify(sources, side)
    charts = _grid_charts if _is_rough(simple) else _xatlas_charts
    geometry = [closed(vertices, faces, side) for vertices, faces in simple]
    layout, width, height = charts(geometry, side, size)
    surfaces = [Surface(*g, *uv) for g, uv in zip(geometry, layout, strict=True)]
    texture = bake(surfaces, sources, width, height, obj if picture else None, picture)
    unclosed = tuple(trimesh.Trimesh(*g, process=False) for g in simple)
    return Atlas(tuple(surfaces), texture, unclosed)


def simplify(
    meshes: list[trimesh.Trimesh], side: float, budget: int = FACE_BUDGET
) -> list[tuple[np.ndarray, np.ndarray]]:
    """(vertices, faces) of every mesh, vertices merged, with about ``budget`` faces together.

    Within the budget nothing is touched; open surfaces count ``OPENED`` times. Closed manifolds are
    simplified first, and only if that leaves them closed; no step moves a surface by more than the
    last of ``TOLERANCES`` times ``side``, or an eighth of the part's thinnest extent. Surfaces that
    are not closed have their vertices clustered, if they alone are still too many.
    """
    merged = [_merged(np.asarray(m.vertices, np.float64), np.asarray(m.faces)) for m in meshes]
    solids: dict[int, manifold3d.Manifold] = {}
    counts = [len(f) * (1 if is_bounded(f) else OPENED) for _, f in merged]
    if sum(counts) > budget:
        for k, (vertices, faces) in enumerate(merged):
            if len(faces) % 2:  # not closed, and manifold3d crashes on an odd number
                continue
            solid = manifold3d.Manifold(
                manifold3d.Mesh(vertices.astype(np.float32), faces.astype(np.uint32))
            )
            if solid.status() == manifold3d.Error.NoError and not solid.is_empty():
                solids[k] = solid
    rest = sum(count for k, count in enumerate(counts) if k not in solids)
    out = list(merged)
    for tolerance in TOLERANCES:
        if rest + sum(solid.num_tri() for solid in solids.values()) <= budget:
            break
        for k, solid in solids.items():
            thin = float(np.ptp(merged[k][0], axis=0).min())
            solids[k] = solid.simplify(min(tolerance * side, thin / 8))
            simple = solids[k].to_mesh()
            vertices, faces = _merged(
                *_untouched(
                    simple.vert_properties[:, :3].astype(np.float64),
                    simple.tri_verts.astype(np.int64),
                    TOUCH * side,
                )
            )
            # places that touch have become one nevertheless: then the last closed level stays
            if len(faces) >= 4 and _closed(faces):
                out[k] = vertices, faces
    if rest > budget:  # clustering opens what was closed
        rest = OPENED * sum(len(f) for k, (_, f) in enumerate(merged) if k not in solids)
    for k, (vertices, faces) in enumerate(merged):
        share = budget * len(faces) / max(rest, budget)
        if k not in solids and len(faces) > share:
            out[k] = _clustered(vertices, faces, side, share)
    return out


def _untouched(
    vertices: np.ndarray, faces: np.ndarray, gap: float
) -> tuple[np.ndarray, np.ndarray]:
    """A closed surface whose vertices in one place, of sheets that touch there, are drawn apart by
    ``gap`` into the solid."""
    _, place, count = np.unique(vertices, axis=0, return_inverse=True, return_counts=True)
    shared = count[place.reshape(-1)] > 1
    if not shared.any():
        return vertices, faces
    normals = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
    return np.where(shared[:, None], vertices - gap * normals, vertices), faces


def _clustered(
    vertices: np.ndarray, faces: np.ndarray, side: float, budget: float
) -> tuple[np.ndarray, np.ndarray]:
    """A surface that is not closed with about ``budget`` faces: vertices in one cell of a grid made
    one (Rossignac and Borrel)."""
    cell = side / 1024
    out = vertices, faces
    while len(out[1]) > budget and cell < side / 16:
        _, first, cluster = np.unique(
            np.floor(vertices / cell), axis=0, return_index=True, return_inverse=True
        )
        corners = cluster.reshape(-1)[faces]
        a, b, c = corners.T
        corners = corners[(a != b) & (b != c) & (a != c)]
        _, kept = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
        if len(kept) == 0:
            break
        out = _merged(vertices[first], corners[np.sort(kept)])
        cell *= 2**0.5
    return out


Geometry = list[tuple[np.ndarray, np.ndarray]]
Layout = tuple[list[tuple[np.ndarray, np.ndarray]], int, int]


def _xatlas_charts(geometry: Geometry, side: float, size: int) -> Layout:
    """([K] (uv, uv_faces), width, height): few charts with little distortion."""
    charts = xatlas.Atlas()
    for vertices, faces in geometry:
        charts.add_mesh(vertices.astype(np.float32) / side, faces.astype(np.uint32))
    pack = xatlas.PackOptions()
    pack.resolution, pack.padding = size, PADDING
    charts.generate(xatlas.ChartOptions(), pack)
    layout = []
    for k in range(len(geometry)):
        _, uv_faces, uv = charts.get_mesh(k)
        layout.append((np.asarray(uv, np.float64), uv_faces.astype(np.int64)))
    return layout, charts.width, charts.height


def _grid_charts(geometry: Geometry, side: float, size: int) -> Layout:
    """As ``_xatlas_charts``, in no time: every triangle is a chart of its own, two in a square. The
    squares of larger triangles are larger, by powers of two; those of one size fill rows."""
    del side
    counts = [len(faces) for _, faces in geometry]
    corners = np.concatenate([vertices[faces] for vertices, faces in geometry])
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(1)
    times = np.log2(np.maximum(longest, 1e-12) / max(float(np.median(longest)), 1e-12))
    for less in itertools.count():  # until large ones take no more room than small ones
        level = np.clip(np.round(times - less), 0, LARGEST).astype(int)
        squares = np.ceil(np.bincount(level, minlength=LARGEST + 1) / 2).astype(int)
        area = int((squares * 4 ** np.arange(LARGEST + 1)).sum())
        if area <= len(level) or not level.any():
            break
    unit = 2 ** int(level.max())
    wide = -(-int(np.ceil(np.sqrt(area))) // unit) * unit
    place, high = np.zeros((len(level), 2)), 0  # small squares, from the upper left
    second = np.zeros(len(level), bool)
    for k in range(LARGEST, -1, -1):
        rows, per_row = np.flatnonzero(level == k), max(wide // 2**k, 1)
        index = np.arange(len(rows))
        place[rows] = np.stack([index // 2 % per_row, index // 2 // per_row], 1) * 2**k + [0, high]
        second[rows] = index % 2 == 1
        high += -(-squares[k] // per_row) * 2**k
    small = max(size // max(wide, high), 8)  # texels
    # texels between charts, so that no two triangles share one when sampled bilinearly
    near, cell = 1.5, (small * 2**level)[:, None, None]
    lower = np.array([[0.0, 0], [1, 0], [0, 1]]) * (cell - 5) + near
    spots = np.where(second[:, None, None], cell - lower, lower) + place[:, None] * small
    width, height = wide * small, high * small
    uv = spots / [width, height]
    starts = np.cumsum([0, *counts])
    layout = [
        (uv[a:b].reshape(-1, 2), np.arange(3 * (b - a)).reshape(-1, 3))
        for a, b in itertools.pairwise(starts)
    ]
    return layout, width, height


def _is_rough(geometry: Geometry) -> bool:
    """Whether xatlas would cut thousands of charts, which takes it many seconds: much geometry,
    full of sharp edges."""
    sharp = total = 0
    for vertices, faces in geometry:
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        angles = mesh.face_adjacency_angles
        sharp += int((angles > ROUGH_ANGLE).sum())
        total += len(angles)
    return total > MANY_EDGES or (total > ROUGH_EDGES and sharp > ROUGH_SHARE * total)


def bake(
    surfaces: list[Surface],
    sources: list[trimesh.Trimesh],
    width: int,
    height: int,
    obj: ArticulatedObject | None = None,
    picture: Picture | None = None,
) -> Image.Image:
    """sRGB image of the sources' colours under the surfaces' charts, or of a picture of ``obj``;
    texels outside all charts repeat the nearest inside."""
    texels: list[tuple[np.ndarray, ...]] = []
    for k, surface in enumerate(surfaces):
        rows, columns, faces, weights = rasterize(surface, width, height)
        corners = surface.vertices[surface.faces[faces]]
        points = np.einsum("nk,nkc->nc", weights, corners)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
        texels.append((rows, columns, points, normals, np.full(len(rows), k)))
    rows, columns, points, normals, own = (np.concatenate(c) for c in zip(*texels, strict=True))

    def decoded(asked: np.ndarray) -> np.ndarray:
        found = np.zeros((len(asked), 3), np.float32)
        for k, source in enumerate(sources):
            mine = np.flatnonzero(own[asked] == k)
            if len(mine):
                found[mine] = source_color(source, points[asked[mine]])
        return found

    if obj is not None and picture is not None:
        found = paint(picture, obj, points, normals, own, decoded)
    else:
        found = decoded(np.arange(len(points)))
    color = np.zeros((height, width, 3), np.float32)
    filled = np.zeros((height, width), bool)
    color[rows, columns], filled[rows, columns] = found, True
    nearest = ndimage.distance_transform_edt(~filled, return_distances=False, return_indices=True)
    rows, columns = np.asarray(nearest)
    color = color[rows, columns]
    return Image.fromarray((linear_to_srgb(color) * 255 + 0.5).astype(np.uint8))


def rasterize(
    surface: Surface, width: int, height: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(rows [n], columns [n], faces [n], barycentric weights [n, 3]) of the texels whose centre
    lies in a chart."""
    corners = (surface.uv * [1, -1] + [0, 1])[surface.uv_faces] * [width, height] - 0.5
    corners = corners.astype(np.float32)  # [f, 3, (x, y)]
    # Scan lines: every row that crosses a triangle, then every texel between the crossings.
    top = np.maximum(np.ceil(corners[..., 1].min(1)), 0).astype(int)
    bottom = np.minimum(np.floor(corners[..., 1].max(1)), height - 1).astype(int)
    face, row = _ranges(top, bottom)
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        (ax, ay), (bx, by) = corners[face, a].T, corners[face, b].T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (row - ay) / (by - ay)
        crossed = (t >= 0) & (t <= 1)
        x = ax + t * (bx - ax)
        left = np.where(crossed, np.minimum(left, x), left)
        right = np.where(crossed, np.maximum(right, x), right)
    empty = left > right
    left[empty], right[empty] = 1, 0
    line, column = _ranges(
        np.maximum(np.ceil(left), 0).astype(int), np.minimum(np.floor(right), width - 1).astype(int)
    )
    face, row = face[line], row[line]
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    inverse = np.where(area != 0, 1 / np.where(area != 0, area, 1), 0)
    x, y = column - a[face, 0], row - a[face, 1]
    w1 = (x * v[face, 1] - y * v[face, 0]) * inverse[face]
    w2 = (y * u[face, 0] - x * u[face, 1]) * inverse[face]
    weights = np.clip(np.stack([1 - w1 - w2, w1, w2], 1), 0, 1)
    return row, column, face, weights / weights.sum(1, keepdims=True)


def _ranges(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(index i, value) of all integers of the closed ranges [first[i], last[i]], one range after
    the other."""
    counts = np.maximum(last - first + 1, 0)
    index = np.repeat(np.arange(len(first)), counts)
    return index, first[index] + np.arange(len(index)) - (np.cumsum(counts) - counts)[index]


def source_color(source: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """[n, 3] linear RGB of the source surface nearest to each of ``points`` [n, 3]."""
    vertices = np.asarray(source.vertices, np.float64)
    faces = np.asarray(source.faces, np.int64)
    _, hit, nearest = igl.point_mesh_squared_distance(np.ascontiguousarray(points), vertices, faces)
    hit = np.asarray(hit).ravel()
    return sample_color(source, hit, corner_weights(vertices[faces[hit]], nearest))


def _merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in the same place made one, unused ones and collapsed faces dropped."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    kept = mesh.nondegenerate_faces() if not mesh.is_watertight else None
    if kept is not None and kept.any() and not kept.all():
        mesh.update_faces(kept)
        mesh.remove_unreferenced_vertices()
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _closed(faces: np.ndarray) -> bool:
    """Whether every edge has exactly two faces."""
    return bool((faces_an_edge(faces) == 2).all())
