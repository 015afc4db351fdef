"""The passes of this folder, one after the other, over the field of an object whose layout is
known."""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.drums import drums, with_drums
from uniart_jax.voxels.cleanup.flat_faces import with_flat_faces
from uniart_jax.voxels.cleanup.layout_boards import with_boards
from uniart_jax.voxels.cleanup.layout_legs import with_legs
from uniart_jax.voxels.cleanup.layout_panels import with_panels
from uniart_jax.voxels.cleanup.loose_parts import with_lost_parts, without_floating_pieces
from uniart_jax.voxels.cleanup.primitive_parts import in_front
from uniart_jax.voxels.cleanup.room_to_move import with_meshes, with_room_to_move
from uniart_jax.voxels.cleanup.rooms import with_clean_rooms
from uniart_jax.voxels.cleanup.round_doors import round_doors, with_round_doors
from uniart_jax.voxels.cleanup.solids_of_revolution import with_revolutions
from uniart_jax.voxels.cleanup.straight_legs import with_whole_legs
from uniart_jax.voxels.cleanup.told_shapes import with_told_shapes
from uniart_jax.voxels.cleanup.trays import trays
from uniart_jax.voxels.cleanup.walls import with_whole_walls
from uniart_jax.voxels.closed_pose import closing_of
from uniart_jax.voxels.isosurface import DenseField
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.opening_direction import still_parts
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution
from uniart_jax.voxels.tube_table import Tube


@dataclasses.dataclass(frozen=True)
class FieldParts:
    """Parts of an object whose field is cleaned. An id is an owner in the field (``DenseField``).

    Attributes:
      layout: row k is the part with id k: first those that voxels show, then those that are made of
        their boxes; parents are ids.
      shown: how many of them voxels show.
      numbers: [K] rows of the parts in the layout that was given, which notes name.
    """

    layout: Layout
    shown: int
    numbers: list[int]

    @property
    def boxes(self) -> np.ndarray:
        """[shown, 6] float32 centre and size, object units."""
        return np.asarray(self.layout.boxes[: self.shown], np.float32)

    @property
    def joints(self) -> list[Joint]:
        """[shown] joints of what voxels show."""
        return list(self.layout.joints[: self.shown])

    @property
    def still(self) -> list[int]:
        """Ids of parts that no joint moves."""
        return still_parts(self.layout.parents, self.layout.joints)

    @property
    def body(self) -> list[int]:
        """Those that voxels show."""
        return [k for k in self.still if k < self.shown]

    @property
    def boards(self) -> dict[int, Panels]:
        """By id, the boards of each part that has some."""
        told = dict(enumerate(self.layout.boards[: self.shown]))
        return {k: own for k, own in told.items() if own is not None and len(own)}

    @property
    def exact_boards(self) -> dict[int, Panels]:
        """By id, boards that are drawn whatever voxels show: of parts that do not move, and of
        those that are told at rest and shown turned."""
        still = set(self.still)
        return {
            k: own
            for k, own in self.boards.items()
            if not own.estimate and (k in still or own.motion is not None)
        }

    @property
    def tubes(self) -> dict[int, Tube]:
        """By id, the tube of each part that is one."""
        told = dict(enumerate(self.layout.tubes[: self.shown]))
        return {k: own for k, own in told.items() if own is not None}

    @property
    def revolutions(self) -> dict[int, Revolution]:
        """By id, the outline of each part that has one."""
        told = dict(enumerate(self.layout.revolutions[: self.shown]))
        return {k: own for k, own in told.items() if own is not None}


def cleaned(
    field: DenseField, parts: FieldParts, boxed: list[trimesh.Trimesh]
) -> tuple[DenseField, list[trimesh.Trimesh], list[str]]:
    """The field after the passes, the meshes of the parts that are made of their boxes, and notes
    of where the layout was not followed, or a part was made a tray.

    Args:
      boxed: [K - shown] meshes of the parts that are made of their boxes, object units, in the
        order of their ids.
    """
    drawn, body = field, parts.body
    notes = [
        f"boards of part {parts.numbers[k]} of the layout left out: it does not move"
        for k, own in parts.boards.items()
        if k in body and own.estimate
    ]
    field, told = _with_shapes(field, parts)
    field = with_lost_parts(field, drawn)
    joints, count = parts.layout.joints, len(parts.layout)
    boxed = [in_front(one, joints[parts.shown + k], field) for k, one in enumerate(boxed)]
    field = whole = with_meshes(field, boxed, parts.shown)
    field = without_floating_pieces(field, body, count)
    field = with_room_to_move(field, joints, parts.layout.parents)
    field = without_floating_pieces(field, body, count)
    return with_lost_parts(field, whole), boxed, notes + told


def _with_shapes(field: DenseField, parts: FieldParts) -> tuple[DenseField, list[str]]:
    """Faces made flat, and boards, trays, legs, rooms, discs, drums and solids of revolution as the
    layout or the voxels tell of them; notes as in ``cleaned``."""
    drawn, layout, boxes, joints, body = field, parts.layout, parts.boxes, parts.joints, parts.body
    field = with_flat_faces(field, boxes, joints, layout.parents, body)
    field = with_whole_walls(field, boxes, joints, body)
    notes = []
    if layout.panels is not None and len(layout.panels):
        built = with_panels(field, body, layout.panels, layout.legs)
        if built is None:
            notes.append("panels of the layout left out: voxels show another body")
        field = built or field
    field, told, left = _with_boards_and_trays(field, parts)
    notes += told
    if layout.legs is None:
        field = with_whole_legs(field, body)
    else:
        field = with_legs(field, body, layout.legs)
    field = with_clean_rooms(field, boxes, joints, layout.parents, parts.still)
    discs = round_doors(drawn, boxes, joints, body)
    field = with_round_doors(field, body, discs)
    turning = drums(field, boxes, joints, body)
    field = with_drums(field, body, turning)
    left -= {other.part for other in (*discs, *turning)} | parts.tubes.keys()
    left -= parts.exact_boards.keys()
    outlines = {k: own for k, own in parts.revolutions.items() if k in left}
    field, rounded = with_revolutions(field, boxes, drawn, outlines)
    notes += [
        f"revolution of part {parts.numbers[k]} of the layout left out: voxels show another shape"
        for k in sorted(outlines.keys() - set(rounded))
    ]
    return with_told_shapes(field, body, parts.exact_boards, parts.tubes), notes


def _with_boards_and_trays(
    field: DenseField, parts: FieldParts
) -> tuple[DenseField, list[str], set[int]]:
    """Parts that move built of the layout's boards, racks made trays; notes, and ids of the parts
    that are neither."""
    layout, boxes, joints, body = parts.layout, parts.boxes, parts.joints, parts.body
    closed = closing_of(layout.joints, layout.boxes, layout.parents)
    left, notes = set(range(parts.shown)), []
    exact = parts.exact_boards
    boards = {k: own for k, own in parts.boards.items() if k not in body and k not in exact}
    if boards:
        ajar = {k: closed[k] for k in boards if (closed[k] != np.eye(3, 4)).any()}
        built: frozenset[int] = frozenset()
        for estimate in (True, False):
            rows = {k: own.boxes for k, own in boards.items() if own.estimate is estimate}
            if rows:
                field, some = with_boards(field, joints, body, rows, ajar, exact=not estimate)
                built |= some
        left -= built
        notes = [
            f"boards of part {parts.numbers[k]} of the layout left out: voxels show another shape"
            for k in sorted(boards.keys() - built)
        ]
    racks = trays(field, boxes, joints, layout.parents, body, closed, left)
    if racks:
        field, _ = with_boards(field, joints, body, racks, exact=True)
        left -= racks.keys()
        notes += [f"part {parts.numbers[k]} of the layout made a tray" for k in racks]
    return field, notes, left
