"""The camera that sees a layout as a picture shows its object: for layouts without a camera, since
a hand, a program or a language model wrote them.

Focal length and shift follow from where the object lies in the crop. Azimuth, elevation and
perspective are searched for by how far the outlines of layout and object agree: on a grid, then by
the simplex method of Nelder and Mead. Many outlines agree from several sides, so a camera that is
given as a guess (a network's) is preferred to others that are hardly better.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh
from PIL import Image, ImageDraw
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from uniart_jax.data.images import MARGIN, crop_mask
from uniart_jax.data.layout_renders import solids
from uniart_jax.voxels.camera_code import project
from uniart_jax.voxels.layout import Layout

SIDE = 96  # pixels of the outlines that are compared
PERSPECTIVES = (0.02, 0.6)  # least and most, 1 / distance in object units
USUAL = 0.33  # perspective, of pictures that networks are trained on
AZIMUTHS = np.radians(np.arange(-80, 81, 16))
ELEVATIONS = np.radians((3, 15, 27, 40, 58))
STARTS = 4  # places of the grid from which the simplex begins
FAR_VIEW = 0.5  # cost of a view square to the guess, where 1 is that of no overlap
UNUSUAL = 0.1  # cost of the squared difference from the usual perspective
STEPS = 120  # of the simplex
FIRST_STEPS = np.array([0.1, 0.1, 0.07])  # of azimuth and elevation, radians, and perspective


def with_camera(
    layout: Layout, cut_out: np.ndarray, guess: np.ndarray | None = None, margin: float = MARGIN
) -> Layout:
    """A layout in object units with the camera that sees it as an image [H, W, 4] uint8, the
    object cut out, shows its object. guess: a code [7] that may be right. margin: of the crop."""
    mask = crop_mask(cut_out, SIDE, margin)
    mask = mask > min(127, mask.max() // 2)  # also of what is thinner than a pixel
    return dataclasses.replace(layout, camera=fit_camera(layout, mask, guess)[0])


def fit_camera(
    layout: Layout, mask: np.ndarray, guess: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """The camera of a picture that a layout describes.

    Args:
      layout: in object units. mask: [S, S] bool, the object in its crop (``data.images.crop``).
      guess: a code [7] that may be right.

    Returns:
      Its code [7] (``voxels.camera_code``), and the overlap (IoU) of both outlines.
    """
    shapes = _convex_pieces(layout)
    toward = None if guess is None else _toward(np.arctan2(guess[0], guess[1]), guess[2])
    window = _window(mask)

    def cost(x: np.ndarray) -> float:
        if not (-0.4 < x[1] < 1.5 and PERSPECTIVES[0] < x[2] < PERSPECTIVES[1]):
            return 2.0
        seen = outline(_placed(x, shapes, window), shapes, len(mask))
        overlap = (seen & mask).sum() / max((seen | mask).sum(), 1)
        far = 0.0 if toward is None else FAR_VIEW * (1 - toward @ _toward(x[0], x[1]))
        return 1 - overlap + far + UNUSUAL * (x[2] - USUAL) ** 2

    starts = [np.array([a, e, USUAL]) for a in AZIMUTHS for e in ELEVATIONS]
    if guess is not None:
        near = np.clip(guess[4], PERSPECTIVES[0] + 0.01, PERSPECTIVES[1] - 0.01)
        starts.append(np.array([np.arctan2(guess[0], guess[1]), guess[2], near]))
    tried = []
    for start in sorted(starts, key=cost)[:STARTS]:
        simplex = start + np.vstack([np.zeros(3), np.diag(FIRST_STEPS)])
        options = {"initial_simplex": simplex, "maxiter": STEPS, "xatol": 2e-3, "fatol": 1e-4}
        tried.append(minimize(cost, start, method="Nelder-Mead", options=options))
    camera = _placed(min(tried, key=lambda one: one.fun).x, shapes, window)
    seen = outline(camera, shapes, len(mask))
    return camera, float((seen & mask).sum() / max((seen | mask).sum(), 1))


def outline(camera: np.ndarray, shapes: list[np.ndarray], side: int) -> np.ndarray:
    """[side, side] bool where a camera code [7] sees convex shapes, each its corners [N, 3]."""
    picture = Image.new("L", (side, side))
    pen = ImageDraw.Draw(picture)
    for corners in shapes:
        spots = (project(camera, corners) + 1) * side / 2
        pen.polygon([tuple(spot) for spot in _hull(spots)], fill=1)
    return np.asarray(picture) > 0


def _convex_pieces(layout: Layout) -> list[np.ndarray]:
    pieces = [
        piece
        for part in solids(layout).parts
        for piece in trimesh.graph.split(part.mesh, only_watertight=False)
    ]
    return [_corners(piece) for piece in pieces]


def _corners(piece: trimesh.Trimesh) -> np.ndarray:
    try:
        return np.asarray(piece.convex_hull.vertices)
    except QhullError:  # it is flat
        return np.asarray(piece.vertices)


def _hull(points: np.ndarray) -> np.ndarray:
    """Corners of the convex hull of points [N, 2]; all of them where they lie in a line."""
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return points


def _toward(azimuth: float, elevation: float) -> np.ndarray:
    """[3] unit vector to a camera."""
    across = np.cos(elevation)
    return np.array([-across * np.cos(azimuth), -across * np.sin(azimuth), np.sin(elevation)])


def _window(mask: np.ndarray) -> np.ndarray:
    """[2, 2] first and last corner (x, y) of what is set in a mask, in [-1, 1]."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    corners = np.array([[columns[0], rows[0]], [columns[-1] + 1, rows[-1] + 1]])
    return corners / len(mask) * 2 - 1


def _placed(x: np.ndarray, shapes: list[np.ndarray], window: np.ndarray) -> np.ndarray:
    """The code [7] of azimuth, elevation and perspective by which shapes fill a window."""
    code = np.array([np.sin(x[0]), np.cos(x[0]), x[1], 1.0, x[2], 0.0, 0.0])
    spots = project(code, np.concatenate(shapes))
    low, high = spots.min(0), spots.max(0)
    longer = int((window[1] - window[0]).argmax())
    code[3] = (window[1] - window[0])[longer] / max(float((high - low)[longer]), 1e-6)
    code[5:] = code[3] * (low + high) / 2 - window.mean(0)
    return code
