"""Sub-cell distances and owners -> one closed, edge-manifold, coloured mesh per part.

Marching cubes on phi_k = sdf where the owner is k, +max(|sdf|, 1/2) elsewhere, over the dense grid
of sub-cells. What lies between the active voxels is unknown to the representation and is filled in
first:

* every connected component of inactive voxels takes the majority sign of the sub-cells that touch
  it, each extrapolated one sub-cell into it (``DEEP``), and the owner that most of its negative
  ones have; a component that touches the grid's border is outside, as is one layer around the grid;
* its magnitude is max(1/2, 1 - |neighbour|), so that the surface lies where a linear distance would
  put it;
* |phi| < 1e-4 becomes -1e-4: no vertex falls onto a lattice point, where several would coincide.

So a solid block is solid, a sealed hollow box is hollow, and parts in contact share their faces.
The classic tables of scikit-image (``method="lorensen"``) treat the two sides of an ambiguous face
alike, so that every edge has exactly two triangles whatever the input; the Lewiner tables do not
(measured: 11 of 150 random grids left open).

Flat stretches are then merged by Manifold's edge collapse, which keeps the surface manifold and
moves it by less than the sum of the tolerances that were tried: .05 sub-cells where the budget is
met at once, 1.85 at most. Colour rides on vertices, so triangles of unlike colour are not merged
while the face budget allows.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import manifold3d
import numpy as np
import trimesh
from scipy import ndimage
from skimage.measure import marching_cubes

from uniart_jax.objects.appearance import linear_to_srgb
from uniart_jax.voxels.grid import PartGrid, VoxelGrid, connected, dilated, occupancy

ZERO = 1e-4  # sub-cells; distances below this count as just inside
HALF_CELL = 0.5  # sub-cells; distance, of either sign, of cells that a pass fills or clears
# a sub-cell beside an inactive voxel counts as inside if its distance, extrapolated by one
# sub-cell, is below minus this: in a solid distances fall on, in a wall that ends there they rise
# (one of 2.2 sub-cells and more)
DEEP = 0.25
SPECK_CELLS = 16  # a loose piece of a part is dropped if it has fewer sub-cells than this
SPECK_SHARE = 0.002  # and less than this share of the part's
FACE_BUDGET = 60_000  # of all parts together
# (colour step in sRGB levels or None, tolerance in sub-cells), tried in turn until the budget is
# met
SIMPLIFICATIONS = ((32, 0.05), (64, 0.1), (None, 0.2), (None, 0.5), (None, 1.0))
COINCIDE = 1e-5  # sub-cells; a reader takes vertices this close for one ...
NUDGE = 2e-3  # ... so they are moved by this
FACES = ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1))  # axis and side of a cell's six faces


@dataclasses.dataclass(frozen=True)
class DenseField:
    """All sub-cells of the grid with one layer of outside around: n = R r + 2 cells a side.

    Attributes:
      sdf: [n, n, n] float32 signed distance in sub-cells, never 0.
      owner: [n, n, n] int16 part id; -1 where nothing is.
      source: [n, n, n] int32 index into the grid's flattened sub-cells; -1 where unknown.
    """

    sdf: np.ndarray
    owner: np.ndarray
    source: np.ndarray


def to_cells(points: Any, size: int) -> Any:
    """Places [...] in object units -> cells [...] of a ``DenseField``, with fractions.

    The grid has ``size`` = R r cells a side and spans -1/2 to 1/2; one cell of padding lies before
    it. So cells 1 to ``size`` are the grid's, their centres are integers, and -1/2, the face
    between the padding and the first of them, is at .5.
    """
    return (points + 0.5) * size + 0.5


def to_points(cells: Any, size: int) -> Any:
    """Centres [...] of cells of a ``DenseField``, object units: the inverse of ``to_cells``."""
    return (cells - 0.5) / size - 0.5


def dense_field(grid: VoxelGrid | PartGrid, owner: np.ndarray) -> DenseField:
    """Spread a grid's sub-cells over space and fill in what is unknown.

    Args:
      grid: active voxels, finite.
      owner: [V, r^3] part id of every sub-cell.
    """
    resolution, r = grid.resolution, grid.subdivisions
    coords = np.asarray(grid.coords)
    sdf = np.asarray(grid.sdf, np.float32)
    sdf = np.where(np.abs(sdf) < ZERO, np.float32(-ZERO), sdf)
    known = np.arange(sdf.size, dtype=np.int32).reshape(sdf.shape)

    labels, inside, part = unknown_regions(coords, resolution, sdf, np.asarray(owner), r)
    coarse_sign = np.where(inside, np.float32(-1), np.float32(1))[labels]
    dense = _repeat(coarse_sign, r)
    dense_owner = _repeat(part.astype(np.int16)[labels], r)
    source = np.full(dense.shape, -1, np.int32)
    for target, values in ((dense, sdf), (dense_owner, owner), (source, known)):
        blocks = target.reshape(resolution, r, resolution, r, resolution, r).transpose(
            0, 2, 4, 1, 3, 5
        )
        blocks[tuple(coords.T)] = np.asarray(values).reshape(-1, r, r, r)
    dense = np.pad(dense, 1, constant_values=1)
    source = np.pad(source, 1, constant_values=-1)
    dense_owner = np.pad(dense_owner, 1, constant_values=-1)
    _fill_magnitude(dense, source < 0)
    return DenseField(dense, dense_owner, source)


def with_sources(field: DenseField, parts: int) -> DenseField:
    """A field in which every solid cell at a part's surface has a source: its own, or that of the
    part's nearest cell that has one. ``parts``: owners 0, 1, …"""
    source = field.source.copy()
    solid = np.where(field.sdf < 0, field.owner + 1, 0)
    for part, window in enumerate(ndimage.find_objects(solid, max_label=parts), 1):
        if window is None:
            continue
        window = tuple(slice(s.start - 1, s.stop + 1) for s in window)  # the layer around
        mine, named = solid[window] == part, source[window]
        bare = mine & (named < 0) & dilated(~mine)
        known = (field.owner[window] == part - 1) & (named >= 0)
        if bare.any() and known.any():
            nearest: Any = ndimage.distance_transform_edt(
                ~known, return_distances=False, return_indices=True
            )
            named[bare] = named[tuple(nearest)][bare]
    return dataclasses.replace(field, source=source)


def part_mesh(
    field: DenseField, part: int, window: tuple[slice, ...], colors: np.ndarray
) -> trimesh.Trimesh:
    """The closed surface of one part.

    Args:
      field: all sub-cells.
      part: id.
      window: slices that hold all cells of the part with negative distance.
      colors: [V r^3, 3] sRGB of the grid's sub-cells.

    Returns:
      Mesh in object units with sRGB vertex colours.
    """
    window = tuple(
        slice(s.start - 1, s.stop + 1) for s in window
    )  # the layer around makes this safe
    sdf, mine = field.sdf[window], field.owner[window] == part
    phi = np.where(mine, sdf, np.maximum(np.abs(sdf), 0.5))
    _drop_specks(phi)
    vertices, faces, _, _ = marching_cubes(phi, 0.0, method="lorensen")
    color = _vertex_colors(vertices, phi, mine, field.source[window], colors)
    start = np.array([s.start for s in window])
    count = field.sdf.shape[0] - 2
    points = to_points(vertices.astype(np.float64) + start, count)
    return trimesh.Trimesh(points, faces, vertex_colors=color, process=False)


def simplify(mesh: trimesh.Trimesh, cell: float, budget: int) -> trimesh.Trimesh:
    """The same closed surface with fewer faces; vertices are a subset of the given ones (to within
    ``NUDGE``, where they coincide) and keep their colours.

    Args:
      mesh: closed, edge-manifold, with vertex colours.
      cell: side of a sub-cell, the unit of the tolerances; each try goes on from the one before, so
        that they add up.
      budget: faces aimed at. The coarsest try that is sound is returned: closed for a reader too,
        and not thinned away.
    """
    rgb = np.asarray(mesh.visual.vertex_colors)[:, :3]
    properties = np.concatenate([mesh.vertices / cell, rgb], axis=1)
    last = manifold3d.Mesh64(properties, mesh.faces.astype(np.uint64))
    tries = []
    for step, tolerance in SIMPLIFICATIONS:
        solid = manifold3d.Manifold(_grouped(last, step))
        if solid.status() != manifold3d.Error.NoError:
            break
        last = solid.simplify(tolerance).to_mesh64()
        tries.append(last)
        if len(last.tri_verts) <= budget:
            break
    volume = signed_volume(mesh)
    for out in reversed(tries):  # to look at every try would double the time
        simple = _to_trimesh(out, cell)
        if simple is not None and 0.7 < signed_volume(simple) / volume < 1.4:
            return simple
    return mesh


def signed_volume(mesh: trimesh.Trimesh) -> float:
    """The volume of a closed mesh, as ``mesh.volume``, without its centre of mass and inertia: a
    tenth of the time."""
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    return float(np.einsum("fc,fc->", a, np.cross(b, c)) / 6)


def _grouped(mesh: manifold3d.Mesh64, step: int | None) -> manifold3d.Mesh64:
    """The same mesh, of which only triangles of one quantised colour may be merged; None: any."""
    properties, faces = np.array(mesh.vert_properties), np.array(mesh.tri_verts)
    return manifold3d.Mesh64(
        properties,
        faces,
        merge_from_vert=np.array(mesh.merge_from_vert, np.uint64),
        merge_to_vert=np.array(mesh.merge_to_vert, np.uint64),
        face_id=None if step is None else _color_groups(properties[:, 3:], faces.astype(np.int64), step),  # noqa: E501
    )  # fmt: skip


def _color_groups(rgb: np.ndarray, faces: np.ndarray, step: int) -> np.ndarray:
    """[F] an id per triangle: the quantised colour of its corners' median."""
    levels = rgb.astype(np.int64) // step
    key = (levels[:, 0] * 256 + levels[:, 1]) * 256 + levels[:, 2]
    return np.sort(key[faces], axis=1)[:, 1].astype(np.uint64)


def _to_trimesh(out: manifold3d.Mesh64, cell: float) -> trimesh.Trimesh | None:
    """Back from Manifold; None if corners that coincide would leave the mesh open once they are
    merged by a reader, even after a nudge."""
    target = np.arange(len(out.vert_properties))
    target[np.asarray(out.merge_from_vert, np.int64)] = np.asarray(out.merge_to_vert, np.int64)
    used, faces = np.unique(target[np.asarray(out.tri_verts, np.int64)], return_inverse=True)
    properties = np.asarray(out.vert_properties)[used]
    colors = np.full((len(used), 4), 255, np.uint8)
    colors[:, :3] = np.clip(np.round(properties[:, 3:]), 0, 255)
    faces = faces.reshape(-1, 3)
    points = _apart(properties[:, :3], faces) * cell
    merged = trimesh.Trimesh(points, faces, process=True)
    if len(faces) < 4 or not merged.is_watertight or len(merged.faces) != len(faces):
        return None
    return trimesh.Trimesh(points, faces, vertex_colors=colors, process=False)


def _apart(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertices [n, 3], in sub-cells, in which those that coincide are drawn by ``NUDGE`` into the
    middle of their own triangles.

    Edge collapse lets two sheets of a surface touch in a vertex; a reader would merge it into an
    edge of four triangles.
    """
    _, place, number = np.unique(
        np.round(points / COINCIDE).astype(np.int64),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    shared = number[place.ravel()] > 1
    if not shared.any():
        return points
    middle, weight = np.zeros_like(points), np.zeros((len(points), 1))
    np.add.at(middle, faces, points[faces].mean(1)[:, None])
    np.add.at(weight, faces, 1)
    way = middle / np.maximum(weight, 1) - points
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
    return np.where(shared[:, None], points + NUDGE * way, points)


def unknown_regions(
    coords: np.ndarray, resolution: int, sdf: np.ndarray, owner: np.ndarray, r: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What lies between the active voxels (see the module's docstring).

    Args:
      coords: [V, 3] active voxels of R a side. sdf: [V, r^3] in sub-cells. owner: [V, r^3] ids of
        parts.

    Returns:
      Labels [R, R, R] of the components of inactive voxels (0: active), and per label whether it is
      inside and whose (-1: nobody's).
    """
    active = occupancy(coords, resolution)
    labels = connected(~active)
    count = int(labels.max())
    flat = np.full(active.shape, -1, np.int32)
    flat[tuple(coords.T)] = np.arange(len(coords))
    parts = int(owner.max()) + 1
    negative = np.zeros((count + 1) * parts, np.int64)
    total = np.zeros(count + 1, np.int64)
    border = np.zeros(count + 1, bool)
    bound = -DEEP if r > 1 else 0.0  # a voxel of one sub-cell shows no slope
    cells_sdf, cells_owner = sdf.reshape(-1, r, r, r), owner.reshape(-1, r, r, r)
    for axis, side in FACES:
        neighbour = coords.copy()
        neighbour[:, axis] += side
        valid = (neighbour[:, axis] >= 0) & (neighbour[:, axis] < resolution)
        label = np.zeros(len(coords), np.int64)
        label[valid] = labels[tuple(neighbour[valid].T)]
        touching = np.nonzero(label)[0]
        face: list[Any] = [slice(None)] * 3
        deeper: list[Any] = [slice(None)] * 3
        face[axis], deeper[axis] = (r - 1, max(r - 2, 0)) if side > 0 else (0, min(1, r - 1))
        last, before = cells_sdf[(touching, *face)], cells_sdf[(touching, *deeper)]
        inside = (2 * last - before).reshape(len(touching), r * r) < bound
        whose = cells_owner[(touching, *face)].reshape(len(touching), r * r)
        slot = label[touching][:, None] * parts + whose
        negative += np.bincount(slot[inside], minlength=len(negative))
        total += np.bincount(label[touching], minlength=len(total)) * r * r
        edge: list[Any] = [slice(None)] * 3
        edge[axis] = -1 if side > 0 else 0
        border[labels[tuple(edge)].ravel()] = True
    negative = negative.reshape(count + 1, parts)
    inside = (2 * negative.sum(1) > total) & ~border
    return labels, inside, np.where(inside, negative.argmax(1), -1)


def _repeat(values: np.ndarray, r: int) -> np.ndarray:
    """[R, R, R] -> [R r, R r, R r]."""
    return values.repeat(r, 0).repeat(r, 1).repeat(r, 2)


def _fill_magnitude(dense: np.ndarray, unknown: np.ndarray) -> None:
    """In place: unknown cells become +-max(1/2, 1 - |neighbour|) over their known neighbours of the
    other sign."""
    magnitude = np.full(dense.shape, 0.5, np.float32)
    for axis, side in FACES:
        here, there = [slice(None)] * 3, [slice(None)] * 3
        here[axis] = slice(None, -1) if side > 0 else slice(1, None)
        there[axis] = slice(1, None) if side > 0 else slice(None, -1)
        h, t = tuple(here), tuple(there)
        crossing = unknown[h] & ~unknown[t] & ((dense[h] < 0) != (dense[t] < 0))
        magnitude[h][crossing] = np.maximum(magnitude[h][crossing], 1 - np.abs(dense[t][crossing]))
    dense[unknown] = np.sign(dense[unknown]) * magnitude[unknown]


def _drop_specks(phi: np.ndarray) -> None:
    """In place: loose pieces of fewer than 16 sub-cells and under .2 % of the part are made
    outside; the largest stays."""
    labels = connected(phi < 0)
    if labels.max() < 2:
        return
    sizes = np.bincount(labels.ravel())[1:]
    drop = (sizes < SPECK_CELLS) & (sizes < SPECK_SHARE * sizes.sum())
    drop[sizes.argmax()] = False
    if drop.any():
        speck = np.concatenate([[False], drop])[labels]
        phi[speck] = np.maximum(-phi[speck], 0.5)


def _vertex_colors(vertices, phi, mine, source, colors) -> np.ndarray:
    """[n, 4] uint8: the colour of the sub-cell just outside the surface, else of the one just
    inside.

    From outside the nearest surface is the one that is seen; from inside it may be what lies under
    a thin inlay. Outside counts only where the part itself is nearest, not where another part
    touches it.
    """
    low = np.floor(vertices).astype(int)
    high = np.ceil(vertices).astype(int)
    low_inside = phi[tuple(low.T)] < 0
    inner = tuple(np.where(low_inside[:, None], low, high).T)
    outer = tuple(np.where(low_inside[:, None], high, low).T)
    seen = (mine[outer] & (source[outer] >= 0)) | (source[inner] < 0)
    rgb = np.full((len(vertices), 4), 255, np.uint8)
    rgb[:, :3] = colors[np.where(seen, source[outer], source[inner])]
    return rgb


def srgb_bytes(color: np.ndarray) -> np.ndarray:
    """[..., 3] uint8 sRGB of linear RGB."""
    return np.round(linear_to_srgb(color) * 255).astype(np.uint8)
