"""What flows see besides tokens and volume: pixels at the places of voxels, and layouts."""

import dataclasses

import jax
import numpy as np
import pytest
from copies import added
from toy import (
    MODEL,
    build,
    flow_arguments,
    flow_table,
    flow_views,
    flow_voxels,
    init,
    latent_config,
    one_block,
    voxel_batch,
)

from uniart_jax.nn.grids import flow_plan


def test_pixels_matter_where_they_are_seen_and_the_order_of_views_does_not():
    model = one_block(voxel_channels=8, pixel_channels=6)
    network = build("latent_flow", model)
    params = init(network)
    tokens, volume, t = flow_arguments()
    batch = voxel_batch(model)
    voxels = flow_voxels(model, batch)
    apply = jax.jit(network.apply)

    def run(maps, cameras):
        return apply(params, batch.latent, t, tokens, volume, views=(maps, cameras), **voxels)

    maps, cameras = flow_views(3)
    maps, cameras = np.asarray(maps), np.asarray(cameras)
    whole = np.asarray(run(maps, cameras))
    np.testing.assert_allclose(run(maps[:, ::-1], cameras[:, ::-1]), whole, rtol=1e-4, atol=1e-4)
    moved = np.abs(run(added(maps, (0, 1), 1), cameras) - whole)
    assert moved[0, :61].max() > 1e-3 and not moved[1].any()
    moved = np.abs(run(maps, added(cameras, (1, 2, 0), 1)) - whole)
    assert moved[1, :37].max() > 1e-3 and not moved[0].any()


def test_reading_pixels_begins_at_nothing():
    """So that a flow trained without goes on as it was."""
    plain, more = one_block(voxel_channels=8), one_block(voxel_channels=8, pixel_channels=6)
    network = build("latent_flow", more)
    tokens, volume, t = flow_arguments()
    batch = voxel_batch(more)
    plan = flow_plan(batch.coords, batch.counts, more.latent_flow, more.grid)
    voxels = {"coords": batch.coords, "counts": batch.counts, "plan": plan}
    params = init(build("latent_flow", plain))
    new = network.abstract().keys() - params.keys()
    added = jax.jit(lambda key: {name: network.init(key)[name] for name in new})(jax.random.key(0))
    assert sorted(added) == ["pixel_cube", "pixel_hidden", "pixel_in", "pixel_voxel"]
    seen = (batch.latent, t, tokens, volume)
    found = jax.jit(network.apply)({**params, **added}, *seen, views=flow_views(), **voxels)
    before = jax.jit(build("latent_flow", plain).apply)(params, *seen, **voxels)
    np.testing.assert_allclose(found, before, rtol=1e-5, atol=1e-5)


@pytest.mark.slow
def test_a_flow_sees_the_layout_of_its_own_picture_and_begins_without():
    """Both flows: new layers add nothing yet; once they do, a part moves its own object alone, and
    the table's order and padding do not matter."""
    tokens, volume, t = flow_arguments()
    batch = voxel_batch(MODEL)
    rng = np.random.default_rng(0)
    structure = dataclasses.replace(MODEL.structure_flow, layout_channels=6)
    models = {
        "structure_flow": dataclasses.replace(MODEL, structure_flow=structure),
        "latent_flow": latent_config(voxel_channels=8, layout_channels=6),
    }
    for name, model in models.items():
        x, voxels = rng.normal(size=(2, 2, 2, 2, 3)).astype(np.float32), {}
        if name == "latent_flow":
            plan = flow_plan(batch.coords, batch.counts, model.latent_flow, model.grid)
            x = batch.latent
            voxels = {"coords": batch.coords, "counts": batch.counts, "plan": plan}
        flow = dataclasses.replace(getattr(model, name), layout_channels=0)
        plain, network = (
            build(name, m) for m in (dataclasses.replace(model, **{name: flow}), model)
        )
        params, table = init(plain), flow_table()
        fresh = jax.jit(network.init)(jax.random.key(0))
        params |= {key: fresh[key] for key in fresh.keys() - params.keys()}
        known = {k: params[k] for k in plain.abstract()}
        before = jax.jit(plain.apply)(known, x, t, tokens, volume, **voxels)
        apply = jax.jit(network.apply)
        found = apply(params, x, t, tokens, volume, layout=table, **voxels)
        np.testing.assert_allclose(found, before, rtol=1e-5, atol=1e-5)
        params = init(network)
        run = lambda table: apply(params, x, t, tokens, volume, layout=table, **voxels)  # noqa: B023, E731
        whole = run(table)
        moved = np.abs(run(table._replace(boxes=added(table.boxes, (0, 0), 0.1))) - whole)
        assert moved[0].max() > 1e-3 and not moved[1].any()
        with pytest.raises(ValueError, match="part table"):
            network.apply(params, x, t, tokens, volume, **voxels)
    with pytest.raises(ValueError, match="layout_channels"):
        build(
            "latent_flow", latent_config(stem="conv", io_channels=(6,), layout_channels=6)
        ).abstract()


def test_a_flow_that_reads_pixels_says_where_it_cannot():
    network = build("latent_flow", latent_config(pixel_channels=6))
    tokens, volume, t = flow_arguments()
    batch = voxel_batch(MODEL)
    plan = flow_plan(batch.coords, batch.counts, MODEL.latent_flow, MODEL.grid)
    voxels = {"coords": batch.coords, "counts": batch.counts, "plan": plan}
    with pytest.raises(ValueError, match="views"):
        jax.eval_shape(
            lambda params: network.apply(params, batch.latent, t, tokens, volume, **voxels),
            init(network),
        )
    with pytest.raises(ValueError, match="pixel_channels"):
        build(
            "latent_flow", latent_config(stem="conv", io_channels=(6,), pixel_channels=6)
        ).abstract()
    dino = dataclasses.replace(MODEL.image_encoder, architecture="dinov2")
    with pytest.raises(ValueError, match="pixel_channels"):
        build(
            "latent_flow", dataclasses.replace(latent_config(pixel_channels=6), image_encoder=dino)
        ).abstract()
