"""Legs, panels and boards as sets: they leave the parts as they are and permute as a set does."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import parameters
from flax import nnx

from uniart_jax.config import LayoutConfig, ModelConfig
from uniart_jax.models.box_sets import (
    LEG_ROW,
    PANEL_ROW,
    BoardDecoder,
    LegDecoder,
    PanelDecoder,
    Seen,
)
from uniart_jax.models.layout import likely_root
from uniart_jax.models.layout_layers import read_boxes
from uniart_jax.models.network import build
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.joint_code import encode_joint

SMALL = LayoutConfig(
    queries=5, image_size=64, backbone="convolutions", map_channels=8, width=16, layers=2, heads=2,
    sketch_width=12, head_width=12, legs=8, panels=24, boards=12,
)  # fmt: skip
NETWORK = build("layout", ModelConfig(layout=SMALL))
IMAGE = jax.random.uniform(jax.random.key(1), (2, 64, 64, 3))


@pytest.fixture(scope="module")
def params():
    return parameters(NETWORK)


SETS = {"legs": (8, LegDecoder), "panels": (24, PanelDecoder), "boards": (12, BoardDecoder)}


@pytest.mark.parametrize("name", SETS)
def test_they_come_with_the_parts_and_leave_them_as_they_are(name, params):
    out = jax.jit(NETWORK.apply)(params, IMAGE)
    found, (count, decoder) = out.pop(name), SETS[name]
    row = LEG_ROW if name == "legs" else PANEL_ROW
    sets = (2, SMALL.queries) if name == "boards" else (2,)  # one a part
    assert [r.shape for r in found["rows"]] == [(*sets, count, row)] * (decoder.RUNS + 1)
    for kind in ("exists", "plinth", "fill") if name == "legs" else ("exists",):
        assert [value.shape for value in found[kind]] == [(*sets, count)] * (decoder.RUNS + 1)
    assert found["alone" if name == "legs" else "share"].shape == sets
    without = build("layout", ModelConfig(layout=dataclasses.replace(SMALL, **{name: 0})))
    bare = jax.jit(without.apply)({k: v for k, v in params.items() if k != name}, IMAGE)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6), out, bare)


def seen_by_chance():
    size, width = SMALL.image_size // 4, SMALL.width
    draw = lambda *shape: jax.random.normal(jax.random.key(sum(shape)), shape)  # noqa: E731
    return Seen(
        map=draw(1, size, size, SMALL.map_channels),
        tokens=draw(1, 9, width),
        tokens_place=draw(9, width),
        sketch=draw(1, SMALL.sketch_width),
        parts=draw(1, 5, width),
        parts_place=draw(1, 5, width),
        asked=draw(1, 2, width),
        asked_corners=jnp.array([[[-0.2, -0.3, -0.4, 0, 0.3, 0.1], [0, 0, 0, 0.1, 0.1, 0.3]]]),
        asked_codes=jnp.zeros((1, 2, 9)),
        body=jnp.array([[-0.2, -0.3, -0.4, 0.2, 0.3, 0.4]]),
        camera=jnp.array([[0.0, 1, 0.3, 1, 0.2, 0, 0]]),
    )


@pytest.mark.parametrize("name", SETS)
def test_they_see_the_image_and_the_parts(name):
    decoder, seen = SETS[name][1](NETWORK.config, nnx.Rngs(0), jnp.float32), seen_by_chance()
    nnx.update(decoder, jax.tree.map(lambda x: x + 0.1, nnx.state(decoder)))
    rows = decoder(seen)["rows"][-1]
    inputs = ["map", "tokens", "parts", "parts_place", "camera"]
    own = {"legs": ["sketch"], "panels": ["sketch", "body"], "boards": ["asked", "asked_corners"]}
    for field in inputs + own[name]:
        changed = getattr(seen, field) * (-0.5 if field == "parts" else 0.5)  # some are normalised
        other = decoder(seen._replace(**{field: changed}))["rows"][-1]
        assert np.abs(np.asarray(other) - np.asarray(rows)).max() > 1e-4, field


def test_panels_begin_as_boards_of_the_body_however_small_it_is():
    decoder, seen = PanelDecoder(NETWORK.config, nnx.Rngs(0), jnp.float32), seen_by_chance()
    rows = np.asarray(decoder(seen)["rows"][0][0])
    wide = rows[:, 3:] - rows[:, :3]
    assert (wide > 0).all()
    np.testing.assert_allclose(np.sort(wide / [0.4, 0.6, 0.8], 1)[:, 1:], 1, rtol=1e-5)
    np.testing.assert_allclose(rows[:, :3].min(0), [-0.2, -0.3, -0.4], atol=0.03)
    point = seen._replace(body=jnp.array([[0.1, 0.1, 0.1, 0.1, 0.0, 0.1]]))
    rows = np.asarray(decoder(point)["rows"][0][0])
    assert np.isfinite(rows).all() and (rows[:, 3:] > rows[:, :3]).all()


def test_boards_begin_in_the_box_of_their_part_and_do_not_see_those_of_another():
    decoder, seen = BoardDecoder(NETWORK.config, nnx.Rngs(0), jnp.float32), seen_by_chance()
    boxes = np.asarray(seen.asked_corners[0])
    for part, rows in enumerate(np.asarray(decoder(seen)["rows"][0][0])):
        wide, size = rows[:, 3:] - rows[:, :3], boxes[part, 3:] - boxes[part, :3]
        np.testing.assert_allclose(np.sort(wide / size, 1)[:, 1:], 1, rtol=1e-5)
        np.testing.assert_allclose((rows[:, :3].min(0) - boxes[part, :3]) / size, 0, atol=0.05)
    nnx.update(decoder, jax.tree.map(lambda x: x + 0.1, nnx.state(decoder)))
    one = decoder(seen)
    other = decoder(seen._replace(asked=seen.asked.at[:, 1].set(0.3)))
    np.testing.assert_array_equal(one["rows"][-1][:, 0], other["rows"][-1][:, 0])
    assert (one["rows"][-1][:, 1] != other["rows"][-1][:, 1]).any()
    first = {f: getattr(seen, f)[:, :1] for f in ("asked", "asked_corners", "asked_codes")}
    alone = decoder(seen._replace(**first))
    np.testing.assert_allclose(alone["rows"][-1][:, 0], one["rows"][-1][:, 0], rtol=1e-4)
    np.testing.assert_allclose(alone["share"][:, 0], one["share"][:, 0], rtol=1e-4)


def board_decoder():
    return BoardDecoder(NETWORK.config, nnx.Rngs(0), jnp.float32)


def open_door():
    """What is seen of a part that is shown open by a right angle, its box there and closed."""
    seen = seen_by_chance()
    hinge = Joint(np.array([-0.2, 0.3, 0]), np.array([0.0, 0, 1]), angle=(0.0, np.pi / 2))
    shown, closed = [-0.6, 0.3, -0.4, -0.2, 0.33, 0.1], [-0.23, -0.1, -0.4, -0.2, 0.3, 0.1]
    code = jnp.asarray(encode_joint(hinge, np.zeros(3)), jnp.float32)
    seen = seen._replace(
        asked_corners=seen.asked_corners.at[0, 0].set(jnp.array(shown)),
        asked_codes=seen.asked_codes.at[0, 0].set(code),
    )
    return seen, shown, closed


def test_boards_of_an_open_door_are_read_where_it_is_shown(monkeypatch):
    decoder, (seen, *_) = board_decoder(), open_door()
    nnx.update(decoder, jax.tree.map(lambda x: x + 0.1, nnx.state(decoder)))
    one, frame = decoder(seen)["rows"][-1], BoardDecoder.frame

    def as_told(self, seen):
        scale, offset, motions = frame(self, seen)
        return scale, offset, jnp.broadcast_to(jnp.eye(3, 4), motions.shape)

    monkeypatch.setattr(BoardDecoder, "frame", as_told)
    other = decoder(seen)["rows"][-1]
    assert np.abs(one[:, 0] - other[:, 0]).max() > 1e-5
    np.testing.assert_array_equal(one[:, 1], other[:, 1])  # what is no open door


def test_boards_of_an_open_door_begin_where_it_lies_closed():
    """Shown at a right angle; its points are read where it is shown."""
    decoder, (seen, shown, closed) = board_decoder(), open_door()
    rows = np.asarray(decoder(seen)["rows"][0][0, 0])
    np.testing.assert_allclose(rows[:, :3].min(0), closed[:3], atol=0.03)
    np.testing.assert_allclose(rows[:, 3:].max(0), closed[3:], atol=0.03)
    _, _, motions = decoder.frame(seen)
    box = jnp.array([[closed]])
    read = read_boxes(seen.map, box, seen.camera, motions[:, :1], gather=True)
    plain = read_boxes(seen.map, jnp.array([[shown]]), seen.camera, gather=True)
    # the same points, in another order: the box is turned by a quarter
    order = np.lexsort(np.round(np.asarray(read).reshape(15, -1)[:, -3:].T, 3))
    other = np.lexsort(np.round(np.asarray(plain).reshape(15, -1)[:, -3:].T, 3))
    np.testing.assert_allclose(
        np.asarray(read).reshape(15, -1)[order],
        np.asarray(plain).reshape(15, -1)[other],
        atol=1e-4,
    )
    other = decoder.frame(seen._replace(asked_codes=seen.asked_codes * 0))[2]
    np.testing.assert_array_equal(other[0, 0], np.eye(3, 4))


def test_the_body_is_the_surest_root():
    corners = jnp.arange(18.0).reshape(1, 3, 6)
    roots = jnp.array([[[0.0, 5, 0], [0, 3, 0], [0, 0, 3]]])  # rows 1 and 2 are roots
    for exists, row in (([5.0, -5, 5], 2), ([5.0, 5, -5], 1)):
        found = likely_root(corners, jnp.array([exists]), roots)
        np.testing.assert_array_equal(found[0], corners[0, row])


@pytest.mark.parametrize("name", SETS)
def test_their_loss_trains_nothing_else(name, params):
    def loss(params):
        found = NETWORK.apply(params, IMAGE)[name]
        return sum(jnp.square(x - 0.3).sum() for x in jax.tree.leaves(found))

    gradient = jax.jit(jax.grad(loss))(params)
    size = lambda tree: float(sum(jnp.abs(x).sum() for x in jax.tree.leaves(tree)))  # noqa: E731
    assert size(gradient.pop(name)) > 1 and size(gradient) == 0


@pytest.mark.parametrize("name", SETS)
def test_queries_are_a_set(name, params):
    order = np.random.default_rng(3).permutation(SETS[name][0])
    own = params[name]
    other = {**own, "queries": own["queries"][order], "anchors": own["anchors"][order]}
    run = jax.jit(NETWORK.apply)
    one, two = (run({**params, name: p}, IMAGE)[name] for p in (own, other))
    for kind, values in one.items():
        if isinstance(values, list):
            value = np.asarray(values[-1])
            value = value[:, :, order] if name == "boards" else value[:, order]
            np.testing.assert_allclose(value, two[kind][-1], atol=2e-3)
        else:
            np.testing.assert_allclose(values, two[kind], atol=2e-4)


def test_the_box_around_a_leg_that_leans():
    row = jnp.array([0.0, 0.1, 0.2, 0.3, -0.1, 0.15, 0.1, 0.4, -0.5, -0.2])
    np.testing.assert_allclose(
        LegDecoder.corners(row), [-0.1, 0.1, -0.5, 0.2, 0.4, -0.2], rtol=1e-6
    )
