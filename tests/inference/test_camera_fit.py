"""The camera that sees a layout as a picture shows its object."""

import json

import numpy as np
import pytest

from uniart_jax.inference.camera_fit import _convex_pieces, fit_camera, outline, with_camera
from uniart_jax.voxels.camera_code import project
from uniart_jax.voxels.layout import Layout

CHEST = Layout.from_json(
    json.dumps(
        {
            "schema": 1,
            "parts": [
                {"parent": None, "box": {"center": [0, 0, -0.1], "size": [0.5, 1.0, 0.4]}},
                {
                    "parent": 0,
                    "box": {"center": [0.2, 0, 0.3], "size": [0.1, 0.9, 0.4]},
                    "joint": {"direction": [0, 1, 0], "angle": [-0.5, 0.5]},
                },
            ],
        }
    )
)
CORNERS = np.concatenate(_convex_pieces(CHEST))


def seen_from(azimuth: float, elevation: float, perspective: float = 0.33) -> np.ndarray:
    """A camera code by which the chest fills a crop, as ``data.images.crop`` cuts it."""
    code = np.array([np.sin(azimuth), np.cos(azimuth), elevation, 1.0, perspective, 0.0, 0.0])
    spots = project(code, CORNERS)
    low, high = spots.min(0), spots.max(0)
    code[3] = 2 / 1.1 / (high - low).max()
    code[5:] = code[3] * (low + high) / 2
    return code


@pytest.mark.parametrize(("azimuth", "elevation"), [(-0.6, 0.35), (0.3, 0.2), (0.9, 0.6)])
def test_the_camera_of_an_outline_is_found(azimuth, elevation):
    true = seen_from(azimuth, elevation)
    mask = outline(true, _convex_pieces(CHEST), 96)
    code, overlap = fit_camera(CHEST, mask)
    assert overlap > 0.97
    off = np.abs(project(code, CORNERS) - project(true, CORNERS)).max()
    assert off < 0.1  # of [-1, 1] across the crop


def test_a_guess_decides_where_outlines_agree_from_several_sides():
    cube = Layout.from_json(
        json.dumps(
            {"schema": 1, "parts": [{"parent": None, "box": {"center": [0] * 3, "size": [1] * 3}}]}
        )
    )
    pieces = _convex_pieces(cube)
    true = np.array([np.sin(0.7), np.cos(0.7), 0.3, 1.3, 0.33, 0.0, 0.0])
    mask = outline(true, pieces, 96)
    for azimuth in (0.7, 0.7 - np.pi / 2):
        near = azimuth + 0.15
        guess = np.array([np.sin(near), np.cos(near), 0.4, 1.0, 0.33, 0.0, 0.0])
        code, overlap = fit_camera(cube, mask, guess)
        assert overlap > 0.95
        assert abs(np.arctan2(code[0], code[1]) - azimuth) < 0.15


def test_a_layout_gets_the_camera_of_the_image_that_it_describes():
    true = seen_from(-0.5, 0.4)
    alpha = outline(true, _convex_pieces(CHEST), 200)
    image = np.zeros((260, 300, 4), np.uint8)  # the object lies anywhere in it
    image[20:220, 60:260, 3] = 255 * alpha
    camera = with_camera(CHEST, image).camera
    assert np.abs(project(camera, CORNERS) - project(true, CORNERS)).max() < 0.1


def test_the_camera_of_what_is_thinner_than_a_pixel_is_found():
    image = np.zeros((900, 900, 4), np.uint8)
    image[50:850, 450:452, 3] = 255
    pole = Layout.from_json(
        json.dumps(
            {
                "schema": 1,
                "parts": [
                    {
                        "parent": None,
                        "box": {"center": [0, 0, 0], "size": [0.002, 0.002, 1]},
                        "revolution": {"axis": "z"},
                    }
                ],
            }
        )
    )
    camera = with_camera(pole, image).camera
    ends = project(camera, np.array([[0, 0, -0.5], [0, 0, 0.5]]))
    assert abs(np.ptp(ends[:, 1]) - 2 / 1.1) < 0.1
