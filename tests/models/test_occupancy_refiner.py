"""The refiner at toy size: it begins with the logits it is given, and reads its own item's picture,
layout and logits."""

import dataclasses
import functools

import jax
import numpy as np
import optax
import pytest
from copies import added, replaced
from toy import MODEL, build, finite, flow_table, flow_views, init

from uniart_jax.config import Config, LossConfig
from uniart_jax.training.flow_losses import make_structure_flow_loss
from uniart_jax.voxels.typed_batches import Condition, StructureBatch

SIDE = MODEL.grid.resolution


def refining(**changes):
    flow = dataclasses.replace(
        MODEL.structure_flow, refine_channels=4, layout_channels=6, **changes
    )
    return dataclasses.replace(MODEL, structure_flow=flow)


def arguments(seed=0):
    logits = np.random.default_rng(seed).normal(-1, 3, (2, SIDE, SIDE, SIDE))
    return logits.astype(np.float32), *jax.device_get((*flow_views(), flow_table()))


@pytest.fixture(scope="module")
def refine():
    network = build("structure_flow", refining())
    return jax.jit(lambda params, *given: network.apply(params, *given, method="refine"))


@pytest.fixture(scope="module")
def params():
    return init(build("structure_flow", refining()))


def test_a_fresh_refiner_leaves_the_logits_as_they_are(refine, params):
    logits, *given = arguments()
    network = build("structure_flow", refining())
    fresh = jax.jit(lambda key: network.init(key)["refiner"])(jax.random.key(0))
    found = refine({**params, "refiner": fresh}, logits, *given)
    np.testing.assert_array_equal(found, logits)


def test_it_reads_logits_pictures_and_layout_of_its_own_item_alone(refine, params):
    logits, pixels, cameras, table = arguments()
    whole = np.asarray(refine(params, logits, pixels, cameras, table))
    assert whole.shape == logits.shape and finite(whole) and (whole != logits).any()
    changed = {
        "logits": (added(logits, (0, 3, 3, 3), 3), pixels, cameras, table),
        "pixels": (logits, added(pixels, (0, 0), 1), cameras, table),
        "cameras": (logits, pixels, added(cameras, (0, 0, 0), 0.5), table),
        "layout": (logits, pixels, cameras, table._replace(boxes=added(table.boxes, (0, 0), 0.1))),
    }
    for name, given in changed.items():
        moved = np.abs(np.asarray(refine(params, *given)) - whole)
        assert moved[0].max() > 1e-3 and not moved[1].any(), name


def test_rows_beyond_a_layouts_parts_and_views_without_a_camera_do_not_matter(refine, params):
    logits, pixels, cameras, table = arguments()
    whole = refine(params, logits, pixels, cameras, table)
    beyond = (1, slice(3, None))
    padded = table._replace(
        boxes=replaced(table.boxes, beyond, 7), codes=replaced(table.codes, beyond, 7)
    )
    np.testing.assert_array_equal(refine(params, logits, pixels, cameras, padded), whole)
    blind, others = (replaced(x, np.s_[:, 1], v) for x, v in ((cameras, 0), (pixels, 9)))
    one, other = (refine(params, logits, p, blind, table) for p in (pixels, others))
    np.testing.assert_array_equal(one, other)


def test_what_is_likely_hides_what_lies_behind(refine, params):
    """A wall of certain voxels, which are no candidates, before the others changes what those
    read."""
    logits, pixels, cameras, table = arguments()
    logits = np.float32(-2 + 0.01 * logits)
    walls = (replaced(logits, np.s_[:, 0], value) for value in (-9, 9))  # none, and one: as certain
    farther = np.s_[:, 6:]  # beyond the convolutions' reach of x = 0, where the camera stands
    open_, shut = (np.asarray(refine(params, a, pixels, cameras, table)) for a in walls)
    assert np.abs(open_[farther] - shut[farther]).max() > 1e-4


def test_it_needs_the_pictures_and_their_camera(refine, params):
    logits, pixels, cameras, table = arguments()
    with pytest.raises(ValueError, match=r"pixels \(refine_channels > 0\)"):
        refine(params, logits, None, cameras, table)
    with pytest.raises(ValueError, match="part table"):
        refine(params, logits, pixels, cameras, None)
    encoder = dataclasses.replace(MODEL.image_encoder, architecture="dinov2")
    with pytest.raises(ValueError, match="needs an image encoder that estimates the"):
        build("structure_flow", dataclasses.replace(refining(), image_encoder=encoder)).abstract()


@pytest.mark.slow
def test_its_loss_trains_the_refiner_alone_and_falls():
    model = refining()
    config = Config(model=model, loss=LossConfig(refined=1.0))
    network, vae = build("structure_flow", model), build("structure_vae", model)
    rng = np.random.default_rng(0)
    pixels, cameras = flow_views()
    occupancy = np.zeros((2, SIDE, SIDE, SIDE), bool)
    occupancy[0, 2:6, 2:6, 2:6] = occupancy[1, 1:7, 3:5, 3:5] = True
    tokens = rng.normal(size=(2, 9, 16)).astype(np.float32)
    volume = rng.normal(size=(2, 4, 4, 4, 5)).astype(np.float32)
    seen = Condition(tokens, volume, pixels, cameras, flow_table())
    batch = StructureBatch(None, occupancy, seen=seen)
    zero = np.zeros(3, np.float32)
    loss_fn = make_structure_flow_loss(network, config, zero, zero + 1)
    vae_params = init(vae)
    step = jax.jit(
        jax.value_and_grad(lambda p: loss_fn(p, batch, jax.random.key(0), vae_params), has_aux=True)
    )
    params = jax.jit(network.init)(jax.random.key(0))
    (first, metrics), gradient = step(params)
    assert metrics["iou"] == metrics["iou_before"]
    moved = {
        name for name, part in gradient.items() if any(np.any(g) for g in jax.tree.leaves(part))
    }
    assert moved == {"refiner"}
    optimizer = optax.adam(1e-2)
    state = optimizer.init(params)
    for _ in range(60):
        (last, metrics), gradient = step(params)
        updates, state = optimizer.update(gradient, state)
        params = optax.apply_updates(params, updates)
    assert last < 0.7 * first and metrics["iou"] > metrics["iou_before"]


def test_the_flow_learns_from_what_its_sample_decodes_to():
    """``loss.decoded_structure`` adds cross-entropy and Dice of the decoded x_0, times its
    weight."""
    model = dataclasses.replace(
        MODEL, structure_flow=dataclasses.replace(MODEL.structure_flow, refine_channels=0)
    )
    network, vae = build("structure_flow", model), build("structure_vae", model)
    rng = np.random.default_rng(0)
    occupancy = np.zeros((2, SIDE, SIDE, SIDE), bool)
    occupancy[:, 2:6, 2:6, 2:6] = True
    params, vae_params = init(network), init(vae)
    encode = jax.jit(lambda params, x: vae.apply(params, x, method="encode")[0])
    latent = encode(vae_params, occupancy.astype(np.float32))
    tokens = rng.normal(size=(2, 9, 16)).astype(np.float32)
    volume = rng.normal(size=(2, 4, 4, 4, 5)).astype(np.float32)
    seen = Condition(tokens, volume, layout=flow_table())
    batch = StructureBatch(latent, occupancy, seen=seen)
    zero = np.zeros(3, np.float32)

    @functools.partial(jax.jit, static_argnames="weight")
    def loss_of(weight):
        config = Config(model=model, loss=LossConfig(decoded_structure=weight, draws_per_image=2))
        loss_fn = make_structure_flow_loss(network, config, zero, zero + 1)
        given = (vae_params,) if weight else ()
        return jax.value_and_grad(
            lambda p: loss_fn(p, batch, jax.random.key(0), *given), has_aux=True
        )(params)

    both = jax.device_get((loss_of(0.0), loss_of(0.5)))
    ((plain, _), gradient), ((decoded, terms), other) = both
    added = 0.5 * (terms["decoded_entropy"] + terms["decoded_dice"])
    np.testing.assert_allclose(decoded, plain + added, rtol=1e-5)
    assert added > 0.1
    moved = [
        np.abs(a - b).max() for a, b in zip(*map(jax.tree.leaves, (gradient, other)), strict=True)
    ]
    assert max(moved) > 1e-6


@pytest.mark.parametrize(("share", "channels"), [(1.5, 4), (0.5, 0)])
def test_a_share_that_cannot_be_is_refused(share, channels):
    flow = dataclasses.replace(MODEL.structure_flow, refine_channels=channels)
    model = dataclasses.replace(MODEL, structure_flow=flow)
    config = Config(model=model, loss=LossConfig(refined=share))
    with pytest.raises(ValueError, match=r"loss\.refined"):
        make_structure_flow_loss(build("structure_flow", model), config, 0, 1)
