"""What kind of thing a layout is likest to: "an oven-like object", told by its parts alone.

No network sees a category (docs/representation.md), so this is read off what was found: how many
parts turn and slide, where and how large they are, and the object's proportions (``features``).
``kinds.json`` weighs them: multinomial logistic regression, fitted to layouts of procedural
training objects by ``tools/fit_kinds.py``. A kind is named only where it is likely enough; all else
is "an object".
"""

from __future__ import annotations

import dataclasses
import functools
import json
from importlib import resources

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.read_layout import KNOB, OFF_AXIS

WORDS = {
    "storage_furniture": "cabinet",
    "washer": "washing machine",
    "sliding_window": "sliding window",
    "casement_window": "casement window",
    "tool_cabinet": "tool cabinet",
    "desk_lamp": "desk lamp",
    "assemblies": "",  # nothing that has a name
}  # other families are called what they are
NAMELESS = "an object"
CLIP = 3.0  # standard deviations from the mean that a feature counts at most
MOVING = slice(10, 14)  # of ``features``: how many sliders, screws, knobs and hinges there are
LEAST_EXTENT = 0.01  # object units, that sides are divided by at least


@dataclasses.dataclass(frozen=True)
class Kind:
    """The likeliest family of a layout. ``named``: whether it is likely enough to be named."""

    family: str
    probability: float
    named: bool

    def __str__(self) -> str:
        """ "an oven-like object"; "an object" where no kind is named."""
        word = WORDS.get(self.family, self.family).replace(" ", "-")
        if not (self.named and word):
            return NAMELESS
        return f"{'an' if word[0] in 'aeiou' else 'a'} {word}-like object"


@dataclasses.dataclass(frozen=True)
class KindTable:
    """What ``kinds.json`` holds: C families, and F features.

    Attributes:
      mean, std: [F] of the features. weights: [F + 1, C], the last row the bias.
      threshold: least probability of a family that is named.
    """

    families: tuple[str, ...]
    mean: np.ndarray
    std: np.ndarray
    weights: np.ndarray
    threshold: float

    def probabilities(self, rows: np.ndarray) -> np.ndarray:
        """[N, C] of features [N, F]."""
        scores = self.scaled(rows) @ self.weights
        shares = np.exp(scores - scores.max(1, keepdims=True))
        return shares / shares.sum(1, keepdims=True)

    def scaled(self, rows: np.ndarray) -> np.ndarray:
        """[N, F + 1] features as they are weighed, and a one."""
        scaled = np.clip((rows - self.mean) / self.std, -CLIP, CLIP)
        return np.concatenate([scaled, np.ones((len(rows), 1))], 1)

    def kind(self, layout: Layout) -> Kind:
        """The likeliest family of a layout; it is not named where nothing moves."""
        row = features(layout)
        shares = self.probabilities(row[None])[0]
        best = int(shares.argmax())
        sure, moves = float(shares[best]), bool(row[MOVING].any())
        return Kind(self.families[best], sure, moves and sure >= self.threshold)

    def to_json(self) -> str:
        """Text that ``from_json`` reads, a line a feature."""
        rows = [
            [_short(mean, 3), _short(std, 3), *(_short(weight, 2) for weight in weights)]
            for mean, std, weights in zip(
                [*self.mean, 0.0], [*self.std, 1.0], self.weights, strict=True
            )
        ]
        head = {"families": self.families, "threshold": self.threshold}
        lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
        return f'{json.dumps(head)[:-1]}, "rows": [\n{lines}\n]}}\n'

    @staticmethod
    def from_json(text: str) -> KindTable:
        """Read ``to_json``'s text: rows are mean, deviation and C weights of a feature, the last
        those of the bias."""
        data = json.loads(text)
        rows = np.array(data["rows"], np.float64)
        families, threshold = tuple(data["families"]), float(data["threshold"])
        return KindTable(families, rows[:-1, 0], rows[:-1, 1], rows[:, 2:], threshold)


def kind_of(layout: Layout) -> Kind:
    """The kind that a layout is likest to, by the table of the package; none is named of a layout
    without parts."""
    if not len(layout):
        return Kind("", 0.0, False)
    return _table().kind(layout)


@functools.cache
def _table() -> KindTable:
    return KindTable.from_json((resources.files("uniart_jax.voxels") / "kinds.json").read_text())


def _short(value: float, digits: int) -> float | int:
    """Rounded; whole numbers without a point."""
    rounded = round(float(value), digits)
    return int(rounded) if rounded == int(rounded) else rounded


def joint_kinds(layout: Layout) -> list[str]:
    """[K] "base", "fixed", "slider", "knob", "screw" or "hinge"."""
    names = {"fixed": "fixed", "prismatic": "slider", "screw": "screw"}
    rows = zip(layout.joints, layout.boxes, layout.parents, strict=True)
    return [
        "base"
        if parent < 0
        else names.get(joint.type) or ("knob" if is_knob(joint, box) else "hinge")
        for joint, box, parent in rows
    ]


def is_knob(joint: Joint, box: np.ndarray) -> bool:
    """Whether what turns is small and about its own axis; of a box no outline tells it.

    Args:
      box: [6] centre and size, object units.
    """
    largest = float(box[3:].max())
    off = np.linalg.norm(np.cross(joint.direction, box[:3] - joint.origin))
    return bool(largest <= KNOB and off <= OFF_AXIS * largest)


def features(layout: Layout) -> np.ndarray:
    """[F] float64 of a layout; what is mirrored left and right has the same.

    Proportions of the object and of its base, counts of the parts by what they do, their share of
    the front, the axis, size and place of the largest hinge and slider, where knobs are, how deep
    the tree is.
    """
    boxes, parents = np.asarray(layout.boxes, np.float64), np.array(layout.parents)
    corners = box_corners(boxes)
    lower, upper = corners[:, :3].min(0), corners[:, 3:].max(0)
    extent = np.maximum(upper - lower, LEAST_EXTENT)
    size = boxes[:, 3:] / extent
    place = _unmirrored((boxes[:, :3] - (lower + upper) / 2) / extent)
    front = size[:, 1] * size[:, 2]
    axis = np.abs([joint.direction for joint in layout.joints])
    turn = np.array([joint.angle[1] - joint.angle[0] for joint in layout.joints])
    slide = np.array([joint.travel[1] - joint.travel[0] for joint in layout.joints])
    root = int(np.argmax(parents < 0))
    found = np.array(joint_kinds(layout))
    are = {kind: found == kind for kind in ("fixed", "slider", "screw", "knob", "hinge")}
    deep = (parents >= 0) & (parents != root)
    values = [*np.log(extent), *size[root], *place[root]]
    values += [_count(rows) for rows in are.values()]
    values += [_count(deep), *(_count(deep & are[kind]) for kind in ("hinge", "knob", "slider"))]
    for kind in ("hinge", "slider"):
        for along in range(3):
            rows = are[kind] & (axis.argmax(1) == along)
            values += [_count(rows), front[rows].sum()]
    for kind in ("hinge", "slider"):
        rows = np.flatnonzero(are[kind])
        if not len(rows):
            values += [0.0] * 12
            continue
        # the largest; of alike ones the highest, then the foremost, then the one in the middle
        near, aside, up = place[rows].round(2).T
        k = rows[np.lexsort((-aside, -near, up, size[rows].sum(1).round(2)))[-1]]
        joint, sides = layout.joints[k], np.maximum(boxes[k, 3:], LEAST_EXTENT)
        arm = joint.origin - boxes[k, :3]
        arm = arm - (arm @ joint.direction) * joint.direction
        hung = _unmirrored(np.clip(arm / sides, -1, 1)) * (kind == "hinge")
        values += [*size[k], *place[k], *axis[k], *hung]
    values += list(place[are["knob"]].mean(0)) if are["knob"].any() else [0.0] * 3
    return np.array([*values, _count(turn > 6), turn[are["hinge"]].max(initial=0), slide.max()])


def _count(rows: np.ndarray) -> float:
    return float(np.log1p(rows.sum()))


def _unmirrored(vectors: np.ndarray) -> np.ndarray:
    """Left is as right."""
    return np.stack([vectors[..., 0], np.abs(vectors[..., 1]), vectors[..., 2]], -1)
