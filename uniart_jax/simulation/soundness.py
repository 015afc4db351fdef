"""What can be judged of an asset without an engine: its meshes, the numbers in its file, whether
its parts hang together.

Meshes are looked at as written, before a reader's repairs: surfaces per file (a part may be several
closed pieces), vertices merged by position.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from pathlib import Path

import igl
import numpy as np
import trimesh
from lxml import etree
from trimesh import transform_points

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.kinematics import subtrees
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.robot import Geometry, Link, Robot
from uniart_jax.objects.robot_mesh import primitive
from uniart_jax.simulation.measure import check, impossible

GAP = 0.02  # of the object's size
SAMPLES = 1500  # points of a part's surface that stand for it when gaps are measured
_NAMED = ("link", "joint", "body", "geom", "mesh")
_TEXT = re.compile(r"name|file|class|type|texture|material|joint|link|body|plugin|mode")
_NAN = re.compile(rb"^\s*v[nt]?(?:ertex)?\s[^\n]*\b(?:nan|inf)", re.MULTILINE | re.IGNORECASE)
_MAY_BE_ENDLESS = ("effort", "velocity")


@dataclasses.dataclass(frozen=True)
class Surface:
    """How well a mesh bounds a solid.

    Attributes:
      open: edges that an odd number of faces share.
      turned: edges whose two faces disagree on which side is out.
      volume: signed.
    """

    open: int
    turned: int
    volume: float


def surface(mesh: trimesh.Trimesh) -> Surface:
    """Of a mesh whose vertices at the same position (to 1e-6 of its size) are one."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    size = max(float(np.ptp(vertices, axis=0).max()), 1e-12) if len(vertices) else 1.0
    cells = np.round((vertices - vertices.min(0)) / (1e-6 * size)).astype(np.int64)
    _, inverse = np.unique(cells @ [1, 2_000_003, 4_000_037_000_009], return_inverse=True)
    faces = inverse.reshape(-1)[faces]
    flat = (faces == np.roll(faces, 1, axis=1)).any(1)
    edges = np.concatenate([faces[~flat][:, [i, (i + 1) % 3]] for i in range(3)])
    forward = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    keys = np.sort(edges, axis=1)
    _, index, counts = np.unique(
        keys @ [1, len(vertices) + 1], return_inverse=True, return_counts=True
    )
    balance = np.bincount(index.reshape(-1), weights=forward)
    odd = counts % 2 == 1
    triangles = vertices[np.asarray(mesh.faces)] - vertices.mean(0)
    volume = float(
        np.einsum("ni,ni->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6
    )
    return Surface(int(odd.sum()), int(((balance != 0) & ~odd).sum()), volume)


def mesh_checks(robot: Robot, files: AssetFiles) -> dict[str, dict]:
    """Missing meshes, watertight, normals outward, finite vertices, collision shapes: each names
    its links."""
    missing, leaking, inverted, broken = [], [], [], []
    holds_nan = functools.cache(_holds_nan)  # once a file, but again next time: it may be repaired
    for link in robot.links.values():
        for shape in [*link.visuals, *link.collisions]:
            if shape.kind == "mesh" and shape.mesh is None:
                try:
                    found = files.find(shape.filename)
                    if holds_nan(found):
                        broken.append(f"link '{link.name}': '{shape.filename}'")
                    files.meshes(found)
                except FileNotFoundError:
                    missing.append(f"link '{link.name}': '{shape.filename}'")
                except ValueError as error:
                    missing.append(f"link '{link.name}': '{shape.filename}' ({error})")
        found = [surface(m) for m in _visible(link, files)]
        edges = sum(s.open for s in found)
        if edges and surface(trimesh.util.concatenate(_visible(link, files))).open:
            leaking.append(f"link '{link.name}': {edges} open edges")
        turned = sum(s.turned for s in found)
        inside_out = sum(1 for s in found if not s.open and s.volume < 0)
        if turned or inside_out:
            why = "faces inside out" if inside_out else f"faces disagree along {turned} edges"
            inverted.append(f"link '{link.name}': {why}")
    return {
        "meshes": _counted(missing, "missing or unreadable"),
        "watertight": _counted(leaking),
        "normals": _counted(inverted),
        "finite_meshes": _counted(list(dict.fromkeys(broken))),
    }


def _holds_nan(path: Path) -> bool:
    """Whether an OBJ or STL says a coordinate that is not finite; readers leave such vertices out
    without a word."""
    data = path.read_bytes()
    if path.suffix.lower() == ".obj" or data[:5] == b"solid":
        return bool(_NAN.search(data))
    if path.suffix.lower() == ".stl":
        count = int.from_bytes(data[80:84], "little")
        faces = np.frombuffer(data[84 : 84 + 50 * count], np.uint8)
        corners = np.ascontiguousarray(faces[: len(faces) // 50 * 50].reshape(-1, 50)[:, 12:48])
        return not np.isfinite(corners.view("<f4")).all()
    return False


def _counted(bad: list[str], what: str = "") -> dict:
    told = "; ".join(bad[:4]) + (f"; and {len(bad) - 4} more" if len(bad) > 4 else "")
    return check(len(bad), 0, not bad, f"{what}: {told}" if what else told)


def _visible(link: Link, files: AssetFiles) -> list[trimesh.Trimesh]:
    """One mesh a visual shape of the link (of its collision shapes if it has no visual one), each
    in the link's frame."""
    return [m for s in link.visuals or link.collisions if (m := _shape(s, files)) is not None]


def _shape(shape: Geometry, files: AssetFiles) -> trimesh.Trimesh | None:
    if shape.mesh is not None:
        pieces = [shape.mesh]
    elif shape.kind != "mesh":
        pieces = [primitive(shape)]
    else:
        try:
            pieces = files.meshes(files.find(shape.filename))
        except (ValueError, FileNotFoundError):
            return None
    matrix = shape.origin @ np.diag([*(shape.size if shape.kind == "mesh" else np.ones(3)), 1.0])
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    bare = [
        trimesh.Trimesh(
            transform_points(p.vertices, matrix),
            p.faces[:, ::-1] if mirrored else p.faces,
            process=False,
        )
        for p in pieces
    ]
    return bare[0] if len(bare) == 1 else trimesh.util.concatenate(bare)


def collision_check(robot: Robot, rigid: dict[str, int], moved: set[str]) -> dict:
    """Every moving rigid body has something to collide with."""
    solid = {rigid[n] for n, link in robot.links.items() if link.collisions}
    seen = {rigid[n]: n for n, link in robot.links.items() if link.visuals and n in moved}
    bare = [f"link '{n}'" for body, n in seen.items() if body not in solid]
    return _counted(bare, "no collision shape")


def gaps(obj: ArticulatedObject) -> dict:
    """Every part, with all that hangs on it, touches the rest of the object at rest."""
    frames = obj.forward_kinematics(obj.rest())
    moved = [transform_points(p.mesh.vertices, f) for p, f in zip(obj.parts, frames, strict=True)]
    size = float(np.ptp(np.concatenate(moved), axis=0).max())
    below = subtrees(obj.parents)
    wide: list[str] = []
    widest = 0.0
    for k in range(1, len(obj.parts)):
        mine = below[k]
        rest = [j for j in range(len(obj.parts)) if j not in mine]
        distance = _distance(obj, moved, sorted(mine), rest) / size
        widest = max(widest, distance)
        if distance > GAP:
            wide.append(
                f"part '{obj.parts[k].name}' hangs in the air, {distance:.3f} of the object's size "
                "away"
            )
    return check(widest, GAP, not wide, "; ".join(wide[:4]))


def _distance(
    obj: ArticulatedObject, moved: list[np.ndarray], first: list[int], second: list[int]
) -> float:
    """Least distance between two sets of parts, from vertices and even samples of each to the
    other's surface."""
    ends = []
    for parts in (first, second):
        meshes = [trimesh.Trimesh(moved[k], obj.parts[k].mesh.faces, process=False) for k in parts]
        ends.append(meshes[0] if len(meshes) == 1 else trimesh.util.concatenate(meshes))
    best = np.inf
    for a, b in (ends, ends[::-1]):
        points = np.concatenate([a.vertices[:: max(1, len(a.vertices) // SAMPLES)], _spread(a)])
        lo, hi = b.bounds
        outside = np.linalg.norm(np.maximum(np.maximum(lo - points, points - hi), 0), axis=1)
        near = points[outside < best]
        if len(near):
            squared = igl.point_mesh_squared_distance(
                near, b.vertices, np.asarray(b.faces, np.int64)
            )[0]
            best = min(best, float(np.sqrt(squared.min())))
    return best


def _spread(mesh: trimesh.Trimesh) -> np.ndarray:
    """[SAMPLES, 3] points of a surface, always the same."""
    rng = np.random.default_rng(0)
    area = np.cumsum(mesh.area_faces)
    face = np.searchsorted(area, rng.random(SAMPLES) * area[-1]).clip(0, len(area) - 1)
    weights = rng.dirichlet(np.ones(3), SAMPLES)
    return np.einsum("nij,ni->nj", mesh.triangles[face], weights)


def finite_check(root: etree._Element) -> dict:
    """No attribute of a description holds NaN or infinity; the nearest named element is told."""
    bad = []
    for element in root.iter():
        for attribute, text in element.attrib.items():
            if _TEXT.search(str(attribute)):
                continue
            words = {w.lstrip("+-").lower() for w in re.split(r"[\s,]+", str(text).strip())}
            endless = words & {"inf", "infinity"} and attribute not in _MAY_BE_ENDLESS
            if "nan" in words or endless:
                bad.append(f"{_owner(element)}: {attribute}='{str(text)[:60]}'")
    return _counted(bad)


def inertial_check(root: etree._Element, moved: set[str], rigid: dict[str, int]) -> dict:
    """Every link that moves says a mass and an inertia that a solid may have, in a URDF; MJCF may
    leave it to the shapes."""
    bad, heavy = [], set()
    massless = []
    for link in root.findall("link"):
        name = (link.get("name") or "").strip()
        if name not in moved:
            continue
        why = _inertial(link.find("inertial"))
        if not why:
            heavy.add(rigid.get(name))
        elif why in ("mass 0", "no <inertial>"):
            massless.append((name, why))
        else:
            bad.append(f"link '{name}': {why}")
    bad += [f"link '{n}': {why}" for n, why in massless if rigid.get(n) not in heavy]
    return _counted(bad)


def _inertial(element: etree._Element | None) -> str:
    if element is None:
        return "no <inertial>"
    mass, tensor = element.find("mass"), element.find("inertia")
    if mass is None or tensor is None:
        return "its <inertial> lacks mass or inertia"
    try:
        kilograms = float(mass.get("value") or "nan")
        ixx, ixy, ixz, iyy, iyz, izz = (
            float(tensor.get(n) or 0) for n in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
    except ValueError:
        return "its <inertial> holds no numbers"
    matrix = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    if not np.isfinite(matrix).all():
        return "not finite"
    return impossible(kilograms, np.linalg.eigvalsh(matrix))


def _owner(element: etree._Element) -> str:
    """The nearest element above that has a name."""
    at: etree._Element | None = element
    while at is not None:
        if at.tag in _NAMED and at.get("name"):
            return f"{at.tag} '{at.get('name')}'"
        at = at.getparent()
    return f"<{element.tag}>"
