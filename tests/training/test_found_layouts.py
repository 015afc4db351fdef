"""A decoder's loss on layouts that the layout network finds, at toy size."""

import dataclasses
import functools
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "models"))
from toy import MODEL, flow_table, init, voxel_batch

from uniart_jax.config import Config, LayoutConfig, LossConfig
from uniart_jax.inference.samplers import make_layout_finder
from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan
from uniart_jax.training.found_layouts import show_found
from uniart_jax.training.vae_losses import make_sampled_latents, make_uniart_vae_loss

LAYOUT = LayoutConfig(
    queries=4, backbone="convolutions", map_channels=8, width=16, layers=1, heads=2,
    sketch_width=8, head_width=8, image_size=32,
)  # fmt: skip
MODEL = dataclasses.replace(
    MODEL,
    layout=LAYOUT,
    uniart_vae=dataclasses.replace(MODEL.uniart_vae, layout_channels=6),
    latent_flow=dataclasses.replace(MODEL.latent_flow, layout_channels=6),
)


@functools.cache
def frozen(name):
    """Parameters of a network that is not trained."""
    return init(build(name, MODEL))


def make_batch(seed=0):
    batch = voxel_batch(MODEL)
    table = flow_table(seed)
    rows = table._replace(
        **{n: getattr(table, n)[:, :4] for n in ("boxes", "codes", "parents", "colors")}
    )
    flow = flow_plan(batch.coords, batch.counts, MODEL.latent_flow, MODEL.grid)
    return batch._replace(
        layout=rows,
        layout_rows=np.tile(np.arange(4, dtype=np.int32), (2, 1)),
        part_counts=np.array([4, 4], np.int32),
        image=np.random.default_rng(0).random((2, 32, 32, 3)).astype(np.float32),
        plans={**batch.plans, "flow": flow},
    )


@pytest.fixture(scope="module")
def loss_of():
    network, zero = build("uniart_vae", MODEL), np.zeros(4, np.float32)
    params, made = init(network), {}

    def run(share, batch):
        if share not in made:
            config = Config(model=MODEL, loss=LossConfig(sampled=1.0, found=share))
            loss_fn = make_uniart_vae_loss(network, config, zero, zero + 1)
            made[share] = jax.jit(jax.value_and_grad(lambda *a: loss_fn(*a)[0]))
        names = ("image_encoder", "latent_flow", "layout")[: 3 if share else 2]
        return made[share](params, batch, jax.random.key(0), tuple(map(frozen, names)))

    return run


@pytest.mark.slow
def test_a_decoder_sees_the_layout_found_in_place_of_its_own(loss_of):
    batch, other = make_batch(), make_batch(1)
    own, found = loss_of(0.0, batch)[0], loss_of(1.0, batch)[0]
    assert np.isfinite(own) and np.isfinite(found) and own != found
    assert loss_of(0.0, other)[0] != own  # its own layout is another
    assert loss_of(1.0, other)[0] == found  # which is not looked at
    dark = batch._replace(image=0.3 * batch.image)
    assert loss_of(1.0, dark)[0] != found
    gradient = loss_of(1.0, batch)[1]
    assert any(np.any(g) for g in jax.tree.leaves(gradient["layout"]))


@functools.cache
def finder():
    return make_layout_finder(MODEL)


def test_pictures_of_another_size_are_resampled():
    small, large = (
        finder()(frozen("layout"), np.full((2, side, side, 3), 0.3, np.float32))
        for side in (32, 48)
    )
    np.testing.assert_allclose(small.table.boxes, large.table.boxes, atol=1e-5)
    out = build("layout", MODEL).apply(frozen("layout"), np.full((2, 32, 32, 3), 0.3, np.float32))
    np.testing.assert_allclose(small.cameras, out["camera"], atol=1e-5)
    np.testing.assert_allclose(large.cameras, out["camera"], atol=1e-5)


def test_what_is_shown_is_what_the_network_finds():
    batch = make_batch()
    found = finder()(frozen("layout"), batch.image).table
    show = jax.jit(show_found, static_argnums=2)
    shown = show(batch, found, 1.0, jax.random.key(0))
    np.testing.assert_array_equal(shown.layout.boxes, found.boxes)
    # the truth: each part is the row of its number
    batch = batch._replace(boxes=np.asarray(found.boxes), part_counts=np.asarray(found.counts))
    rows = show(batch, found, 1.0, jax.random.key(0)).layout_rows
    for row, count in zip(np.asarray(rows), batch.part_counts, strict=True):
        assert row[:count].tolist() == list(range(count)) and (row[count:] == -1).all()


def test_sampled_latents_are_seen_through_the_cameras_found_with_layouts():
    """Where the structure flow reads pixels, and of items that have a layout."""
    reads = lambda flow: dataclasses.replace(flow, pixel_channels=4)  # noqa: E731
    latent = {"latent_flow": reads(MODEL.latent_flow)}
    both = latent | {"structure_flow": reads(MODEL.structure_flow)}
    batch, zero = make_batch(), np.zeros(4, np.float32)
    batch = batch._replace(layout=batch.layout._replace(counts=np.array([3, 0], np.int32)))
    front = np.tile(np.float32([0.6, 0.8, 0.4, 1.6, 0.3, 0, 0]), (2, 1))
    for networks, moved in ((latent, [False, False]), (both, [True, False])):
        model = dataclasses.replace(MODEL, **networks)
        sample = make_sampled_latents(Config(model=model), zero, zero + 1)
        frozen = [init(build(name, model)) for name in ("image_encoder", "latent_flow")]
        one, other = (
            np.asarray(sample(frozen, batch, jax.random.key(0), cameras))
            for cameras in (front, front * np.float32([-1, 1, 1, 1, 1, 1, 1]))
        )
        assert [(a != b).any() for a, b in zip(one, other, strict=True)] == moved
