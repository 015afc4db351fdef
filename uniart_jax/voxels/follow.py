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
from uniart_jax.voxels.cleanup.clearance import with_meshes, with_room_to_move
from uniart_jax.voxels.cleanup.drums import drums, with_drums
from uniart_jax.voxels.cleanup.flat_faces import with_flat_faces
from uniart_jax.voxels.cleanup.found_boards import with_boards
from uniart_jax.voxels.cleanup.found_legs import with_legs
from uniart_jax.voxels.cleanup.found_panels import with_panels
from uniart_jax.voxels.cleanup.legs import with_whole_legs
from uniart_jax.voxels.cleanup.loose_parts import (
    with_lost_parts,
    with_parts_joined,
    without_floating_pieces,
)
from uniart_jax.voxels.cleanup.primitive_parts import (
    doubles,
    in_front,
    needed,
    primitive_part,
    side_by_side,
)
from uniart_jax.voxels.cleanup.rooms import with_clean_rooms
from uniart_jax.voxels.cleanup.round_doors import round_doors, with_round_doors
from uniart_jax.voxels.cleanup.solids_of_revolution import with_revolutions
from uniart_jax.voxels.cleanup.trays import trays
from uniart_jax.voxels.cleanup.walls import with_whole_walls
from uniart_jax.voxels.closing import closing_of
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
    grid: VoxelGrid,
    layout: Layout,
    *,
    scale: float = 1.0,
    name: str = "",
    flat: bool = True,
    room: bool = True,
) -> ArticulatedObject:
    """The object that the voxels show, with the layout's parts, tree and joints.

    Args:
      grid: attributes on active voxels as a network gives them. layout: of the same shown state and
        frame.
      flat: nearly flat faces are made flat (``flat_faces``), boards within the body are the
        layout's panels (``found_panels``), parts that move its boards (``found_boards``), racks
        trays (``trays``), legs are whole (``found_legs``, ``legs``), rooms behind doors and in
        drawers boxes (``rooms``), what surrounds their fronts is flat (``frames``), and parts with
        a revolution have its outline (``solids_of_revolution``).
      room: what stands in the way of moving parts is taken off (``clearance``).

    Returns:
      Parts 'base', 'link_1', ..., parents first; every mesh is closed. A small row that voxels
      hardly show, or that turns about its middle, and a turntable are made of their boxes
      (``primitive_parts``). Another that no voxel shows, or a fixed one of which they show a
      fragment, is left out; its children hang on its parent. ``provenance`` tells of all.

    Raises:
      ValueError: the grid holds no voxels.
    """
    if len(grid.coords) == 0:
        raise ValueError("assemble: the voxel grid is empty; nothing was generated")
    grid = _finite(grid)
    owner = row_of_subcells(grid, layout.boxes)
    solid = np.bincount(owner[np.asarray(grid.sdf) < 0], minlength=len(layout))
    cells = grid.resolution * grid.subdivisions
    boxed, specks, twice, hidden = _kinds(layout, solid, cells)
    left_out = hidden + twice + specks
    notes = tuple(
        f"part {k} of the layout (confidence {layout.confidence[k]:.2f}) {what}"
        for rows, what in (
            (hidden, "left out: no voxels show it"),
            (specks, "left out: it is too small"),
            (twice, "left out: a surer part is in its place"),
            (boxed, "made of its box: voxels are too coarse for it"),
        )
        for k in rows
    )
    # in the place of their meshes
    theirs = np.isin(owner, boxed + twice + specks) & (np.asarray(grid.sdf) < 0)
    grid = dataclasses.replace(grid, sdf=np.where(theirs, np.float32(0.5), grid.sdf))
    kept = [k for k in range(len(layout)) if k not in left_out]
    boxed = [kept.index(k) for k in boxed]
    layout = _without(layout, left_out)
    shown = [k for k in range(len(layout)) if k not in boxed]
    boxes = np.asarray(layout.boxes[shown], np.float32)
    if len(shown) < len(solid):  # what the others had joins these
        owner = row_of_subcells(grid, layout.boxes[shown])
    pure = (owner == owner[:, :1]).all(1)
    told = dataclasses.replace(grid, own_box=boxes[owner])
    fitting = side_by_side(layout.boxes[boxed], [layout.joints[k] for k in boxed])
    meshes = {
        k: primitive_part(box, layout.joints[k], layout.colors[k], 1 / cells)
        for k, box in zip(boxed, fitting, strict=True)
    }
    rows = [*shown, *boxed]  # of the field's owners

    place = {row: new for new, row in enumerate(rows)} | {-1: -1}
    joints, up = [layout.joints[k] for k in rows], [place[layout.parents[k]] for k in rows]

    body = [k for k in still_parts(up, joints) if k < len(shown)]

    boards = {
        k: own.boxes
        for k, row in enumerate(shown)
        if layout.boards and (own := layout.boards[row]) is not None and len(own)
    }
    unfit = [
        f"boards of part {kept[rows[k]]} of the layout left out: it does not move"
        for k in boards
        if k in body
    ]
    boards = {k: own for k, own in boards.items() if k not in body}
    outlines_of = {
        k: own
        for k, row in enumerate(shown)
        if layout.revolutions and (own := layout.revolutions[row]) is not None
    }
    closed = closing_of(joints, layout.boxes[rows], up)
    ajar = {k: closed[k] for k in boards if (closed[k] != np.eye(3, 4)).any()}

    def reshape(field: DenseField) -> DenseField:
        drawn = field
        if flat:
            carries = [rows.index(k) for k in set(layout.parents) if k >= 0]
            field = with_flat_faces(field, boxes, joints[: len(shown)], carries, body)
            field = with_whole_walls(field, boxes, joints[: len(shown)], body)
            if layout.panels is not None and len(layout.panels):
                built = with_panels(field, body, layout.panels, layout.legs)
                if built is None:
                    unfit.append("panels of the layout left out: voxels show another body")
                field = built or field
            left = set(range(len(boxes)))
            if boards:
                field, built = with_boards(field, boards, joints, body, ajar)
                unfit.extend(
                    f"boards of part {kept[rows[k]]} of the layout left out: voxels show another "
                    "shape"
                    for k in sorted(boards.keys() - built)
                )
                left -= built
            racks = trays(field, boxes, joints, up, body, closed, left)
            if racks:
                field, _ = with_boards(field, racks, joints, body, exact=True)
                left -= racks.keys()
                unfit.extend(f"part {kept[rows[k]]} of the layout made a tray" for k in racks)
            if layout.legs is None:
                field = with_whole_legs(field, body)
            else:
                field = with_legs(field, body, layout.legs)
            field = with_clean_rooms(field, boxes, joints, up)
            discs = round_doors(drawn, boxes, joints[: len(shown)], body)
            field = with_round_doors(field, discs, body)
            turning = drums(field, boxes, joints[: len(shown)], body)
            field = with_drums(field, turning, body)
            outlines = {k: one for k, one in outlines_of.items() if k in left}
            for other in (*discs, *turning):
                outlines.pop(other.part, None)
            field, rounded = with_revolutions(field, drawn, boxes, outlines)
            unfit.extend(
                f"revolution of part {kept[rows[k]]} of the layout left out: voxels show another "
                "shape"
                for k in sorted(outlines.keys() - set(rounded))
            )
        field = with_lost_parts(field, drawn)
        for k in boxed:
            meshes[k] = in_front(meshes[k], layout.joints[k], field)
        field = whole = with_meshes(field, [meshes[k] for k in boxed], len(shown))
        field = without_floating_pieces(field, len(rows), body)
        if not room:
            return with_lost_parts(field, whole)
        field = with_room_to_move(field, joints, up)
        return with_lost_parts(without_floating_pieces(field, len(rows), body), whole)

    found = mesh_parts(told, Segmentation(boxes, owner, pure), reshape)
    meshes |= dict(zip(shown, found, strict=True))
    fragments = [k for k in range(len(layout)) if _is_fragment(meshes[k], layout, k)]
    notes += tuple(
        f"part {kept[k]} of the layout (confidence {layout.confidence[k]:.2f}) left out: voxels "
        "show a fragment of it"
        for k in fragments
    )
    meshes = {
        new: meshes[k] for new, k in enumerate(k for k in sorted(meshes) if k not in fragments)
    }
    layout = _without(layout, fragments)
    order = topological_order(list(layout.parents))
    position = {old: new for new, old in enumerate(order)}
    parts = tuple(
        Part(
            "base" if layout.parents[k] < 0 else f"link_{position[k]}",
            meshes[k],
            position.get(layout.parents[k], -1),
            layout.joints[k],
        )
        for k in order
    )
    obj = ArticulatedObject(parts, scale, name, provenance=(*notes, *unfit), from_voxels=True)
    return with_parts_joined(obj)


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
    return boxed, specks, twice, hidden


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
    position = {old: new for new, old in enumerate(kept)} | {-1: -1}
    return Layout(
        layout.boxes[kept],
        tuple(layout.joints[k] for k in kept),
        tuple(position[parents[k]] for k in kept),
        layout.colors[kept],
        layout.confidence[kept],
        layout.camera,
        layout.legs,
        layout.panels,
        tuple(layout.boards[k] for k in kept) if layout.boards else (),
        tuple(layout.revolutions[k] for k in kept) if layout.revolutions else (),
    )
