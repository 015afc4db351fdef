"""Legs, panels and boards as sets: they leave the parts as they are and permute as a set does."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from copies import replaced
from drawn import parameters
from flax import nnx

from uniart_jax.config import Config, DataConfig, LayoutConfig, ModelConfig
from uniart_jax.models.box_sets import (
    LEG_ROW,
    BoardDecoder,
    BoxSetDecoder,
    LegDecoder,
    PanelDecoder,
    Seen,
)
from uniart_jax.models.layout import likely_root
from uniart_jax.models.layout_layers import read_boxes
from uniart_jax.models.network import build
from uniart_jax.objects.kinematics import Joint
from uniart_jax.stages.layout import LayoutStage
from uniart_jax.training.layout_loss import make_layout_loss
from uniart_jax.voxels.joint_code import encode_joint
from uniart_jax.voxels.typed_batches import LayoutBatch

SMALL = LayoutConfig(
    queries=5, image_size=64, backbone="convolutions", map_channels=8, width=16, layers=1, heads=2,
    sketch_width=12, head_width=12, legs=8, panels=24, boards=12,
)  # fmt: skip
NETWORK = build("layout", ModelConfig(layout=SMALL))
IMAGE = np.random.default_rng(1).random((2, 64, 64, 3), np.float32)


SETS = {"legs": (8, LegDecoder), "panels": (24, PanelDecoder), "boards": (12, BoardDecoder)}
apply = jax.jit(NETWORK.apply)


@pytest.fixture(scope="module", autouse=True)
def two_runs():
    """Of the layer: each is compiled anew."""
    with pytest.MonkeyPatch.context() as patch:
        for decoder in (BoxSetDecoder, PanelDecoder):
            assert decoder.RUNS > 2
            patch.setattr(decoder, "RUNS", 2)
        yield


@pytest.fixture(scope="module")
def params():
    return parameters(NETWORK)


@pytest.mark.parametrize("name", SETS)
def test_they_come_with_the_parts(name, params):
    found, (count, decoder) = apply(params, IMAGE)[name], SETS[name]
    row = LEG_ROW if name == "legs" else 6  # lower and upper corner
    sets = (2, SMALL.queries) if name == "boards" else (2,)  # one a part
    assert [r.shape for r in found["rows"]] == [(*sets, count, row)] * (decoder.RUNS + 1)
    for kind in ("exists", "plinth", "fill") if name == "legs" else ("exists",):
        assert [value.shape for value in found[kind]] == [(*sets, count)] * (decoder.RUNS + 1)
    assert found["alone" if name == "legs" else "share"].shape == sets


@pytest.mark.parametrize(
    "names", [tuple(SETS), *(pytest.param((name,), marks=pytest.mark.slow) for name in SETS)]
)
def test_they_leave_all_else_as_it_is(names, params):
    none = dataclasses.replace(SMALL, **dict.fromkeys(names, 0))
    without = build("layout", ModelConfig(layout=none))
    out, rest = apply(params, IMAGE), {k: v for k, v in params.items() if k not in names}
    bare = jax.jit(without.apply)(rest, IMAGE)
    assert out.keys() - bare.keys() == set(names)
    for name in bare:
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6),
            out[name],
            bare[name],
        )


@pytest.mark.parametrize("name", SETS)
def test_nothing_else_depends_on_their_parameters(name, params):
    other = {**params, name: jax.tree.map(lambda x: np.asarray(x) + 0.1, params[name])}
    out, changed = (jax.device_get(apply(p, IMAGE)) for p in (params, other))
    assert (out[name]["rows"][-1] != changed[name]["rows"][-1]).any()
    for kind in out.keys() - {name}:
        jax.tree.map(np.testing.assert_array_equal, out[kind], changed[kind])


@functools.cache
def made(name):
    """A decoder's graph, and its parameters as training begins with them."""

    def make():
        return SETS[name][1](NETWORK.config, nnx.Rngs(0), jnp.float32)

    graph = nnx.graphdef(nnx.eval_shape(make))
    return graph, jax.device_get(jax.jit(lambda: nnx.state(make()))())


def moved(name):
    """Its parameters after some training: no zeros, behind which mistakes would hide."""
    return jax.tree.map(lambda x: x + np.float32(0.1), made(name)[1])


def method_of(name, method="__call__"):
    """Compiled: (parameters, what is seen) -> NumPy's arrays."""
    run = jax.jit(lambda state, seen: getattr(nnx.merge(made(name)[0], state), method)(seen))
    return lambda *given: jax.device_get(run(*given))


decode = functools.cache(method_of)


def seen_by_chance():
    size, width = SMALL.image_size // 4, SMALL.width
    rng = np.random.default_rng(0)
    draw = lambda *shape: rng.normal(size=shape).astype(np.float32)  # noqa: E731
    return Seen(
        map=draw(1, size, size, SMALL.map_channels),
        tokens=draw(1, 9, width),
        tokens_place=draw(9, width),
        sketch=draw(1, SMALL.sketch_width),
        parts=draw(1, 5, width),
        parts_place=draw(1, 5, width),
        asked=draw(1, 2, width),
        asked_corners=np.float32([[[-0.2, -0.3, -0.4, 0, 0.3, 0.1], [0, 0, 0, 0.1, 0.1, 0.3]]]),
        asked_codes=np.zeros((1, 2, 9), np.float32),
        body=np.float32([[-0.2, -0.3, -0.4, 0.2, 0.3, 0.4]]),
        camera=np.float32([[0, 1, 0.3, 1, 0.2, 0, 0]]),
    )


@pytest.mark.parametrize("name", SETS)
def test_they_see_the_image_and_the_parts(name):
    decoder, state, seen = decode(name), moved(name), seen_by_chance()
    rows = decoder(state, seen)["rows"][-1]
    inputs = ["map", "tokens", "parts", "parts_place", "camera"]
    own = {"legs": ["sketch"], "panels": ["sketch", "body"], "boards": ["asked", "asked_corners"]}
    for field in inputs + own[name]:
        changed = getattr(seen, field) * np.float32(-0.5 if field == "parts" else 0.5)
        # some are normalised
        other = decoder(state, seen._replace(**{field: changed}))["rows"][-1]
        assert np.abs(other - rows).max() > 1e-4, field


def test_panels_begin_as_boards_of_the_body_however_small_it_is():
    decoder, state, seen = decode("panels"), made("panels")[1], seen_by_chance()
    rows = decoder(state, seen)["rows"][0][0]
    wide = rows[:, 3:] - rows[:, :3]
    assert (wide > 0).all()
    np.testing.assert_allclose(np.sort(wide / [0.4, 0.6, 0.8], 1)[:, 1:], 1, rtol=1e-5)
    np.testing.assert_allclose(rows[:, :3].min(0), [-0.2, -0.3, -0.4], atol=0.03)
    point = seen._replace(body=np.float32([[0.1, 0.1, 0.1, 0.1, 0.0, 0.1]]))
    rows = decoder(state, point)["rows"][0][0]
    assert np.isfinite(rows).all() and (rows[:, 3:] > rows[:, :3]).all()


def test_boards_begin_in_the_box_of_their_part_and_do_not_see_those_of_another():
    decoder, seen = decode("boards"), seen_by_chance()
    boxes = seen.asked_corners[0]
    for part, rows in enumerate(decoder(made("boards")[1], seen)["rows"][0][0]):
        wide, size = rows[:, 3:] - rows[:, :3], boxes[part, 3:] - boxes[part, :3]
        np.testing.assert_allclose(np.sort(wide / size, 1)[:, 1:], 1, rtol=1e-5)
        np.testing.assert_allclose((rows[:, :3].min(0) - boxes[part, :3]) / size, 0, atol=0.05)
    state = moved("boards")
    one = decoder(state, seen)
    other = decoder(state, seen._replace(asked=replaced(seen.asked, np.s_[:, 1], 0.3)))
    np.testing.assert_array_equal(one["rows"][-1][:, 0], other["rows"][-1][:, 0])
    assert (one["rows"][-1][:, 1] != other["rows"][-1][:, 1]).any()
    first = {f: getattr(seen, f)[:, :1] for f in ("asked", "asked_corners", "asked_codes")}
    alone = decoder(state, seen._replace(**first))
    close = {"rtol": 1e-4, "atol": 1e-5}
    np.testing.assert_allclose(alone["rows"][-1][:, 0], one["rows"][-1][:, 0], **close)
    np.testing.assert_allclose(alone["share"][:, 0], one["share"][:, 0], **close)


def open_door():
    """What is seen of a part that is shown open by a right angle, its box there and closed."""
    seen = seen_by_chance()
    hinge = Joint(np.array([-0.2, 0.3, 0]), np.array([0.0, 0, 1]), angle=(0.0, np.pi / 2))
    shown, closed = [-0.6, 0.3, -0.4, -0.2, 0.33, 0.1], [-0.23, -0.1, -0.4, -0.2, 0.3, 0.1]
    code = encode_joint(hinge, np.zeros(3))
    seen = seen._replace(
        asked_corners=replaced(seen.asked_corners, (0, 0), shown),
        asked_codes=replaced(seen.asked_codes, (0, 0), code),
    )
    return seen, shown, closed


def test_boards_of_an_open_door_are_read_where_it_is_shown(monkeypatch):
    state, (seen, *_) = moved("boards"), open_door()
    one, frame = decode("boards")(state, seen)["rows"][-1], BoardDecoder.frame

    def as_told(self, seen):
        scale, offset, motions = frame(self, seen)
        return scale, offset, jnp.broadcast_to(jnp.eye(3, 4), motions.shape)

    monkeypatch.setattr(BoardDecoder, "frame", as_told)
    other = method_of("boards")(state, seen)["rows"][-1]
    assert np.abs(one[:, 0] - other[:, 0]).max() > 1e-5
    np.testing.assert_array_equal(one[:, 1], other[:, 1])  # what is no open door


def test_boards_of_an_open_door_begin_where_it_lies_closed():
    """Shown at a right angle; its points are read where it is shown."""
    state, (seen, shown, closed) = made("boards")[1], open_door()
    rows = decode("boards")(state, seen)["rows"][0][0, 0]
    np.testing.assert_allclose(rows[:, :3].min(0), closed[:3], atol=0.03)
    np.testing.assert_allclose(rows[:, 3:].max(0), closed[3:], atol=0.03)
    frame = method_of("boards", "frame")
    _, _, motions = frame(state, seen)
    reading = jax.jit(read_boxes, static_argnames="gather")
    box, there = np.float32([[closed]]), np.float32([[shown]])
    read = reading(seen.map, box, seen.camera, motions[:, :1], gather=True)
    plain = reading(seen.map, there, seen.camera, gather=True)
    # the same points, in another order: the box is turned by a quarter
    order = np.lexsort(np.round(np.asarray(read).reshape(15, -1)[:, -3:].T, 3))
    other = np.lexsort(np.round(np.asarray(plain).reshape(15, -1)[:, -3:].T, 3))
    np.testing.assert_allclose(
        np.asarray(read).reshape(15, -1)[order],
        np.asarray(plain).reshape(15, -1)[other],
        atol=1e-4,
    )
    other = frame(state, seen._replace(asked_codes=seen.asked_codes * 0))[2]
    np.testing.assert_array_equal(other[0, 0], np.eye(3, 4))


def test_the_body_is_the_surest_root():
    corners = np.arange(18, dtype=np.float32).reshape(1, 3, 6)
    roots = np.float32([[[0, 5, 0], [0, 3, 0], [0, 0, 3]]])  # rows 1 and 2 are roots
    surest = jax.jit(likely_root)
    for exists, row in (([5, -5, 5], 2), ([5, 5, -5], 1)):
        found = surest(corners, np.float32([exists]), roots)
        np.testing.assert_array_equal(found[0], corners[0, row])


def test_their_loss_trains_nothing_else(params):
    """And each its own set, as nothing else depends on its parameters."""

    def loss(params):
        out = NETWORK.apply(params, IMAGE)
        found = jax.tree.leaves([out[name] for name in SETS])
        return sum(jnp.square(x - 0.3).sum() for x in found)

    gradient = jax.device_get(jax.jit(jax.grad(loss))(params))
    size = lambda tree: float(sum(np.abs(x).sum() for x in jax.tree.leaves(tree)))  # noqa: E731
    assert all(size(gradient.pop(name)) > 1 for name in SETS) and size(gradient) == 0


@pytest.mark.parametrize("name", SETS)
def test_queries_are_a_set(name, params):
    order = np.random.default_rng(3).permutation(SETS[name][0])
    own = params[name]
    turned = {kind: np.asarray(own[kind])[order] for kind in ("queries", "anchors")}
    one, two = (apply({**params, name: p}, IMAGE)[name] for p in (own, own | turned))
    for kind, values in one.items():
        if isinstance(values, list):
            value = np.asarray(values[-1])
            value = value[:, :, order] if name == "boards" else value[:, order]
            np.testing.assert_allclose(value, two[kind][-1], atol=2e-3)
        else:
            np.testing.assert_allclose(values, two[kind], atol=2e-4)


def test_the_box_around_a_leg_that_leans():
    row = np.float32([0.0, 0.1, 0.2, 0.3, -0.1, 0.15, 0.1, 0.4, -0.5, -0.2])
    np.testing.assert_allclose(
        jax.jit(LegDecoder.corners)(row), [-0.1, 0.1, -0.5, 0.2, 0.4, -0.2], rtol=1e-6
    )


def test_a_batch_without_them_teaches_the_parts_alone(params):
    """The sets are not in the loss, and a training holds them still; where a training is not of
    such batches, or some sets alone are missing, it is told."""
    rng = np.random.default_rng(2)
    rows = {
        "boxes": rng.random((2, 4, 6), np.float32),
        "codes": rng.random((2, 4, 9), np.float32),
        "colors": rng.random((2, 4, 3), np.float32),
    }
    counts = np.array([2, 4], np.int32)
    batch = LayoutBatch(
        image=IMAGE,
        camera=rng.random((2, 7), np.float32),
        parents=np.zeros((2, 4), np.int32),
        part_counts=counts,
        **rows,
    )
    config = Config(model=ModelConfig(layout=SMALL), data=DataConfig(box_sets_every=2))
    loss = make_layout_loss(NETWORK, config)
    moved, terms = jax.jit(jax.grad(loss, has_aux=True))(params, batch, jax.random.key(0))
    assert not {*SETS} & {*terms} and {"box", "code", "camera"} <= {*terms}
    for name, gradient in moved.items():
        largest = max(float(np.abs(leaf).max()) for leaf in jax.tree.leaves(gradient))
        assert (largest == 0) == (name in SETS), name
    lacking = batch._replace(
        legs=np.zeros((2, 8, 12), np.float32), leg_counts=counts, legs_alone=counts > 0
    )
    assert LayoutStage().idle(config, batch) == tuple(SETS)
    assert LayoutStage().idle(config, lacking) == ()
    always = make_layout_loss(NETWORK, Config(model=config.model))
    for given, words, loss_fn in ((lacking, "panels", loss), (batch, "legs", always)):
        with pytest.raises(ValueError, match=f"the batch has no {words}"):
            jax.eval_shape(loss_fn, params, given, jax.random.key(0))
