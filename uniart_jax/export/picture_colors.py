"""Colours of an object's surface from the picture that it was made of.

What the picture shows, each place of the surface takes from it: the more it faces the camera and
the farther it lies from the silhouette, where a small error of the camera shows the background;
nothing close beside a surface in front, whose colour it might be. The
light is divided out that our renderer has fall there, past what stands in its way: from the front
and above, as in most pictures, so that the object looks in a viewer as it does in the picture.
What the picture does not show takes the colour of the nearest place of the same part that it does
show, or of its mirror image (y -> -y), if that is near, else what ``hidden_colors`` says; backs of
doors in the areas of their fronts (``plate_backs``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from embreex.rtcore_scene import EmbreeScene
from scipy import ndimage
from scipy.spatial import cKDTree

from uniart_jax.data.images import MARGIN, crop, crop_mask
from uniart_jax.export.hidden_colors import Places, hidden_colors, with_normals
from uniart_jax.export.plate_backs import even_backs
from uniart_jax.objects.appearance import linear_to_srgb, srgb_to_linear
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.render import build_scene, light_on, occluded
from uniart_jax.voxels.camera_code import camera_position, project

SIZE = 512  # pixels a side that a picture is cropped to
FACING = (0.1, 0.35)  # cosine of normal and way to the camera: believed from, fully from
EDGE = 0.015  # of the picture's side, from the silhouette, over which it comes to be believed
OFFSET = 0.004  # object units, of rays to the camera from the surface they leave
SEEN = 0.5  # belief of places that others take their colour from
TURNED = 0.1  # object units that the opposite of a normal counts as twice
NEAR = 0.04  # object units over which a colour is carried
FAR = 0.12  # beyond which none is: less than a 1,000th of it
LIFT = 0.012  # object units above a surface, whose teeth are no shadows, that light is asked at
ASIDE = 0.012  # object units to the sides, where another surface may stand in front
STEP = (
    0.02  # object units before or behind a place's own plane, from which on it is another surface
)
DARKEST = 0.15  # light that a place has at least
SAMPLES = 5_000  # places a part that colours are carried from
PLACES = 8_000  # of an object, of whose hidden ones colours are asked
FEWEST = 64  # of them of each part, at least
FACE = 0.5  # object units that the opposite of a normal counts as twice, between these places
AROUND = 24  # nearest of them, of which a colour is the median: guesses are blotchy
WIDE = 100  # of a part that does not move, up to a quarter of its places: doors have windows
BETWEEN = 6  # nearest of them, of whose colours a place's is the mean


@dataclasses.dataclass(frozen=True)
class Picture:
    """A picture and where it was taken from.

    Attributes:
      pixels: [S, S, 3] linear RGB of the square crop. depth: [S, S] how far a pixel lies within the
        silhouette, in shares of the side.
      camera: [7] code (``voxels.camera_code``).
    """

    pixels: np.ndarray
    depth: np.ndarray
    camera: np.ndarray

    @staticmethod
    def of(
        rgba: np.ndarray, camera: np.ndarray, margin: float = MARGIN, size: int = SIZE
    ) -> Picture:
        """Of an image [H, W, 4] uint8 with the object cut out (``data.background.cut_out``)."""
        alpha = crop_mask(rgba, size, margin) / 255
        color = srgb_to_linear(crop(rgba, size, margin) / 255)
        depth = np.asarray(ndimage.distance_transform_edt(alpha > 0.9)) / size
        return Picture(color, depth, np.asarray(camera, np.float64))


def paint(
    picture: Picture,
    obj: ArticulatedObject,
    points: np.ndarray,
    normals: np.ndarray,
    parts: np.ndarray,
    decoded: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """[n, 3] linear RGB of places on an object at the state that the picture shows.

    Args:
      points, normals: [n, 3] places, object units and frame, and unit normals. parts: [n] whose
        they are. decoded: rows [m] of them -> [m, 3] the network's colours; most are never asked.
    """
    shown, belief = look(picture, obj, points, normals)
    if (belief > SEEN).sum() < 50:  # the camera is off, or the picture says nothing
        return decoded(np.arange(len(points)))
    places = Places(points, normals, parts, None, linear_to_srgb(shown), belief > SEEN)
    filled = guessed(places, decoded, obj, camera_position(picture.camera), belief)
    moving = [k for k, part in enumerate(obj.parts) if part.parent >= 0]
    filled = even_backs(points, normals, parts, shown, belief > SEEN, filled, moving)
    for k in np.unique(parts):
        mine = np.flatnonzero(parts == k)
        seen, unseen = mine[belief[mine] > SEEN], mine[belief[mine] < 1]
        if len(seen) < 10 or not len(unseen):
            continue
        seen = seen[:: -(-len(seen) // SAMPLES)]
        tree = cKDTree(with_normals(points[seen], normals[seen], TURNED))
        where = points[unseen], normals[unseen]
        found = [
            tree.query(
                with_normals(where[0] * mirror, where[1] * mirror, TURNED),
                eps=0.5,
                distance_upper_bound=FAR,
            )
            for mirror in ([1, 1, 1], [1, -1, 1])
        ]
        distance, index = (np.stack(rows) for rows in zip(*found, strict=True))
        best = distance.argmin(0)[None]
        near = np.exp(-((np.take_along_axis(distance, best, 0)[0] / NEAR) ** 2))[:, None]
        nearest = np.minimum(np.take_along_axis(index, best, 0)[0], len(seen) - 1)  # none: len
        carried = shown[seen[nearest]]
        filled[unseen] = near * carried + (1 - near) * filled[unseen]
    return belief[:, None] * shown + (1 - belief[:, None]) * filled


def guessed(
    places: Places,
    decoded: Callable[[np.ndarray], np.ndarray],
    obj: ArticulatedObject,
    camera: np.ndarray,
    belief: np.ndarray,
) -> np.ndarray:
    """[n, 3] linear RGB of the places that are not seen for sure, by ``hidden_colors`` of
    ``PLACES``, and means in between; of parts without any of these the network's. 0 elsewhere.

    Args:
      decoded: as in ``paint``. camera: [3] where the picture was taken from. belief: [n] as
        ``look`` says.
    """
    points, normals, parts = places.points, places.normals, places.parts
    owners, counts = np.unique(parts, return_counts=True)
    asked = np.maximum(PLACES * counts // len(parts), FEWEST)
    mine = [np.flatnonzero(parts == k) for k in owners]
    rows = np.concatenate(
        [
            own[np.linspace(0, len(own) - 1, min(count, len(own))).astype(int)]
            for own, count in zip(mine, asked, strict=True)
        ]
    )
    some = Places(
        points[rows],
        normals[rows],
        parts[rows],
        linear_to_srgb(decoded(rows)),
        places.shown[rows],
        places.seen[rows],
    )
    at = np.flatnonzero(~some.seen)
    said = hidden_colors(some, obj, camera, at)
    known = with_normals(some.points[at], some.normals[at], FACE)
    filled = np.zeros((len(points), 3))
    for k, own in zip(owners, mine, strict=True):
        hidden, told = own[belief[own] < 1], some.parts[at] == k
        if not told.any():
            filled[hidden] = decoded(hidden)
            continue
        tree, count = cKDTree(known[told]), int(told.sum())
        moves = obj.parts[int(k)].joint.type != "fixed"
        around = AROUND if moves else int(np.clip(count // 4, AROUND, WIDE))
        near = tree.query(known[told], k=np.arange(1, min(around, count) + 1), workers=-1)[1]
        even = np.median(said[told][near], axis=1)
        where = with_normals(points[hidden], normals[hidden], FACE)
        distance, near = tree.query(
            where, k=np.arange(1, min(BETWEEN, count) + 1), eps=0.5, workers=-1
        )
        weight = 1 / (distance + 1e-3)
        filled[hidden] = (even[near] * weight[..., None]).sum(1) / weight.sum(1)[:, None]
    return filled


def look(
    picture: Picture, obj: ArticulatedObject, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """[n, 3] linear RGB of places of the object by what the picture shows there, without its light,
    and how far that is to be believed, [n] in 0..1."""
    position, places = camera_position(picture.camera), project(picture.camera, points)
    towards = position - points
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    size = len(picture.depth)
    at = ((places + 1) * (size / 2) - 0.5)[:, ::-1].T  # rows, columns
    read = lambda image: ndimage.map_coordinates(image, at, order=1, mode="constant")  # noqa: E731
    shown = np.stack([read(picture.pixels[..., c]) for c in range(3)], -1)
    belief = np.clip(((normals * towards).sum(-1) - FACING[0]) / (FACING[1] - FACING[0]), 0, 1)
    belief = belief * np.clip(read(picture.depth) / EDGE, 0, 1)
    tried = np.flatnonzero(belief > 0)
    start = points[tried] + OFFSET * (normals[tried] + towards[tried])
    scene = build_scene(obj)[0]
    hidden = occluded(scene, start.astype(np.float32), towards[tried])
    seen = tried[~hidden]
    seen = seen[~beside_nearer(scene, position, points[seen], normals[seen])]
    light = light_on(scene, points[seen] + LIFT * normals[seen], normals[seen])
    shown[seen] /= np.maximum(light, DARKEST)[:, None]
    believed = np.zeros(len(points), np.float32)
    believed[seen] = belief[seen]
    shown /= np.maximum(shown.max(-1, keepdims=True), 1)  # as bright as can be, same hue
    return np.maximum(shown, 0).astype(np.float32), believed


def beside_nearer(
    scene: EmbreeScene, position: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """[n] whether a camera at ``position`` [3] sees another surface in front, ``ASIDE`` to the left
    or right of a place [n, 3], above or below it."""
    towards = points - position
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    across = np.cross(towards, [0.0, 0, 1])
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    height = ((points - position) * normals).sum(-1)
    beside = np.zeros(len(points), bool)
    for shift in (across, -across, np.cross(towards, across), np.cross(across, towards)):
        ray = points + ASIDE * shift - position
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        start = np.broadcast_to(position, ray.shape).astype(np.float32)
        hit = scene.run(start, ray.astype(np.float32), output=1)
        plane = height / np.minimum((ray * normals).sum(-1), -1e-3)  # how far the ray goes to it
        beside |= (hit["primID"] >= 0) & (hit["tfar"] < plane - STEP)
    return beside
