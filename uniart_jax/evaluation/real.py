"""Folders of real assets as test objects for layouts: rendered as the procedural ones are, with
what is true of their parts.

    asset -> a shown state (``objects.states``) -> one picture by ``visual.render.sample_camera`` ->
    CACHE/<name>.png, CACHE/<name>.json

The JSON holds the true layout (``voxels.layout``) and the category. Textured assets take seconds
each, so pictures are kept and taken again from the cache; remove the folder when assets change. A
state, a camera: functions of the asset's path below the root.
"""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path

import numpy as np
from PIL import Image

from uniart_jax.data.folder import Settings
from uniart_jax.data.images import PICTURE_SIDE
from uniart_jax.data.layouts import encodable_state, part_colors
from uniart_jax.data.sources import Entry, find_entries, load_entry
from uniart_jax.evaluation.runner import run_or_reason
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.runtime.files import complete, write_text
from uniart_jax.visual.render import render, sample_camera
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.part_table import SMALLEST_SIDE


@dataclasses.dataclass(frozen=True)
class RealObject:
    """One test object.

    Attributes:
      name: its path below the root. family: its category.
      obj: its parts as boxes, normalised, at the shown state.
      image: [S, S, 4] uint8 straight-alpha rendering.
    """

    name: str
    family: str
    obj: ArticulatedObject
    image: np.ndarray


def real_objects(
    root: Path,
    cache: Path,
    *,
    image_size: int = PICTURE_SIDE,
    count: int | None = None,
    allow_outside: bool = False,
    processes: int = 1,
) -> tuple[list[RealObject], dict[str, str]]:
    """The first ``count`` assets below ``root`` (default: all), and {name: why} of those that
    cannot be shown.

    Raises:
      FileNotFoundError: no assets. ValueError: none of them can be shown.
    """
    settings = Settings("urdf", root=str(root), allow_outside=allow_outside)
    entries = find_entries(root, "urdf")[:count]
    cache.mkdir(parents=True, exist_ok=True)
    show = functools.partial(_show, settings, cache, image_size)
    made = run_or_reason(show, entries, "real objects", processes=processes)
    found, refused = [], {}
    for entry, result in zip(entries, made, strict=True):
        if isinstance(result, str):
            refused[entry.key] = result
        else:
            found.append(result)
    if not found:
        why = next(iter(refused.values()))
        raise ValueError(f"'{root}': no asset can be shown, the first because: {why}")
    return found, refused


def shown_object(entry: Entry, settings: Settings) -> ArticulatedObject:
    """The asset at its shown state, normalised; one whose parts nothing can tell apart is drawn
    again.

    Raises:
      ValueError, FileNotFoundError: it cannot be read, nothing of it moves, or every state has two
        equal boxes.
    """
    closed = load_entry(entry, settings)
    if all(part.joint.type == "fixed" for part in closed.parts):
        raise ValueError("nothing of it moves")
    found = encodable_state(closed, entry.generator(1))
    if found is None:
        raise ValueError("two of its parts have the same box, whatever its state")
    return found[0]


def _show(settings: Settings, cache: Path, size: int, entry: Entry) -> RealObject:
    stem = f"{entry.key.replace('/', '+')}-{size}"
    kept = cache / f"{stem}.json"
    if kept.is_file():
        data = json.loads(kept.read_text())
        obj = Layout.from_json(json.dumps(data["layout"])).to_object()
        with Image.open(cache / f"{stem}.png") as picture:
            return RealObject(entry.key, data["category"], obj, np.asarray(picture))
    obj = shown_object(entry, settings)
    picture = render(obj, sample_camera(entry.generator(2)), size=size, samples=4)
    image = np.round(picture * 255).astype(np.uint8)
    layout = Layout.of_object(obj, part_colors(obj))
    layout.boxes[:, 3:] = np.maximum(layout.boxes[:, 3:], SMALLEST_SIDE)  # flat sheets
    data = {"category": entry.category or "-", "layout": json.loads(layout.to_json())}
    picture = cache / f"{stem}.png"
    with complete(picture) as partial:
        Image.fromarray(image).save(partial, "PNG")
    write_text(kept, json.dumps(data) + "\n")
    return RealObject(entry.key, data["category"], layout.to_object(), image)
