"""The head of the layout network that tells which parts are round."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import parameters
from flax import nnx

from uniart_jax.config import Config, DataConfig, LayoutConfig, ModelConfig
from uniart_jax.data.mirror import mirror_revolutions
from uniart_jax.inference.layouts import LayoutPredictor
from uniart_jax.models.box_sets import BoxSetDecoder, PanelDecoder
from uniart_jax.models.layout import SETS, RevolutionHead, _proportions
from uniart_jax.models.network import build
from uniart_jax.stages.layout import LayoutStage
from uniart_jax.training.layout_loss import make_layout_loss
from uniart_jax.voxels.part_table import MOST_BOARDS, MOST_LEGS, MOST_PANELS
from uniart_jax.voxels.revolution_table import RADII
from uniart_jax.voxels.typed_batches import LayoutBatch, parts_of

SMALL = LayoutConfig(
    queries=5, image_size=64, backbone="convolutions", map_channels=8, width=16, layers=1, heads=2,
    sketch_width=12, head_width=12, revolutions=True,
)  # fmt: skip
MODEL = ModelConfig(layout=SMALL)
NETWORK = build("layout", MODEL)
IMAGE = np.random.default_rng(1).random((2, 64, 64, 3), np.float32)


@pytest.fixture(scope="module")
def params():
    return parameters(NETWORK)


def test_training_begins_with_cylinders_that_fill_their_boxes():
    @jax.jit
    def begin(corners):
        return RevolutionHead(16, 8, nnx.Rngs(0), jnp.float32)(jnp.ones((2, 5, 16)), corners)

    lower, size = np.array([-0.4, -0.2, 0.1]), np.array([0.2, 0.3, 0.4])
    corners = np.tile(np.concatenate([lower, lower + size]), (2, 5, 1)).astype(np.float32)
    out = jax.device_get(begin(corners))
    assert out["axis"].shape == (2, 5, 4) and not out["axis"].any()
    middle = lower + size / 2
    for axis in range(3):
        np.testing.assert_allclose(out["centers"][1, 2, axis], np.delete(middle, axis), rtol=1e-5)
        half = np.delete(size, axis).mean() / 2
        np.testing.assert_allclose(out["radii"][1, 2, axis], [half] * RADII, rtol=1e-5)


def test_it_comes_with_the_parts_leaves_them_as_they_are_and_trains_what_it_reads(params):
    bare = build("layout", ModelConfig(layout=dataclasses.replace(SMALL, revolutions=False)))
    rest = {name: value for name, value in params.items() if name != "revolutions"}

    @jax.jit
    def run(params):
        def loss(params):
            out = NETWORK.apply(params, IMAGE)
            found = jax.tree.leaves(out["revolutions"])
            return sum(jnp.square(x - 0.3).sum() for x in found), out

        return jax.grad(loss, has_aux=True)(params)

    gradient, out = jax.device_get(run(params))
    without = jax.device_get(jax.jit(bare.apply)(rest, IMAGE))
    assert out.keys() - without.keys() == {"revolutions"}
    for name in without:
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6),
            out[name],
            without[name],
        )
    size = lambda tree: float(sum(np.abs(x).sum() for x in jax.tree.leaves(tree)))  # noqa: E731
    assert size(gradient["revolutions"]) > 1 and size(gradient["layers"]) > 1
    assert size(gradient["heads"]) == 0  # none through the boxes that outlines are told in


def test_it_is_trained_by_batches_without_legs_panels_and_boards(monkeypatch):
    for decoder in (BoxSetDecoder, PanelDecoder):  # each run of their layer is compiled anew
        monkeypatch.setattr(decoder, "RUNS", 2)
    some = dataclasses.replace(SMALL, legs=MOST_LEGS, panels=MOST_PANELS, boards=MOST_BOARDS)
    config = Config(model=ModelConfig(layout=some), data=DataConfig(box_sets_every=2))
    network, rng = build("layout", config.model), np.random.default_rng(0)
    batch = LayoutBatch(
        image=IMAGE,
        camera=rng.random((2, 7), np.float32),
        boxes=rng.random((2, 4, 6), np.float32),
        codes=rng.random((2, 4, 9), np.float32),
        parents=np.zeros((2, 4), np.int32),
        colors=rng.random((2, 4, 3), np.float32),
        part_counts=np.array([2, 4], np.int32),
        revolutions=np.concatenate([np.ones((2, 4, 1)), rng.random((2, 4, 10))], -1).astype(
            np.float32
        ),
    )
    assert parts_of(batch) == batch and LayoutStage().idle(config, batch) == tuple(SETS)
    loss = jax.grad(make_layout_loss(network, config), has_aux=True)
    moved, terms = jax.jit(loss)(parameters(network), batch, jax.random.key(0))
    assert {"revolutions", "revolutions_outline"} < {*terms} and not {*SETS} & {*terms}
    largest = {n: max(float(np.abs(x).max()) for x in jax.tree.leaves(g)) for n, g in moved.items()}
    assert largest["revolutions"] > 0 and not any(largest[name] for name in SETS)


def test_it_sees_how_long_a_box_is():
    head = nnx.eval_shape(lambda: RevolutionHead(4, 6, nnx.Rngs(0), jnp.float32))
    graph, state = nnx.split(head)
    rng = np.random.default_rng(1)
    state = jax.tree.map(lambda x: rng.normal(size=x.shape).astype(np.float32), state)
    query = np.zeros((1, 2, 4), np.float32)
    corners = np.array([[[0, 0, 0, 0.2, 0.2, 0.2], [0, 0, 0, 0.2, 0.2, 0.6]]], np.float32)
    look = jax.jit(lambda state: nnx.merge(graph, state)(query, corners)["axis"])
    axis = np.asarray(look(state))
    assert np.abs(axis[0, 0] - axis[0, 1]).min() > 1e-2


def test_a_box_is_told_whatever_its_place_and_by_its_proportions():
    lower = np.array([[0.1, -0.2, 0.3], [-0.5, 0.0, 0.0]])
    near = _proportions(np.concatenate([lower, lower + [0.2, 0.2, 0.5]], -1))
    np.testing.assert_allclose(near[0], near[1], atol=1e-6)
    np.testing.assert_allclose(near[0, 3:6], np.log([0.4, 0.4, 1.0]), atol=1e-6)
    np.testing.assert_allclose(near[0, 6:], [0.4**4, 0.4**4, 1.0], rtol=1e-5)
    flat = _proportions(np.concatenate([lower, lower + [0.2, 0.0, 0.5]], -1))
    assert np.isfinite(flat).all()


def test_a_mirrored_picture_has_mirrored_outlines(params):
    predictor = LayoutPredictor(MODEL, params)
    picture = np.round(IMAGE[0] * 255).astype(np.uint8)
    out, turned = predictor([picture, picture[:, ::-1]])
    for axis in range(3):
        rows, others = (
            np.concatenate(
                [np.full((5, 1), 1.0 + axis), o["round_centers"][:, axis], o["round_radii"][:, axis]],  # noqa: E501
                1,
            )
            for o in (out, turned)
        )  # fmt: skip
        order = np.abs(mirror_revolutions(rows)[:, None] - others).sum(-1).argmin(1)
        np.testing.assert_allclose(mirror_revolutions(rows), others[order], atol=1e-4)
        np.testing.assert_allclose(out["round_axis"], turned["round_axis"][order], atol=1e-4)
