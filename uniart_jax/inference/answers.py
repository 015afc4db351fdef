"""What a vision-language model answers to ``layout_prompt.md``: a layout, and where the camera
stands."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np

from uniart_jax.voxels.json_rows import check_names, json_numbers
from uniart_jax.voxels.layout import MOST_PARTS, SCHEMA, Layout

VIEW = ("azimuth", "elevation")
THINNEST = 1e-3  # object units, of a side of a box
STARTS = 200  # braces of a text at which its JSON may begin


def read_answer(text: str, most: int = MOST_PARTS) -> tuple[Layout, tuple[float, float] | None]:
    """The layout in an answer, with or without words around it, in object units, as the picture
    shows it, with its size; and azimuth and elevation of the camera, radians, or None. ``most``:
    parts that it may have.

    Raises:
      ValueError: one line that says what is wrong.
    """
    data = {"schema": SCHEMA, "units": "m"} | find_json(text)
    view = _view(data.pop("view", None))
    told = Layout.from_json(json.dumps(data))
    if len(told) > most:
        raise ValueError(f"layout: {len(told)} parts; give {most} at most")
    layout, side = told.normalized()
    boxes = layout.boxes.copy()
    boxes[:, 3:] = np.maximum(boxes[:, 3:], THINNEST)
    return dataclasses.replace(layout, boxes=boxes, size=side if told.metres else told.size), view


def find_json(text: str) -> dict[str, Any]:
    """The first JSON object that has parts, in any text.

    Raises:
      ValueError: there is none.
    """
    decoder, at = json.JSONDecoder(), text.find("{")
    problem = "there is no JSON object"
    for _ in range(STARTS):
        if at < 0:
            break
        try:
            data, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError) as error:
            problem = f"not valid JSON ({error})" if '"parts"' in text[at:] else problem
            end = at + 1
        else:
            if isinstance(data, dict) and "parts" in data:
                return data
        at = text.find("{", end)
    raise ValueError(f"layout: {problem}")


def _view(data: Any) -> tuple[float, float] | None:
    if data is None:
        return None
    if not isinstance(data, dict):
        raise ValueError('layout: view: give an object with "azimuth" and "elevation", degrees')
    check_names(data, VIEW, "layout: view")
    azimuth, elevation = (json_numbers({n: [data.get(n)]}, n, 1, "layout: view")[0] for n in VIEW)
    if not (abs(azimuth) <= 360 and abs(elevation) <= 90):
        raise ValueError(f"layout: view: {azimuth:g}, {elevation:g} are no degrees of a camera")
    return math.remainder(math.radians(azimuth), 2 * math.pi), math.radians(elevation)
