"""An object as SINGAPO's ``object.json`` holds it, moved as SINGAPO's and CAGE's code moves it,
mistakes included.

What it gets wrong (3dlg-hcvc/singapo, ``objects/motions.py`` and ``objects/dict_utils.py``):

* a part is moved by its own joint and by its parent's, never by those farther up: grandchildren are
  left behind;
* a hinge turns by 90 degrees whatever its limit says (the overlap of siblings alone uses the
  limit), a continuous joint by 360;
* a screw does not move;
* a change of scale reaches boxes and axes but not the length that a drawer travels, nor the
  directions.

Their y-up frame differs from ours by quarter turns, which no figure sees.
"""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np

from uniart_jax.objects.kinematics import rotation
from uniart_jax.objects.object import ArticulatedObject


@dataclasses.dataclass(frozen=True)
class BoxTree:
    """Boxes and joints at rest.

    Attributes:
      boxes: [K, 6] centre and size of every part's own box.
      parents: [K] index of the parent, -1 for the root.
      types: [K] 'fixed', 'revolute', 'continuous', 'prismatic' or 'screw'.
      origins, directions: [K, 3] the axes.
      reach: [K] the open end, signed: radians (revolute) or length (prismatic); their ``range[1]``.
    """

    boxes: np.ndarray
    parents: tuple[int, ...]
    types: tuple[str, ...]
    origins: np.ndarray
    directions: np.ndarray
    reach: np.ndarray

    @classmethod
    def of(cls, obj: ArticulatedObject) -> BoxTree:
        """``obj`` stands at its rest state (``evaluation.metric.at_rest``)."""
        return cls(
            obj.boxes,
            tuple(obj.parents),
            tuple("fixed" if p.parent < 0 else p.joint.type for p in obj.parts),
            np.stack([j.origin for j in obj.joints]),
            np.stack([j.direction for j in obj.joints]),
            obj.open(1.0) - obj.rest(),
        )

    @property
    def bounds(self) -> np.ndarray:
        """[2, 3] corners of the box around all boxes."""
        half = self.boxes[:, 3:] / 2
        return np.stack([(self.boxes[:, :3] - half).min(0), (self.boxes[:, :3] + half).max(0)])

    @property
    def size(self) -> np.ndarray:
        """[3] of the box around all boxes."""
        return self.bounds[1] - self.bounds[0]

    def centered(self) -> BoxTree:
        """Moved so that the box around all boxes is centred at 0."""
        shift = np.concatenate([-self.bounds.mean(0), np.zeros(3)])
        return dataclasses.replace(self, boxes=self.boxes + shift, origins=self.origins + shift[:3])

    def scaled(self, factors: np.ndarray) -> BoxTree:
        """Boxes and axes scaled by [3] about 0; travels are left as they are."""
        boxes = self.boxes * np.tile(factors, 2)
        return dataclasses.replace(self, boxes=boxes, origins=self.origins * factors)

    def motions(self, state: float, *, quarter_turns: bool) -> np.ndarray:
        """[K, 4, 4] motion of every part's own joint at ``state`` in [0, 1] of the way from rest to
        open."""
        matrices = np.tile(np.eye(4), (len(self.parents), 1, 1))
        for k, kind in enumerate(self.types):
            if kind == "prismatic":
                matrices[k, :3, 3] = self.directions[k] * (self.reach[k] * state)
            elif kind in ("revolute", "continuous"):
                full = 2 * np.pi if kind == "continuous" else self.reach[k]
                if kind == "revolute" and quarter_turns:
                    full = np.sign(full) * np.pi / 2
                turn = rotation(self.directions[k], full * state)
                matrices[k, :3, :3] = turn
                matrices[k, :3, 3] = self.origins[k] - turn @ self.origins[k]
        return matrices

    def poses(self, states: np.ndarray, *, quarter_turns: bool) -> np.ndarray:
        """[S, K, 4, 4] where every part stands at ``states`` [S]: its own motion, then its
        parent's."""
        own = np.stack([self.motions(s, quarter_turns=quarter_turns) for s in states])
        parents = np.array(self.parents)
        carried = own.copy()
        below = parents >= 0
        carried[:, below] = own[:, parents[below]] @ own[:, below]
        return carried

    @property
    def moves(self) -> np.ndarray:
        """[K] whether a part, or its parent, has a joint that their code moves."""
        own = np.array([kind in ("prismatic", "revolute", "continuous") for kind in self.types])
        parents = np.array(self.parents)
        return own | ((parents >= 0) & own[parents])


def siblings(parents: tuple[int, ...] | list[int]) -> np.ndarray:
    """[P, 2] all pairs of parts that share a parent."""
    pairs = [
        (i, j)
        for i in range(len(parents))
        for j in range(i + 1, len(parents))
        if parents[i] >= 0 and parents[i] == parents[j]
    ]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def same_hash(a: tuple[int, ...] | list[int], b: tuple[int, ...] | list[int]) -> bool:
    """Whether SINGAPO's Weisfeiler-Lehman hash is equal for two trees, given by their parents.

    They hash the graph of edges child -> parent without labels by networkx below 3.5, the one of
    the time of their tables: labels begin with a node's degree and take in the *successor's* three
    times. The hashes are equal where the multisets of the degrees of a node and its three next
    ancestors are; this compares those, as networkx 3.5 hashes directed graphs in another way.
    """
    return _ancestry(a) == _ancestry(b)


def _ancestry(parents: tuple[int, ...] | list[int]) -> Counter:
    degree = [sum(p == k for p in parents) + (parent >= 0) for k, parent in enumerate(parents)]

    def line(k: int, length: int) -> tuple[int, ...]:
        above = line(parents[k], length - 1) if length and parents[k] >= 0 else ()
        return (degree[k], *above)

    return Counter(line(k, 3) for k in range(len(parents)))


def canonical_tree(parents: tuple[int, ...] | list[int], labels: list[str]) -> tuple:
    """A nested tuple that is equal for two labelled rooted trees if and only if they are isomorphic
    (Aho, Hopcroft, Ullman)."""

    def node(k: int) -> tuple:
        below = sorted(node(c) for c, parent in enumerate(parents) if parent == k)
        return (labels[k], tuple(below))

    return node(list(parents).index(-1))
