import jax
import jax.numpy as jnp
import numpy as np
import scipy.ndimage
from copies import replaced

from uniart_jax.data.cameras import camera_codes, mirror_camera_codes
from uniart_jax.data.images import MARGIN
from uniart_jax.nn import lifting
from uniart_jax.nn.lifting import sample_map_dense
from uniart_jax.visual.render import sample_camera

SIZE = 64
project, sample_map = jax.jit(lifting.project), jax.jit(lifting.sample_map)
hidden_depth = jax.jit(lifting.hidden_depth, static_argnums=3)
read_pixels = jax.jit(lifting.read_pixels, static_argnums=4)


def _seen(rng, rows, columns):
    """A camera, the code of its picture whose foreground spans these pixels, and the crop's corner
    and side."""
    camera = sample_camera(rng)
    image = np.zeros((1, SIZE, SIZE, 4), np.uint8)
    image[0, slice(*rows), slice(*columns), 3] = 255
    angles = [[camera.azimuth, camera.elevation, camera.fov_degrees, camera.distance]]
    side = max(np.ptp(rows), np.ptp(columns)) * MARGIN
    corner = np.array([np.mean(columns), np.mean(rows)]) - side / 2
    return camera, camera_codes(np.array(angles), image), corner, side


def test_project_agrees_with_the_renderers_camera_after_the_crop():
    rng = np.random.default_rng(0)
    for rows, columns in [((3, 50), (20, 41)), ((10, 30), (5, 64)), ((0, 64), (0, 64))]:
        camera, code, corner, side = _seen(rng, rows, columns)
        points = rng.uniform(-0.5, 0.5, (50, 3))
        expected = (camera.project(points, SIZE) - corner) / side * 2 - 1
        places, depth = project(code, np.float32(points))
        np.testing.assert_allclose(places[0], expected, atol=2e-5)
        np.testing.assert_allclose(depth[0], (points @ camera.matrix()[:3, :3].T)[:, 2], atol=1e-5)


def test_mirrored_code_sees_the_mirrored_point_in_the_flipped_place():
    _, code, _, _ = _seen(np.random.default_rng(1), (3, 50), (20, 41))
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3)).astype(np.float32)
    places, depth = project(code, points)
    mirrored = points * np.float32([1, -1, 1])
    flipped, same = project(mirror_camera_codes(code), mirrored)
    np.testing.assert_allclose(flipped, np.asarray(places) * [-1, 1], atol=1e-6)
    np.testing.assert_allclose(same, depth, atol=1e-6)


def test_a_code_of_no_length_and_a_point_behind_the_camera_stay_finite():
    code = np.array([[0, 0, 0, 1.6, 5.0, 0, 0]], np.float32)
    points = np.float32([[0.5, 0.5, 0.5], [-0.5, 0.5, 0.0]])
    value, gradient = jax.jit(jax.value_and_grad(lambda c: project(c, points)[0].sum()))(code)
    assert np.isfinite(value) and np.isfinite(gradient).all()


def test_sample_map_interpolates_rows_and_columns():
    rng = np.random.default_rng(3)
    features = rng.normal(size=(2, 6, 6, 3)).astype(np.float32)
    places = rng.uniform(-1.3, 1.3, (2, 40, 2)).astype(np.float32)
    found = np.asarray(sample_map(features, places))
    for b in range(2):
        x, y = (places[b].T + 1) * 3 - 0.5
        for c in range(3):
            expected = scipy.ndimage.map_coordinates(
                features[b, :, :, c], [y, x], order=1, mode="nearest"
            )
            np.testing.assert_allclose(found[b, :, c], expected, atol=1e-5)


def test_a_product_with_weights_is_sample_map_by_other_means():
    """Its values and both gradients; what is beyond the border moves nothing."""
    rng = np.random.default_rng(4)
    features = rng.normal(size=(2, 6, 6, 3)).astype(np.float32)
    places = rng.uniform(-1.3, 1.3, (2, 40, 2)).astype(np.float32)
    tangent = rng.normal(size=(2, 40, 3)).astype(np.float32)

    def both(function):
        run = lambda *given: (jax.vjp(function, *given)[1](tangent), function(*given))  # noqa: E731
        return jax.tree.leaves(jax.jit(run)(features, places))

    for found, expected in zip(both(lifting.sample_map), both(sample_map_dense), strict=True):
        np.testing.assert_allclose(found, expected, atol=2e-5)


def test_half_precision_maps_are_read_in_half_precision():
    features, places = jnp.ones((1, 4, 4, 2), jnp.bfloat16), jnp.zeros((1, 3, 2), jnp.float32)
    assert jax.eval_shape(lifting.sample_map, features, places).dtype == jnp.bfloat16


def test_hidden_depth_is_measured_from_the_foremost_valid_point_of_the_same_cell():
    places = np.float32([[-0.9, -0.9], [-0.6, -0.7], [-0.9, 0.9], [0.9, -0.9], [-0.8, -0.8]])
    depth = np.float32([0.3, 0.1, 0.5, -0.2, -5.0])
    valid = np.array([True, True, True, True, False])
    found = hidden_depth(places, depth, valid, 2)
    np.testing.assert_allclose(found, [0.2, 0, 0, 0, 0], atol=1e-6)


def test_only_points_that_hide_others_are_the_front():
    places = np.float32([[-0.9, -0.9], [-0.6, -0.7], [-0.9, -0.8], [0.9, 0.9]])
    depth = np.float32([0.3, 0.1, 0.5, 0.2])
    valid = np.array([True, True, True, True])
    found = hidden_depth(places, depth, valid, 2, np.array([True, False, False, False]))
    np.testing.assert_allclose(found, [0, -0.2, 0.2, -np.inf], atol=1e-6)


def _pixels(views=3, width=64):
    rng = np.random.default_rng(5)
    coords = np.zeros((2, width, 3), np.int32)
    counts = np.array([50, 31], np.int32)
    for b, n in enumerate(counts):
        coords[b, :n] = rng.integers(0, 8, (n, 3))
    codes = [_seen(rng, (3, 50), (20, 41))[1][0] for _ in range(2 * views)]
    cameras = np.reshape(codes, (2, views, 7)).astype(np.float32)
    maps = rng.normal(size=(2, views, 16, 16, 4)).astype(np.float32)
    return maps, cameras, coords, counts


def test_voxels_read_the_picture_where_the_camera_sees_them():
    """A map that holds its own coordinates gives back the projection of each voxel's centre."""
    _, cameras, coords, counts = _pixels()
    side = (np.arange(16) + 0.5) / 8 - 1
    x, y = np.meshgrid(side, side)
    maps = np.broadcast_to(np.float32(np.stack([x, y], -1)), (2, 3, 16, 16, 2))
    read = np.asarray(read_pixels(maps, cameras, coords, counts, 8))
    assert read.shape == (2, 3, 64, 3)
    for b, n in enumerate(counts):
        centers = np.float32((coords[b, :n] + 0.5) / 8 - 0.5)
        places, depth = jax.device_get(project(cameras[b], centers))
        np.testing.assert_allclose(
            read[b, :, :n, :2], np.clip(places, -15 / 16, 15 / 16), atol=1e-5
        )
        for view in range(3):
            behind = np.asarray(hidden_depth(places[view], depth[view], np.ones(n, bool), 16))
            assert behind.max() > 0.02
            np.testing.assert_allclose(read[b, view, :n, 2], np.tanh(behind * 2), atol=1e-5)


def test_reading_pixels_knows_no_padding_and_no_view_without_a_camera():
    maps, cameras, coords, counts = _pixels()
    unseen = cameras.copy()

    def run(*given):
        return np.asarray(read_pixels(*given))

    unseen[1, 2] = 0
    read = run(maps, unseen, coords, counts, 8)
    assert not read[1, 2].any() and read[1, 1].any()
    whole = run(maps, cameras, coords, counts, 8)
    everywhere = np.tile(np.argwhere(np.ones((8, 8, 8))), (2, 1, 1)).astype(np.int32)
    for b, n in enumerate(counts):  # padding before every voxel, as seen from anywhere
        filled = np.concatenate([coords[:, :n], everywhere], 1)
        padded = run(maps, cameras, filled, replaced(counts, b, n), 8)
        hidden = run(maps, cameras, filled, np.full(2, n + 512, np.int32), 8)
        np.testing.assert_allclose(padded[b, :, :n], whole[b, :, :n], atol=1e-6)
        assert np.abs(hidden[b, :, :n, -1] - whole[b, :, :n, -1]).max() > 0.1


def test_no_gradient_reaches_maps_and_cameras():
    maps, cameras, coords, counts = _pixels()
    total = jax.grad(lambda *a: read_pixels(*a, coords, counts, 8).sum(), (0, 1))
    found = jax.jit(total)(maps, cameras)
    assert not any(np.asarray(g).any() for g in found)
