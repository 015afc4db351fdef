"""Solids of revolution as a network and JSON tell of them."""

import json

import numpy as np
import pytest

from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.revolution_table import (
    RADII,
    Revolution,
    read_revolution,
    revolution_from_json,
    revolution_rows,
    revolution_to_json,
)

BOX = np.array([0, 0, 0, 0.5, 0.5, 0.5])
ROUND = Revolution(1, np.array([0.1, -0.2]), np.linspace(0.1, 0.2, RADII))


def outputs(axis=(0.0, 0, 3, 0)):
    return {
        "round_axis": np.array([np.zeros(4), axis]),
        "round_centers": np.tile(np.arange(3.0)[:, None], (2, 1, 2)) / 10,
        "round_radii": np.tile(np.arange(1, 4.0)[:, None], (2, 1, RADII)) / 10,
    }


def test_the_likeliest_axis_is_read_where_a_part_is_probably_round():
    found = read_revolution(outputs(), 1)
    assert found.axis == 1
    np.testing.assert_array_equal(found.center, 0.1)
    np.testing.assert_array_equal(found.radii, 0.2)
    assert found.estimate


def test_no_axis_alone_need_be_probable():
    assert read_revolution(outputs((0, 1.0, 1.1, 0.9)), 1).axis == 1


@pytest.mark.parametrize("axis", [(0, 0, 0, 0.9), (0.0, 0, -9, -9), (9, 0, 8, 0)])
def test_what_is_hardly_round_is_none(axis):
    """The first two are round with .81 and .5."""
    found = read_revolution(outputs(axis), 1, threshold=0.85)
    assert found is None


def test_nonsense_is_none_and_radii_are_in_bounds():
    out = outputs()
    out["round_radii"][1, 1] = [-1.0, 7, *[0.1] * (RADII - 2)]
    assert read_revolution(out, 1).radii[:3].tolist() == [0.002, 1.0, 0.1]
    out["round_centers"][1, 1] = np.nan
    assert read_revolution(out, 1) is None


def test_radii_lie_at_the_middles_of_layers_and_go_on_at_the_ends():
    two = Revolution(2, np.zeros(2), np.array([0.1, 0.2]))
    np.testing.assert_allclose(
        two.radius(np.array([0, 0.25, 0.5, 0.75, 1])), [0.1, 0.1, 0.15, 0.2, 0.2]
    )


def test_rows_of_a_table():
    rows = revolution_rows([None, ROUND], 3)
    assert not rows[0].any() and not rows[2].any()
    np.testing.assert_allclose(rows[1], [2, *ROUND.center, *ROUND.radii], rtol=1e-6)


def test_json_round_trip_with_the_layout(layout_of_two):
    text = layout_of_two.to_json()
    assert json.loads(text)["parts"][0]["revolution"] is None
    back = Layout.from_json(text)
    assert back.revolutions[0] is None
    assert back.revolutions[1].axis == ROUND.axis
    np.testing.assert_allclose(back.revolutions[1].radii, ROUND.radii, atol=1e-6)
    assert "revolutions" in repr(back)
    with pytest.raises(ValueError, match="part 0: no entry 'else'; there are name, parent, box"):
        Layout.from_json(text.replace('"revolution"', '"else"'))


def test_json_tells_an_estimate_from_an_outline_to_follow():
    assert "estimate" not in revolution_to_json(ROUND)
    told = revolution_to_json(read_revolution(outputs(), 1))
    assert revolution_from_json(told, "part 1", BOX).estimate
    assert not revolution_from_json(told | {"estimate": False}, "part 1", BOX).estimate


@pytest.fixture
def layout_of_two():
    plain = {"angle": [0, 0], "travel": [0, 0]}
    part = {"box": {"center": [0, 0, 0], "size": [0.5, 0.5, 0.5]}, "joint": plain}
    rows = [part | {"parent": None}, part | {"parent": 0, "revolution": revolution_to_json(ROUND)}]
    return Layout.from_json(json.dumps({"schema": 1, "parts": rows}))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axis": "w"}, '"axis": "x", "y" or "z"'),
        ({"axis": 1}, '"axis": "x", "y" or "z"'),
        ({"center": [0.1]}, "center must be 2 numbers"),
        ({"center": [0.1, float("nan")]}, "center must be 2 numbers"),
        ({"radii": []}, "radii must be 1 to 256 numbers"),
        ({"radii": [0.1, -0.1]}, "radii must be 1 to 256 numbers"),
        ({"radii": [0.1] * 257}, "radii must be 1 to 256 numbers"),
        ({"radii": "0.1"}, "radii must be 1 to 256 numbers"),
        ({"estimate": 1}, "estimate must be true or false"),
    ],
)
def test_bad_ones_are_refused_in_one_line(change, words):
    with pytest.raises(ValueError, match="part 3: revolution: ") as caught:
        revolution_from_json(revolution_to_json(ROUND) | change, "part 3", BOX)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="give an object"):
        revolution_from_json([1], "part 3", BOX)
