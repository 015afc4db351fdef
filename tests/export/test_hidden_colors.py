"""What a picture does not show looks as what it shows, or as the decoder says."""

import runpy
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from uniart_jax.export import hidden_colors as network
from uniart_jax.export.hidden_colors import FARTHEST, Places, described, hidden_colors, weighed
from uniart_jax.objects.appearance import linear_to_srgb
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

ROOT = Path(__file__).resolve().parents[2]
BODY, DOOR, SAID = np.array([0.8, 0.3, 0.2]), np.array([0.2, 0.3, 0.7]), np.array([0.4, 0.5, 0.4])
CAMERA = np.array([-2.0, -1.2, 1.5])


def cabinet(decoded=SAID, count=1500):
    """A block with a plate in front; its places, of which those that face the camera are seen."""
    body, door = trimesh.creation.box((0.6, 0.8, 1.0)), trimesh.creation.box((0.05, 0.8, 1.0))
    door.apply_translation((-0.35, 0, 0))
    hinge = Joint((-0.35, -0.4, 0), (0, 0, 1), angle=(0, 1.5))
    parts = (Part("body", body, -1, Joint.fixed()), Part("door", door, 0, hinge))
    rows = []
    for k, mesh in enumerate((body, door)):
        points, face = trimesh.sample.sample_surface(mesh, count, seed=k)
        rows.append((points, mesh.face_normals[face], np.full(count, k)))
    points, normals, own = (np.concatenate(column) for column in zip(*rows, strict=True))
    towards = CAMERA - points
    seen = (normals * towards).sum(-1) > 0.3 * np.linalg.norm(towards, axis=-1)
    seen &= (own == 1) | (normals[:, 0] > -0.5)  # the door stands before the body's front
    shown = np.where(own[:, None] == 0, BODY, DOOR)
    decoded = None if decoded is None else np.tile(decoded, (len(points), 1))
    return ArticulatedObject(parts), Places(points, normals, own, decoded, shown, seen)


def test_candidates_are_of_places_that_are_seen_and_of_the_decoder():
    obj, places = cabinet()
    at = np.flatnonzero(~places.seen)
    features, colors, there = described(places, obj, CAMERA, at)
    assert features.shape == (len(at), 57) and np.isfinite(features).all() and there.all()
    own = np.where(places.parts[at][:, None] == 0, BODY, DOOR)
    for column in (network.NEAREST, network.ANY_WAY, network.MEDIAN):  # of the same part
        np.testing.assert_allclose(colors[:, column], own, atol=1e-6)
    for column, color in ((network.BODY, BODY), (network.DECODER, SAID)):
        np.testing.assert_allclose(colors[:, column], np.tile(color, (len(at), 1)), atol=1e-6)


def test_there_are_no_candidates_without_a_decoder_or_of_a_part_that_is_not_seen():
    obj, places = cabinet(decoded=None)
    places = places._replace(seen=places.seen & (places.parts == 1))
    at = np.flatnonzero(~places.seen)
    features, _, there = described(places, obj, CAMERA, at)
    body = places.parts[at] == 0
    assert there[body].any(0).tolist() == [False, False, False, True, *[False] * 4]
    assert not there[:, 6:].any() and np.isfinite(features).all()
    assert FARTHEST not in features[:, -8:-4]
    colors = hidden_colors(places, obj, CAMERA, at)
    assert colors.shape == (len(at), 3) and (colors >= 0).all() and (colors <= 1).all()


@pytest.mark.parametrize("seen", [0, 1, 2])
@pytest.mark.parametrize("decoded", [None, SAID])
def test_little_that_is_seen_is_no_error(seen, decoded):
    obj, places = cabinet(decoded=decoded, count=200)
    few = np.zeros(len(places.points), bool)
    few[np.flatnonzero(places.seen)[:seen]] = True
    places = places._replace(seen=few)
    at = np.flatnonzero(~few)
    colors = hidden_colors(places, obj, CAMERA, at)
    assert colors.shape == (len(at), 3) and np.isfinite(colors).all()
    assert hidden_colors(places, obj, CAMERA, at[:0]).shape == (0, 3)


def test_what_all_candidates_say_is_so():
    obj, places = cabinet(decoded=BODY)
    places = places._replace(shown=np.tile(BODY, (len(places.points), 1)))
    said = hidden_colors(places, obj, CAMERA, np.flatnonzero(~places.seen))
    off = np.abs(linear_to_srgb(said) - BODY).mean(-1)
    assert np.median(off) < 0.02 and np.quantile(off, 0.9) < 0.1


def test_the_order_of_places_changes_nothing():
    obj, places = cabinet()
    at = np.flatnonzero(~places.seen)
    first = hidden_colors(places, obj, CAMERA, at)
    order = np.random.default_rng(0).permutation(len(places.points))
    shuffled = Places(*(column[order] for column in places))
    np.testing.assert_allclose(
        hidden_colors(shuffled, obj, CAMERA, np.argsort(order)[at]), first, atol=1e-5
    )


def test_numpy_and_jax_weigh_alike_and_what_is_not_there_counts_nothing():
    rng = np.random.default_rng(0)
    features, colors = rng.normal(size=(40, 57)).astype(np.float32), rng.random((40, 8, 3))
    there = rng.random((40, 8)) < 0.6
    weights = network._weights()
    ours = weighed(features, colors, there, weights)
    theirs = weighed(*map(jnp.asarray, (features, colors, there)), weights, jnp)
    np.testing.assert_allclose(ours, theirs, atol=1e-4)
    other = np.where(there[..., None], colors, rng.random((40, 8, 3)))
    np.testing.assert_allclose(weighed(features, other, there, weights), ours, atol=1e-6)


def test_without_weights_all_that_is_there_counts_the_same():
    rng = np.random.default_rng(0)
    features, colors = rng.normal(size=(30, 57)), rng.random((30, 8, 3))
    there = rng.random((30, 8)) < 0.5
    nothing = {name: np.zeros_like(value) for name, value in network._weights().items()}
    nothing["deviation"] += 1
    found = weighed(features, colors, there, nothing)
    total = (colors * there[..., None]).sum(1) + 0.5  # its own colour is gray
    np.testing.assert_allclose(found, total / (there.sum(1) + 1)[:, None], atol=1e-6)


def test_the_tool_learns_which_candidate_is_right(tmp_path):
    tool = runpy.run_path(str(ROOT / "tools/fit_hidden_colors.py"), run_name="tool")
    seeds = tool["TRUE_SEED"], tool["MADE_SEED"]
    assert all(seed + 100_000 <= 900_000 for seed in seeds)  # validation seeds begin there
    calls = []

    def make(family, seed):
        calls.append(seed)
        return tool["of_true"](family, seed)

    rows = tool["blocks"](tmp_path, "true", 6, seeds[0], make)
    assert len(rows.true) == 6 and len(calls) == 6
    again = tool["blocks"](tmp_path, "true", 6, seeds[0], make)
    np.testing.assert_array_equal(again.features, rows.features)
    assert len(calls) == 6  # read, not made
    few = type(rows)(*(column[:, :32] for column in rows))  # places are enough
    asked = few._replace(true=few.colors[:, :, 3])  # all look as the nearest that is seen
    weights = tool["fit"](asked, asked, 150)
    found = tool["errors"](asked, weights)
    assert found["network"].mean() < 0.5 * np.abs(asked.colors[:, :, 4] - asked.true).mean()


@pytest.mark.parametrize("name", ["mean", "deviation", "kernel_0", "bias_3"])
def test_weights_fit_the_features(name):
    weights = network._weights()
    sizes = {"mean": (57,), "deviation": (57,), "kernel_0": (57 + 8 * 4, 64), "bias_3": (12,)}
    assert weights[name].shape == sizes[name] and np.isfinite(weights[name]).all()
