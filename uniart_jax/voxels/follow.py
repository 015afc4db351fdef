"""VoxelGrid and Layout -> ArticulatedObject: sub-cells join the layout's rows, joints and tree are
the layout's.

Where a layout is known, nothing is clustered and no joint is voted for (``assemble`` does both). A
sub-cell at place p that says its part has the box b joins the row of the least

    cost = outside(p, row) + SAID * mean |corners(b) - corners(row)| + SIZE * longest side of the row        (object units)

so that a place within several boxes goes to the one that it names, or else to the smallest.
"""  # noqa: E501

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import topological_order
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.assemble import _finite, mesh_parts
from uniart_jax.voxels.cleanup.loose_parts import with_parts_joined
from uniart_jax.voxels.cleanup.passes import FieldParts, cleaned
from uniart_jax.voxels.cleanup.primitive_parts import (
    doubles,
    needed,
    primitive_part,
    side_by_side,
)
from uniart_jax.voxels.grid import VoxelGrid, subcell_centers
from uniart_jax.voxels.isosurface import DenseField
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.opening_direction import still_parts
from uniart_jax.voxels.segment import Segmentation, outside

SAID = 0.25
SIZE = 0.02
SPECK = 0.015  # object units; a part with no side as long, that carries none, is left out
FRAGMENT = 0.25  # of the longest side of its box, that a fixed part has at least
FEWEST = 4  # solid sub-cells that a part is made of; with fewer its row is left out


def row_of_subcells(grid: VoxelGrid, boxes: np.ndarray) -> np.ndarray:
    """[V, r^3] int16 row of a layout's ``boxes`` [K, 6] that each sub-cell joins."""
    places = subcell_centers(grid.coords, grid.resolution, grid.subdivisions).astype(np.float32)
    said = box_corners(np.asarray(grid.own_box, np.float32))
    rows = box_corners(boxes).astype(np.float32)
    best = np.full(places.shape[:2], np.inf, np.float32)
    owner = np.zeros(places.shape[:2], np.int16)
    for k, row in enumerate(rows):  # one at a time: the sub-cells are hundreds of thousands
        cost = np.maximum(outside(places, row), 0) + SAID * np.abs(said - row).mean(-1)
        cost += SIZE * float((row[3:] - row[:3]).max())
        nearer = cost < best
        best[nearer], owner[nearer] = cost[nearer], k
    return owner


def assemble_layout(
    grid: VoxelGrid, layout: Layout, *, scale: float = 1.0, name: str = ""
) -> ArticulatedObject:
    """The object that the voxels show, with the layout's parts, tree and joints. What networks draw
    badly is mended first (``voxels.cleanup`` lists the passes).

    Args:
      grid: attributes on active voxels as a network gives them. layout: of the same shown state and
        frame.

    Returns:
      Parts 'base', 'link_1', ... or as the layout names them, parents first; meshes are closed. A
      row that is fixed and told as boards, a tube or an outline is a piece of what carries it. A
      small row that voxels hardly show, or that turns about its middle, and a turntable are made of
      their boxes (``primitive_parts``). Another that no voxel shows, or a fixed one of which they
      show a fragment, is left out; its children hang on its parent. ``provenance`` tells of all.

    Raises:
      ValueError: the grid holds no voxels.
    """
    if len(grid.coords) == 0:
        raise ValueError("assemble: the voxel grid is empty; nothing was generated")
    chosen = _chosen_rows(_finite(grid), layout)
    layout, numbers = chosen.layout, chosen.numbers
    rows = [*chosen.shown, *chosen.boxed]  # of the field's owners
    parts = FieldParts(layout.taken(rows), len(chosen.shown), [numbers[row] for row in rows])
    boxed = _primitive_meshes(layout, chosen.boxed, 1 / (grid.resolution * grid.subdivisions))
    unfollowed: list[str] = []

    carriers = _carriers(layout, rows, len(chosen.shown))
    pieces = [row for k, row in enumerate(rows) if carriers[k] != k]

    def reshape(field: DenseField) -> DenseField:
        nonlocal boxed, unfollowed
        field, boxed, unfollowed = cleaned(field, parts, boxed)
        if not pieces:
            return field
        owner = np.where(field.owner < 0, field.owner, carriers[field.owner])
        return dataclasses.replace(field, owner=owner.astype(field.owner.dtype))

    pure = (chosen.owner == chosen.owner[:, :1]).all(1)
    told = dataclasses.replace(chosen.grid, own_box=parts.boxes[chosen.owner])
    found = mesh_parts(told, Segmentation(parts.boxes, chosen.owner, pure), reshape)
    meshes = dict(zip(rows, [*found, *boxed], strict=True))
    fragments = [
        k for k in range(len(layout)) if k not in pieces and _is_fragment(meshes[k], layout, k)
    ]
    left_out = "left out: voxels show a fragment of it"
    notes = [_note(numbers[k], layout.confidence[k], left_out) for k in fragments]
    gone = fragments + pieces
    kept = [meshes[k] for k in range(len(layout)) if k not in gone]
    made = _parts(_without(layout, gone), kept)
    provenance = (*chosen.notes, *notes, *unfollowed)
    return with_parts_joined(
        ArticulatedObject(made, scale, name, provenance=provenance, from_voxels=True)
    )


def _carriers(layout: Layout, rows: list[int], shown: int) -> np.ndarray:
    """[N] the place in ``rows`` of what each becomes a piece of: itself, or, of a row that is fixed
    and drawn as it is told, of what carries it; ``shown``: how many of them voxels show."""
    drawn = _drawn_as_told(layout)
    place = {row: k for k, row in enumerate(rows)}

    def carrier(row: int) -> int:
        up = layout.parents[row]
        fixed = row in drawn and up >= 0 and layout.joints[row].type == "fixed"
        return carrier(up) if fixed and place[up] < shown else row

    return np.array([place[carrier(row)] for row in rows])


def _note(row: int, confidence: float, what: str) -> str:
    return f"part {row} of the layout (confidence {confidence:.2f}) {what}"


@dataclasses.dataclass(frozen=True)
class _Chosen:
    """Which rows of a layout become parts, and how.

    Attributes:
      grid: solid sub-cells of rows made of boxes, too small or found twice are outside in it.
      layout: [K] rows that become parts; voxels show ``shown``, ``boxed`` are made of their boxes.
      numbers: [K] their rows in the layout that was given.
      owner: [V, r^3] int16, index into ``shown`` that each sub-cell joins.
      notes: of rows that are left out or made of their boxes.
    """

    grid: VoxelGrid
    layout: Layout
    shown: list[int]
    boxed: list[int]
    numbers: list[int]
    owner: np.ndarray
    notes: tuple[str, ...]


def _chosen_rows(grid: VoxelGrid, layout: Layout) -> _Chosen:
    """The rows of a layout that become parts of a finite grid."""
    owner = row_of_subcells(grid, layout.boxes)
    inside = np.asarray(grid.sdf) < 0
    solid = np.bincount(owner[inside], minlength=len(layout))
    cells = grid.resolution * grid.subdivisions
    boxed, specks, twice, hidden = _kinds(layout, solid, cells)
    notes = tuple(
        _note(k, layout.confidence[k], what)
        for rows, what in (
            (hidden, "left out: no voxels show it"),
            (specks, "left out: it is too small"),
            (twice, "left out: a surer part is in its place"),
            (boxed, "made of its box: voxels are too coarse for it"),
        )
        for k in rows
    )
    theirs = np.isin(owner, boxed + twice + specks) & inside  # in the place of their meshes
    grid = dataclasses.replace(grid, sdf=np.where(theirs, np.float32(0.5), grid.sdf))
    left_out = hidden + twice + specks
    numbers = [k for k in range(len(layout)) if k not in left_out]
    layout = _without(layout, left_out)
    boxed = [numbers.index(k) for k in boxed]
    shown = [k for k in range(len(layout)) if k not in boxed]
    if len(shown) < len(solid):  # what the others had joins these
        owner = row_of_subcells(grid, layout.boxes[shown])
    return _Chosen(grid, layout, shown, boxed, numbers, owner, notes)


def _primitive_meshes(layout: Layout, rows: list[int], cell: float) -> list[trimesh.Trimesh]:
    """Meshes of rows of a layout, made of their boxes; ``cell``: side of a sub-cell, object
    units."""
    fitting = side_by_side(layout.boxes[rows], [layout.joints[k] for k in rows])
    return [
        primitive_part(box, layout.joints[k], layout.colors[k], cell)
        for k, box in zip(rows, fitting, strict=True)
    ]


def _parts(layout: Layout, meshes: list[trimesh.Trimesh]) -> tuple[Part, ...]:
    """A layout's rows with their meshes [K] as parts, parents first."""
    order = topological_order(list(layout.parents))
    position = {old: new for new, old in enumerate(order)}
    counted = ["base" if layout.parents[k] < 0 else f"link_{position[k]}" for k in position]
    names = layout.names or dict(zip(position, counted, strict=True))
    return tuple(
        Part(
            names[k],
            meshes[k],
            position.get(layout.parents[k], -1),
            layout.joints[k],
        )
        for k in order
    )


def _kinds(
    layout: Layout, solid: np.ndarray, cells: int
) -> tuple[list[int], list[int], list[int], list[int]]:
    """Rows that are made of their boxes, that are too small, that are found twice, and that no
    voxel shows; ``solid`` [K]: solid sub-cells of each, of a grid with ``cells`` along its side."""
    boxed = needed(layout, solid, cells)
    specks = [
        k
        for k, up in enumerate(layout.parents)
        if up >= 0 and k not in layout.parents and layout.boxes[k, 3:].max() < SPECK
    ]
    boxed = [k for k in boxed if k not in specks]
    twice = doubles(layout, boxed)
    boxed = [k for k in boxed if k not in twice]
    told = boxed + specks + twice
    hidden = [
        k for k, up in enumerate(layout.parents) if solid[k] < FEWEST and up >= 0 and k not in told
    ]
    drawn = _drawn_as_told(layout)
    boxed, specks, twice, hidden = (
        [k for k in rows if k not in drawn] for rows in (boxed, specks, twice, hidden)
    )
    return boxed, specks, twice, hidden


def _drawn_as_told(layout: Layout) -> set[int]:
    """Rows that are drawn whatever voxels show: tubes; boards and outlines that are told, of what
    does not move; boards of what is told at rest and shown turned."""
    still = still_parts(layout.parents, layout.joints)
    tubes = {k for k, own in enumerate(layout.tubes) if own is not None}
    told = {k: own for k, own in enumerate(layout.boards) if own is not None and not own.estimate}
    round_ = {k for k, own in enumerate(layout.revolutions) if own is not None and not own.estimate}
    turned = {k for k, own in told.items() if own.motion is not None}
    return tubes | turned | ((round_ | told.keys()) & set(still))


def _is_fragment(mesh: trimesh.Trimesh, layout: Layout, row: int) -> bool:
    """Whether a part that is fixed to another, as a handle, and carries none, is hardly there."""
    alone = layout.parents[row] >= 0 and row not in layout.parents
    longest = float(layout.boxes[row, 3:].max())
    small = float(mesh.extents.max()) < FRAGMENT * longest
    return alone and layout.joints[row].type == "fixed" and small


def _without(layout: Layout, left_out: list[int]) -> Layout:
    """The layout without some rows, none of them the root; what hung on them hangs on their
    parents."""
    parents = list(layout.parents)
    for k in range(len(parents)):
        while parents[k] in left_out:
            parents[k] = parents[parents[k]]
    kept = [k for k in range(len(layout)) if k not in left_out]
    return dataclasses.replace(layout, parents=tuple(parents)).taken(kept)
