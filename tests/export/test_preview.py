"""Previews: tiles, the view of the input image, and a small looping GIF."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from PIL import Image

from uniart_jax.data.cameras import camera_codes
from uniart_jax.export import preview
from uniart_jax.export.preview import (
    TILE,
    choose_view,
    read_image,
    view_of_code,
    write_motion,
    write_preview,
)
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.render import FRONT_LEFT, Camera, fit, render


@pytest.fixture(scope="module")
def shown(cabinet):
    return cabinet.normalized()


def picture(obj, azimuth: float, elevation: float) -> Image.Image:
    camera = fit(obj, Camera(np.deg2rad(azimuth), np.deg2rad(elevation), 35), margin=1.3)
    return Image.fromarray((render(obj, camera, 96) * 255).astype(np.uint8))


@pytest.mark.parametrize("azimuth", [-40, 0, 25])
def test_the_view_is_that_of_the_image(shown, azimuth):
    view = choose_view(shown, picture(shown, azimuth, 22))
    assert abs(np.rad2deg(view.azimuth) - azimuth) <= 10
    assert abs(np.rad2deg(view.elevation) - 22) <= 14


@pytest.mark.parametrize(("azimuth", "elevation"), [(-140.0, -20.0), (35.0, 60.0)])
def test_a_known_camera_is_the_view(azimuth, elevation):
    angles, image = np.deg2rad([azimuth, elevation]), np.full((1, 8, 8, 4), 255, np.uint8)
    (code,) = camera_codes(np.array([[*angles, 35, 2]]), image)
    view = view_of_code(code)
    assert np.allclose([view.azimuth, view.elevation], angles, atol=1e-6)
    assert view.fov_degrees == FRONT_LEFT.fov_degrees
    assert np.rad2deg(view_of_code(np.array([0, 1, 1.7, 1, 1, 0, 0])).elevation) < 90


def test_a_large_image_is_looked_at_small(shown, monkeypatch):
    seen = []
    cropped = preview._cropped
    monkeypatch.setattr(preview, "_cropped", lambda p: (seen.append(p.shape), cropped(p))[1])
    image = picture(shown, 25, 22).resize((2000, 1500))
    before = image.tobytes()
    choose_view(shown, image)
    assert seen[0] == (192, 256, 4)
    assert image.size == (2000, 1500) and image.tobytes() == before


def test_an_image_without_transparency_gives_the_default_view(shown):
    assert choose_view(shown, picture(shown, 30, 20).convert("RGB")) == FRONT_LEFT
    assert choose_view(shown, None) == FRONT_LEFT
    assert choose_view(shown, Image.new("RGBA", (50, 50))) == FRONT_LEFT


def test_preview_shows_the_object_opened(shown, tmp_path):
    image = picture(shown, -30, 20)
    path = write_preview(shown, tmp_path / "preview.png", image, FRONT_LEFT)
    sheet = np.asarray(Image.open(path).convert("RGB")).astype(int)
    assert sheet.shape[1] > 4 * TILE
    tiles = np.split(sheet[:, : sheet.shape[1] // 4 * 4], 4, axis=1)
    background = sheet[0, 0]
    for tile in tiles:
        covered = (np.abs(tile - background).max(-1) > 8).mean()
        assert 0.1 < covered < 0.9
    assert np.abs(tiles[1] - tiles[2]).mean() > 2  # open is not rest
    assert np.abs(tiles[2] - tiles[3]).mean() > 2  # parts are not textures
    # nothing touches the frame: the border of every tile is background
    assert (np.abs(sheet[-4:] - background).max(-1) <= 8).all()


def test_motion_is_small_and_loops(shown, tmp_path):
    path = write_motion(shown, tmp_path / "motion.gif", FRONT_LEFT)
    assert path.stat().st_size < 1_000_000
    with Image.open(path) as gif:
        assert 16 <= gif.n_frames <= 24
        assert gif.size == (256, 256)
        assert gif.info["loop"] == 0
        first = np.asarray(gif.convert("RGB")).astype(int)
        gif.seek(gif.n_frames // 2)
        middle = np.asarray(gif.convert("RGB")).astype(int)
    assert np.abs(first - middle).mean() > 2


def test_an_object_that_cannot_move_has_no_motion(shown, tmp_path):
    alone = ArticulatedObject((dataclasses.replace(shown.parts[0]),))
    assert write_motion(alone, tmp_path / "motion.gif", FRONT_LEFT) is None
    assert not (tmp_path / "motion.gif").exists()
    write_preview(alone, tmp_path / "preview.png", None, FRONT_LEFT)


@pytest.mark.parametrize("size", [(1, 1), (1, 900), (2000, 3)])
@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P", "CMYK", "I;16"])
def test_any_image_makes_a_tile(shown, tmp_path, size, mode, monkeypatch):
    monkeypatch.setattr(preview, "TILE", 32)
    image = Image.new(mode, size)
    view = choose_view(shown, image)
    alone = ArticulatedObject((dataclasses.replace(shown.parts[0]),))
    write_preview(alone, tmp_path / "preview.png", image, view)


def test_read_image_takes_paths_arrays_and_pictures(tmp_path):
    array = np.random.default_rng(0).random((5, 7, 4))
    picture = read_image(array)
    assert picture.size == (7, 5) and picture.mode == "RGBA"
    picture.save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png").size == (7, 5)
    (tmp_path / "b.png").write_text("no image")
    for bad in (tmp_path / "b.png", tmp_path / "absent.png", np.zeros((4, 4))):
        with pytest.raises(ValueError, match="preview") as error:
            read_image(bad)
        assert "\n" not in str(error.value)
