"""The table of parts as text that people edit, and the layout that an edited text asks for.

What a picture's table says is rounded and told row by row, the root first, parents by name. A text
that says the same is the layout that was read, with its certainty; any other is followed as it is,
but that

- boards, outlines, legs and panels that were left as they are go along with a box that was changed;
- parts that were added get the boards that such parts usually have;
- names that the page gave are given anew, by what the parts are now.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from uniart_jax.app.part_words import part_kinds_of, root_first
from uniart_jax.export.naming import BASE, is_made_up, reading_order
from uniart_jax.inference.answers import find_json, read_answer
from uniart_jax.voxels.closed_pose import closing_of
from uniart_jax.voxels.layout import ROOT, Layout
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import SMALLEST, Revolution
from uniart_jax.voxels.usual_boards import with_usual_boards

LONGEST = 200_000  # characters of a text
DIGITS = 4
SMALLEST_OBJECT = 1e-6  # of a table's lengths, that one side is at least
REACH = 1.0  # object units from the middle that boxes of a picture's object may reach
OTHER_LENGTHS = "with a picture lengths are object units: its longest side is 1, its middle 0"


def table_text(layout: Layout) -> str:
    """A layout as JSON (``voxels.layout``) for people: a part a line, its boards and its outline on
    lines of their own, without what is null."""
    layout = root_first(layout)
    layout = dataclasses.replace(layout, names=layout.names or tuple(_names(layout)))
    data = _short(json.loads(layout.to_json()))
    parts, other = data.pop("parts"), ("boards", "revolution", "tube")
    lines = [
        f'"{name}": {_line(data[name])}'
        for name in ("schema", "frame", "camera", "size")
        if data[name]
    ]
    rows = []
    for row in parts:
        if row["parent"] is not None:
            row["parent"] = parts[row["parent"]]["name"]
        joint = row["joint"]
        spans = {name: joint.pop(name) for name in ("angle", "travel")}
        row["joint"] = {**joint, **{name: ends for name, ends in spans.items() if any(ends)}}
        if joint["type"] == "fixed" or not {"angle", "travel"} & set(row["joint"]):
            row["joint"] = {"type": "fixed"}
        if "tube" in row:
            del row["box"]
        kept = {name: value for name, value in row.items() if name not in other}
        further = [f'"{name}": {_line(row[name])}' for name in other if row.get(name)]
        rows.append(",\n    ".join([_line(kept)[:-1], *further]) + "}")
    lines.append('"parts": [\n  ' + ",\n  ".join(rows) + "\n ]")
    lines += [f'"{name}": {_line(data[name])}' for name in ("legs", "panels") if data[name]]
    return "{\n " + ",\n ".join(lines) + "\n}"


def followed_layout(text: Any, read: Layout | None) -> Layout:
    """The layout that is followed: ``read`` itself where the text is empty or says the same, else
    that of the text, of no certainty, with the camera of ``read`` unless it tells another.

    Args:
      read: what was read off the picture; None where there is no picture, or nothing was read.

    Raises:
      ValueError: one line that says what is wrong with the text.
    """
    if not isinstance(text, str | None):
        raise ValueError("table: give a text")
    text = text or ""
    if len(text) > LONGEST:
        raise ValueError(f"table: {len(text):,} characters; {LONGEST:,} are the most")
    if read is not None and (not text.strip() or is_unchanged(text, read)):
        return read
    if not text.strip():
        raise ValueError("table: it is empty; paste one, or take an example")
    if read is None and is_told(text) and not _is_plain(text):
        return read_answer(text)[0]
    layout = dataclasses.replace(Layout.from_json(text), certainty=None)
    if read is None:
        if layout.boxes[:, 3:].max() < SMALLEST_OBJECT:
            raise ValueError(f"table: no box is longer than {SMALLEST_OBJECT:g}")
        return layout
    reach = (np.abs(layout.boxes[:, :3]) + layout.boxes[:, 3:] / 2).max(1)
    if reach.max() > REACH:
        name = layout.name(int(reach.argmax()))
        raise ValueError(f"table: {name!r} reaches {reach.max():.3g} far; {OTHER_LENGTHS}")
    return _taken_along(layout, read)


def is_told(text: Any) -> bool:
    """Whether a text tells an object anew, as a vision-language model's answer does, and is no
    table that was read and edited: lengths are metres, or it says where the camera stands."""
    if not isinstance(text, str) or len(text) > LONGEST:
        return False
    try:
        data = find_json(text)
    except ValueError:
        return False
    return "view" in data or data.get("units") == "m"


def _is_plain(text: str) -> bool:
    """Whether a text is a layout's JSON and nothing else."""
    try:
        return "view" not in json.loads(text)
    except (ValueError, RecursionError):
        return False


def is_unchanged(text: str, read: Layout) -> bool:
    """Whether a text says what ``table_text`` says of a layout, however it is laid out."""
    try:
        return json.loads(text) == json.loads(table_text(read))
    except (ValueError, RecursionError):
        return False


def _names(layout: Layout) -> Iterator[str]:
    """What rows are called, the root first: by what they are, counted as one reads the front."""
    kinds, counts = part_kinds_of(layout), dict[str, int]()
    names = {0: BASE}
    for k in reading_order(layout.to_object())[1:]:
        counts[kinds[k]] = counts.get(kinds[k], 0) + 1
        names[k] = f"{kinds[k]}_{counts[kinds[k]]}"
    return (names[k] for k in range(len(layout)))


def _short(value: Any) -> Any:
    """JSON with rounded numbers, whole ones without a point."""
    if isinstance(value, dict):
        return {name: _short(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_short(one) for one in value]
    if isinstance(value, float):
        value = round(value, DIGITS)
        return int(value) if value == int(value) else value
    return value


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _taken_along(layout: Layout, read: Layout) -> Layout:
    """An edited layout with all that goes along with its boxes (the module's docstring)."""
    shown = Layout.from_json(table_text(read))  # with the text's roundings and names
    boards, outlines, names = [], [], []
    straight, as_read = (_is_straight(one) for one in (layout, shown))
    usual = with_usual_boards(dataclasses.replace(layout, boards=())).boards
    for k, box in enumerate(layout.boxes):
        own = layout.boards[k] if layout.boards else None
        if (j := _row_with(own, shown.boards)) is not None and own is not None:
            sound = (straight[k] and as_read[j]) or np.array_equal(box, shown.boxes[j])
            own = _moved_panels(own, shown.boxes[j], box) if sound else None
        is_new = layout.name(k) not in shown.names and not (shown.boxes == box).all(1).any()
        if own is None and is_new and usual:
            own = usual[k]
        boards.append(own)
        round_ = layout.revolutions[k] if layout.revolutions else None
        if (j := _row_with(round_, shown.revolutions)) is not None and round_ is not None:
            round_ = _moved_outline(round_, shown.boxes[j], box)
        outlines.append(round_)
        name = layout.name(k)
        names.append(f"part_{k}" if name in shown.names or is_made_up(name) else name)
    old, new = (one.boxes[one.parents.index(ROOT)] for one in (shown, layout))
    legs, panels = layout.legs, layout.panels
    if legs is not None and _same(legs, shown.legs):
        legs = _moved_legs(legs, old, new)
    if panels is not None and _same(panels, shown.panels):
        panels = _moved_panels(panels, old, new)
    camera, told = layout.camera, shown.camera
    if camera is None or (told is not None and np.array_equal(camera, told)):
        camera = read.camera
    return dataclasses.replace(
        layout,
        boards=tuple(boards) if any(own is not None for own in boards) else (),
        revolutions=tuple(outlines) if any(own is not None for own in outlines) else (),
        names=() if all(is_made_up(name) for name in names) else tuple(names),
        legs=legs,
        panels=panels,
        camera=camera,
    )


def _is_straight(layout: Layout) -> np.ndarray:
    """[K] parts that lie closed: of others boards do not lie in their boxes."""
    closing = closing_of(layout.joints, layout.boxes, layout.parents)
    return (closing == np.eye(3, 4)).all((1, 2))


def _row_with(one: Any, rows: tuple[Any, ...]) -> int | None:
    """The row of a table that holds the same boards or the same outline."""
    if one is None:
        return None
    return next((j for j, other in enumerate(rows) if _same(one, other)), None)


def _same(one: Any, other: Any) -> bool:
    """Whether two tables of a layout hold the same numbers."""
    if type(one) is not type(other):
        return False
    return all(
        np.array_equal(getattr(one, field.name), getattr(other, field.name))
        for field in dataclasses.fields(one)
    )


def _moved(points: np.ndarray, old: np.ndarray, new: np.ndarray, axes: list[int]) -> np.ndarray:
    """Coordinates along some axes that go with a box [6] as it becomes another."""
    size = [3 + axis for axis in axes]
    return new[axes] + (points - old[axes]) * (new[size] / old[size])


def _moved_panels(panels: Panels, old: np.ndarray, new: np.ndarray) -> Panels:
    return dataclasses.replace(panels, boxes=_moved(panels.boxes, old, new, [0, 1, 2, 0, 1, 2]))


def _moved_legs(legs: Legs, old: np.ndarray, new: np.ndarray) -> Legs:
    lower, upper = (_moved(ends, old, new, [0, 1, 0, 1]) for ends in (legs.lower, legs.upper))
    heights = _moved(legs.heights, old, new, [2, 2])
    return dataclasses.replace(legs, lower=lower, upper=upper, heights=heights)


def _moved_outline(outline: Revolution, old: np.ndarray, new: np.ndarray) -> Revolution:
    """Followed as it is where the box is another."""
    if np.array_equal(old, new):
        return outline
    across = [axis for axis in range(3) if axis != outline.axis]
    size = [3 + axis for axis in across]
    radii = np.maximum(outline.radii * (new[size] / old[size]).mean(), SMALLEST)
    center = _moved(outline.center, old, new, across)
    return dataclasses.replace(outline, center=center, radii=radii, estimate=False)
