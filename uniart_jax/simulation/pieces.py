"""Surfaces as points: what checks of places and gaps look at.

Points are drawn evenly over each part, always the same, as many as its share of the object's area;
all lengths are shares of the object's longest side at rest.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from uniart_jax.export.frames import moves, rigid_groups
from uniart_jax.objects.kinematics import subtrees
from uniart_jax.objects.object import ArticulatedObject, moved_mesh

POINTS = 40_000  # of the whole object
LEAST, MOST = 60, 20_000  # of one piece, or part
CELL = 0.005  # pieces that pass through one cell of this size touch
MANY = 5_000  # pieces; of more, each part is looked at as one


@dataclasses.dataclass(frozen=True)
class Stance:
    """An object at rest, its longest side 1.

    Attributes:
      obj: joints count from there.
      leaders: [K] the part that leads each part's rigid group.
      below: [K] each part and all that hang on it.
    """

    obj: ArticulatedObject
    leaders: list[int]
    below: list[set[int]]

    @property
    def moving(self) -> list[int]:
        """Parts with a joint that moves them."""
        return [k for k, part in enumerate(self.obj.parts) if moves(part)]

    def group(self, k: int) -> list[int]:
        """Part k and what is fixed to it."""
        return [i for i, leader in enumerate(self.leaders) if leader == k]

    def beside(self, k: int) -> list[int]:
        """The parts that do not hang on part k."""
        return [i for i in range(len(self.obj.parts)) if i not in self.below[k]]

    def mesh(self, parts: list[int]) -> trimesh.Trimesh:
        """Bare surfaces of some parts at rest."""
        meshes = [self.obj.parts[i].mesh for i in parts]
        bare = [trimesh.Trimesh(m.vertices, m.faces, process=False) for m in meshes]
        return bare[0] if len(bare) == 1 else trimesh.util.concatenate(bare)


def at_rest(obj: ArticulatedObject) -> Stance:
    """The object's rest state as its shown state, normalised; joints as short as they are kept."""
    rest = obj.shown_at(obj.rest())
    lo, hi = rest.bounds
    matrix = np.diag([*[1 / max(float((hi - lo).max()), 1e-12)] * 3, 1.0])
    parts = [
        dataclasses.replace(
            p.with_joints(lambda joint: joint.transformed(matrix)), mesh=moved_mesh(p.mesh, matrix)
        )
        for p in rest.parts
    ]
    small = dataclasses.replace(rest, parts=tuple(parts))
    return Stance(small, rigid_groups(small), subtrees(small.parents))


def spread(mesh: trimesh.Trimesh, count: int) -> np.ndarray:
    """[n, 3] ``count`` even points of a surface and some of its vertices, always the same."""
    rng = np.random.default_rng(0)
    area = np.cumsum(mesh.area_faces)
    some = mesh.vertices[:: max(1, len(mesh.vertices) // LEAST)]
    if not area[-1] > 0:
        return np.asarray(some)
    face = np.searchsorted(area, rng.random(count) * area[-1]).clip(0, len(area) - 1)
    weights = rng.dirichlet(np.ones(3), count)
    return np.concatenate([np.einsum("nij,ni->nj", mesh.triangles[face], weights), some])


def pieces_of(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """What of a surface hangs together by shared places (to 1e-6)."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    _, place = np.unique(np.round(vertices / 1e-6).astype(np.int64), axis=0, return_inverse=True)
    place = np.asarray(place).reshape(-1)
    corners = place[faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=[place.max() + 1] * 2)
    _, label = connected_components(graph, directed=False)
    of_face = label[corners[:, 0]]
    order = np.argsort(of_face, kind="stable")
    groups = np.split(faces[order], np.flatnonzero(np.diff(of_face[order])) + 1)
    pieces = []
    for group in groups:
        used, own = np.unique(group, return_inverse=True)
        own = np.asarray(own).reshape(-1, 3)
        pieces.append(trimesh.Trimesh(vertices[used], own, process=False))
    return pieces


@dataclasses.dataclass(frozen=True)
class Cluster:
    """Pieces that hang together.

    Attributes:
      parts: those that the pieces belong to.
      points: [n, 3] of their surfaces.
      mesh: all of them.
    """

    parts: tuple[int, ...]
    points: np.ndarray
    mesh: trimesh.Trimesh


def clusters(stance: Stance, gap: float) -> list[Cluster]:
    """Pieces of all parts at rest in groups with no more than about ``gap`` between neighbours, the
    one with the root's largest piece first."""
    every = [pieces_of(part.mesh) for part in stance.obj.parts]
    if sum(len(found) for found in every) > MANY:
        every = [[stance.mesh([k])] for k in range(len(every))]
    pieces = [piece for found in every for piece in found]
    owner = [k for k, found in enumerate(every) for _ in found]
    areas = np.array([float(p.area) for p in pieces])
    counts = (POINTS * areas / max(float(areas.sum()), 1e-12)).astype(int).clip(LEAST, MOST)
    samples = [spread(p, int(n)) for p, n in zip(pieces, counts, strict=True)]
    number = np.repeat(np.arange(len(pieces)), [len(s) for s in samples])
    spacing = float(np.sqrt(areas / counts).max())
    points = np.concatenate(samples)
    _, first, cell = np.unique(
        np.floor(points / CELL).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    near = cKDTree(points[first]).query_pairs(gap + spacing, output_type="ndarray")
    links = np.concatenate(
        [np.stack([number, len(pieces) + np.asarray(cell).reshape(-1)], 1), len(pieces) + near]
    )  # pieces with their cells, cells with their neighbours
    graph = coo_matrix((np.ones(len(links)), links.T), shape=[len(pieces) + len(first)] * 2)
    label = connected_components(graph, directed=False)[1][: len(pieces)]
    root = max((i for i, k in enumerate(owner) if k == 0), key=lambda i: areas[i])
    labels = [label[root], *sorted(set(label) - {label[root]})]
    found = []
    for one in labels:
        own = np.flatnonzero(label == one)
        parts = tuple(dict.fromkeys(owner[i] for i in own))
        mesh = trimesh.util.concatenate([pieces[i] for i in own])
        found.append(Cluster(parts, np.concatenate([samples[i] for i in own]), mesh))
    return found
