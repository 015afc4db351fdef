"""Bent and slanted bars, as JSON and in a layout."""

import json

import numpy as np
import pytest

from uniart_jax.data.layout_renders import solids
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.tube_table import Tube, tube_from_json, tube_to_json

BENT = {"points": [[0.1, 0, 0], [0.3, 0, 0], [0.3, 0, 0.2]], "radius": 0.02}
BODY = {"parent": None, "box": {"center": [0, 0, 0], "size": [0.2, 0.2, 0.4]}}
SPIN = {"origin": [0, 0, 0], "direction": [0, 0, 1], "angle": [-1.6, 1.6]}


def read(row, units="object"):
    return Layout.from_json(
        json.dumps({"schema": 1, "units": units, "parts": [BODY, {"parent": 0} | row]})
    )


def test_its_box_is_around_it_and_json_keeps_it():
    layout = read({"tube": BENT})
    np.testing.assert_allclose(layout.boxes[1], [0.2, 0, 0.1, 0.24, 0.04, 0.24])
    again = Layout.from_json(layout.to_json())
    np.testing.assert_allclose(again.tubes[1].points, BENT["points"])
    assert again.tubes[0] is None and again.tubes[1].radius == 0.02
    np.testing.assert_allclose(again.boxes, layout.boxes, atol=1e-6)
    assert tube_from_json(None, "part 1") is None
    assert tube_to_json(layout.tubes[1]) == BENT


def test_it_turns_with_its_joint_and_is_scaled_with_its_layout():
    shown = read({"tube": BENT, "joint": SPIN | {"shown": np.pi / 2}}, "m")
    np.testing.assert_allclose(shown.tubes[1].points[1], [0, 0.3, 0], atol=1e-9)
    np.testing.assert_allclose(shown.boxes[1], [0, 0.2, 0.1, 0.04, 0.24, 0.24], atol=1e-9)
    unit, side = shown.normalized()
    np.testing.assert_allclose(unit.tubes[1].box, unit.boxes[1], atol=1e-9)
    assert unit.tubes[1].radius == pytest.approx(0.02 / side)
    assert shown.taken([0]).tubes == (None,)


def test_distances_are_those_of_capsules():
    tube = Tube(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]]), 0.1)
    places = np.array([[0.5, 0.3, 0], [-1, 0, 0], [1, 0.5, 0.05], [1.2, -0.2, 0]])
    expected = [0.2, 0.9, -0.05, np.hypot(0.2, 0.2) - 0.1]
    np.testing.assert_allclose(tube.distance(places), expected, atol=1e-6)
    point = Tube(np.zeros((2, 3)), 0.1)
    np.testing.assert_allclose(point.distance(places[1:2]), [0.9], atol=1e-6)


def test_its_picture_shows_bars():
    mesh = solids(read({"tube": BENT})).parts[1].mesh
    np.testing.assert_allclose(mesh.bounds, [[0.08, -0.02, -0.02], [0.32, 0.02, 0.22]], atol=1e-3)
    dot = solids(read({"tube": {"points": [[0.2, 0, 0]] * 2, "radius": 0.05}})).parts[1].mesh
    np.testing.assert_allclose(dot.extents, 0.1, atol=5e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"points": [[0, 0, 0]]}, "points must be 2 to 64"),
        ({"points": [[0, 0, 0], [0, 1]]}, "points must be 2 to 64"),
        ({"points": [[0, 0, 0], [0, 0, 7]]}, "of 3 numbers in -1..1"),
        ({"radius": 0}, "radius must be a number"),
        ({"radius": "wide"}, "radius must be a number"),
        ({"width": 1}, "no entry 'width'; there are points, radius"),
    ],
)
def test_bad_ones_are_refused_in_one_line(change, words):
    with pytest.raises(ValueError, match=f"part 1: tube: .*{words}"):
        read({"tube": BENT | change})
    with pytest.raises(ValueError, match="part 1: tube: give an object"):
        read({"tube": [1]})
    with pytest.raises(ValueError, match="part 1: a tube goes without boards and revolution"):
        read({"tube": BENT, "revolution": {"axis": "z"}})
