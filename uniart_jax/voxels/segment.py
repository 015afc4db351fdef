"""Which part does every sub-cell belong to? Clustering of the per-sub-cell ``own_box``; the number
of parts is not given.

True codes hold a handful of distinct boxes: these are the parts. Boxes out of a network need
clustering. They are wrong together, cube of voxels by cube (a flow's token), and blurred along
borders; but a voxel also lies somewhere, and a part that does not reach there is not its part.

1. Each voxel votes with the median of its sub-cells' boxes (lower and upper corner). A voxel whose
   sub-cells disagree by more than ``MIXED`` lies on a border between parts and does not vote.
2. A box explains a voter if it is near the voter's vote and holds the voter's place. Of many
   proposed boxes (medians of votes around some voters) the one that explains most of what is still
   unexplained is taken, again and again, until the next would explain fewer than ``FEWEST`` voters.
   How near is near follows the votes: the first of ``NEAR`` that leaves few unexplained.
3. Rounds of refinement: every box moves to its voters, half to the median of their votes and half
   to the extent of their places; boxes that the others make superfluous, or whose voters do not
   fill them, are dropped.
4. A knob lives in border voxels only. Solid sub-cells whose boxes are far from all parts found so
   far fall into connected pieces; a piece that agrees with the box it votes for is a part, and its
   extent is its box.
5. Every sub-cell joins the part whose box is nearest to its own and holds its place; one that joins
   a small part, the small part that it lies in or next to. Crumbs, apart from the rest of their
   part, join what is around them.

The constants were chosen on 28 procedural objects of validation seeds, through the UniArt VAE and
on a flow's output. What they give on others: the rows "vae" and "latent_flow" of ``uniart evaluate
procedural`` (docs/training_history.md).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.ndimage
from scipy.spatial import cKDTree

from uniart_jax.voxels.grid import VoxelGrid, connected, subcell_centers, subcell_indices
from uniart_jax.voxels.joint_code import SAME_BOX, box_corners

MIXED = 0.15  # a voxel whose sub-cell votes differ by more than this does not vote
MOST_POINTS = 2000  # voters that are looked at; more are thinned
SEEDS = 200  # voters around which boxes are proposed
RADII = (0.06, 0.12)  # of the neighbourhoods whose medians are proposed
NEAR = (0.04, 0.12, 0.2)  # a voter is explained below this cost, the smallest that leaves few ...
BLUR = 0.05  # ... and not at all above NEAR + BLUR
ENOUGH = 0.95  # share of voters that are explained somewhat
SLACK = 0.02  # a place this far outside of a box is still inside
OUTSIDE = 8  # cost of a sub-cell's place beyond that, against 1 of its vote
FEWEST = 60  # unexplained voters that a box must explain; what is smaller is left to the pieces
LEAST = 20  # voters of a box that is kept
ROUNDS = 3
FILL = 0.2  # between a box and the extent of its voters
FAR = 0.2  # a sub-cell whose box differs from all parts by more than this may be of a small part
PIECE_AGREEMENT = 0.15  # between a piece and the box it votes for
PIECE = 16  # sub-cells of the smallest piece
PIECE_APART = 0.05  # a piece's box differs from all parts' by at least this
CRUMB = 64  # sub-cells; what hangs together with fewer of its part, or ...
CRUMB_SHARE = 0.02  # ... with less than this share of the part's largest piece, is a crumb
MOST = 64  # parts; more distinct boxes than this are noise
MANY = 4 * MOST


@dataclasses.dataclass(frozen=True)
class Segmentation:
    """Parts of a grid, largest first.

    Attributes:
      boxes: [K, 6] centre and size: what sub-cells say on true codes; out of a network what voters
        say and where they lie, half each, or a small piece's extent.
      owner: [V, r^3] int16 part of every sub-cell.
      pure: [V] bool, all sub-cells of the voxel belong to one part.
    """

    boxes: np.ndarray
    owner: np.ndarray
    pure: np.ndarray


def segment(grid: VoxelGrid) -> Segmentation:
    """Cluster sub-cells into parts by the box each says it belongs to. Deterministic.

    Raises:
      ValueError: the grid is empty.
    """
    if len(grid.coords) == 0:
        raise ValueError("assemble: the voxel grid is empty; nothing was generated")
    own_box = np.clip(np.nan_to_num(np.asarray(grid.own_box, np.float32)), -2, 2)
    votes = box_corners(own_box)
    flat = votes.reshape(-1, 6)
    centers = _exact_centers(flat)
    if centers is None:
        large = _large_parts(grid, votes)
        small = _pieces(grid, votes, large)
        centers = np.stack(large + small)
        places = subcell_centers(grid.coords, grid.resolution, grid.subdivisions).reshape(-1, 3)
        owner = nearest(flat, centers, places.astype(np.float32))
        owner = _join_pieces(places, flat, owner, centers, len(large))
        owner = _absorb_crumbs(grid, owner)
        used = np.bincount(owner, minlength=len(centers)) > 0
        centers, owner = centers[used], (np.cumsum(used) - 1)[owner]
    else:
        owner = nearest(flat, centers)
    order = np.argsort(-np.bincount(owner, minlength=len(centers)), kind="stable")
    rank = np.argsort(order)
    centers, owner = centers[order], rank[owner].reshape(votes.shape[:2]).astype(np.int16)
    low, high = centers[:, :3], centers[:, 3:]
    boxes = np.concatenate([(low + high) / 2, high - low], -1)
    return Segmentation(boxes, owner, (owner == owner[:, :1]).all(1))


def nearest(votes: np.ndarray, centers: np.ndarray, places: np.ndarray | None = None) -> np.ndarray:
    """[n] index of the nearest center (L-infinity on box corners) for votes [n, 6].

    With ``places`` [n, 3] a box also costs ``OUTSIDE`` times what the place lies outside of it.
    """
    best = np.zeros(len(votes), np.int64)
    smallest = np.full(len(votes), np.inf, np.float32)
    columns = np.ascontiguousarray(votes.T)  # NumPy takes longer for rows of six
    for k, center in enumerate(centers.astype(np.float32)):
        distance = np.abs(columns - center[:, None]).max(0)
        if places is not None:
            distance += OUTSIDE * np.maximum(outside(places, center) - SLACK, 0)
        closer = distance < smallest
        best[closer] = k
        smallest[closer] = distance[closer]
    return best


def outside(places: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """[...] how far places [..., 3] lie outside of boxes, corners [6] or [..., 6] (L-infinity;
    negative inside)."""
    return np.maximum(boxes[..., :3] - places, places - boxes[..., 3:]).max(-1)


def _exact_centers(flat: np.ndarray) -> np.ndarray | None:
    """Distinct boxes if there are few, as on true codes; None on votes with noise."""
    keys = np.round(flat / 1e-4).astype(np.int64)
    few = keys[:: max(len(keys) // (10 * MANY), 1)]
    if len(np.unique(few, axis=0)) > MANY:  # to sort all takes a second
        return None
    _, first = np.unique(keys, axis=0, return_index=True)
    if len(first) > MANY:
        return None
    distinct = flat[np.sort(first)]
    kept: list[np.ndarray] = []
    for box in distinct:
        if all(np.abs(box - other).max() >= SAME_BOX / 2 for other in kept):
            kept.append(box)
    return np.stack(kept).astype(np.float64) if len(kept) <= MOST else None


@dataclasses.dataclass(frozen=True)
class _Voters:
    """Voxels that vote on what the parts are.

    Attributes:
      votes: [n, 6] corners of the box that each says it belongs to. places: [n, 3] their centres.
      step: voxels that each stands for. half: half a voxel's side.
    """

    votes: np.ndarray
    places: np.ndarray
    step: int
    half: float

    def unexplained(self, boxes: np.ndarray, near: float) -> np.ndarray:
        """[K, n] in [0, 1]: 0 where a box is the voter's, to within ``near``, 1 where it is
        another's."""
        cost = [
            2 * np.abs(self.votes - box).mean(1)
            + 2 * np.maximum(outside(self.places, box) - SLACK, 0)
            for box in boxes
        ]
        return np.clip((np.stack(cost) - near) / BLUR, 0, 1)

    def moved(self, boxes: np.ndarray, unexplained: np.ndarray) -> np.ndarray:
        """[<= K, 6] boxes between the median of their voters' votes and the extent of their places;
        those of too few voters are left out."""
        found = []
        for mine in _shares(unexplained):
            if mine.sum() * self.step >= LEAST:
                vote = np.median(self.votes[mine], axis=0)
                found.append((vote + _extent(self.places[mine], self.half)) / 2)
        return np.stack(found) if found else boxes[:1]


def _large_parts(grid: VoxelGrid, votes: np.ndarray) -> list[np.ndarray]:
    """Corners [6] of the parts that fill voxels; never none. ``votes`` [V, r^3, 6]."""
    voters = _voters(grid, votes)
    fewest = FEWEST / voters.step
    proposed = _proposals(voters.votes)
    boxes = proposed[:1]
    for near in NEAR:
        boxes = proposed[_choose(voters.unexplained(proposed, near), fewest)]
        for _ in range(ROUNDS):
            boxes = voters.moved(boxes, voters.unexplained(boxes, near))
            boxes = boxes[_needed(voters.unexplained(boxes, near), fewest)]
            boxes = boxes[_filled(voters.unexplained(boxes, near), boxes, voters)]
        if (voters.unexplained(boxes, near).min(0) < 1).mean() >= ENOUGH:
            break
    return list(boxes)


def _voters(grid: VoxelGrid, votes: np.ndarray) -> _Voters:
    """Voxels whose sub-cells agree, thinned; all if none agrees."""
    points = np.median(votes, axis=1).astype(np.float64)
    agree = np.abs(votes - points[:, None].astype(votes.dtype)).max((1, 2)) <= MIXED
    if not agree.any():
        agree[:] = True
    step = -(-int(agree.sum()) // MOST_POINTS)
    places = subcell_centers(grid.coords, grid.resolution, 1)[:, 0]
    return _Voters(points[agree][::step], places[agree][::step], step, 0.5 / grid.resolution)


def _shares(unexplained: np.ndarray) -> list[np.ndarray]:
    """[n] bool masks of the voters that each row of [K, n] explains best; who is not explained at
    all is nobody's."""
    owner, explained = unexplained.argmin(0), unexplained.min(0) < 1
    return [(owner == k) & explained for k in range(len(unexplained))]


def _choose(unexplained: np.ndarray, fewest: float) -> list[int]:
    """Rows of [K, n] that explain most of what those before left, until the next would add fewer
    than ``fewest``."""
    left = np.ones(unexplained.shape[1])
    chosen: list[int] = []
    while len(chosen) < MOST:
        gain = np.maximum(left - unexplained, 0).sum(1)
        best = int(gain.argmax())
        if chosen and gain[best] < fewest:
            break
        chosen.append(best)
        left = np.minimum(left, unexplained[best])
    return chosen


def _proposals(points: np.ndarray) -> np.ndarray:
    """[K, 6] medians of the votes around evenly chosen ones, moved to the middle of their
    neighbourhoods."""
    tree = cKDTree(points)
    seeds = points[np.linspace(0, len(points) - 1, min(len(points), SEEDS)).astype(int)]
    found = []
    for radius in RADII:
        boxes = seeds
        for _ in range(3):
            near = tree.query_ball_point(boxes, radius, p=np.inf)
            boxes = np.stack(
                [
                    _median(points[rows]) if rows else box
                    for rows, box in zip(near, boxes, strict=True)
                ]
            )
        found.append(boxes)
    boxes = np.concatenate(found)
    _, first = np.unique(np.round(boxes / 0.01).astype(int), axis=0, return_index=True)
    return boxes[np.sort(first)]


def _median(rows: np.ndarray) -> np.ndarray:
    """``np.median`` over axis 0 of numbers that are finite, without its checks: rows are few."""
    low, high = (len(rows) - 1) // 2, len(rows) // 2
    middle = np.partition(rows, (low, high), axis=0)
    return (middle[low] + middle[high]) / 2


def _extent(places: np.ndarray, half: float) -> np.ndarray:
    """Corners [6] of the voxels at ``places`` [n, 3], without the outermost 2 % on each side."""
    low, high = np.quantile(places, (0.02, 0.98), axis=0)
    return np.concatenate([low - half, high + half])


def _needed(unexplained: np.ndarray, fewest: float) -> np.ndarray:
    """Rows of [K, n] that stay when those are left out, one by one, without which others explain
    all but ``fewest`` voters."""
    keep = np.arange(len(unexplained))
    while len(keep) > 1:
        now = np.vstack([unexplained[keep], np.ones(unexplained.shape[1])])
        best, second = np.partition(now, 1, axis=0)[:2]
        loss = np.bincount(now[:-1].argmin(0), second - best, minlength=len(keep))
        if loss.min() >= fewest:
            break
        keep = np.delete(keep, loss.argmin())
    return keep


def _filled(unexplained: np.ndarray, boxes: np.ndarray, voters: _Voters) -> np.ndarray:
    """Rows of boxes [K, 6] that stay when those are left out, one by one, whose voters' extent is
    not their box."""
    keep = np.arange(len(boxes))
    while len(keep) > 1:
        gaps = np.full(len(keep), np.inf)
        for k, mine in enumerate(_shares(unexplained[keep])):
            if mine.any():
                extent = _extent(voters.places[mine], voters.half)
                gaps[k] = np.abs(extent - boxes[keep[k]]).max()
        if gaps.max() < FILL:
            break
        keep = np.delete(keep, gaps.argmax())
    return keep


def _pieces(grid: VoxelGrid, votes: np.ndarray, large: list[np.ndarray]) -> list[np.ndarray]:
    """Corners [6] of small parts: connected solid sub-cells that no large part explains and that
    agree with the box they vote for."""
    side = grid.resolution * grid.subdivisions
    voxel, sub = np.nonzero(grid.sdf < 0)
    said = votes[voxel, sub]
    far = np.ones(len(said), bool)
    for center in large:
        far &= np.abs(said - center).max(1) > FAR
    voxel, sub = voxel[far], sub[far]
    cells = subcell_indices(grid.coords, grid.subdivisions)[voxel, sub]
    dense = np.zeros((side,) * 3, bool)
    dense[tuple(cells.T)] = True
    label = connected(dense)[tuple(cells.T)]
    sizes = np.bincount(label) if len(label) else np.zeros(1, int)
    members = np.split(np.argsort(label, kind="stable"), np.cumsum(sizes)[:-1])
    found: list[np.ndarray] = []
    for k in np.argsort(-sizes, kind="stable")[:MANY]:
        if sizes[k] < PIECE or len(large) + len(found) == MOST:
            break
        mine = members[k]
        low, high = cells[mine].min(0) / side - 0.5, (cells[mine].max(0) + 1) / side - 0.5
        extent = np.concatenate([low, high])
        voted = np.median(votes[voxel[mine], sub[mine]], axis=0)
        agrees = np.abs(voted - extent).max() < PIECE_AGREEMENT
        if agrees and _gap(extent, large + found) >= PIECE_APART:
            found.append(extent)
    return found


def _join_pieces(
    places: np.ndarray, flat: np.ndarray, owner: np.ndarray, centers: np.ndarray, large: int
) -> np.ndarray:
    """[V r^3] owners in which sub-cells that vote for a small part join the small part that they
    lie in or next to.

    A sub-cell inside several small parts' boxes (a knob within a ring handle) stays with its vote
    among them.
    """
    rows = np.nonzero(owner >= large)[0]
    if len(rows) == 0 or len(centers) - large < 2:
        return owner
    at = places[rows]
    votes = flat[rows]
    best = np.full(len(rows), large)
    apart, gap = np.full(len(rows), np.inf), np.full(len(rows), np.inf)
    for k in range(large, len(centers)):
        here = np.maximum(outside(at, centers[k]), 0)
        differs = np.abs(votes - centers[k]).max(1)
        better = (here < apart) | ((here == apart) & (differs < gap))
        best[better], apart[better], gap[better] = k, here[better], differs[better]
    owner = owner.copy()
    owner[rows] = best
    return owner


def _absorb_crumbs(grid: VoxelGrid, owner: np.ndarray) -> np.ndarray:
    """[V r^3] owners in which the crumbs of a part (never its largest piece) join the nearest
    sub-cell that is none."""
    cells = subcell_indices(grid.coords, grid.subdivisions).reshape(-1, 3)
    dense = np.zeros((grid.resolution * grid.subdivisions,) * 3, np.int16)
    dense[tuple(cells.T)] = owner + 1
    crumb = np.zeros(len(owner), bool)
    for k, window in enumerate(scipy.ndimage.find_objects(dense)):
        if window is None:
            continue
        labels = connected(dense[window] == k + 1)
        sizes = np.bincount(labels.ravel())
        sizes[0] = 0
        small = sizes < max(CRUMB, CRUMB_SHARE * sizes.max())
        small[sizes.argmax()] = False
        mine = np.nonzero(owner == k)[0]
        crumb[mine] = small[labels[tuple((cells[mine] - [w.start for w in window]).T)]]
    if not crumb.any():
        return owner
    _, around = cKDTree(cells[~crumb]).query(cells[crumb])
    owner = owner.copy()
    owner[crumb] = owner[~crumb][around]
    return owner


def _gap(box: np.ndarray, others: list[np.ndarray]) -> float:
    return min((float(np.abs(box - other).max()) for other in others), default=np.inf)
