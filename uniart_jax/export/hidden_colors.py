"""Colours of places that a picture does not show, by a small network.

A place may look as one near it that the picture shows, as all that is seen of its part, or as the
decoder says. Which of these it is depends on where it lies: on the back of a door, on a drawer's
side, in a room. A multilayer perceptron weighs these candidates, and a colour of its own, by what
is known of the place. It was fitted to objects that *nano* makes of pictures of procedural training
objects (``tools/fit_hidden_colors.py``; the model card has the figures).
"""

from __future__ import annotations

import functools
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
from safetensors.numpy import load
from scipy.spatial import cKDTree

from uniart_jax.objects.appearance import srgb_to_linear
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.render import build_scene
from uniart_jax.voxels.joint_code import box_corners

WEIGHTS = "hidden_colors.safetensors"
KINDS = {"fixed": 0, "revolute": 1, "continuous": 1, "prismatic": 2, "screw": 3}
ROOT = 4
FEWEST = 4  # seen places of a part that its colours are taken from
LIFT = 0.004  # object units above a surface, that rays leave it from
# of the opposite of a normal, object units, in distances to seen places
TURNED, ANY_SIDE, ALIKE = 0.1, 0.02, 0.03
COLOR, PART = 2.0, 0.2  # object units that the whole range of a colour, and another part, count as
NEIGHBOURS, WIDTH = 8, 0.15  # places that a mean by likeness is of; object units of its Gaussian
NEAR = 0.1  # object units, that nearness falls off over
FARTHEST = 2.0  # object units, in place of a distance where there is no candidate
CLIP = 4.0  # standard deviations that a feature counts at most
# Candidates: the nearest seen place of the same part that faces the same way, perhaps mirrored
# (y -> -y); the nearest whichever way it faces; the part's median; the nearest of any part; the
# root's median; that of parts of the same kind; the decoder's colour; and the mean of seen places
# that the decoder gives like colours.
NEAREST, ANY_WAY, MEDIAN, OTHERS, BODY, KIND, DECODER, LIKE = range(8)
MEASURED = [NEAREST, ANY_WAY, OTHERS, LIKE]  # candidates whose distances are features


class Places(NamedTuple):
    """Places on the surface of an object at its shown state.

    Attributes:
      points, normals: [n, 3] object units, and unit normals. parts: [n] whose they are. decoded:
        [n, 3] sRGB in 0..1 by the decoder, if there is one. shown: [n, 3] sRGB by the picture.
        seen: [n] bool, whether ``shown`` is to be believed.
    """

    points: np.ndarray
    normals: np.ndarray
    parts: np.ndarray
    decoded: np.ndarray | None
    shown: np.ndarray
    seen: np.ndarray


def hidden_colors(
    places: Places, obj: ArticulatedObject, camera: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """[m, 3] linear RGB of some of the places, rows ``at`` [m].

    Args:
      camera: [3] where the picture was taken from, object units.
    """
    if not len(at):
        return np.zeros((0, 3), np.float32)
    return srgb_to_linear(weighed(*described(places, obj, camera, at), _weights()))


def described(
    places: Places, obj: ArticulatedObject, camera: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is known of places ``at`` [m]: features [m, F], candidates [m, C, 3] sRGB, and which of
    these there are, [m, C]."""
    kinds = np.array([ROOT if p.parent < 0 else KINDS[p.joint.type] for p in obj.parts])
    colors, distances = _candidates(places, kinds, at)
    there = distances < FARTHEST
    apart = np.where(there, distances, 0)[:, MEASURED]
    around = _surroundings(places, obj, kinds, camera, at)
    features = np.concatenate([around, apart, np.exp(-((apart / NEAR) ** 2))], -1)
    return features.astype(np.float32), colors, there


def weighed(features: Any, colors: Any, there: Any, weights: dict[str, Any], xp: Any = np) -> Any:
    """[m, 3] sRGB: the mean of candidates and of a colour of its own, by a perceptron's weights;
    ``xp``: numpy, or jax.numpy."""
    count = colors.shape[1]
    colors = colors * there[..., None]
    known = xp.clip((features - weights["mean"]) / weights["deviation"], -CLIP, CLIP)
    x = xp.concatenate([known, colors.reshape(len(colors), 3 * count) * 2 - 1, there], -1)
    last = sum(name.startswith("kernel") for name in weights) - 1
    for k in range(last):
        y = x @ weights[f"kernel_{k}"] + weights[f"bias_{k}"]
        y = 0.5 * y * (1 + xp.tanh(np.sqrt(2 / np.pi) * (y + 0.044715 * y**3)))  # GELU
        x = x + y if k else y
    out = x @ weights[f"kernel_{last}"] + weights[f"bias_{last}"]
    there = xp.concatenate([there, xp.ones_like(there[:, :1])], -1)
    share = xp.exp(xp.where(there, out[:, : count + 1], -30.0))
    share = share / share.sum(-1, keepdims=True)
    own = 1 / (1 + xp.exp(-out[:, count + 1 :]))
    return (share[:, :count, None] * colors).sum(1) + share[:, count:] * own


def _candidates(places: Places, kinds: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[m, 8, 3] sRGB of the candidates and [m, 8] distances to them, ``FARTHEST`` where there is
    none."""
    points, normals, parts = places.points, places.normals, places.parts
    seen, shown = np.flatnonzero(places.seen), places.shown
    colors = np.zeros((len(at), 8, 3), np.float32)
    distances = np.full((len(at), 8), FARTHEST, np.float32)

    def take(
        rows: np.ndarray, column: int, color: np.ndarray, distance: np.ndarray | float
    ) -> None:
        colors[rows, column], distances[rows, column] = color, np.minimum(distance, FARTHEST)

    own = parts[at]
    for part in range(len(kinds)):
        mine, rows = seen[parts[seen] == part], np.flatnonzero(own == part)
        if len(mine) < FEWEST:
            continue
        median = np.median(shown[mine], 0)
        take(rows, MEDIAN, median, 0)
        if kinds[part] == ROOT:
            take(np.arange(len(at)), BODY, median, 0)
        if not len(rows):
            continue
        where = points[at[rows]], normals[at[rows]]
        tree = cKDTree(with_normals(points[mine], normals[mine], TURNED))
        plain, there = tree.query(with_normals(*where, TURNED))
        mirror = np.array([1, -1, 1])
        other, opposite = tree.query(with_normals(where[0] * mirror, where[1] * mirror, TURNED))
        nearest = np.where(other < plain, opposite, there)
        take(rows, NEAREST, shown[mine[nearest]], np.minimum(other, plain))
        tree = cKDTree(with_normals(points[mine], normals[mine], ANY_SIDE))
        distance, nearest = tree.query(with_normals(*where, ANY_SIDE))
        take(rows, ANY_WAY, shown[mine[nearest]], distance)
    for kind in np.unique(kinds):
        mine = seen[kinds[parts[seen]] == kind]
        if len(mine) >= FEWEST:
            take(np.flatnonzero(kinds[own] == kind), KIND, np.median(shown[mine], 0), 0)
    every = np.arange(len(at))
    if places.decoded is not None:
        take(every, DECODER, places.decoded[at], 0)
    if not len(seen):
        return colors, distances
    tree = cKDTree(with_normals(points[seen], normals[seen], TURNED))
    distance, nearest = tree.query(with_normals(points[at], normals[at], TURNED))
    take(every, OTHERS, shown[seen[nearest]], distance)
    if places.decoded is None:
        return colors, distances
    alike = (
        with_normals(points, normals, ALIKE),
        COLOR * places.decoded,
        PART * np.eye(len(kinds))[parts],
    )
    alike = np.concatenate(alike, -1)
    count = np.arange(1, min(NEIGHBOURS, len(seen)) + 1)
    distance, nearest = cKDTree(alike[seen]).query(alike[at], k=count)
    weight = np.exp(-((distance / WIDTH) ** 2) / 2) + 1e-9
    mean = (weight[..., None] * shown[seen[nearest]]).sum(1) / weight.sum(1)[:, None]
    take(every, LIKE, mean, np.minimum(distance[:, 0], 0.95 * FARTHEST))
    return colors, distances


def _surroundings(
    places: Places,
    obj: ArticulatedObject,
    kinds: np.ndarray,
    camera: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """[m, 49] where places lie in their part and in the object, what is before them, how much is
    seen of their part, and what parts there are."""
    points, normals, own = places.points[at], places.normals[at], places.parts[at]
    corners = box_corners(np.asarray(obj.boxes, np.float64))
    low, high = corners[:, :3], corners[:, 3:]
    size, centre = high - low, (low + high) / 2
    within = np.clip((points - centre[own]) / np.maximum(size[own] / 2, 1e-3), -1.5, 1.5)
    scene, _, face_part, _ = build_scene(obj)
    start = (points + LIFT * normals).astype(np.float32)
    hit = scene.run(start, normals.astype(np.float32), output=1)
    blocked = hit["primID"] >= 0
    before = np.where(blocked, face_part[np.maximum(hit["primID"], 0)], 0)
    gap = np.where(blocked, np.minimum(hit["tfar"] + LIFT, 1), 1)[:, None]
    towards = camera - points
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    count = np.bincount(places.parts, minlength=len(kinds))
    share = np.bincount(places.parts[places.seen], minlength=len(kinds)) / np.maximum(count, 1)
    kind = np.eye(ROOT + 1)
    every = np.ones((len(at), 1))
    rows = (
        *(within, np.abs(within), normals, np.abs(normals), points),
        *(size[own], np.log(size[own] + 0.01), centre[own], kind[kinds[own]]),
        *(gap, blocked[:, None], np.log(gap + 0.01)),
        *((blocked & (before == own))[:, None], (blocked & (kinds[before] == ROOT))[:, None]),
        *(kind[kinds[before]] * blocked[:, None], share[own][:, None]),
        (normals * towards).sum(-1)[:, None],
        every * (high.max(0) - low.min(0)),
        every * np.minimum(np.bincount(kinds, minlength=ROOT + 1) / 8, 1),
    )
    return np.concatenate(rows, -1)


def with_normals(points: np.ndarray, normals: np.ndarray, turned: float) -> np.ndarray:
    """[n, 6] whose distances are those of places [n, 3], and of their normals ``turned`` times."""
    return np.concatenate([points, turned * normals], -1)


@functools.cache
def _weights() -> dict[str, np.ndarray]:
    """The perceptron's: ``kernel_k`` [in, out] and ``bias_k`` [out], ``mean`` and ``deviation`` of
    the features."""
    held = (resources.files("uniart_jax.export") / WEIGHTS).read_bytes()
    return {name: value.astype(np.float32) for name, value in load(held).items()}
