"""Whether the parts of an object run into one another at a joint state: a coarse test, for drawing
states that could be.

Real meshes are open and overlap where they are joined, so neither volumes nor crossings mean much
by themselves. What is asked is whether parts overlap
*more than at rest*: of every part, points are spread through its convex hull (that of a sheet is
given a thickness); of each pair, the share of the one's points in the other's hull is compared with
the share at rest. What is small, as a button that is pressed in, does not count. A drawer in its
cabinet is in the cabinet's hull from the start; a drawer that is pulled through a closed door is
not in the door's.
"""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from uniart_jax.objects.directions import directions
from uniart_jax.objects.object import ArticulatedObject

POINTS = 256  # a part
SHEET = 0.004  # of the object's longest side: the thickness that a thinner hull gets
GROSS = 0.06  # of a part's points, more than at rest, in another part
SMALL = 2e-4  # of the cube of the object's longest side: an overlap that is not gross


class Clearance:
    """The hulls and points of an object's parts, made once for many states."""

    def __init__(self, obj: ArticulatedObject):
        self.obj = obj
        lo, hi = obj.bounds
        side = float((hi - lo).max())
        hulls = [_hull(_seen(part.mesh), SHEET * side) for part in obj.parts]
        self.planes, self.points, volumes = zip(*hulls, strict=True)
        self.volumes = np.array(volumes) / side**3
        self.at_rest = self._shares(obj.rest())

    def collision(self, q: np.ndarray) -> tuple[str, str] | None:
        """Two parts that overlap grossly at state ``q`` though not at rest; None if there are
        none."""
        more = self._shares(q) - self.at_rest
        more[more * self.volumes[:, None] < SMALL] = 0
        a, b = np.unravel_index(int(np.argmax(more)), more.shape)
        if more[a, b] <= GROSS:
            return None
        return self.obj.parts[a].name, self.obj.parts[b].name

    def _shares(self, q: np.ndarray) -> np.ndarray:
        """[K, K] share of part a's points in part b's hull."""
        moved = self.obj.forward_kinematics(q)
        back = np.linalg.inv(moved)
        count = len(self.points)
        shares = np.zeros((count, count))
        for a in range(count):
            for b in range(count):
                if a == b:
                    continue
                matrix = back[b] @ moved[a]
                points = self.points[a] @ matrix[:3, :3].T + matrix[:3, 3]
                planes = self.planes[b]
                shares[a, b] = (points @ planes[:, :3].T + planes[:, 3] <= 0).all(1).mean()
        return shares


def _seen(mesh: trimesh.Trimesh) -> np.ndarray:
    """[n, 3] vertices that a face touches; others may lie anywhere."""
    return np.asarray(mesh.vertices)[np.unique(mesh.faces)]


def _hull(vertices: np.ndarray, thickness: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Planes [F, 4] (inside: <= 0) of the vertices' hull, [POINTS, 3] points spread evenly in it,
    and its volume."""
    if len(vertices) > 5000:  # support points in many directions make the hull but for crumbs
        vertices = vertices[np.unique(np.argmax(vertices @ directions(1000).T, axis=0))]
    centred = vertices - vertices.mean(0)
    _, axes = np.linalg.eigh(centred.T @ centred)  # of a single point: any axes
    flat = axes[:, np.ptp(centred @ axes, axis=0) < thickness]
    for normal in flat.T:
        vertices = np.concatenate(
            [vertices + normal * thickness / 2, vertices - normal * thickness / 2]
        )
    lo, hi = vertices.min(0), vertices.max(0)
    try:
        hull = ConvexHull(vertices)
        planes, volume = hull.equations, hull.volume
    except QhullError:  # as good as flat after all
        planes = np.concatenate([np.c_[np.eye(3), -hi], np.c_[-np.eye(3), lo]])
        volume = float(np.prod(hi - lo))
    rng = np.random.default_rng(0)
    kept = np.zeros((0, 3))
    for _ in range(20):
        drawn = rng.uniform(lo, hi, (4 * POINTS, 3))
        inside = (drawn @ planes[:, :3].T + planes[:, 3] <= 0).all(1)
        kept = np.concatenate([kept, drawn[inside]])
        if len(kept) >= POINTS:
            break
    return planes, (kept if len(kept) else vertices)[:POINTS], volume
