"""Image features on voxels: projections and samples checked by hand, views averaged, memory that
does not grow with them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_dinov2 import NETWORK
from toy import build, init

from uniart_jax.models import multiview
from uniart_jax.models.multiview import add_views, intrinsic_matrices, multiview_features

project, sample_patches = jax.jit(multiview.project), jax.jit(multiview.sample_patches)
FOV = np.deg2rad(40)


def orbit(azimuth, elevation=0.0, radius=2.0):
    """Camera-to-world in Blender's convention, looking at the origin, z up."""
    ce, se = np.cos(elevation), np.sin(elevation)
    back = np.array([np.cos(azimuth) * ce, np.sin(azimuth) * ce, se])
    right = np.cross([0.0, 0.0, 1.0], back) / ce
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, radius * back], -1)
    return pose


def matrices(camera_to_world):
    """Extrinsics and intrinsics of cameras [M, 4, 4] in Blender's convention."""
    poses = np.array(camera_to_world)
    poses[:, :3, 1:3] *= -1
    return np.linalg.inv(poses).astype(np.float32), intrinsic_matrices(np.full(len(poses), FOV))


def cameras(count):
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return matrices([orbit(a, 0.3) for a in angles])


def mean_of_views(patches, extrinsics, intrinsics, points):
    start = np.zeros((len(points), patches.shape[-1]), np.float32)
    return add_views(start, patches, extrinsics, intrinsics, points) / len(patches)


def centers(count, seed=0):
    return np.random.default_rng(seed).uniform(-0.4, 0.4, (count, 3)).astype(np.float32)


def test_projection_by_hand():
    extrinsics, intrinsics = matrices([orbit(0.0)])  # on +x: y right, z up
    reach = 2.0 * np.tan(FOV / 2)  # half the picture at the origin's depth
    points = np.array([[0, 0, 0], [0, reach, 0], [0, 0, reach / 2], [1, reach / 2, 0], [3, 0, 0]])
    uv = project(np.float32(points), extrinsics[0], intrinsics[0])
    np.testing.assert_allclose(uv[:4], [[0, 0], [1, 0], [0, -0.5], [1, 0]], atol=1e-6)
    assert (np.abs(uv[4]) > 100).all()  # behind the camera
    tele = intrinsic_matrices([FOV, FOV / 2])
    ratio = np.tan(FOV / 2) / np.tan(FOV / 4)
    np.testing.assert_allclose(
        tele[:, 0, 0], [0.5 / np.tan(FOV / 2), 0.5 / np.tan(FOV / 2) * ratio]
    )


def test_bilinear_samples_by_hand():
    patches = np.arange(12, dtype=np.float32).reshape(3, 4, 1)  # value = 4 row + column
    column, row = np.meshgrid(np.arange(4), np.arange(3))
    places = np.stack([(column + 0.5) / 4, (row + 0.5) / 3], -1).reshape(-1, 2) * 2 - 1
    at_centers = sample_patches(patches, np.float32(places))
    np.testing.assert_allclose(at_centers, patches.reshape(-1, 1), atol=1e-5)
    middle = sample_patches(patches, np.zeros((1, 2), np.float32))  # row 1, between columns 1 and 2
    np.testing.assert_allclose(middle, [[5.5]], atol=1e-6)
    # a quarter of a cell beyond the first column's centre and half a cell above the first row's:
    # the corner (0, 0), fading
    outside = np.float32([[0.25 / 4 * 2 - 1, 0.0 - 1], [-1.5, 0.0], [1e3, 1e3]])
    ones = sample_patches(np.ones((3, 4, 1), np.float32), outside)
    np.testing.assert_allclose(ones, [[0.75 * 0.5], [0.0], [0.0]], atol=1e-5)


def test_a_voxel_at_the_centre_reads_every_pictures_middle():
    extrinsics, intrinsics = cameras(5)
    patches = np.zeros((5, 3, 3, 2), np.float32)
    patches[:, 1, 1, 0], patches[:, 1, 1, 1] = np.arange(5), 1.0
    mean = mean_of_views(patches, extrinsics, intrinsics, np.zeros((1, 3), np.float32))
    np.testing.assert_allclose(mean, [[2.0, 1.0]], atol=1e-4)


def test_the_mean_is_of_all_views():
    rng = np.random.default_rng(1)
    extrinsics, intrinsics = cameras(7)
    patches, points = rng.normal(size=(7, 5, 5, 3)).astype(np.float32), centers(20)
    expected = np.mean(
        [
            sample_patches(p, project(points, e, k))
            for p, e, k in zip(patches, extrinsics, intrinsics, strict=True)
        ],
        0,
    )
    found = mean_of_views(patches, extrinsics, intrinsics, points)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_memory_does_not_grow_with_the_views():
    """Temporaries of the compiled program, for the arrays that it is given and nothing beside
    them."""

    def temporaries(views):
        shape = jax.ShapeDtypeStruct
        compiled = add_views.lower(
            shape((1000, 64), jnp.float32),
            shape((views, 9, 9, 64), jnp.float32),
            shape((views, 4, 4), jnp.float32),
            shape((views, 3, 3), jnp.float32),
            shape((1000, 3), jnp.float32),
        ).compile()
        return compiled.memory_analysis().temp_size_in_bytes

    assert temporaries(8) == temporaries(64)


def test_features_computed_on_the_way_are_those_computed_first_and_padding_is_zero():
    params = init(NETWORK)
    images = np.random.default_rng(0).random((5, 16, 16, 3), np.float32)
    extrinsics, intrinsics = cameras(5)
    patches = jax.jit(NETWORK.apply)(params, images)["patches"]
    points = centers(30)
    expected = np.array(mean_of_views(patches, extrinsics, intrinsics, points))
    points[25:], expected[25:] = np.nan, 0
    for chunk in (2, 5, 8):  # the last chunk is not full, or none is
        views = iter(images) if chunk == 2 else images
        found = multiview_features(
            NETWORK, params, views, extrinsics, intrinsics, points, 25, chunk=chunk
        )
        np.testing.assert_allclose(found, expected, atol=1e-5)
    for number in (0, 4, 6):
        pictures = np.zeros((number, 16, 16, 3))
        with pytest.raises(ValueError, match="pictures"):
            multiview_features(NETWORK, params, pictures, extrinsics, intrinsics, centers(30))


def test_half_precision_features_are_summed_in_single():
    half = build("image_encoder", dataclasses.replace(NETWORK.config, compute_dtype="bfloat16"))
    extrinsics, intrinsics = cameras(3)
    images = np.random.default_rng(0).random((3, 16, 16, 3), np.float32)
    params, points = init(NETWORK), centers(9)
    exact = multiview_features(NETWORK, params, images, extrinsics, intrinsics, points)
    rounded = multiview_features(half, params, images, extrinsics, intrinsics, points)
    assert rounded.dtype == jnp.float32
    assert np.abs(rounded - exact).mean() < 0.05 * np.abs(exact).mean()
