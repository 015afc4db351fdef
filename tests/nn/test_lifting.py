import jax
import jax.numpy as jnp
import numpy as np
import scipy.ndimage

from uniart_jax.data.cameras import camera_codes, mirror_camera_codes
from uniart_jax.data.images import MARGIN
from uniart_jax.nn.lifting import project, sample_map
from uniart_jax.render import sample_camera

SIZE = 64


def _seen(rng, rows, columns):
    """A camera, the code of its picture whose foreground spans these pixels, and the crop's corner and side."""
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
        places, depth = project(jnp.asarray(code), jnp.asarray(points, jnp.float32))
        np.testing.assert_allclose(places[0], expected, atol=2e-5)
        np.testing.assert_allclose(depth[0], (points @ camera.matrix()[:3, :3].T)[:, 2], atol=1e-5)


def test_mirrored_code_sees_the_mirrored_point_in_the_flipped_place():
    _, code, _, _ = _seen(np.random.default_rng(1), (3, 50), (20, 41))
    points = jnp.asarray(np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3)), jnp.float32)
    places, depth = project(jnp.asarray(code), points)
    flipped, same = project(jnp.asarray(mirror_camera_codes(code)), points * jnp.array([1, -1, 1]))
    np.testing.assert_allclose(flipped, places * jnp.array([-1, 1]), atol=1e-6)
    np.testing.assert_allclose(same, depth, atol=1e-6)


def test_a_code_of_no_length_and_a_point_behind_the_camera_stay_finite():
    code = jnp.zeros((1, 7)).at[0, 3:5].set(jnp.array([1.6, 5.0]))
    value, gradient = jax.value_and_grad(
        lambda c: project(c, jnp.array([[0.5, 0.5, 0.5], [-0.5, 0.5, 0.0]]))[0].sum()
    )(code)
    assert np.isfinite(value) and np.isfinite(gradient).all()


def test_sample_map_interpolates_rows_and_columns():
    rng = np.random.default_rng(3)
    features = rng.normal(size=(2, 6, 6, 3)).astype(np.float32)
    places = rng.uniform(-1.3, 1.3, (2, 40, 2)).astype(np.float32)
    found = sample_map(jnp.asarray(features), jnp.asarray(places))
    for b in range(2):
        x, y = (places[b].T + 1) * 3 - 0.5
        for c in range(3):
            expected = scipy.ndimage.map_coordinates(
                features[b, :, :, c], [y, x], order=1, mode="nearest"
            )
            np.testing.assert_allclose(found[b, :, c], expected, atol=1e-5)
