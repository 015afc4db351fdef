"""VoxelGrid -> ArticulatedObject: cluster parts, rebuild the tree, read the joints, mesh every part
(paper, section on decoding)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import trimesh
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint, topological_order
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.cleanup.loose_parts import with_parts_joined, without_debris
from uniart_jax.voxels.grid import SDF_CLIP, VoxelGrid, subcell_centers
from uniart_jax.voxels.isosurface import (
    FACE_BUDGET,
    DenseField,
    dense_field,
    part_mesh,
    simplify,
    srgb_bytes,
    with_sources,
)
from uniart_jax.voxels.joint_code import LARGEST, box_corners, canonical, decode_part, decode_tree
from uniart_jax.voxels.segment import Segmentation, outside, segment

EXPLAINED = (
    0.02  # a border voxel whose code is this close to a neighbour's belongs to that neighbour
)


def assemble(
    grid: VoxelGrid, *, scale: float = 1.0, name: str = "", tolerance: float = 0.0
) -> ArticulatedObject:
    """Rebuild an articulated object from its voxels. Deterministic; never crashes on what a network
    emits.

    Args:
      grid: attributes on active voxels, true or predicted.
      scale: metres per object unit.
      name: name of the object.
      tolerance: of ``joint_code.decode_part``: 0 for true grids, ``NETWORK_TOLERANCE`` for
        predicted ones, whose specks in the air are left out.

    Returns:
      Object with parts 'base', 'link_1', ... (parents first, larger first); every mesh is closed
      and edge-manifold.

    Raises:
      ValueError: the grid holds no voxels.
    """
    grid = _finite(grid)
    parts = segment(grid)
    count = len(parts.boxes)
    voters = joint_voters(grid, parts)
    parent_boxes = np.stack([np.median(grid.parent_box[v], axis=0) for v in voters])
    parents = decode_tree(parts.boxes, parent_boxes)
    joints = [
        Joint.fixed()
        if parents[k] < 0
        else decode_part(grid.joint_code[voters[k]], parts.boxes[k, :3], tolerance)
        for k in range(count)
    ]
    meshes = mesh_parts(grid, parts)
    order = topological_order(parents)
    position = {old: new for new, old in enumerate(order)}
    obj = ArticulatedObject(
        tuple(
            Part(
                "base" if parents[k] < 0 else f"link_{position[k]}",
                meshes[k],
                position.get(parents[k], -1),
                joints[k],
            )
            for k in order
        ),
        scale=scale,
        name=name,
        from_voxels=tolerance > 0,
    )
    return with_parts_joined(without_debris(obj)) if tolerance else obj


def _finite(grid: VoxelGrid) -> VoxelGrid:
    """Without values that are not finite, or beyond all reason: unknown distances are outside,
    unknown boxes all of space, other values 0."""
    everywhere = np.array([0, 0, 0, 1, 1, 1], np.float32)
    return dataclasses.replace(
        grid,
        sdf=np.clip(np.nan_to_num(grid.sdf, nan=SDF_CLIP), -SDF_CLIP, SDF_CLIP),
        color=np.clip(np.nan_to_num(grid.color), 0, 1),
        own_box=np.clip(np.where(np.isfinite(grid.own_box), grid.own_box, everywhere), -2, 2),
        joint_code=np.clip(np.nan_to_num(grid.joint_code), -LARGEST, LARGEST),
        parent_box=np.clip(np.nan_to_num(grid.parent_box), -2, 2),
    )


def joint_voters(grid: VoxelGrid, parts: Segmentation) -> list[np.ndarray]:
    """Per part, the indices of the voxels whose joint code and parent box are read.

    Those that lie in one part only. A part without any takes, of its border voxels, those whose
    code is not that of a neighbour in the same voxel, preferring the ones where its share is
    largest.
    """
    count = len(parts.boxes)
    voters = [np.nonzero(parts.pure & (parts.owner[:, 0] == k))[0] for k in range(count)]
    if all(len(v) for v in voters):
        return voters
    said = np.concatenate([canonical(grid.joint_code), box_corners(grid.parent_box)], -1)
    decided = {k: np.median(said[v], axis=0) for k, v in enumerate(voters) if len(v)}
    for k in range(count):
        if len(voters[k]):
            continue
        share = (parts.owner == k).mean(1)
        present = np.nonzero(share > 0)[0]
        own = np.ones(len(present), bool)
        for other, value in decided.items():
            beside = (parts.owner[present] == other).any(1)
            own &= ~(beside & (np.abs(said[present] - value).max(1) < EXPLAINED))
        if own.any():
            present = present[own]
        voters[k] = (
            present[share[present] >= 0.5 * share[present].max()]
            if len(present)
            else np.arange(len(share))
        )
    return voters


def mesh_parts(
    grid: VoxelGrid,
    parts: Segmentation,
    reshape: Callable[[DenseField], DenseField] = lambda field: field,
) -> list[trimesh.Trimesh]:
    """[K] closed meshes with sRGB vertex colours, object units, empty of owners that ``reshape``
    took all cells from; ``reshape``: what is done to the field before."""
    grid = dataclasses.replace(grid, sdf=_within_boxes(grid, parts))
    sdf, owner = _every_part_has_a_cell(grid, parts)
    field = reshape(dense_field(dataclasses.replace(grid, sdf=sdf), owner))
    field = with_sources(field, len(parts.boxes))
    cells = np.where(field.sdf < 0, field.owner + 1, 0)
    windows = ndimage.find_objects(cells, max_label=len(parts.boxes))
    colors = srgb_bytes(grid.color).reshape(-1, 3)
    meshes = [
        trimesh.Trimesh() if window is None else part_mesh(field, k, window, colors)
        for k, window in enumerate(windows)
    ]
    share = FACE_BUDGET / sum(len(mesh.faces) for mesh in meshes)
    cell = 1 / (grid.resolution * grid.subdivisions)
    return [
        mesh if mesh.is_empty else simplify(mesh, cell, int(share * len(mesh.faces)))
        for mesh in meshes
    ]


def _within_boxes(grid: VoxelGrid, parts: Segmentation) -> np.ndarray:
    """[V, r^3] distances in which no active sub-cell of a part is solid beyond the part's box: such
    noise would be the part's extent.

    The box is widened to what the part's sub-cells say (their median), so that thin ends, which few
    voters show, stay; and by one sub-cell. True distances stay as they are: beyond its box a part
    is farther away than its box, or by .87 sub-cells nearer if it is thin.
    """
    cells = grid.resolution * grid.subdivisions
    votes, solid = box_corners(grid.own_box), np.asarray(grid.sdf) < 0
    limits = box_corners(parts.boxes)
    for k in range(len(limits)):
        if not (mine := parts.owner == k).any():
            continue
        said = np.median(votes[mine & solid if (mine & solid).any() else mine], axis=0)
        limits[k, :3] = np.minimum(limits[k, :3], said[:3])
        limits[k, 3:] = np.maximum(limits[k, 3:], said[3:])
    centers = subcell_centers(grid.coords, grid.resolution, grid.subdivisions)
    beyond = outside(centers, limits[parts.owner]) * cells - 1
    return np.clip(np.maximum(grid.sdf, beyond), -SDF_CLIP, SDF_CLIP)


def _every_part_has_a_cell(grid: VoxelGrid, parts: Segmentation) -> tuple[np.ndarray, np.ndarray]:
    """sdf and owner [V, r^3] in which a part without a negative sub-cell is given the one that
    suits it best.

    Its own with the smallest distance, else the one whose box is nearest, but never another part's
    only one.
    """
    shape = parts.owner.shape
    sdf = np.asarray(grid.sdf).ravel()
    owner = parts.owner.ravel()
    counts = np.bincount(owner[sdf < 0], minlength=len(parts.boxes))
    missing = np.nonzero(counts == 0)[0]
    if len(missing):
        sdf, owner = sdf.copy(), owner.copy()
        votes = box_corners(grid.own_box).reshape(-1, 6)
    for k in missing:
        distance = np.abs(votes - box_corners(parts.boxes[k])).max(1)
        cost = np.where(owner == k, sdf, 10 + distance)
        cell = np.where((sdf < 0) & (counts[owner] == 1), np.inf, cost).argmin()
        counts[owner[cell]] -= sdf[cell] < 0
        counts[k] = 1
        owner[cell], sdf[cell] = k, -0.5
    return sdf.reshape(shape), owner.reshape(shape)
