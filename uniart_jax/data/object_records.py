"""One object as records: its shown states voxelised and rendered, and a row of the manifest for
each, which says why where one failed.

    object -> shown states -> normalised -> voxels, views -> record, orbit, row
"""

from __future__ import annotations

import collections
from collections.abc import Sequence

import numpy as np

from uniart_jax.data.columns import pack_orbit
from uniart_jax.data.folder import Row, Settings
from uniart_jax.data.memory import release
from uniart_jax.data.records import from_object, to_bytes
from uniart_jax.data.sources import Entry, clean, load_entry
from uniart_jax.objects.clearance import Clearance
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.perturb import part_factors, scale_parts
from uniart_jax.objects.robot_object import lost_pieces
from uniart_jax.objects.states import sample_state
from uniart_jax.visual.render import Camera

MAX_TEXT = 4000  # characters of a field of the manifest
ATTEMPTS = 8  # shown states drawn before an object counts as failed
Made = list[tuple[bytes, bytes, Row]]  # record, orbit, row; b"" instead of a record where it failed


def make_records(settings: Settings, entry: Entry) -> Made:
    """Records, orbits and manifest rows of an object at each of its shown states. Never raises
    ``Exception``."""
    base: Row = {
        "object": entry.key,
        "category": entry.category,
        "seed": entry.seed if entry.seed >= 0 else "",
        "split": entry.split,
        "refused": 0,
        "error": "",
    }
    made: Made = []
    try:
        obj = load_entry(entry, settings)
        if settings.source != "procedural":
            release()  # decoded textures of this object's files and of the object before
        base["repairs"] = listed(obj.normalized().provenance)  # what codes cannot hold too
        base["category"] = entry.category or obj.category
        if settings.strict and (lost := lost_pieces(obj.provenance)):
            raise ValueError(f"incomplete: {lost[0]}")
        if len(obj.parts) > settings.max_parts:
            raise ValueError(f"{len(obj.parts)} parts, more than max_parts = {settings.max_parts}")
        clearance = Clearance(obj)
    except Exception as error:  # one bad object must not stop a run of thousands; its row says why
        row: Row = {**base, "id": f"{entry.key}-0", "state": 0, "error": _reason(error)}
        return [(b"", b"", row)]
    for state in range(settings.states):
        row = {**base, "id": f"{entry.key}-{state}", "state": state}
        data = orbit = b""
        for attempt in range(ATTEMPTS):
            try:
                data, orbit, facts = _make_record(settings, obj, clearance, entry, row, attempt)
                row = {**row, **facts, "error": ""}
                break
            except ValueError as error:
                # boxes too close, parts too small: in another state they may not be
                row = {**row, "refused": attempt + 1, "error": _reason(error)}
            except Exception as error:
                row = {**row, "error": _reason(error)}
                break
        made.append((data, orbit, row))
    return made


def _make_record(
    settings: Settings,
    obj: ArticulatedObject,
    clearance: Clearance,
    entry: Entry,
    row: Row,
    attempt: int,
) -> tuple[bytes, bytes, Row]:
    from uniart_jax.visual.render import render, sample_camera
    from uniart_jax.voxels.voxelize import voxelize

    # Own stream (last entry): generate() uses [seed, family index].
    rng = entry.generator(int(row["state"]), attempt, 7)
    if settings.part_scale and int(row["state"]):
        rest = obj.shown_at(obj.rest())
        obj = scale_parts(rest, part_factors(rest, rng, settings.part_scale))
        clearance = Clearance(obj)
    shown = sample_state(obj, rng, clearance)
    grid = voxelize(shown, settings.resolution, settings.subdivisions)
    cameras = [sample_camera(rng) for _ in range(settings.views)]
    images = np.stack([render(shown, camera, size=settings.image_size) for camera in cameras])
    meta = {"id": row["id"], "category": row["category"], "state": row["state"]}
    if entry.seed >= 0:
        meta["seed"] = entry.seed
    record = from_object(shown, images, _angles(cameras), meta, grid)
    types = collections.Counter(j.type for j in shown.joints[1:])
    facts: Row = {
        "joints": " ".join(f"{name}:{n}" for name, n in sorted(types.items())),
        "parts": len(shown.parts),
        "voxels": len(grid.coords),
    }
    return to_bytes(record), _make_orbit(settings, shown, str(row["id"])), facts


def _make_orbit(settings: Settings, shown: ArticulatedObject, name: str) -> bytes:
    """Pictures from all around, evenly over the sphere, as an item of the column "orbit"; b"" if
    none are asked for."""
    from uniart_jax.visual.render import orbit_cameras, render

    if not settings.orbit_views:
        return b""
    cameras = orbit_cameras(settings.orbit_views)
    images = [
        np.rint(render(shown, camera, size=settings.orbit_size) * 255).astype(np.uint8)
        for camera in cameras
    ]
    return pack_orbit(np.stack(images), _angles(cameras), name)


def _angles(cameras: Sequence[Camera]) -> np.ndarray:
    rows = [(c.azimuth, c.elevation, c.fov_degrees, c.distance) for c in cameras]
    return np.array(rows, np.float32).reshape(-1, 4)


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    text = text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"
    return clean(text)[:MAX_TEXT]


def listed(repairs: Sequence[str]) -> str:
    """Repairs as one field of the manifest; of very many, the first and how many more there are."""
    text, shown = "", 0
    for shown, repair in enumerate(repairs):
        longer = f"{text} | {repair}" if text else repair
        if len(longer) > MAX_TEXT:
            return clean(f"{text} | and {len(repairs) - shown} more" if text else longer[:MAX_TEXT])
        text = longer
    return clean(text)
