"""A layout: an object's parts as a table, each a box, a joint, a parent, a colour and how sure a
network is of it.

As JSON (``to_json``, ``from_json``), angles in radians, colours sRGB in 0..1, lengths in object
units, of the frame that it names, or in metres, anywhere:

    {"schema": 1, "frame": "object: z up, front at -x, shown state, longest side 1, centred",
     "units": "object" (if left out) or "m",
     "camera": [7] code (``voxels.camera_code``) of the picture that is sampled from, or null,
     "certainty": expected share of moving parts that is right (``inference.certainty``), or null,
     "size": metres of the longest side, where units are "object", or null,
     "parts": [{"name", "parent": row, or its name, or null, "box": {"center": [3], "size": [3]},
                "color": [3], "confidence", "shape": "box" of one that fills its box,
                "joint": {"type", "origin": [3], "direction": [3], "angle": [2], "travel": [2],
                    "shown": angle or travel in the picture, where box and joint are told at 0},
                "boards": null or as "panels", of the part,
                "revolution": null or {"axis": "x", "y" or "z" that it is round about, "center": [2]
                    of that axis, coordinates of the other two in order (left out: the box's
                    middle), "radii": [N] at the middles of N equal layers of its box, from the
                    lower end on (left out: a cylinder), "estimate": true where
                    voxels may correct large radii and the middle; else, or left out, the outline
                    is followed as it is},
                "tube": null or {"points": [N][3] of the path of a bar, "radius"}, in place of box,
                    boards and revolution}],
     "legs": null or {"alone": bool, "rows": [{"lower": [x0, y0, x1, y1] of its lower end, "upper":
                the same of its upper end, "heights": [2] of both, "fill": share of the rectangles
                that it fills (1 a prism, .785 a cylinder), "plinth": bool}]},
     "panels": null or {"share": of the body that they and the legs explain, "estimate": as of a
                revolution, "rows": [{"lower": [3], "upper": [3] corner}]}}

Legs carry what does not move. ``alone``: it has nothing else below their upper ends, and what
voxels show there is taken away. Panels are the boards that it is built of; those within it take the
place of what voxels show there, unless that is another body. Boards are the same of a part that
moves, all that it is built of, of a door that stands ajar as it lies closed (``closed_pose``):
where that is follows from its joint and its box, so whoever edits these edits its boards too, and
takes ``estimate`` away: they are followed as they are then, and nothing else is drawn of the part.
A network's boards of what does not move are not used, and ``provenance`` says so. A network's
panels and boards are kept where their share is high, boards not of a disc that turns about its
middle. A part with a revolution becomes that solid of revolution, where voxels show no other shape
and it is not made of its box or its boards, or as a tray, a disc or a drum; a spout or a handle is
kept where the part's box reaches beyond it. Whoever edits its box edits ``center`` and ``radii``
too, and takes ``estimate`` away, which a network's outlines have.

A part's ``type`` is for readers; it follows from the two spans (``objects.kinematics.Joint``) and
is not read back. ``voxels.read_layout`` makes a layout of what a network says.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh

from uniart_jax.objects.appearance import linear_to_srgb, srgb_to_linear
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.joint_code import encode_joint
from uniart_jax.voxels.json_rows import (
    FARTHEST,
    LIMIT,
    check_names,
    json_numbers,
    json_share,
    plain,
)
from uniart_jax.voxels.leg_table import Legs, legs_from_json, legs_to_json
from uniart_jax.voxels.panel_table import Panels, panels_from_json, panels_to_json
from uniart_jax.voxels.part_rows import (
    ENTRIES,
    check_tree,
    part_boards,
    part_box,
    part_joint,
    part_name,
    part_shown,
)
from uniart_jax.voxels.part_table import SMALLEST_SIDE
from uniart_jax.voxels.revolution_table import (
    Revolution,
    revolution_from_json,
    revolution_to_json,
)
from uniart_jax.voxels.shown_state import (
    at_shown,
    moved_boards,
    moved_revolution,
    usual_plates,
)
from uniart_jax.voxels.tube_table import Tube, tube_from_json, tube_to_json

SCHEMA = 1
FRAME = "object: z up, front at -x, shown state, longest side 1, centred"
WHOLE = (
    "schema", "frame", "units", "camera", "certainty", "size", "parts", "legs", "panels"
)  # fmt: skip
SIZES = (0.01, 20.0)  # metres of the longest side
MOST_PARTS = 256  # of JSON
ROOT = -1  # name of the virtual root


@dataclasses.dataclass(frozen=True)
class Layout:
    """K parts at the shown state.

    Attributes:
      boxes: [K, 6] own boxes, centre and size, object units (metres if ``metres``), z up, front at
        -x. joints: K joints in the same frame; the root's is fixed.
      parents: [K] rows, -1 for the root; in any order. colors: [K, 3] linear RGB in 0..1.
      confidence: [K] in 0..1. camera: [7] code of the picture's camera, or None.
      legs: what it stands on, panels: what its body is built of, where that is known. boards: what
        each part is built of, revolutions: the outlines of parts that are round about an axis; each
        empty, or K, None where that is not known.
      certainty: expected share of the moving parts that is right, in 0..1, or None.
      names: of the parts, empty or K; a network gives none. metres: lengths are metres. size: of
        one in object units, metres of the longest side, or None. tubes: of parts that are bent or
        slanted bars; empty, or K, None of others.
    """

    boxes: np.ndarray
    joints: tuple[Joint, ...]
    parents: tuple[int, ...]
    colors: np.ndarray
    confidence: np.ndarray
    camera: np.ndarray | None = None
    legs: Legs | None = None
    panels: Panels | None = None
    boards: tuple[Panels | None, ...] = ()
    revolutions: tuple[Revolution | None, ...] = ()
    certainty: float | None = None
    names: tuple[str, ...] = ()
    metres: bool = False
    size: float | None = None
    tubes: tuple[Tube | None, ...] = ()

    def __len__(self) -> int:
        return len(self.boxes)

    def __repr__(self) -> str:
        types = ", ".join(joint.type for joint in self.joints[:8])
        types += ", ..." if len(self) > 8 else ""
        also = [name for name in ("camera", "legs", "panels") if getattr(self, name) is not None]
        for name in ("boards", "revolutions"):
            also += [name] if any(own is not None for own in getattr(self, name)) else []
        sure = f"; confidence from {min(self.confidence):.2f}" if len(self) else ""
        sure += "" if self.certainty is None else f"; certainty {self.certainty:.2f}"
        beside = f"; with {', '.join(also)}" if also else ""
        return f"Layout({len(self)} parts: {types}{sure}{beside})"

    @staticmethod
    def of_object(obj: ArticulatedObject, colors: np.ndarray | None = None) -> Layout:
        """The true layout of a normalised object at its shown state; ``colors`` [K, 3] linear RGB,
        gray by default."""
        count = len(obj.parts)
        colors = np.full((count, 3), 0.5) if colors is None else np.asarray(colors)
        joints = tuple(part.joint for part in obj.parts)
        parents = tuple(part.parent for part in obj.parts)
        return Layout(np.asarray(obj.boxes), joints, parents, colors, np.ones(count))

    def name(self, row: int) -> str:
        """What a part is called; ``part_<row>`` if nobody said."""
        return self.names[row] if self.names else f"part_{row}"

    def taken(self, rows: Sequence[int]) -> Layout:
        """These rows, in this order; the parent of each is one of them, or -1."""
        place = {old: new for new, old in enumerate(rows)} | {ROOT: ROOT}
        return dataclasses.replace(
            self,
            boxes=self.boxes[rows],
            joints=tuple(self.joints[k] for k in rows),
            parents=tuple(place[self.parents[k]] for k in rows),
            colors=self.colors[rows],
            confidence=self.confidence[rows],
            boards=tuple(self.boards[k] for k in rows) if self.boards else (),
            revolutions=tuple(self.revolutions[k] for k in rows) if self.revolutions else (),
            names=tuple(self.names[k] for k in rows) if self.names else (),
            tubes=tuple(self.tubes[k] for k in rows) if self.tubes else (),
        )

    def normalized(self) -> tuple[Layout, float]:
        """The layout in object units, and how long its longest side was.

        Returns:
          The same parts, moved and scaled so that the box around all of them has its middle at 0
          and a longest side of 1; without a camera. And that side before.
        """
        low = (self.boxes[:, :3] - self.boxes[:, 3:] / 2).min(0)
        high = (self.boxes[:, :3] + self.boxes[:, 3:] / 2).max(0)
        side = float((high - low).max())
        return self.moved((low + high) / 2, side), side

    def moved(self, middle: np.ndarray, side: float) -> Layout:
        """The layout whose point ``middle`` [3] is at 0 and whose length ``side`` is 1; without a
        camera."""
        matrix = np.diag([1 / side] * 3 + [1.0])
        matrix[:3, 3] = -middle / side

        legs, across = self.legs, np.tile(middle[:2], 2)
        if legs is not None:
            lower, upper = (legs.lower - across) / side, (legs.upper - across) / side
            heights = (legs.heights - middle[2]) / side
            legs = dataclasses.replace(legs, lower=lower, upper=upper, heights=heights)
        return dataclasses.replace(
            self,
            boxes=np.concatenate([self.boxes[:, :3] - middle, self.boxes[:, 3:]], 1) / side,
            joints=tuple(joint.transformed(matrix) for joint in self.joints),
            legs=legs,
            panels=self.panels and self.panels.scaled(middle, side),
            boards=tuple(own and own.scaled(middle, side) for own in self.boards),
            revolutions=tuple(own and own.scaled(middle, side) for own in self.revolutions),
            tubes=tuple(own and own.scaled(middle, side) for own in self.tubes),
            camera=None,
            metres=False,
        )

    def rows(self, most: int) -> dict[str, np.ndarray]:
        """Boxes, codes, parents (root: its own) and colours as ``voxels.part_table`` has them, of
        the ``most`` surest parts and the root."""
        kept = np.arange(len(self))
        if len(self) > most:
            sure = np.where(np.array(self.parents) < 0, np.inf, self.confidence)
            kept = np.sort(np.argsort(-sure, kind="stable")[:most])
        place = {int(k): new for new, k in enumerate(kept)}
        parents = []
        for k in kept.tolist():
            up = self.parents[k]
            while up >= 0 and up not in place:
                up = self.parents[up]
            parents.append(place[up] if up >= 0 else place[k])
        codes = [encode_joint(self.joints[k], self.boxes[k, :3]) for k in kept]
        return {
            "boxes": np.asarray(self.boxes)[kept],
            "codes": np.array(codes),
            "parents": np.array(parents, np.int32),
            "colors": np.asarray(self.colors)[kept],
        }

    def to_object(self, meshes: Sequence[trimesh.Trimesh] | None = None) -> ArticulatedObject:
        """An object whose parts are their boxes, or ``meshes`` [K] in their place, in the layout's
        colours."""
        if meshes is None:
            sides = np.maximum(self.boxes[:, 3:], SMALLEST_SIDE)
            meshes = [trimesh.creation.box(side) for side in sides]
            for mesh, box in zip(meshes, self.boxes, strict=True):
                mesh.apply_translation(box[:3])
        parts = []
        for k, (mesh, joint, parent) in enumerate(
            zip(meshes, self.joints, self.parents, strict=True)
        ):
            paint = np.append(linear_to_srgb(np.clip(self.colors[k], 0, 1)), 1.0)
            mesh.visual.face_colors = np.round(255 * paint).astype(np.uint8)
            parts.append(Part(self.name(k), mesh, int(parent), joint))
        return ArticulatedObject(tuple(parts))

    def to_json(self) -> str:
        """Text of the module's schema."""
        rows = []
        none = (None,) * len(self)
        boards, revolutions = self.boards or none, self.revolutions or none
        tubes = self.tubes or none
        for k, joint in enumerate(self.joints):
            rows.append(
                {
                    "name": self.name(k),
                    "parent": None if self.parents[k] < 0 else int(self.parents[k]),
                    "box": {"center": plain(self.boxes[k, :3]), "size": plain(self.boxes[k, 3:])},
                    "color": plain(linear_to_srgb(np.clip(self.colors[k], 0, 1))),
                    "confidence": round(float(self.confidence[k]), 4),
                    "joint": {
                        "type": joint.type,
                        "origin": plain(joint.origin),
                        "direction": plain(joint.direction),
                        "angle": plain(joint.angle),
                        "travel": plain(joint.travel),
                    },
                    "boards": None if (own := boards[k]) is None else panels_to_json(own),
                    "revolution": (
                        None if (one := revolutions[k]) is None else revolution_to_json(one)
                    ),
                    **({} if (tube := tubes[k]) is None else {"tube": tube_to_json(tube)}),
                }
            )
        camera = None if self.camera is None else plain(self.camera)
        sure = None if self.certainty is None else round(float(self.certainty), 4)
        units = "m" if self.metres else "object"
        data: dict[str, Any] = {"schema": SCHEMA, "frame": FRAME, "units": units}
        data |= {"camera": camera, "certainty": sure, "size": self.size and round(self.size, 4)}
        data["parts"] = rows
        data["legs"] = None if self.legs is None else legs_to_json(self.legs)
        data["panels"] = None if self.panels is None else panels_to_json(self.panels)
        return json.dumps(data, indent=2) + "\n"

    @staticmethod
    def from_json(text: str) -> Layout:
        """Read ``to_json``'s text. ``units``, ``camera``, ``certainty``, ``legs`` and ``panels``
        may be left out, and ``size``; of a part ``name``, ``color``, ``confidence``, ``shape``,
        ``boards``, ``revolution``, ``tube`` and, where it is fixed, ``joint``; of a joint ``type``,
        ``origin`` (the middle of the box), ``shown`` and ``angle`` or ``travel``.

        Raises:
          ValueError: one line that names the row and the field.
        """
        try:
            data = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"layout: not valid JSON ({error})") from None
        if not isinstance(data, dict) or data.get("schema") != SCHEMA:
            raise ValueError(f'layout: give an object with "schema": {SCHEMA}')
        check_names(data, WHOLE, "layout")
        rows, units = data.get("parts"), data.get("units", "object")
        if units not in ("object", "m"):
            raise ValueError(f'layout: units {units!r}; give "m" (metres) or "object"')
        if not isinstance(rows, list) or not 0 < len(rows) <= MOST_PARTS:
            raise ValueError(f'layout: "parts" must be a list of 1 to {MOST_PARTS} parts')
        far = FARTHEST if units == "m" else LIMIT
        boxes, joints, parents, colors, confidence = [], [], [], [], []
        boards, revolutions, names, shown, tubes = [], [], [], [], []
        called = [
            isinstance(row, dict) and (row.get("name") or f"part_{k}") for k, row in enumerate(rows)
        ]
        for k, row in enumerate(rows):
            where = f"layout: part {k}"
            if not isinstance(row, dict):
                raise ValueError(f"{where} is not an object")
            check_names(row, ENTRIES, where)
            names.append(part_name(row.get("name"), names, where))
            tubes.append(tube_from_json(row.get("tube"), where, far))
            boxes.append(part_box(row, tubes[k], units, where))
            parent = row.get("parent")
            if isinstance(parent, str) and parent in called:
                parent = called.index(parent)
            if parent is not None and (type(parent) is not int or not 0 <= parent < len(rows)):
                raise ValueError(f"{where}: parent {parent!r} is no row of the table, nor null")
            parents.append(ROOT if parent is None else parent)
            joints.append(part_joint(row, parent, boxes[k][:3], where))
            shown.append(part_shown(row, joints[k], where))
            paint = json_numbers(row, "color", 3, where) if "color" in row else np.full(3, 0.6)
            colors.append(srgb_to_linear(np.clip(paint, 0, 1)))
            confidence.append(json_share(row.get("confidence", 1.0), f"{where}: confidence"))
            boards.append(part_boards(row, boxes[k], where, far))
            revolutions.append(revolution_from_json(row.get("revolution"), where, boxes[k], far))
        check_tree(parents)
        if any(shown):
            plain = [not any(one) for one in zip(boards, revolutions, tubes, strict=True)]
            plates = usual_plates(np.array(boxes), joints, shown, units)
            boards = [plates[k] if plain[k] else own for k, own in enumerate(boards)]
            boxes, joints, moves = at_shown(np.array(boxes), joints, parents, shown, revolutions)
            revolutions = [moved_revolution(*one) for one in zip(revolutions, moves, strict=True)]
            boards = [moved_boards(*one) for one in zip(boards, moves, strict=True)]
            tubes = [own and own.moved(move) for own, move in zip(tubes, moves, strict=True)]
            boxes = [b if own is None else own.box for b, own in zip(boxes, tubes, strict=True)]
        camera = data.get("camera")
        camera = None if camera is None else json_numbers(data, "camera", 7, "layout")
        if camera is not None and not np.any(camera[:2]):
            raise ValueError("layout: camera's first two numbers, sine and cosine, are both 0")
        if (size := data.get("size")) is not None:
            (size,) = json_numbers({"size": [size]}, "size", 1, "layout").tolist()
            if units == "m" or not SIZES[0] <= size <= SIZES[1]:
                raise ValueError(f'layout: size {size:g}; give metres, with units "object" alone')
        sure = data.get("certainty")
        made = Layout(
            np.array(boxes),
            tuple(joints),
            tuple(parents),
            np.array(colors),
            np.array(confidence),
            camera,
            legs_from_json(data.get("legs"), far),
            panels_from_json(data.get("panels"), far=far),
            tuple(boards) if any(b is not None for b in boards) else (),
            tuple(revolutions) if any(r is not None for r in revolutions) else (),
            None if sure is None else json_share(sure, "layout: certainty"),
            tuple(n or f"part_{k}" for k, n in enumerate(names)) if any(names) else (),
            units == "m",
            size,
            tuple(tubes) if any(tubes) else (),
        )
        if made.metres and not SIZES[0] <= (side := made.normalized()[1]) <= SIZES[1]:
            least, most = SIZES
            raise ValueError(f"layout: {side:g} m long; give metres, from {least:g} to {most:g}")
        return made
