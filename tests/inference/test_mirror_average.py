"""Averages over a picture and its mirror image: of a mirrored picture they are mirror images."""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest
from drawn import parameters as parameters_of

from uniart_jax.cli import load_config
from uniart_jax.config import NETWORKS
from uniart_jax.data.cameras import mirror_camera_codes
from uniart_jax.data.mirror import mirror_coords, mirror_dense, mirror_subcells
from uniart_jax.inference.mirror_average import encode_views, find_grid, find_voxels
from uniart_jax.inference.samplers import with_first_view_cameras
from uniart_jax.models.network import build
from uniart_jax.objects.kinematics import Joint
from uniart_jax.pipeline import Pipeline
from uniart_jax.voxels.grid import occupancy
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.typed_batches import Condition

ROOT = Path(__file__).parent.parent.parent
KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def pipeline():
    """Networks by chance; flows and the decoder see a layout."""
    config = load_config(ROOT / "configs" / "debug.py")
    sees = {
        name: dataclasses.replace(getattr(config.model, name), layout_channels=4)
        for name in ("structure_flow", "latent_flow")
    }
    encoder = dataclasses.replace(config.model.image_encoder, num_blocks=0)
    decoder = dataclasses.replace(config.model.uniart_vae, num_blocks=1, layout_channels=4)
    model = dataclasses.replace(config.model, **sees, image_encoder=encoder, uniart_vae=decoder)
    parameters = {
        name: parameters_of(build(name, model), seed=i) for i, name in enumerate(NETWORKS)
    }
    channels = model.structure_vae.latent_channels, model.uniart_vae.latent_channels
    statistics = {
        name: (np.zeros(c, np.float32), np.ones(c, np.float32))
        for name, c in zip(("structure", "latent"), channels, strict=True)
    }
    return Pipeline(dataclasses.replace(config, model=model), parameters, statistics)


@pytest.fixture(scope="module")
def pixels():
    return np.random.default_rng(0).random((2, 64, 64, 3), np.float32)  # two views


def layout(y):
    """A body, and a panel before it."""
    boxes = np.array([[0, 0, 0, 0.8, 1, 1], [-0.45, y, 0, 0.1, 0.4, 0.8]])
    return Layout(boxes, (Joint.fixed(),) * 2, (-1, 0), np.full((2, 3), 0.5), np.ones(2))


def options(pipeline, mirrored=True, steps=1):
    return [
        dataclasses.replace(each, mirrored=mirrored, steps=steps, adaptive=False)
        for each in pipeline.options()
    ]


def made(pipeline, pixels, where, asked):
    """Voxels, and the grid on some voxels and their mirror images."""
    conditions = encode_views(pipeline, pixels, where, *asked)
    logits = pipeline.structure_logits(
        pipeline.solve_structure(conditions.original, KEY, asked[0]).x, conditions.original
    )
    middle = dataclasses.replace(asked[0], threshold=float(np.median(logits)))
    voxels, _ = find_voxels(pipeline, conditions, KEY, middle)
    return conditions, voxels, middle


def test_a_mirrored_picture_gives_the_mirror_image(pipeline, pixels):
    asked = options(pipeline)
    conditions, voxels, middle = made(pipeline, pixels, layout(0.2), asked)
    mirrored = encode_views(pipeline, pixels[:, :, ::-1], layout(-0.2), *asked)
    other, _ = find_voxels(pipeline, mirrored, KEY, middle)
    resolution = pipeline.config.model.grid.resolution
    one, two = occupancy(voxels, resolution), mirror_dense(occupancy(other, resolution))
    assert one.sum() > 100 and (one != two).mean() < 1e-3
    plain, _ = find_voxels(pipeline, conditions._replace(mirrored=None), KEY, middle)
    assert (occupancy(plain, resolution) != one).mean() > 1e-3

    rng = np.random.default_rng(1)
    coords = np.argwhere(rng.random((resolution,) * 3) < 0.01).astype(np.int32)
    turned = mirror_coords(coords, resolution)
    order = np.lexsort(turned.T[::-1])
    here, _ = find_grid(pipeline, coords, conditions, KEY, asked[1], layout(0.2))
    there, _ = find_grid(pipeline, turned[order], mirrored, KEY, asked[1], layout(-0.2))
    for name in ("sdf", "color"):
        back = mirror_subcells(getattr(there, name), here.subdivisions)[np.argsort(order)]
        np.testing.assert_allclose(getattr(here, name), back, atol=2e-4)
    once, _ = find_grid(
        pipeline, coords, conditions._replace(mirrored=None), KEY, asked[1], layout(0.2)
    )
    assert np.abs(once.sdf - here.sdf).max() > 0.01
    np.testing.assert_array_equal(once.own_box, here.own_box)


def test_the_layouts_camera_takes_the_place_of_the_first_views_estimate(pipeline, pixels):
    asked = options(pipeline)
    estimated = encode_views(pipeline, pixels, layout(0.2), *asked)
    camera = np.array([0.6, 0.8, 0.4, 1.6, 0.3, 0.05, -0.02])
    known = dataclasses.replace(layout(0.2), camera=camera)
    same = encode_views(pipeline, pixels, known, *asked)  # a flow that reads no pixels
    for found, plain in zip(same, estimated, strict=True):
        np.testing.assert_array_equal(found.cameras, plain.cameras)
    model = pipeline.config.model
    flow = dataclasses.replace(model.structure_flow, pixel_channels=2, layout_channels=0)
    model = dataclasses.replace(model, structure_flow=flow)
    reads = Pipeline(
        dataclasses.replace(pipeline.config, model=model), pipeline.parameters, pipeline.statistics
    )
    seen = encode_views(reads, pixels, known, *asked)
    for condition, code, plain in (
        (seen.original, camera, estimated.original),
        (seen.mirrored, mirror_camera_codes(camera[None])[0], estimated.mirrored),
    ):
        np.testing.assert_allclose(condition.cameras[0, 0], code, atol=1e-6)
        np.testing.assert_array_equal(condition.cameras[0, 1], plain.cameras[0, 1])
        assert np.abs(plain.cameras[0, 0] - code).max() > 0.01


def test_cameras_are_put_in_where_an_item_has_one():
    cameras = np.zeros((3, 2, 7), np.float32)
    given = [None, np.arange(7.0), None]
    seen = with_first_view_cameras(Condition(np.zeros((3, 1, 1)), cameras=cameras), given)
    expected = cameras.copy()
    expected[1, 0] = given[1]
    np.testing.assert_array_equal(seen.cameras, expected)
    assert not cameras.any()
    without = Condition(np.zeros((3, 1, 1)))
    assert with_first_view_cameras(without, given) is without


def test_samples_of_several_steps_are_looked_at_once(pipeline, pixels):
    assert encode_views(pipeline, pixels, None, *options(pipeline)).mirrored is not None
    for asked in (options(pipeline, steps=2), options(pipeline, mirrored=False)):
        assert encode_views(pipeline, pixels, None, *asked).mirrored is None
    mixed = options(pipeline)[0], options(pipeline, steps=2)[1]
    conditions = encode_views(pipeline, pixels, None, *mixed)
    coords = np.argwhere(np.ones((4, 4, 4))).astype(np.int32)
    grids = [
        find_grid(pipeline, coords, each, KEY, mixed[1], None)[0]
        for each in (conditions, conditions._replace(mirrored=None))
    ]
    np.testing.assert_array_equal(grids[0].sdf, grids[1].sdf)
