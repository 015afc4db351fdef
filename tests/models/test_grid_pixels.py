"""What cells of a dense grid read in pictures: the pixels before them, of their own item's views;
and the structure flow with it."""

import dataclasses

import jax
import numpy as np
import pytest
from copies import added
from toy import MODEL, build, flow_arguments, flow_table, flow_views, init

from uniart_jax.models.grid_pixels import POINTS
from uniart_jax.models.image_encoder import silhouette
from uniart_jax.nn.embeddings import grid_coords
from uniart_jax.nn.lifting import project

SIDE = 2  # of the toy's latent
CHANNELS = 4


def reading(**changes):
    flow = dataclasses.replace(MODEL.structure_flow, **{"pixel_channels": CHANNELS, **changes})
    return dataclasses.replace(MODEL, structure_flow=flow)


@pytest.fixture(scope="module")
def network():
    return build("structure_flow", reading(layout_channels=6))


@pytest.fixture(scope="module")
def read(network):
    return jax.jit(lambda params, *views: network.apply(params, *views, method="read_pictures"))


@pytest.fixture(scope="module")
def params(network):
    return init(network)


def test_cells_read_the_map_where_the_camera_sees_their_points(read, params):
    pixels, cameras = jax.device_get(flow_views(1))
    row, column = 2, 5
    change = np.asarray(read(params, added(pixels, (0, 0, row, column), 2), cameras))
    change = np.abs(change - read(params, pixels, cameras))
    assert not change[1].any()
    fine = POINTS * SIDE
    points = ((grid_coords(fine) + 0.5) / fine - 0.5).astype(np.float32)
    places = np.asarray(project(cameras[:1, 0], points)[0])[0]
    place = np.clip((places + 1) * (pixels.shape[2] / 2) - 0.5, 0, pixels.shape[2] - 1)
    near = (np.abs(place - [column, row]) < 1).all(-1).reshape((SIDE, POINTS) * 3)
    near = near.transpose(0, 2, 4, 1, 3, 5).reshape(*(SIDE,) * 3, -1)
    assert near.any() and not near.all()
    read_points = change[0][..., : POINTS**3 * CHANNELS]
    moved = read_points.reshape(*near.shape, CHANNELS).max(-1) > 0
    np.testing.assert_array_equal(moved, near)


def test_voxels_read_the_silhouette_where_the_camera_sees_them(read, params):
    pixels, cameras = jax.device_get(flow_views(1))
    size = pixels.shape[2]
    pixels = np.full_like(pixels, -1)  # black
    pixels[0, 0, :, size // 2 :] = -0.5
    shown = np.asarray(read(params, pixels, cameras))[..., POINTS**3 * CHANNELS :]
    assert not shown[1].any()
    inner = MODEL.grid.resolution // SIDE
    voxels = ((grid_coords(MODEL.grid.resolution) + 0.5) / (inner * SIDE) - 0.5).astype("f4")
    right = np.asarray(project(cameras[:1, 0], voxels)[0])[0, :, 0].reshape((SIDE, inner) * 3)
    right = right.transpose(0, 2, 4, 1, 3, 5).reshape(shown[0].shape)
    pixel = 2 / (size * MODEL.image_encoder.stem_stride)
    assert (shown[0][right > pixel] > 0.999).all() and not shown[0][right < -pixel].any()
    assert (right > pixel).any() and (right < -pixel).any()


def test_views_are_averaged_and_no_picture_is_read_as_zeros(read, params):
    pixels, cameras = jax.device_get(flow_views(2))
    both = np.asarray(read(params, pixels, cameras))
    np.testing.assert_allclose(read(params, pixels[:, ::-1], cameras[:, ::-1]), both, atol=1e-5)
    nothing = read(params, pixels, np.zeros_like(cameras))
    np.testing.assert_array_equal(nothing, read(params, np.zeros_like(pixels), 0 * cameras))
    assert np.abs(both - nothing).max() > 1e-3
    assert not np.asarray(nothing)[..., POINTS**3 * CHANNELS :].any()


def test_the_silhouette_is_what_is_not_black():
    side = 2
    picture = np.zeros((4, 4, 3), np.float32)
    picture[1, 2] = [0, 1 / 255, 0]
    blocks = (picture * 2 - 1).reshape(2, side, 2, side, 3).transpose(0, 2, 1, 3, 4)
    shown = silhouette(blocks.reshape(2, 2, -1), side)
    np.testing.assert_array_equal(shown[..., 0], picture.max(-1) > 0)


def test_the_structure_flow_begins_as_without_pixels_and_then_sees_its_own_items(network, params):
    tokens, volume, t = flow_arguments(2)
    x = np.random.default_rng(1).normal(size=(4, SIDE, SIDE, SIDE, 3)).astype(np.float32)
    pixels, cameras = jax.device_get(flow_views())

    @jax.jit
    def run(params, pixels):
        given = {"views": (pixels, cameras), "layout": flow_table()}
        return network.apply(params, x, t, tokens, volume, **given)

    def begin(key):  # of what is asked for alone
        return {k: network.init(key)[k] for k in ("grid_pixels", "pixel_cube", "pixel_cell")}

    before = params | jax.jit(begin)(jax.random.key(0))
    without = build("structure_flow", reading(layout_channels=6, pixel_channels=0))
    apply = jax.jit(lambda p: without.apply(p, x, t, tokens, volume, layout=flow_table()))
    same = apply({k: v for k, v in params.items() if "pixel" not in k})
    np.testing.assert_allclose(run(before, pixels), same, atol=1e-5)
    moved = np.abs(run(params, added(pixels, (1,), 1)) - run(params, pixels))
    assert not moved[:2].any() and moved[2:].max() > 1e-4  # two draws of each item


def test_it_says_what_it_needs(network, params):
    tokens, volume, t = flow_arguments()
    x = np.zeros((2, SIDE, SIDE, SIDE, 3), np.float32)
    with pytest.raises(ValueError, match=r"pixel_channels > 0\); pass views=\(pixels"):
        jax.eval_shape(
            lambda p: network.apply(p, x, t, tokens, volume, layout=flow_table()), params
        )
    dino = dataclasses.replace(MODEL.image_encoder, architecture="dinov2")
    with pytest.raises(ValueError, match="structure_flow: pixel_channels needs"):
        build("structure_flow", dataclasses.replace(reading(), image_encoder=dino)).abstract()
