"""Pictures of an asset: the input image beside the object at rest, open, and as coloured parts with
their joint axes; and its motion.

All tiles share one view: of the input image's camera where it is known. Else, if the image has
transparency, it is the one whose silhouette and colours at the shown state match it best, since
generated objects stand in a canonical frame.
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from uniart_jax.objects.image_formats import image_formats
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.diagram import picture
from uniart_jax.visual.render import FRONT_LEFT, Camera, Scene, build_scene, fit, render

TILE = 320  # pixels a side
GAP, CAPTION = 8, 26  # pixels between tiles, and above them
BACKGROUND = (244, 244, 246)
INK = (70, 72, 80)
_tile = functools.partial(picture, background=BACKGROUND)
STEEPEST = np.deg2rad(85)  # elevation
MARGIN = 1.08  # frame over object
MATCH_SIZE = 48  # pixels a side of the pictures that are compared
SEARCH_SIZE = 256  # pixels a side, at most, of the input image that they are cut from
MOTION_SIZE = 256
MOTION_FRAMES = 10  # from rest to open; played forth and back
MOTION_SECONDS = 2.4


def view_of_code(code: np.ndarray) -> Camera:
    """The direction that a camera code [7] (``voxels.camera_code``) looks from."""
    elevation = float(np.clip(code[2], -STEEPEST, STEEPEST))
    return Camera(np.arctan2(code[0], code[1]), elevation, FRONT_LEFT.fov_degrees)


def choose_view(obj: ArticulatedObject, image: Image.Image | None) -> Camera:
    """The direction to look from where no camera is known: the input image's if it has
    transparency, else from the front left and above.

    Coarse search over the view directions that training images have; both pictures are cropped to
    their silhouettes, so that distance and framing do not matter.
    """
    if image is None or not image.has_transparency_data:
        return FRONT_LEFT
    small = image.convert("RGBA")
    small.thumbnail((SEARCH_SIZE, SEARCH_SIZE))
    target = _cropped(np.asarray(small, np.float32) / 255)
    if target is None or target[..., 3].min() > 0.9:
        return FRONT_LEFT
    best, scene = (np.inf, 0.0, 0.0), build_scene(obj)
    coarse = [(a, e) for e in (8, 20, 32) for a in range(-50, 51, 10)]
    for azimuth, elevation in coarse:
        best = min(best, (_mismatch(obj, scene, target, azimuth, elevation), azimuth, elevation))
    fine = [(best[1] + a, best[2] + e) for e in (-6, 0, 6) for a in (-5, 0, 5)]
    for azimuth, elevation in fine:
        best = min(best, (_mismatch(obj, scene, target, azimuth, elevation), azimuth, elevation))
    if not np.isfinite(best[0]):
        return FRONT_LEFT
    return _view(best[1], best[2])


def _view(azimuth: float, elevation: float) -> Camera:
    """The camera at angles in degrees."""
    return Camera(np.deg2rad(azimuth), np.deg2rad(elevation), FRONT_LEFT.fov_degrees)


def _mismatch(
    obj: ArticulatedObject, scene: Scene, target: np.ndarray, azimuth: float, elevation: float
) -> float:
    """Mean difference between the object seen from there (degrees) and the cropped image; infinite
    if nothing is seen."""
    camera = fit(obj, _view(azimuth, elevation))
    seen = _cropped(render(obj, camera, MATCH_SIZE * 3 // 2, samples=1, scene=scene))
    if seen is None:
        return np.inf
    return float(np.abs(_premultiplied(seen) - _premultiplied(target)).mean())


def write_preview(
    obj: ArticulatedObject, path: Path, image: Image.Image | None, view: Camera
) -> Path:
    """A strip of square tiles: input (if any), rest, open, and the open parts in colours with their
    joint axes."""
    staged, camera = _framed(obj, view)
    rest, opened = staged.rest(), staged.open()
    tiles = []
    if image is not None:
        tiles.append(("input", _input_tile(image)))
    tiles.append(("rest", _tile(staged, camera, TILE, rest)))
    tiles.append(("open", _tile(staged, camera, TILE, opened)))
    tiles.append(("parts and axes", _tile(staged, camera, TILE, opened, parts=True, axes=True)))
    width = len(tiles) * (TILE + GAP) + GAP
    sheet = Image.new("RGB", (width, TILE + CAPTION + 2 * GAP), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(size=15)
    for i, (title, tile) in enumerate(tiles):
        left = GAP + i * (TILE + GAP)
        sheet.paste(tile, (left, GAP + CAPTION - 4))
        draw.text((left + TILE / 2, GAP + 8), title, fill=INK, font=font, anchor="mm")
    sheet.save(path, compress_level=6)
    return path


def write_motion(obj: ArticulatedObject, path: Path, view: Camera) -> Path | None:
    """An endless GIF from rest to open and back, joints one after the other; None (and no file) if
    nothing moves."""
    staged, camera = _framed(obj, view)
    moving = [k for k, joint in enumerate(staged.joints) if k and joint.type != "fixed"]
    if not moving:
        return None
    rest, opened = staged.rest(), staged.open()
    frames = []
    for time in np.linspace(0, 1, MOTION_FRAMES):
        q = rest.copy()
        for order, k in enumerate(moving):
            q[k] += (opened[k] - rest[k]) * _eased(time, order, len(moving))
        frames.append(_tile(staged, camera, MOTION_SIZE, q))
    middle = Image.new("RGB", (MOTION_SIZE, 2 * MOTION_SIZE))
    middle.paste(frames[0], (0, 0))
    middle.paste(frames[-1], (0, MOTION_SIZE))
    palette = middle.quantize(colors=128, method=Image.Quantize.MEDIANCUT)
    indexed = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    loop = indexed + indexed[-2:0:-1]
    duration = [round(1000 * MOTION_SECONDS / len(loop) / 10) * 10] * len(loop)
    duration[0] = duration[len(indexed) - 1] = 500  # stand still at both ends
    loop[0].save(path, save_all=True, append_images=loop[1:], duration=duration, loop=0)
    return path


def _eased(time: float, order: int, count: int) -> float:
    """How far joint ``order`` of ``count`` has opened at ``time`` in [0, 1]: each takes at least
    half of the time, staggered evenly."""
    share = 1.0 if count == 1 else 0.55
    start = 0.0 if count == 1 else (1 - share) * order / (count - 1)
    t = float(np.clip((time - start) / share, 0, 1))
    return t * t * (3 - 2 * t)


def _framed(obj: ArticulatedObject, view: Camera) -> tuple[ArticulatedObject, Camera]:
    """The object moved, and the camera set back, so that all that is seen between rest and open
    just fills the frame."""
    points = np.concatenate([obj.mesh(obj.open(f)).vertices for f in (0.0, 0.5, 1.0)])
    axes = view.matrix()[:3, :3]
    tangent = np.tan(np.deg2rad(view.fov_degrees) / 2)
    seen = (points - (points.min(0) + points.max(0)) / 2) @ axes.T
    for _ in range(4):  # where the middle is depends on the distance, hardly
        reach = np.abs(seen[:, :2]).max(1) * MARGIN / tangent - seen[:, 2]
        distance = max(float(reach.max()), 1e-3 - float(seen[:, 2].min()))
        depth = seen[:, 2:] + distance
        slope = seen[:, :2] / depth
        nearest = float(depth.min())
        seen[:, :2] -= (slope.min(0) + slope.max(0)) / 2 * (nearest + float(depth.mean())) / 2
    matrix = np.eye(4)
    matrix[:3, 3] = seen[0] @ axes - points[0]
    reach = np.abs(seen[:, :2]).max(1) * MARGIN / tangent - seen[:, 2]
    return obj.transformed(matrix), dataclasses.replace(view, distance=float(reach.max()))


def _input_tile(image: Image.Image) -> Image.Image:
    """The input image, transparency on the sheet's background, as large as a tile allows."""
    rgba = image.convert("RGBA")
    rgba.thumbnail((TILE, TILE), Image.Resampling.LANCZOS)
    if max(rgba.size) < TILE:
        factor = TILE / max(rgba.size)
        size = (max(1, round(rgba.width * factor)), max(1, round(rgba.height * factor)))
        rgba = rgba.resize(size, Image.Resampling.BICUBIC)
    tile = Image.new("RGB", (TILE, TILE), BACKGROUND)
    tile.paste(rgba, ((TILE - rgba.width) // 2, (TILE - rgba.height) // 2), rgba)
    return tile


def _cropped(picture: np.ndarray) -> np.ndarray | None:
    """The silhouette's square neighbourhood at MATCH_SIZE, [n, n, 4] in [0, 1]; None if there is no
    silhouette."""
    rows, columns = np.nonzero(picture[..., 3] > 0.5)
    if len(rows) < 4:
        return None
    side = max(np.ptp(rows), np.ptp(columns)) + 1
    top, left = (
        (rows.min() + rows.max() + 1 - side) // 2,
        (columns.min() + columns.max() + 1 - side) // 2,
    )
    crop = Image.fromarray((picture * 255 + 0.5).astype(np.uint8)).crop(
        (left, top, left + side, top + side)
    )
    return np.asarray(crop.resize((MATCH_SIZE, MATCH_SIZE), Image.Resampling.BOX)) / 255.0


def _premultiplied(picture: np.ndarray) -> np.ndarray:
    """Colour, black where there is nothing, beside alpha."""
    alpha = picture[..., 3:]
    return np.concatenate([picture[..., :3] * alpha, alpha], -1)


def read_image(image: str | Path | np.ndarray | Image.Image) -> Image.Image:
    """An input image as PIL: a path, an [h, w, 3 or 4] array (uint8, or floats in [0, 1]), or PIL
    itself.

    Raises:
      ValueError: not an image.
    """
    if isinstance(image, Image.Image):
        return image
    if isinstance(image, np.ndarray):
        if image.ndim != 3 or image.shape[-1] not in (3, 4):
            raise ValueError(f"preview: expected an image [h, w, 3 or 4], got shape {image.shape}")
        if image.dtype != np.uint8:
            image = (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)
        return Image.fromarray(image)
    try:
        with Image.open(image, formats=image_formats()) as opened:
            opened.load()
            return opened
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"preview: {image} cannot be read as an image ({error})") from None


def with_meshes(obj: ArticulatedObject, meshes) -> ArticulatedObject:
    """The object with other meshes of the same parts, such as the exported ones, so that previews
    show what was written."""
    parts = [dataclasses.replace(p, mesh=m) for p, m in zip(obj.parts, meshes, strict=True)]
    return dataclasses.replace(obj, parts=tuple(parts))
