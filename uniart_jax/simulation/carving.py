"""Cells taken off parts that run into each other: what ``clearing`` does for convex shapes, for the
cells of rough parts.

The surfaces of a generated object are rough, and its joints lie a little beside where they should,
so that parts the image shows apart run into each other on a joint's way. Such cells are taken off
whichever of the two parts loses the smaller share of itself, up to half of it; only collision
shapes change, and what is seen still crosses there. A door that only has to be opened first is left
whole; so is what would cost more, for ``refine`` (limits) and ``validate``.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np
import trimesh

from uniart_jax.export.voxel_boxes import Cells
from uniart_jax.objects.kinematics import subtrees
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.grid import dilated

MOST_LOST = 0.5  # of a part's cells, in all
# of the moving part's cells that meet another: more, and the other may be a door that should be
# open
PASSED = 0.3
FREED = 0.05  # of that, or of the part's cells: less is no meeting
# of a part's cells that meet another one which is open: more, and the two are not meant to be open
# together
CROWDED = 0.1
STATES = (
    25,
    193,
)  # of a joint's range that are tried, least and most: the farthest cell goes about half a cell a step, two where a long arm turns all round  # noqa: E501
# cells that a part's own and spare ones may lie beyond the box of its mesh, and the other's too
ROOM = 3
# Of a cell: how far from its centre, along each axis, the points of it lie that are looked at.
# Parent and child do not push each other in
# a simulator and may share a third of a cell; others must not touch.
INSETS = (0.49, 0.35)


@dataclasses.dataclass
class _Meeting:
    """Two parts on one joint's way: [n, n, n] bool, the cells of each that meet the other."""

    moving: np.ndarray
    still: np.ndarray


class _Field:
    """Parts that stand still, on the lattice.

    Attributes:
      owner, spare: [n, n, n] the part whose own, or spare, cell is there; -1 for none.
      near: [n, n, n] bool: such a cell, or one beside it.
    """

    def __init__(self, cells: Cells, parts: list[int], from_rest: np.ndarray):
        self.cells, self.back = cells, np.linalg.inv(from_rest)
        shape = cells.full.shape[1:]
        self.owner, self.spare = np.full(shape, -1, np.int16), np.full(shape, -1, np.int16)
        for b in parts:
            if np.allclose(from_rest[b], np.eye(4)):
                self.owner[cells.full[b]] = b
                self.spare[cells.spare[b]] = b
                continue
            reach = np.argwhere(cells.full[b] | cells.spare[b])
            there = cells.holding(_moved(cells.centers(reach), from_rest[b]))
            low = np.clip(there.min(0) - 1, 0, shape)
            block = np.indices(np.clip(there.max(0) + 2, 0, shape) - low).reshape(3, -1).T + low
            source = cells.holding(_moved(cells.centers(block), self.back[b]))
            inside = ((source >= 0) & (source < shape)).all(1)
            block, source = block[inside], tuple(source[inside].T)
            self.owner[tuple(block[cells.full[b][source]].T)] = b
            self.spare[tuple(block[cells.spare[b][source]].T)] = b
        filled = (self.owner >= 0) | (self.spare >= 0)
        self.near = dilated(filled)

    def beside(self, points: np.ndarray) -> np.ndarray:
        """Indices of the points [n, 3] whose cells are near a part's."""
        at = self.cells.holding(points)
        inside = ((at >= 0) & (at < self.near.shape)).all(1)
        inside = np.asarray(inside)
        inside[inside] = self.near[tuple(at[inside].T)]
        return np.flatnonzero(inside)

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """([n] owner, [n] spare owner) of the cells that hold points [n, 3] beside the parts."""
        at = tuple(np.clip(self.cells.holding(points), 0, self.near.shape[0] - 1).T)
        return self.owner[at], self.spare[at]

    def source(self, part: int, points: np.ndarray) -> tuple[np.ndarray, ...]:
        """Index of the part's cells, as they lie at rest, that points [n, 3] are in."""
        at = self.cells.holding(_moved(points, self.back[part]))
        return tuple(np.clip(at, 0, self.near.shape[0] - 1).T)


def carve(obj: ArticulatedObject, cells: Cells) -> tuple[Cells, tuple[str, ...]]:
    """The cells without those that joints run into, and without spare cells that are in any joint's
    way.

    Every joint is moved over its range, the others at rest, as shown, and with one of them open.

    Args:
      obj: any object. cells: of it (``as_cells``).

    Returns:
      The cells, and a line for each pair of parts that lost some.
    """
    given = cells
    cells = dataclasses.replace(cells, full=cells.full.copy(), spare=cells.spare.copy())
    first = cells.full.sum((1, 2, 3))
    lost: dict[tuple[int, int], int] = {}
    below = [sorted(group) for group in subtrees(obj.parents)]
    for others, swung in _surroundings(obj, below):
        for k, part in enumerate(obj.parts):
            if part.parent < 0 or part.joint.type == "fixed" or (swung and k == swung[0]):
                continue
            only = swung if swung and k not in swung else range(len(obj.parts))
            still = [i for i in only if i not in below[k]]
            if swung and not _may_meet(obj, cells, k, below[k], still, others):
                continue
            met = _meetings(obj, cells, k, below[k], still, others)
            if not swung:
                left = _barred(obj, cells, k, below, others, met)
            elif obj.parts[swung[0]].joint.type == "continuous":  # has no place to go back to
                left = set()
            else:
                left = {pair for pair, m in met.items() if _crowded(cells, pair, m)}
            for (a, b), meeting in met.items():
                if (a, b) in left:
                    continue
                sides = [(a, meeting.moving), (b, meeting.still)]
                sides = [side for side in sides if side[0] not in cells.knobs]  # hulls stay whole
                for i, own in sorted(sides, key=lambda side: side[1].sum() / first[side[0]]):
                    taken = cells.full[i] & own
                    if (cells.full[i] & ~own).sum() >= (1 - MOST_LOST) * first[i]:
                        pair = min(a, b), max(a, b)
                        lost[pair] = lost.get(pair, 0) + int(taken.sum())
                        cells.full[i][taken] = False
                        break
    lines = tuple(
        f"refine: collision shapes of '{obj.parts[a].name}' and '{obj.parts[b].name}' cut back by "
        f"{n / (first[a] + first[b]):.1%} of their volume where they run into each other"
        for (a, b), n in sorted(lost.items())
        if n
    )
    fine = {k: f.without(given.full[k] & ~cells.full[k]) for k, f in cells.fine.items()}
    return dataclasses.replace(cells, fine=fine), lines


def _surroundings(
    obj: ArticulatedObject, below: list[list[int]]
) -> Iterator[tuple[np.ndarray, list[int]]]:
    """(state [K] of the other joints, the parts that are not where they are at rest; empty if that
    may be all of them)."""
    rest, opened = obj.rest(), obj.open()
    yield rest, []
    if rest.any():
        yield np.zeros(len(rest)), []
    for j, part in enumerate(obj.parts):
        if part.joint.type != "fixed" and part.parent >= 0:
            state = rest.copy()
            state[j] = opened[j]
            yield state, below[j]


def _may_meet(
    obj: ArticulatedObject,
    cells: Cells,
    k: int,
    below: list[int],
    still: list[int],
    others: np.ndarray,
) -> bool:
    """Whether the boxes around what joint k moves, over its range, and around the parts that stand
    still overlap."""
    if not still:
        return False
    poses = obj.forward_kinematics(others)
    corners = [
        _moved(trimesh.bounds.corners(part.mesh.bounds), pose)
        for part, pose in zip(obj.parts, poses, strict=True)
    ]
    stands = np.concatenate([corners[i] for i in still])
    moving = np.concatenate([corners[i] for i in below])
    way = np.concatenate([_moved(moving, m) for m in _motions(obj, cells, k, below, others)])
    room = ROOM * cells.side
    return bool(((way.min(0) - room <= stands.max(0)) & (way.max(0) + room >= stands.min(0))).all())


def _crowded(cells: Cells, pair: tuple[int, int], met: _Meeting) -> bool:
    counts = np.array([met.moving.sum(), met.still.sum()])
    return bool((counts > CROWDED * cells.full[list(pair)].sum((1, 2, 3))).any())


def _barred(
    obj: ArticulatedObject,
    cells: Cells,
    k: int,
    below: list[list[int]],
    others: np.ndarray,
    met: dict[tuple[int, int], _Meeting],
) -> set[tuple[int, int]]:
    """Pairs that meet because a part is closed that can be opened first: a rack and the door before
    it."""
    found = set()
    bare = dataclasses.replace(cells, spare=np.zeros_like(cells.spare))
    for (a, b), meeting in met.items():
        count = int(meeting.moving.sum())
        if count <= PASSED * cells.full[a].sum():
            continue
        door = b
        while door >= 0 and obj.parts[door].joint.type == "fixed":
            door = obj.parts[door].parent
        if door < 0 or k in below[door]:
            continue
        state = others.copy()
        state[door] = obj.open()[door]
        after = _meetings(obj, bare, k, below[k], [b], state).get((a, b))
        way = _meetings(obj, bare, door, below[door], [a], others).values()
        free = not any(
            share.sum() > FREED * cells.full[part].sum()
            for m in way
            for part, share in ((a, m.still), (b, m.moving))
        )
        if free and (after is None or after.moving.sum() < FREED * count):
            found.add((a, b))
    return found


def _meetings(
    obj: ArticulatedObject,
    cells: Cells,
    k: int,
    below: list[int],
    still: list[int],
    others: np.ndarray,
) -> dict[tuple[int, int], _Meeting]:
    """{(moving part, still part): cells that meet} over joint k's range. Spare cells that meet
    anything are taken out of ``cells`` at once."""
    from_rest = obj.forward_kinematics(others) @ np.linalg.inv(cells.rest)
    field = _Field(cells, still, from_rest)
    corners = np.array(list(itertools.product((-1, 1), repeat=3)))
    offsets = np.concatenate([corners * inset for inset in INSETS]) * cells.side
    inner = np.repeat([False, True], len(corners))
    parents = np.array(obj.parents)
    met: dict[tuple[int, int], _Meeting] = {}
    moving = {}
    for a in below:
        own = np.argwhere(cells.full[a] | cells.spare[a])
        moving[a] = own, cells.full[a][tuple(own.T)], cells.centers(own)
    for motion in _motions(obj, cells, k, below, others):
        for a, (own, is_full, centers) in moving.items():
            matrix = motion @ from_rest[a]
            center = _moved(centers, matrix)
            rows = field.beside(center)
            points = (center[rows, None] + offsets @ matrix[:3, :3].T).reshape(-1, 3)
            near, rows = len(rows), np.repeat(rows, len(offsets))
            b, spare = field.at(points)
            hit = (b >= 0) & (np.tile(inner, near) | ((b != parents[a]) & (parents[b] != a)))
            # spare cells of the moving part give way to everything, those of the still parts to its
            # own
            away = own[rows[~is_full[rows] & (hit | (spare >= 0))]]
            cells.spare[a][tuple(away.T)] = False
            for part, mask in _split(spare, is_full[rows] & (spare >= 0)):
                cells.spare[part][field.source(part, points[mask])] = False
            for part, mask in _split(b, is_full[rows] & hit):
                empty = np.zeros((2, *cells.full.shape[1:]), bool)
                meeting = met.setdefault((a, part), _Meeting(*empty))
                meeting.moving[tuple(own[rows[mask]].T)] = True
                meeting.still[field.source(part, points[mask])] = True
    for (a, b), meeting in met.items():
        meeting.moving &= cells.full[a]
        meeting.still &= cells.full[b]
    return met


def _split(labels: np.ndarray, mask: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    for label in np.unique(labels[mask]):
        yield int(label), mask & (labels == label)


def _motions(
    obj: ArticulatedObject, cells: Cells, k: int, below: list[int], others: np.ndarray
) -> Iterator[np.ndarray]:
    """[4, 4] that carry the sub-tree from where it is at ``others`` to states of joint k's
    range."""
    parent = obj.forward_kinematics(others)[obj.parts[k].parent]
    joint = obj.parts[k].joint
    start = np.linalg.inv(parent @ joint.motion(others[k]))
    low, high = joint.limits
    corners = np.concatenate([obj.parts[i].mesh.bounds for i in below])
    arm = np.linalg.norm(np.cross(corners - joint.origin, joint.direction), axis=1).max()
    path = (high - low) * (arm if joint.rotates else 1.0)
    count = int(np.clip(np.ceil(2 * path / cells.side) + 1, *STATES))
    for q in np.linspace(low, high, count):
        yield parent @ joint.motion(q) @ start


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]
