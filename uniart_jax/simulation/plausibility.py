"""Whether an asset is what a person would take for an object: four checks that need no engine.

Engines are content with a door that hangs in the air and with a drawer that cuts through its
cabinet where nobody simulates it. Lengths are shares of the object's longest side at rest.
"""

from __future__ import annotations

import igl
import numpy as np
import trimesh
from scipy.spatial import QhullError, cKDTree

from uniart_jax.export.part_kinds import is_round
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.simulation.measure import check
from uniart_jax.simulation.pieces import Stance, at_rest, clusters, spread

GAP = 0.02  # that a part may keep from what it hangs on, or slides in
RAIL = 0.05  # likewise of a slide on its way while it stays in its opening: nobody models rails
STAYS = 0.1  # of its surface that is then still within the hull of what it does not carry
REACH = 0.12  # that a hinge's axis may keep from the part, and from its parent; so it may gape
CRUMB = 0.003  # of the object's volume: a smaller part must look like something
SPECK = 0.015  # a smaller part is one in any case
PLATE = 0.1  # a longer part is no crumb, however thin
FLAKE = 8.0  # times as long as thick, and
FLAT = 3.0  # times as wide as thick: no knob is
FULL, EVEN = 0.3, 0.6  # of its box, that a knob, or a flat disc, fills at least
BURIED = 0.005  # how deep a place lies in another part that is inside it
INSIDE = 0.05  # of a part's surface that may be inside others, anywhere on its way
STATES = 5  # of a joint's way
SAMPLES = 800  # points of a part


def plausibility(obj: ArticulatedObject) -> dict[str, dict]:
    """{"attached", "crumb", "free", "plausible": verdict} of an object, whatever state is shown."""
    stance = at_rest(obj)
    return {
        "attached": attached(stance),
        "crumb": crumbs(stance),
        "free": free(stance),
        "plausible": plausible(stance),
    }


def attached(stance: Stance) -> dict:
    """Every moving part, with what is fixed to it, touches something that it does not carry, at
    rest and on its way (what is unscrewed may come off; what slides may keep from its opening, as
    long as it stays in it); and the axis of what turns passes within
    reach of it and of its parent.

    ``value``: the widest gap, as a share of what is allowed.
    """
    bad, worst = [], 0.0
    for k in stance.moving:
        name, joint = stance.obj.parts[k].name, stance.obj.parts[k].joint
        others = stance.mesh(stance.beside(k))
        far = _axis_reach(stance, k)
        worst = max(worst, far / REACH)
        if far > REACH:
            bad.append(f"'{name}' turns about an axis that is {far:.3f} off it or its parent")
        way = _way(stance, k)
        for share, matrix in way[:1] if joint.type == "screw" else way:
            moved = stance.mesh(stance.group(k)).apply_transform(matrix)
            gap = _gap(moved, others)
            allowed = REACH if share and joint.rotates else GAP
            if share and gap > allowed and _stays(moved, others):
                allowed = RAIL
            worst = max(worst, gap / allowed)
            if gap > allowed:
                bad.append(f"'{name}' hangs in the air {_when(share)}, {gap:.3f} away")
                break
    return check(worst, 1, not bad, _listed(bad))


def free(stance: Stance) -> dict:
    """No piece of a part floats: all hang together with the root. ``value``: groups of pieces that
    do not."""
    main, *others = clusters(stance, GAP)
    bad = []
    whole = stance.mesh(list(range(len(stance.obj.parts))))
    for one in others:
        solids = _inside(whole, one.points) - _inside(one.mesh, one.points)
        if np.median(solids) < 0.5:  # no other solid holds it
            gap = float(cKDTree(main.points).query(one.points)[0].min())
            names = ", ".join(f"'{stance.obj.parts[k].name}'" for k in one.parts[:3])
            bad.append(f"a piece of {names} floats, {gap:.3f} away")
    return check(len(bad), 0, not bad, _listed(bad))


def crumbs(stance: Stance) -> dict:
    """No part is a crumb: smaller than .3 % of the object's volume and no knob, button or bar.

    ``value``: how many are.
    """
    volumes = np.array([_volume(part.mesh) for part in stance.obj.parts])
    shares = volumes / max(float(volumes.sum()), 1e-12)
    bad = [
        f"'{part.name}' is a crumb, {share:.2%} of the object"
        for part, share in zip(stance.obj.parts[1:], shares[1:], strict=True)
        if share < CRUMB and not _looks_made(part.mesh)
    ]
    return check(len(bad), 0, not bad, _listed(bad))


def plausible(stance: Stance) -> dict:
    """A moving part stays within the opening that it sweeps: no more than 5 % of its surface gets
    into other parts on its way, unless these could be opened first.

    ``value``: the largest share.
    """
    bad, worst = [], 0.0
    opened = stance.obj.open()
    for k in stance.moving:
        part, points = stance.obj.parts[k], spread(stance.mesh(stance.group(k)), SAMPLES)
        ways = _way(stance, k)
        moved = np.concatenate([trimesh.transform_points(points, m) for _, m in ways])
        shares = _buried(stance.mesh(stance.beside(k)), moved).reshape(len(ways), -1).mean(1)
        if shares.max() > INSIDE:
            state = np.where([i in _carriers(stance, k) for i in range(len(opened))], 0.0, opened)
            poses = stance.obj.forward_kinematics(state)
            beside = [stance.mesh([i]).apply_transform(poses[i]) for i in stance.beside(k)]
            others = trimesh.util.concatenate(beside)
            again = _buried(others, moved).reshape(len(ways), -1).mean(1)
            shares = np.minimum(shares, again)
        worst = max(worst, float(shares.max()))
        if shares.max() > INSIDE:
            at = ways[int(shares.argmax())][0]
            bad.append(f"{shares.max():.0%} of '{part.name}' is inside other parts {_when(at)}")
    return check(worst, INSIDE, not bad, _listed(bad))


def _carriers(stance: Stance, k: int) -> set[int]:
    """Part k and all that it hangs on."""
    found = set()
    while k >= 0:
        found.add(k)
        k = stance.obj.parts[k].parent
    return found


def _way(stance: Stance, k: int) -> list[tuple[float, np.ndarray]]:
    """[(share of its way, [4, 4])] of part k from rest, the other joints at rest."""
    joint = stance.obj.parts[k].joint
    lo, hi = joint.limits
    ends = (0.0, 1.5 * np.pi) if joint.type == "continuous" else (0.0, hi if hi > -lo else lo)
    return [(s, joint.motion(ends[0] + s * (ends[1] - ends[0]))) for s in np.linspace(0, 1, STATES)]


def _when(share: float) -> str:
    return "at rest" if share == 0 else f"at {share:.0%} of its way"


def _listed(bad: list[str]) -> str:
    return "; ".join(bad[:4]) + (f"; and {len(bad) - 4} more" if len(bad) > 4 else "")


def _gap(mesh: trimesh.Trimesh, others: trimesh.Trimesh) -> float:
    """Least distance of two surfaces; where points of theirs are within ``GAP``, an upper bound."""
    a, b = spread(mesh, SAMPLES), spread(others, 4 * SAMPLES)
    near = float(cKDTree(b).query(a)[0].min())
    if near <= GAP:
        return near
    return min(near, float(_distances(others, a).min()), float(_distances(mesh, b).min()))


def _stays(mesh: trimesh.Trimesh, others: trimesh.Trimesh) -> bool:
    """Whether enough of a part is within the convex hull of others."""
    try:
        hull = others.convex_hull
    except QhullError:  # flat
        return False
    return float((_inside(hull, spread(mesh, SAMPLES)) > 0.5).mean()) >= STAYS


def _distances(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """[n] of points from a surface."""
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    squared = igl.point_mesh_squared_distance(np.ascontiguousarray(points), vertices, faces)[0]
    return np.sqrt(np.asarray(squared).ravel())


def _inside(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """[n] winding numbers: how many solids hold a point."""
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    return np.asarray(
        igl.fast_winding_number(vertices, faces, np.ascontiguousarray(points))
    ).ravel()


def _buried(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """[n] whether points lie inside a solid, deeper than ``BURIED``."""
    lo, hi = mesh.bounds
    found = ((points > lo + BURIED) & (points < hi - BURIED)).all(1)
    found[found] = _inside(mesh, points[found]) > 0.5 if found.any() else False
    found[found] = _distances(mesh, points[found]) > BURIED if found.any() else False
    return found


def _axis_reach(stance: Stance, k: int) -> float:
    """How far the axis of part k is off the part or its parent, where it is farther; 0 for what
    only slides. A part that is round about its axis, as a lid, counts as full, and so does what it
    turns on."""
    part = stance.obj.parts[k]
    joint = part.joint
    if not joint.rotates:
        return 0.0
    own = stance.mesh(stance.group(k))
    along = (np.asarray(own.vertices) - joint.origin) @ joint.direction
    line = joint.origin + np.linspace(along.min(), along.max(), 41)[:, None] * joint.direction
    full = is_round(np.asarray(part.mesh.vertices), joint)
    parent = stance.mesh(stance.group(stance.leaders[part.parent]))
    return max(_off(line, own, full), _off(line, parent, full))


def _off(line: np.ndarray, mesh: trimesh.Trimesh, full: bool) -> float:
    """Least distance of points from a surface, or from its convex hull, inside which it is 0."""
    if not full:
        return float(_distances(mesh, line).min())
    try:
        hull = mesh.convex_hull
    except QhullError:  # flat
        return float(_distances(mesh, line).min())
    distances = np.where(_inside(hull, line) > 0.5, 0.0, _distances(hull, line))
    return float(distances.min())


def _volume(mesh: trimesh.Trimesh) -> float:
    """Of the solid; where it is open, of its hull."""
    if mesh.is_watertight:
        return abs(float(mesh.volume))
    try:
        return float(mesh.convex_hull.volume)
    except Exception:  # flat: qhull has an error of its own
        return 0.0


def _looks_made(mesh: trimesh.Trimesh) -> bool:
    """Whether a small part has the shape of a knob, a button, a bar, a disc or a plate."""
    try:
        extents = np.sort(trimesh.bounds.oriented_bounds(mesh)[1])
    except Exception:  # flat: qhull has an error of its own
        extents = np.sort(mesh.extents)
    thin, wide, long = (float(e) for e in extents)
    if long >= PLATE:
        return True
    if long < SPECK:
        return False
    flat = long > FLAKE * thin and wide > FLAT * thin
    return _volume(mesh) >= (EVEN if flat else FULL) * thin * wide * long
