"""Pictures and part tables of procedural objects without end: what the layout network and the mask
network train on (``data.layout_batches``, ``data.scene_batches``). No voxels, no jax.

Objects are made in *blocks* of ``BLOCK``, one file a block in ``DataConfig.layouts``. A block is a
pure function of its number and the settings, so whoever needs one that is not there makes it,
several programs can share a folder, and training resumes at any batch. ``uniart prepare layouts``
makes them ahead.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import logging
import os
import threading
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax import procedural
from uniart_jax.config import DataConfig, ModelConfig
from uniart_jax.data.cameras import camera_codes
from uniart_jax.data.images import crop, crop_mask
from uniart_jax.data.legs import legs_of
from uniart_jax.data.panels import boards_of, panels_of
from uniart_jax.data.revolutions import revolutions_of
from uniart_jax.objects.appearance import sample_color
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.states import sample_state
from uniart_jax.runtime.files import write_text
from uniart_jax.runtime.processes import map_ordered, process_pool
from uniart_jax.runtime.progress import track
from uniart_jax.visual.render import Camera, render, sample_camera
from uniart_jax.voxels.joint_code import encode_object
from uniart_jax.voxels.part_table import MOST_BOARDS, MOST_LEGS, MOST_PANELS
from uniart_jax.voxels.revolution_table import revolution_rows

BLOCK = 256  # objects a file
STATES = 20  # shown states tried before an object is left out
# of what ``make_block`` draws; 5: legs, 6: panels, 7: boards, 8: boards of open doors, 9:
# revolutions
VERSION = 9
# a rendering's side over its crop's, and samples a pixel: sharp with hard shadows, or soft
RENDERINGS = ((2.0, 1), (1.25, 4))
LEGS = ("legs", "leg_counts", "legs_alone")
PANELS = ("panels", "panel_counts", "panel_share")
BOARDS = ("boards", "board_counts", "board_share")
COLUMNS = (
    *("images", "masks", "cameras", "boxes", "codes", "parents", "colors", "part_counts"),
    *LEGS,
    *PANELS,
    *BOARDS,
    "revolutions",
)

logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class LayoutSettings:
    """What a folder of blocks was made with."""

    image_size: int = 256
    views: int = 2
    max_parts: int = procedural.MAX_PARTS
    start_seed: int = 0
    families: tuple[str, ...] = procedural.SEEN_FAMILIES
    version: int = VERSION


def training_seed(number: int, start_seed: int = 0) -> int:
    """The procedural seed of object ``number``; never one that evaluation or validation reserves.

    Seeds from ``DataConfig.validation_seed`` to ten times ``HELD_OUT_SEED`` are passed over, unless
    ``start_seed`` is the validation's own.
    """
    seed = start_seed + number
    reserved = DataConfig.validation_seed
    if start_seed >= reserved:
        if not reserved <= seed < procedural.HELD_OUT_SEED:
            raise ValueError(f"layouts: validation seed {seed} lies among the held-out seeds")
        return seed
    beyond = 10 * procedural.HELD_OUT_SEED
    return seed if seed < reserved else seed - reserved + beyond


def shown_object(seed: int, families: tuple[str, ...], rng: np.random.Generator):
    """The object of a seed at a random shown state, and its ``encode_object``; None if no state can
    be encoded."""
    return encodable_state(procedural.draw(seed, families), rng)


def encodable_state(closed: ArticulatedObject, rng: np.random.Generator):
    """An object at a random shown state, and its ``encode_object``; None if no state of ``STATES``
    can be encoded."""
    for _ in range(STATES):
        obj = sample_state(closed, rng)
        try:
            return obj, encode_object(obj)
        except ValueError:  # two equal boxes: another state
            continue
    return None


def part_colors(obj: ArticulatedObject) -> np.ndarray:
    """[K, 3] mean linear RGB of each part's surface, read at the centres of its triangles."""
    centre = np.full((1, 3), 1 / 3)
    rows = []
    for part in obj.parts:
        faces, area = np.arange(len(part.mesh.faces)), part.mesh.area_faces
        color = sample_color(part.mesh, faces, np.repeat(centre, len(faces), 0))
        rows.append((color * area[:, None]).sum(0) / max(area.sum(), 1e-12))
    return np.array(rows, np.float32)


def take_picture(
    obj: ArticulatedObject, camera: Camera, size: int, rendering: tuple[float, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[S, S, 3] uint8 crop over black of one of ``RENDERINGS``, its mask [S, S] uint8 (255: the
    object), and its camera code [7]."""
    scale, samples = rendering
    picture = render(obj, camera, size=round(scale * size), samples=samples)
    picture = np.round(picture * 255).astype(np.uint8)
    row = [[camera.azimuth, camera.elevation, camera.fov_degrees, camera.distance]]
    code = camera_codes(np.array(row), picture[None])[0]
    return crop(picture, size), crop_mask(picture, size), code


def make_item(
    index: int, settings: LayoutSettings
) -> tuple[ArticulatedObject, dict[str, np.ndarray]] | None:
    """Object ``index`` at its shown state and its row of every column of ``COLUMNS``, tables zero
    beyond its parts; None where no state can be encoded or it has more than ``max_parts``.

    Raises:
      ValueError: the object is faulty.
    """
    seed = training_seed(index, settings.start_seed)
    rng = np.random.default_rng([seed, 2])
    closed = procedural.draw(seed, settings.families)
    found = encodable_state(closed, rng)
    if found is None or len(found[0].parts) > settings.max_parts:
        return None
    obj, (boxes, codes, parents) = found
    pictures = [
        take_picture(
            obj,
            sample_camera(rng),
            settings.image_size,
            RENDERINGS[rng.integers(len(RENDERINGS))],
        )
        for _ in range(settings.views)
    ]
    images, masks, cameras = (np.stack(column) for column in zip(*pictures, strict=True))
    pad = ((0, settings.max_parts - len(boxes)), (0, 0))
    return obj, {
        "images": images,
        "masks": masks,
        "cameras": cameras,
        "boxes": np.pad(boxes.astype(np.float32), pad),
        "codes": np.pad(codes.astype(np.float32), pad),
        "parents": np.pad(parents.astype(np.int32), pad[0]),
        "colors": np.pad(part_colors(obj), pad),
        "part_counts": np.int32(len(boxes)),
        **_body_columns(closed, obj),
        **_board_columns(obj, settings.max_parts),
        "revolutions": revolution_rows(revolutions_of(obj), settings.max_parts),
    }


def _body_columns(closed: ArticulatedObject, obj: ArticulatedObject) -> dict[str, Any]:
    """An object's row of ``LEGS`` and ``PANELS``; counts are -1 where they cannot be told."""
    legs = legs_of(closed, obj)
    panels = panels_of(obj, legs)
    none = np.zeros((MOST_LEGS, 12), np.float32), np.zeros((MOST_PANELS, 6), np.float32)
    return {
        "legs": none[0] if legs is None else legs.table(MOST_LEGS),
        "leg_counts": np.int32(-1 if legs is None else len(legs)),
        "legs_alone": np.bool_(legs is not None and legs.alone),
        "panels": none[1] if panels is None else panels.table(MOST_PANELS),
        "panel_counts": np.int32(-1 if panels is None else len(panels)),
        "panel_share": np.float32(0 if panels is None else panels.share),
    }


def _board_columns(obj: ArticulatedObject, most: int) -> dict[str, Any]:
    """An object's row of ``BOARDS``, for ``most`` parts; counts are -1 where they cannot be
    told."""
    tables = np.zeros((most, MOST_BOARDS, 6), np.float32)
    counts, shares = np.full(most, -1, np.int32), np.zeros(most, np.float32)
    for k, boards in enumerate(boards_of(obj)):
        if boards is not None:
            tables[k], counts[k], shares[k] = boards.table(MOST_BOARDS), len(boards), boards.share
    return {"boards": tables, "board_counts": counts, "board_share": shares}


def make_block(number: int, settings: LayoutSettings) -> dict[str, np.ndarray]:
    """Block ``number``: arrays of ``COLUMNS``, n <= ``BLOCK`` objects (``make_item``)."""
    rows, fault = [], None
    for index in range(number * BLOCK, (number + 1) * BLOCK):
        try:
            made = make_item(index, settings)
        except ValueError as error:  # one faulty object in many thousands must not end a training
            seed = training_seed(index, settings.start_seed)
            logger.warning("data: procedural object %d is left out: %s", seed, error)
            fault = error
            continue
        if made is not None:
            rows.append(made[1])
    if not rows:
        raise ValueError(f"layouts: block {number} has no object") from fault
    return {name: np.stack([row[name] for row in rows]) for name in COLUMNS}


def block_path(folder: str | Path, number: int) -> Path:
    """Where a block lies."""
    return Path(folder) / f"block-{number:06d}.npz"


def load_block(folder: str | Path, number: int, settings: LayoutSettings) -> dict[str, np.ndarray]:
    """Read block ``number``, made first where it is not there or damaged."""
    path = block_path(folder, number)
    try:
        with np.load(path, allow_pickle=False) as held:
            return {name: held[name] for name in COLUMNS}
    except FileNotFoundError:
        pass
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        logger.warning("data: %s is damaged (%s) and is made again", path, error)
    return write_block(folder, number, settings)


def write_block(folder: str | Path, number: int, settings: LayoutSettings) -> dict[str, np.ndarray]:
    """Make block ``number`` and put it into the folder at once."""
    path = block_path(folder, number)
    block: dict[str, Any] = make_block(number, settings)
    # threads of one process may make the same block
    partial = path.with_name(f".{path.stem}-{os.getpid()}-{threading.get_ident()}.part")
    with open(partial, "wb") as file:
        np.savez_compressed(file, **block)
    os.replace(partial, path)
    return block


def check_settings(folder: str | Path, settings: LayoutSettings) -> None:
    """Make the folder these settings', or check that it is.

    Raises:
      ValueError: it holds blocks of other settings.
    """
    path = Path(folder) / "settings.json"
    text = json.dumps(dataclasses.asdict(settings), indent=2) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file():
        write_text(path, text)
    elif path.read_text() != text:
        raise ValueError(
            f"{folder}: holds layouts of other settings ({_differing(path, settings)}); "
            "give another folder, in which they are made anew"
        )


def _differing(path: Path, settings: LayoutSettings) -> str:
    """Names of the settings in which a folder's file differs."""
    try:
        found = json.loads(path.read_text())
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        return f"{path.name} cannot be read"
    asked = json.loads(json.dumps(dataclasses.asdict(settings)))
    return ", ".join(k for k in sorted({*found, *asked}) if found.get(k) != asked.get(k))


def prepare_layouts(
    folder: str | Path, count: int, settings: LayoutSettings, processes: int = 1, first: int = 0
) -> None:
    """Make the blocks from ``first`` on, ``count`` objects or a few more; those that are there are
    kept."""
    check_settings(folder, settings)
    numbers = range(first, first - (-count // BLOCK))
    numbers = [n for n in numbers if not block_path(folder, n).is_file()]
    with process_pool(processes) as submit:
        work = functools.partial(_write, folder=folder, settings=settings)
        made = map_ordered(submit, work, numbers, 2 * processes)
        for _ in track(made, "blocks of layouts", len(numbers), unit="blocks"):
            pass


def _write(number: int, folder: str | Path, settings: LayoutSettings) -> int:
    return len(write_block(folder, number, settings)["images"])


def settings_of(data: DataConfig, model: ModelConfig, validation: bool = False) -> LayoutSettings:
    """The settings that a config asks for."""
    start = data.validation_seed if validation else 0
    families = procedural.WORLDS[data.world]
    return LayoutSettings(model.layout.image_size, start_seed=start, families=families)
