"""The folder of a print: a closed STL a piece, millimetres, ``print.json`` and ``README.txt``."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.export.atlas import Surface
from uniart_jax.export.convex_split import triangles
from uniart_jax.export.frames import check_lengths
from uniart_jax.export.printing.build import (
    Piece,
    Print,
    PrintedJoint,
    at_rest_bounds,
    make_print,
)
from uniart_jax.export.printing.check import Held, Walls, held, touching, walls
from uniart_jax.export.printing.lay import Lying, laid, on_plate
from uniart_jax.export.printing.settings import MOST_SIZE, PrintSettings
from uniart_jax.export.printing.solids import box_of, turned
from uniart_jax.export.stl import closed_solid, stl_bytes
from uniart_jax.objects.object import ArticulatedObject

JSON_FILE, TEXT_FILE = "print.json", "README.txt"
DETAILS = (0.002, 0.01, 0.03)  # mm: left out of a piece that STL's floats would not leave closed
HAIR = 0.004  # mm
PIN = Walls(None, 0.0, None)  # its legs are as thin as they have to be to bend


def write_print(
    obj: ArticulatedObject,
    folder: Path,
    surfaces: Sequence[Surface],
    stems: Sequence[str],
    settings: PrintSettings,
) -> tuple[str, ...]:
    """Write what is needed to print an object and to put it together.

    Args:
      obj: closed, coordinates from 0 up (``placement.place``).
      folder: where to; made if need be.
      surfaces: [K] of the parts, closed, object frame and units, at rest.
      stems: [K] file names without suffix.
      settings: size, clearance, least wall, mm.

    Returns:
      What is other than it was, and what is weak, a line each.

    Raises:
      ValueError: lists that do not fit the parts, or a part without a volume.
    """
    check_lengths("write_print", obj, surfaces=surfaces, stems=stems)
    made = make_print(obj, [(s.vertices, s.faces) for s in surfaces], stems, settings)
    lying = [laid(piece.solid) for piece in made.pieces]
    flat = [turned(p.solid, way.matrix) for p, way in zip(made.pieces, lying, strict=True)]
    places = on_plate([box_of(solid)[1, :2] for solid in flat])
    folder.mkdir(parents=True, exist_ok=True)
    matrices, unclosed = [], {}
    for piece, solid, way, corner in zip(made.pieces, flat, lying, places, strict=True):
        shift = np.eye(4)
        shift[:2, 3] = corner
        matrices.append(shift @ way.matrix)
        if not _write_piece(piece, turned(solid, shift), folder):
            unclosed[piece.name] = (
                f"'{piece.name}' is not closed as STL rounds it, and was left out"
            )
    tried = [held(made, joint) for joint in made.joints]
    report = _report(obj, made, lying, matrices, tried, set(unclosed))
    report["notes"] = [*report["notes"], *unclosed.values()]
    (folder / JSON_FILE).write_text(json.dumps(report, indent=2, allow_nan=False) + "\n", "utf-8")
    (folder / TEXT_FILE).write_text(_text(obj, report), "utf-8")
    return tuple(f"print: {line}" for line in report["notes"])


def _write_piece(piece: Piece, solid: Manifold, folder: Path) -> bool:
    """Whether the piece is closed as STL has it, where places alone tell corners apart."""
    mesh = None
    for detail in (0.0, *DETAILS):
        vertices, faces = triangles(solid.simplify(detail) if detail else solid)
        vertices = _told_apart(vertices, faces) if detail else vertices.copy()
        vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)  # rounding
        mesh = closed_solid(vertices, faces)
        if mesh is not None:
            break
    if mesh is None:
        return False
    (folder / f"{piece.name}.stl").write_bytes(stl_bytes(mesh, piece.name))
    return True


def _told_apart(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corners of different surfaces in one place, moved a hair, each towards its own neighbours."""
    vertices = np.array(vertices)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    for turn in range(1, 6):
        _, place, count = np.unique(
            np.round(vertices, 4), axis=0, return_inverse=True, return_counts=True
        )
        shared = np.flatnonzero(count[place.ravel()] > 1)
        for k in shared:
            way = vertices[mesh.vertex_neighbors[k]].mean(0) - vertices[k]
            vertices[k] += turn * HAIR * way / max(float(np.linalg.norm(way)), HAIR)
        if not len(shared):
            break
    return vertices


def _report(
    obj: ArticulatedObject,
    made: Print,
    lying: Sequence[Lying],
    matrices: Sequence[np.ndarray],
    tried: Sequence[Held],
    missing: set[str],
) -> dict:
    """``print.json``: plain values, mm; ``missing`` names pieces that were not written."""
    notes = list(made.notes)
    pieces = []
    for piece, way, matrix in zip(made.pieces, lying, matrices, strict=True):
        found = walls(piece.solid, piece.hardware, made.settings) if piece.parts else PIN
        entry = {
            "file": None if piece.name in missing else f"{piece.name}.stl",
            "parts": list(piece.parts),
            "size": [round(float(x), 2) for x in np.ptp(box_of(turned(piece.solid, matrix)), 0)],
            "volume": round(float(piece.solid.volume()), 1),
            "on_plate": round(way.contact, 1),
            "overhang": round(way.overhang, 1),
            "thinnest_wall": None if found.thinnest is None else round(found.thinnest, 2),
            "thin_area": round(found.thin, 1),
            "assembled_to_plate": [[round(float(x), 6) for x in row] for row in matrix],
        }
        pieces.append(entry)
        if found.where is not None:
            entry["thin_at"] = [round(float(x), 1) for x in found.where]
            notes.append(
                f"'{piece.name}' has walls of {found.thinnest:.2f} mm, thinner than "
                f"{made.settings.wall:g} mm, around {entry['thin_at']} (assembled, mm)"
                + _larger(found.thinnest, made.settings)
            )
    joints = []
    for joint, found in zip(made.joints, tried, strict=True):
        name = obj.parts[joint.child].name
        lo, hi = joint.joint.limits
        joints.append(
            {
                "part": name,
                "parent": obj.parts[joint.parent].name,
                "kind": joint.fit.kind,
                "type": joint.joint.type,
                "range": [round(float(lo), 4), round(float(hi), 4)],
                **joint.fit.facts,
                "gap": round(found.gap, 3),
                "runs_into_parent_at": list(found.meets),
                "held_along": found.along,
                "held_across": found.across,
                "pins_held": found.pins,
            }
        )
        notes += _weak(name, joint, found)
    notes += [f"'{a}' and '{b}' are only {d:.2f} mm apart at rest" for a, b, d in touching(made)]
    return {
        "unit": "millimetre",
        **dataclasses.asdict(made.settings),
        "assembled_size": [round(float(x), 2) for x in np.ptp(at_rest_bounds(made), 0)],
        "pieces": pieces,
        "joints": joints,
        "assembly": _steps(made, missing),
        "notes": notes,
    }


def _larger(thinnest: float | None, settings: PrintSettings) -> str:
    if not thinnest:
        return ""
    most = min(10 * settings.size, MOST_SIZE)
    size = np.ceil(settings.size * settings.wall / thinnest / 5) * 5
    return f"; they have it at --print-size {size:.0f}" if size <= most else ""


def _weak(name: str, joint: PrintedJoint, found: Held) -> list[str]:
    """What of a joint is not as it should be, a line each."""
    lines = []
    if found.meets:
        turns = joint.joint.rotates
        ends = [np.rad2deg(q) if turns else q for q in (min(found.meets), max(found.meets))]
        where = dict.fromkeys(f"{q:.1f}" for q in ends)
        unit = "degrees" if turns else "mm"
        lines.append(f"'{name}' runs into its parent at {' to '.join(where)} {unit}")
    if joint.fit.kind == "loose":  # said already
        return lines
    if not found.along:
        lines.append(f"'{name}' can be pulled out along its axis")
    if not found.across:
        lines.append(f"'{name}' can be lifted off its axis")
    if not found.pins:
        lines.append(f"a pin of '{name}' can slip out")
    return lines


def _steps(made: Print, missing: set[str]) -> list[str]:
    """What to do in which order: as the URDF has the tree, parents first; without ``missing``."""
    root = made.pieces[0].name
    steps = [] if root in missing else [f"Begin with {root}.stl."]
    names = {p.leader: p.name for p in made.pieces if p.parts and not p.loose}
    for joint in made.joints:
        child, parent = names[joint.child], names[joint.parent]
        if missing & {child, parent}:
            continue
        step = f"Put {child}.stl to {parent}.stl: {joint.fit.text}"
        pins = ", ".join(f"{name}.stl" for name in joint.pins if name not in missing)
        steps.append(step + (f" ({pins})." if pins else "."))
    glued = [(p.name, names[p.leader]) for p in made.pieces if p.loose]
    return steps + [f"Glue {a}.stl to {b}.stl." for a, b in glued if not missing & {a, b}]


def _text(obj: ArticulatedObject, report: dict) -> str:
    """The same for people."""
    side = report["assembled_size"]
    lines = [
        f"{obj.name or 'object'}: {len(report['pieces'])} pieces to print, "
        f"{side[0]:.0f} x {side[1]:.0f} x {side[2]:.0f} mm when assembled.",
        "",
        "All lengths are millimetres. Every file lies flat on z = 0; loaded together, no two",
        f"overlap. Parts that move keep {report['clearance']:g} mm apart: if they stick,",
        "write the print again with a larger --clearance.",
        "",
        "Pieces",
    ]
    for piece in report["pieces"]:
        x, y, z = piece["size"]
        wall = piece["thinnest_wall"]
        what = f"{x:.1f} x {y:.1f} x {z:.1f}"
        if wall is not None:
            what += f", thinnest wall {wall:.2f}"
        if piece["overhang"] > 1:
            what += f", {piece['overhang']:.0f} mm^2 hang over (supports)"
        called = piece["file"] or f"not written ({', '.join(piece['parts']) or 'a pin'})"
        lines.append(f"  {called}: {what}")
    lines += ["", "Assembly"]
    lines += [f"  {n}. {step}" for n, step in enumerate(report["assembly"], 1)]
    if report["joints"]:
        lines += ["", "Joints"]
    for joint in report["joints"]:
        lo, hi = np.rad2deg(joint["range"]) if joint["type"] != "prismatic" else joint["range"]
        unit = "mm" if joint["type"] == "prismatic" else "degrees"
        lines.append(f"  {joint['part']}: {joint['kind']}, {lo:.0f} to {hi:.0f} {unit}")
    lines += ["", "To know"] + ([f"  - {n}" for n in report["notes"]] or ["  nothing"])
    return "\n".join(lines) + "\n"
