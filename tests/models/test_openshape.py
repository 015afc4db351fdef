"""OpenShape's and OpenCLIP's encoders against upstream's own outputs, their full sizes, and how
centres and balls are found.

``tests/parity/openshape.npz`` was made with PyTorch on a CPU by upstream's own modules
(Colin97/OpenShape_code ``ppat.py``, mlfoundations/open_clip ``transformer.py``, both as of 2025) in
tiny sizes with random weights: every tensor was drawn (norms' scales in [.5, 1.5], running
variances in [.3, 2]) and rounded to float16, so that it is stored as such. DGL's farthest point
sampler was a plain loop that starts at point 0. Keys as in ``parity/fixtures/README.md``; no point
is nearer than 4e-5 to a ball's surface, so rounding cannot decide.
"""

import dataclasses
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.config import from_json
from uniart_jax.models import openclip, openshape
from uniart_jax.weights.mapping import flatten
from uniart_jax.weights.openclip import convert_image_tower
from uniart_jax.weights.openshape import OpenShapeConfig, convert_point_encoder

TOLERANCE = {"rtol": 1e-4, "atol": 1e-4}
embed_points = jax.jit(openshape.embed, static_argnames="config")
farthest_points = jax.jit(openshape.farthest_points, static_argnames="count")
ball_points = jax.jit(openshape.ball_points, static_argnames="count")


@pytest.fixture(scope="module")
def case():
    arrays = np.load(Path(__file__).parents[1] / "parity" / "openshape.npz", allow_pickle=False)
    values = {k: arrays[k] for k in arrays.files}
    config = from_json(OpenShapeConfig, str(values.pop("config")))
    wide = {k: v.astype(np.float32) if v.dtype == np.float16 else v for k, v in values.items()}
    return config, wide


def state(case, prefix):
    return {k[3:]: v for k, v in case[1].items() if k.startswith(f"sd/{prefix}")}


@pytest.fixture(scope="module")
def point_encoder(case):
    return convert_point_encoder(state(case, "module."), case[0].point_encoder)


def test_point_encoder_is_upstreams(case, point_encoder):
    config, values = case[0].point_encoder, case[1]
    clouds = values["in/points"]
    first = [farthest_points(c[:, :3], config.patches) for c in clouds]
    np.testing.assert_array_equal(first, values["out/first"])
    sa = point_encoder["ppat"]["sa"]
    features = jax.jit(jax.vmap(lambda c: openshape.patches(sa, c, config)[1]))(clouds)
    np.testing.assert_allclose(features, values["out/features"], **TOLERANCE)
    found = embed_points(point_encoder, clouds, config)
    np.testing.assert_allclose(found, values["out/points"], **TOLERANCE)


def test_image_tower_is_upstreams(case):
    config, values = case[0].image_tower, case[1]
    params = convert_image_tower(state(case, "visual."), config)
    found = openclip.embed(params, values["in/image"], config)
    np.testing.assert_allclose(found, values["out/image"], **TOLERANCE)
    inside = jax.jit(openclip.embed, static_argnames="config")(params, values["in/image"], config)
    np.testing.assert_allclose(inside, found, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    "name",
    [
        "module.ppat.sa.mlp_bns.1.running_var",
        "module.ppat.transformer.layers.1.0.fn.to_qkv.weight",
        "module.ppat.lift.2.bias",
        "module.ppat.cls_token",
    ],
)
def test_a_wrong_weight_is_seen(case, name):
    """The tolerance means something: a twentieth of one weight's size is enough."""
    config, values = case[0].point_encoder, case[1]
    wrong = state(case, "module.")
    wrong[name] = wrong[name].copy()
    wrong[name].flat[7] += 0.05 * np.abs(wrong[name]).max()
    found = embed_points(convert_point_encoder(wrong, config), values["in/points"], config)
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(found, values["out/points"], **TOLERANCE)


def test_point_order_matters_only_by_the_first_point(case, point_encoder):
    """Fewer points in every ball than are taken: then the cloud is a set, but for where the centres
    start."""
    config = dataclasses.replace(case[0].point_encoder, neighbors=200, radius=0.25)
    cloud = case[1]["in/points"][1]
    order = np.concatenate([[0], 1 + np.random.default_rng(0).permutation(len(cloud) - 1)])
    clouds = np.stack([cloud, cloud[order], cloud[::-1]])
    one, other, elsewhere = embed_points(point_encoder, clouds, config)
    np.testing.assert_allclose(one, other, **TOLERANCE)
    assert np.abs(elsewhere - one).max() > 1e-3


def test_too_few_points(point_encoder, case):
    with pytest.raises(ValueError, match="a cloud of 20 points; give at least 24"):
        openshape.embed(point_encoder, jnp.zeros((1, 20, 6)), case[0].point_encoder)


def test_farthest_points_on_a_line():
    line = np.zeros((5, 3), np.float32)
    line[:, 0] = [
        1,
        0,
        4,
        2.4,
        3,
    ]  # from 1: 4 is farthest, then 2.4 (1.4 away), then 0 and 3 (1 and .6)
    np.testing.assert_array_equal(farthest_points(line, 5), [0, 2, 3, 1, 4])
    same = np.zeros((4, 3), np.float32)
    np.testing.assert_array_equal(farthest_points(same, 3), [0, 0, 0])


def test_a_ball_takes_its_first_points():
    xyz = np.zeros((6, 3), np.float32)
    xyz[:, 0] = [0, 0.1, 5, 0.25, -0.2, 0.05]
    found = ball_points(xyz, xyz[[0, 2]], 0.25, 3)
    np.testing.assert_array_equal(found, [[0, 1, 3], [2, 2, 2]])  # .25 itself is inside; 2 is alone


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.05, 1.5))
def test_balls_and_centres_against_plain_loops(seed, radius):
    xyz = np.random.default_rng(seed).normal(size=(60, 3)).astype(np.float32)
    taken = [0]
    for _ in range(7):
        distance = np.linalg.norm(xyz[:, None] - xyz[taken], axis=-1).min(1)
        taken.append(int(distance.argmax()))
    np.testing.assert_array_equal(farthest_points(xyz, 8), taken)
    squares = np.square(xyz[taken][:, None] - xyz).sum(-1)
    if np.abs(squares - radius**2).min() < 1e-5:
        return  # rounding decides
    found = np.asarray(ball_points(xyz, xyz[taken], radius, 12))
    for row, center in zip(found, squares, strict=True):
        inside = np.flatnonzero(center <= radius**2)[:12]
        np.testing.assert_array_equal(row, np.append(inside, [inside[0]] * (12 - len(inside))))


def test_full_sizes():
    """What the published names mean in numbers: embeddings of 1280, 32 million and 1.84 billion
    parameters."""
    points, tower = openshape.PointEncoderConfig(), openclip.ImageTowerConfig()
    cloud = jax.ShapeDtypeStruct((2, 10_000, 6), jnp.float32)
    image = jax.ShapeDtypeStruct((2, 224, 224, 3), jnp.float32)
    embeddings = (
        jax.eval_shape(lambda p, x: openshape.embed(p, x, points), openshape.abstract(points), cloud),  # noqa: E501
        jax.eval_shape(lambda p, x: openclip.embed(p, x, tower), openclip.abstract(tower), image),
    )  # fmt: skip
    assert [e.shape for e in embeddings] == [(2, 1280), (2, 1280)]
    counts = [
        sum(leaf.size for leaf in flatten(tree).values())
        for tree in (openshape.abstract(points), openclip.abstract(tower))
    ]
    # PyTorch's count of the first, and its batch norms' statistics; of the second by hand, 1844.91
    # M in open_clip's model_profile.csv
    assert counts == [32_326_080 + 2 * (64 + 64 + 256), 1_844_907_264]
    assert openclip.abstract(tower)["transformer"]["resblocks"]["47"]["mlp"]["c_fc"][
        "kernel"
    ].shape == (1664, 8192)


def test_configs_survive_json():
    config = OpenShapeConfig()
    text = json.dumps(dataclasses.asdict(config))
    assert from_json(OpenShapeConfig, text) == config
