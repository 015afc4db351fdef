"""Folders laid out as PartNet-Mobility's, from a made-up cabinet, with the defects that real ones
have; and where its parts truly go.

    write_cabinet(folder, "backwards", "missing_texture")  ->  Cabinet

Everything true is in the raw frame (y up, +z front), as ``mobility_v2.json`` is; ``WORLD`` turns it
z up, front -x. Nothing of PartNet-Mobility's is copied.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from trimesh.transformations import rotation_matrix, translation_matrix

WORLD = np.array([[0.0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
BASE = 'rpy="1.570796326794897 0 -1.570796326794897"'
ENDLESS = (-math.inf, math.inf)


@dataclasses.dataclass
class Piece:
    """One part: the truth, and what the two files say where that is something else."""

    name: str
    parent: str | None
    kind: str
    low: tuple[float, float, float]  # its box
    high: tuple[float, float, float]
    origin: tuple[float, float, float] = (0, 0, 0)
    direction: tuple[float, float, float] = (0, 0, 1)  # unit
    limits: tuple[float, float] = (0, 0)  # degrees or lengths along the direction
    turn: float = 0.0  # degrees that a slider also turns; inf: endless
    axis_json: dict | None = None
    limit_json: dict | None = None
    urdf: dict = dataclasses.field(default_factory=dict)  # type, axis, limits, origin, parent, link
    shown: float = 0.0  # where along its joint a host's URDF shows it


@dataclasses.dataclass
class Cabinet:
    """What was written, and the truth about it."""

    pieces: dict[str, Piece]
    folder: Path
    files: dict[str, bytes] = dataclasses.field(default_factory=dict)  # to be written last
    missing: set[str] = dataclasses.field(default_factory=set)  # not to be written
    base: str = 'type="fixed"'
    scale: float = 1.0  # of every mesh and length of the URDF
    mtl: str = "newmtl m\nKd 1 1 1\nmap_Kd ../images/texture_0.jpg\n"
    semantics: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def linked(self) -> list[str]:
        """Names of the pieces that the URDF holds, in its order."""
        return [n for n, p in self.pieces.items() if p.kind != "junk"]

    def link(self, name: str) -> str:
        number = self.linked.index(name)
        return self.pieces[name].urdf.get("link", f"link_{number}")

    def pose(self, name: str | None, state: dict[str, float]) -> np.ndarray:
        """[4, 4] raw frame: where a piece has gone at ``state`` (name -> degrees or length; of a
        cap, its travel)."""
        if name is None:
            return np.eye(4)
        piece = self.pieces[name]
        above, value = self.pose(piece.parent, state), state.get(name, 0.0)
        along = translation_matrix(np.array(piece.direction) * value)
        if piece.kind == "hinge":
            return above @ rotation_matrix(math.radians(value), piece.direction, piece.origin)
        if piece.kind != "slider":
            return above
        if math.isfinite(piece.turn) and piece.turn:
            lo, hi = piece.limits
            spun = math.radians(piece.turn) * value / (hi - lo)
            return above @ along @ rotation_matrix(spun, piece.direction, piece.origin)
        return above @ along

    def world(self, matrix: np.ndarray) -> np.ndarray:
        """A raw motion in the world of the URDF."""
        turned = WORLD @ np.diag([self.scale] * 3 + [1.0])
        return turned @ matrix @ np.linalg.inv(turned)

    def corners(self, name: str, state: dict[str, float]) -> np.ndarray:
        """[2, 3] corners of a piece's own box in the world at ``state``."""
        piece = self.pieces[name]
        grid = np.array(np.meshgrid(*zip(piece.low, piece.high, strict=True))).reshape(3, -1)
        points = WORLD @ self.pose(name, state) @ np.vstack([grid, np.ones(grid.shape[1])])
        points = self.scale * points[:3]
        return np.stack([points.min(1), points.max(1)])


def cabinet() -> dict[str, Piece]:
    """A body with a drawer, a door that bears a knob and a flap, and a cap that turns as it rises;
    the body last, as it often is."""
    found = [
        Piece("drawer", "body", "slider", (0.05, 0, -0.4), (0.45, 0.3, 0.4), limits=(0, 0.5)),
        Piece("door", "body", "hinge", (-0.5, -0.5, 0.4), (0, 0.5, 0.45), (-0.5, 0, 0.4), (0, -1, 0), (0, 90)),  # noqa: E501
        Piece("knob", "door", "hinge", (-0.1, 0, 0.45), (-0.05, 0.05, 0.5), (-0.075, 0.025, 0), (0, 0, 1), ENDLESS),  # noqa: E501
        Piece("flap", "door", "hinge", (-0.4, 0.2, 0.45), (-0.2, 0.4, 0.47), (-0.3, 0.2, 0.45), (1, 0, 0), (0, 120)),  # noqa: E501
        Piece("cap", "body", "slider", (-0.1, 0.5, -0.1), (0.1, 0.6, 0.1), (0, 0, 0), (0, 1, 0), (0, 0.2), turn=180.0),  # noqa: E501
        Piece("body", None, "heavy", (-0.5, -0.5, -0.5), (0.5, 0.5, 0.4)),
    ]  # fmt: skip
    return {p.name: p for p in found}


def write_cabinet(folder: Path, *defects: str) -> Cabinet:
    """Write the cabinet's folder with any of ``DEFECTS``."""
    made = Cabinet(cabinet(), Path(folder))
    for defect in defects:
        DEFECTS[defect](made)
    write(made)
    return made


def write(made: Cabinet) -> None:
    """All files of a PartNet-Mobility folder."""
    files: dict[str, bytes] = {"images/texture_0.jpg": _texture()}
    tree, objects = [], []
    for number, (name, piece) in enumerate(made.pieces.items()):
        files[f"textured_objs/original-{number}.obj"] = _obj(number, piece).encode()
        files[f"textured_objs/original-{number}.mtl"] = made.mtl.encode()
        tree.append({"id": 10 + number, "name": name, "objs": [f"original-{number}"]})
        parts = [{"id": 10 + number, "name": name, "children": []}]
        parent = -1 if piece.parent is None else list(made.pieces).index(piece.parent)
        entry = {"id": number, "parent": parent, "joint": piece.kind, "name": name, "parts": parts}
        objects.append({**entry, "jointData": _joint_data(piece)})
    files["mobility_v2.json"] = json.dumps(objects).encode()
    files["result.json"] = json.dumps([{"id": 1, "name": "cabinet", "children": tree}]).encode()
    meta = {"model_id": "0a1b", "anno_id": "99", "version": "2", "model_cat": "StorageFurniture"}
    files["meta.json"] = json.dumps(meta).encode()
    box = {"min": [-0.5, -0.5, -0.5], "max": [0.5, 0.6, 0.5]}
    files["bounding_box.json"] = json.dumps(box).encode()
    lines = [
        f"{made.link(n)} {made.pieces[n].kind} {made.semantics.get(n, n)}" for n in made.linked
    ]
    files["semantics.txt"] = ("\n".join(lines) + "\n").encode()
    files["mobility.urdf"] = _urdf(made).encode()
    for name, data in (files | made.files).items():
        if name not in made.missing:
            (made.folder / name).parent.mkdir(parents=True, exist_ok=True)
            (made.folder / name).write_bytes(data)


def _joint_data(piece: Piece) -> dict:
    if piece.parent is None:
        return {}
    lo, hi = piece.limits
    bounded = math.isfinite(hi)
    limit: dict = {"a": lo if bounded else 0, "b": hi if bounded else 0, "noLimit": not bounded}
    if piece.turn:
        endless = math.isinf(piece.turn)
        limit |= {"rotates": True, "noRotationLimit": endless}
        limit["rotationLimit"] = 0 if endless else piece.turn
    axis = {"origin": list(piece.origin), "direction": list(piece.direction)}
    return {
        "axis": axis | (piece.axis_json or {}),
        "limit": limit if piece.limit_json is None else piece.limit_json,
    }


def _urdf(made: Cabinet) -> str:
    """As PartNet-Mobility writes it: link frames at the joints' origins, visuals moved back by
    them, neither inertia nor effort."""
    lines = ['<?xml version="1.0" ?>', '<robot name="partnet_0a1b">', '<link name="base"/>']
    for number, (name, piece) in enumerate(made.pieces.items()):
        if piece.kind == "junk":
            continue
        link, back = made.link(name), -made.scale * _origin(piece)
        size = f' scale="{made.scale} {made.scale} {made.scale}"' if made.scale != 1 else ""
        mesh = f'<geometry><mesh filename="textured_objs/original-{number}.obj"{size}/></geometry>'
        body = f'<origin xyz="{_text(back)}"/>{mesh}'
        extra = piece.urdf.get("extra", "")
        shapes = f"<visual>{body}</visual><collision>{body}</collision>{extra}"
        lines += [f'<link name="{link}">{shapes}</link>', *_joints(made, name, link)]
    return "\n".join([*lines, "</robot>\n"])


def _joints(made: Cabinet, name: str, link: str) -> list[str]:
    piece, number = made.pieces[name], made.linked.index(name)
    if piece.parent is None:
        ends = f'<child link="{link}"/><parent link="base"/>'
        return [
            f'<joint name="joint_{number}" {made.base}><origin {BASE} xyz="0 0 0"/>{ends}</joint>'
        ]
    parent = piece.urdf.get("parent", piece.parent)
    place = _origin(piece) + piece.shown * np.array(piece.direction)
    place = made.scale * (place - _origin(made.pieces[parent]))
    lo, hi = (made.scale * (v - piece.shown) for v in piece.limits)
    if piece.kind == "hinge":
        lo, hi = (math.radians(v) for v in piece.limits)
    kind = {"hinge": "revolute", "slider": "prismatic"}.get(piece.kind, "fixed")
    if kind == "revolute" and not math.isfinite(hi):
        kind = "continuous"
    lo, hi = piece.urdf.get("limits", (lo, hi))
    limit = (
        f'<limit lower="{lo!r}" upper="{hi!r}"/>' if math.isfinite(hi) and kind != "fixed" else ""
    )
    axis = f'<axis xyz="{piece.urdf.get("axis", _text(piece.direction))}"/>'
    kind = piece.urdf.get("type", kind)

    def joint(number: int, kind: str, above: str, below: str, xyz, inner: str) -> str:
        ends = f'<child link="{below}"/><parent link="{above}"/>'
        where = f'<origin xyz="{_text(xyz)}"/>'
        return f'<joint name="joint_{number}" type="{kind}">{where}{axis}{ends}{inner}</joint>'

    if not piece.turn:
        return [joint(number, kind, made.link(parent), link, place, limit)]
    helper = f"{link}_helper"  # PartNet's own way; it drops the limit of the turn
    return [
        f'<link name="{helper}"/>',
        joint(number, "continuous", helper, link, (0, 0, 0), ""),
        joint(len(made.linked), kind, made.link(parent), helper, place, limit),
    ]


def _origin(piece: Piece) -> np.ndarray:
    still = piece.kind not in ("hinge", "slider")
    return np.array(piece.urdf.get("origin", (0, 0, 0) if still else piece.origin), dtype=float)


def _text(vector) -> str:
    return " ".join(repr(float(v)) for v in vector)


def _obj(number: int, piece: Piece) -> str:
    corners = np.array(np.meshgrid(*zip(piece.low, piece.high, strict=True))).reshape(3, -1).T
    flat = [i for i in range(3) if piece.low[i] == piece.high[i]]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    if flat:  # a sheet: the two faces that have an area lie on one another; one is written
        area = [
            np.linalg.norm(np.cross(corners[q[1]] - corners[q[0]], corners[q[3]] - corners[q[0]]))
            for q in quads
        ]
        quads = [quads[int(np.argmax(area))]]
    lines = [f"mtllib original-{number}.mtl", *(f"v {_text(c)}" for c in corners)]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "usemtl m"]
    for a, b, c, d in quads:
        lines += [f"f {a + 1}/1 {b + 1}/2 {c + 1}/3", f"f {a + 1}/1 {c + 1}/3 {d + 1}/4"]
    return "\n".join(lines) + "\n"


@functools.cache
def _texture() -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (4, 4), (200, 40, 40)).save(buffer, "JPEG")
    return buffer.getvalue()


def _backwards(made: Cabinet) -> None:
    """a > b about the opposite direction; the URDF flips the axis back."""
    door = made.pieces["door"]
    door.axis_json = {"direction": [-v for v in door.direction]}
    door.limit_json = {"a": 0, "b": -90, "noLimit": False}


def _held_fixed(made: Cabinet) -> None:
    for name in ("drawer", "door"):
        made.pieces[name].urdf["type"] = "fixed"


def _not_unit(made: Cabinet) -> None:
    made.pieces["door"].axis_json = {"direction": [0, -0.93, 0]}
    made.pieces["door"].urdf["axis"] = "0 -0.93 0"


def _null_direction(made: Cabinet) -> None:
    """As both files hold it: nobody knows the axis."""
    made.pieces["drawer"].axis_json = {"direction": [None, None, None]}
    made.pieces["drawer"].urdf["axis"] = "None None None"
    made.pieces["drawer"].limits = (0, 0)
    made.pieces["drawer"].urdf["limits"] = (0, 0.5)


def _null_in_json(made: Cabinet) -> None:
    made.pieces["drawer"].axis_json = {"direction": [None, None, None]}


def _zero_direction(made: Cabinet) -> None:
    made.pieces["door"].axis_json = {"direction": [0, 0, 0]}


def _no_limits(made: Cabinet) -> None:
    made.pieces["knob"].limit_json = {}


def _open_at_zero(made: Cabinet) -> None:
    made.pieces["door"].limits = (20, 90)
    made.pieces["drawer"].limits = (-0.2, 0.3)


def _whole_turns(made: Cabinet) -> None:
    """A range that holds 0 only once a whole turn is taken off; the URDF keeps it as it is."""
    made.pieces["door"].limit_json = {"a": -380, "b": -270, "noLimit": False}
    made.pieces["door"].limits = (-20, 90)
    made.pieces["door"].urdf["limits"] = (math.radians(-380), math.radians(-270))


def _junk(made: Cabinet) -> None:
    """Junk first: ids run ahead of the links' numbers by one."""
    junk = Piece("other_leaf", None, "junk", (0.6, 0.6, 0.6), (0.7, 0.7, 0.7))
    made.pieces = {"other_leaf": junk, **made.pieces}


def _pushed_in(made: Cabinet) -> None:
    """Modelled open; a host's URDF shows it pushed in, and counts its limits from there."""
    made.pieces["drawer"].limits = (-0.2, 0.3)
    made.pieces["drawer"].shown = -0.2


def _axis_at_origin(made: Cabinet) -> None:
    """A host set the joint's origin to 0 and the visual's with it: the shape is right, the axis is
    not."""
    made.pieces["door"].urdf["origin"] = (0, 0, 0)


def _narrower(made: Cabinet) -> None:
    made.pieces["door"].urdf["limits"] = (0, 1.0)


def _tilted(made: Cabinet) -> None:
    made.pieces["door"].urdf["axis"] = "0.2 -1 0"


def _movable(made: Cabinet) -> None:
    made.base = 'type="prismatic"'


def _free_part(made: Cabinet) -> None:
    made.pieces["flap"].kind = "free"
    made.pieces["flap"].urdf["origin"] = made.pieces["flap"].origin


def _other_parent(made: Cabinet) -> None:
    made.pieces["flap"].urdf["parent"] = "body"


def _renamed(made: Cabinet) -> None:
    made.pieces["door"].urdf["link"] = "my_door"
    made.pieces["drawer"].urdf["link"] = "my_drawer"


def _stale_names(made: Cabinet) -> None:
    made.semantics["door"] = "furniture_lid"


def _flat_sheet(made: Cabinet) -> None:
    made.pieces["door"].high = (0, 0.5, 0.4)


def _missing_mesh(made: Cabinet) -> None:
    gone = '<visual><geometry><mesh filename="textured_objs/original-77.obj"/></geometry></visual>'
    made.pieces["body"].urdf["extra"] = gone


def _extra_obj(made: Cabinet) -> None:
    made.files["textured_objs/new-3.obj"] = b"v 9 9 9\nv 8 9 9\nv 9 8 9\nf 1 2 3\n"


def _escaping_texture(made: Cabinet) -> None:
    """A texture above the folder; the caller may put one there."""
    made.mtl = "newmtl m\nmap_Kd ../../texture_0.jpg\n"


def _scaled(made: Cabinet) -> None:
    made.scale = 2.0


def _endless_cap(made: Cabinet) -> None:
    made.pieces["cap"].turn = math.inf


DEFECTS: dict[str, Callable[[Cabinet], None]] = {
    "backwards": _backwards,
    "held fixed": _held_fixed,
    "not unit": _not_unit,
    "null direction": _null_direction,
    "null in json": _null_in_json,
    "zero direction": _zero_direction,
    "no limits": _no_limits,
    "open at zero": _open_at_zero,
    "whole turns": _whole_turns,
    "junk": _junk,
    "pushed in": _pushed_in,
    "axis at origin": _axis_at_origin,
    "narrower": _narrower,
    "tilted": _tilted,
    "movable": _movable,
    "free part": _free_part,
    "other parent": _other_parent,
    "renamed": _renamed,
    "stale names": _stale_names,
    "flat sheet": _flat_sheet,
    "missing mesh": _missing_mesh,
    "extra obj": _extra_obj,
    "missing texture": lambda made: made.missing.add("images/texture_0.jpg"),
    "escaping texture": _escaping_texture,
    "no meta": lambda made: made.missing.add("meta.json"),
    "scaled": _scaled,
    "endless cap": _endless_cap,
}
