"""OpenShape similarity: what goes into the networks, and what is made of what comes out. Random
networks of toy size stand in for the real ones."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.visual import ColorVisuals

from uniart_jax.config import from_json, to_json
from uniart_jax.evaluation import openshape
from uniart_jax.evaluation.metric import STATES, at_rest
from uniart_jax.models import openclip
from uniart_jax.models.checkpoint_files import write_network
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.weights.openclip import convert_image_tower
from uniart_jax.weights.openshape import CARD, OpenShapeConfig, convert_point_encoder, files_of

RED, BLUE = (200, 30, 30), (20, 40, 220)


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A folder as ``uniart convert openshape`` leaves one, of the parity fixture's toy networks."""
    arrays = np.load(Path(__file__).parents[1] / "parity" / "openshape.npz", allow_pickle=False)
    config = from_json(OpenShapeConfig, str(arrays["config"]))
    state = {k[3:]: arrays[k] for k in arrays.files if k.startswith("sd/")}
    points = convert_point_encoder(
        {k: v for k, v in state.items() if k.startswith("module.")}, config.point_encoder
    )
    tower = convert_image_tower(state, config.image_tower)
    folder = tmp_path_factory.mktemp("weights")
    for stem, tree in files_of(points, tower).items():
        write_network(folder, stem, tree, "stored")
    (folder / CARD).write_text(to_json(config))
    return folder


def box(extents, center, color=None):
    mesh = trimesh.creation.box(extents)
    mesh.apply_translation(center)
    if color is not None:
        mesh.visual = ColorVisuals(mesh, face_colors=np.tile([*color, 255], (len(mesh.faces), 1)))
    return mesh


def cabinet(angle=(0.0, 1.5), colors=(RED, BLUE)):
    """A red cube of side 1 and a blue door (1.0 x 1.0 x .05) before its front, hinged at y =
    -.5."""
    body = Part("body", box((1, 1, 1), (0, 0, 0), colors[0]))
    hinge = Joint(np.array([-0.55, -0.5, 0.0]), np.array([0.0, 0, 1]), angle=angle)
    door = Part(
        "door",
        box((0.05, 1, 1), (-0.525, 0, 0), colors[1]),
        0,
        hinge if angle != (0, 0) else Joint.fixed(),
    )
    return at_rest(ArticulatedObject((body, door), name="cabinet"))


def test_without_weights_nothing_is_computed():
    assert openshape.measure(cabinet(), cabinet()) == {}
    assert openshape.NOT_COMPUTED.startswith(
        "not computed: no OpenShape weights (uniart convert openshape"
    )


def test_figures_are_the_cosines_of_the_embeddings(weights):
    pred, ref = cabinet(), cabinet((0.0, 0.7))
    found = openshape.measure(pred, ref, weights)
    assert set(found) == set(openshape.METRICS)
    encoders = openshape.load(weights)
    image = openshape.embed_picture(encoders, openshape.reference_picture(ref))
    cosines = openshape.embed_clouds(encoders, openshape.point_clouds(pred)) @ image
    assert found["rs_openshape"] == cosines[0]
    assert found["as_openshape"] == pytest.approx(cosines.mean(), abs=1e-12)
    assert np.abs(cosines).max() <= 1 and len(np.unique(cosines)) == len(STATES)
    assert openshape.measure(pred, ref, weights) == found
    np.testing.assert_allclose(np.linalg.norm(image), 1, atol=1e-12)


def test_the_given_image_counts_and_the_reference_does_not(weights):
    image = np.random.default_rng(0).integers(0, 256, (40, 30, 3), dtype=np.uint8)
    one, other = (
        openshape.measure(cabinet(), ref, weights, image) for ref in (cabinet(), cabinet((0, 0)))
    )
    assert one == other != openshape.measure(cabinet(), cabinet(), weights)


def test_what_does_not_move_is_the_same_in_every_state(weights):
    found = openshape.measure(cabinet((0, 0)), cabinet(), weights)
    assert found["as_openshape"] == pytest.approx(found["rs_openshape"], abs=1e-6)


def test_one_image_an_object(weights, monkeypatch):
    """The tower is by far the dearest step: it runs once for all samples of an object, again for
    the next object."""
    runs = []
    whole = openclip.embed
    monkeypatch.setattr(openclip, "embed", lambda *args: runs.append(1) or whole(*args))
    openshape._embed_kept.cache_clear()
    first, second = cabinet((0.0, 1.0)), cabinet((0.0, 1.0), (BLUE, RED))
    for ref, pred in ((first, first), (first, second), (second, first), (second, second)):
        openshape.measure(pred, ref, weights)
    assert len(runs) == 2


def test_clouds_are_as_openshape_wants_them():
    clouds = openshape.point_clouds(cabinet())
    assert clouds.shape == (5, 10_000, 6) and clouds.dtype == np.float32
    np.testing.assert_allclose(clouds[..., :3].mean(1), 0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(clouds[..., :3], axis=-1).max(1), 1, atol=1e-6)
    np.testing.assert_array_equal(clouds[0, :, 3:], clouds[4, :, 3:])
    blue = np.abs(clouds[0, :, 3:] - np.array(BLUE) / 255).max(-1) < 1e-3
    red = np.abs(clouds[0, :, 3:] - np.array(RED) / 255).max(-1) < 1e-3
    assert (red | blue).all()
    # areas: 6 of the cube, 2.2 of the door; the share's standard deviation is .0045
    assert blue.mean() == pytest.approx(2.2 / 8.2, abs=0.02)
    assert blue[:500].mean() == pytest.approx(2.2 / 8.2, abs=0.08)  # shuffled: balls take the first
    np.testing.assert_array_equal(clouds, openshape.point_clouds(cabinet()))


def test_points_move_with_their_parts_and_the_cloud_is_a_mirror_image():
    obj = cabinet()
    clouds = openshape.point_clouds(obj)[..., :3].astype(float) * [1, -1, 1]
    blue = openshape.point_clouds(obj)[0, :, 5] > 0.5
    # undo each cloud's own scale: distances between points of the cube are the same in all states
    some = np.flatnonzero(~blue)[:200]
    lengths = [np.linalg.norm(c[some[1:]] - c[some[:-1]], axis=1) for c in clouds]
    scale = np.array([(lengths[0] / each).mean() for each in lengths])
    rest, opened = clouds[0], clouds[4] * scale[4]
    opened = opened - opened[some].mean(0) + rest[some].mean(0)
    np.testing.assert_allclose(opened[~blue], rest[~blue], atol=1e-5)
    turn = trimesh.transformations.rotation_matrix(1.5, [0, 0, 1])[:3, :3]
    there, here = opened[blue] - opened[blue].mean(0), rest[blue] - rest[blue].mean(0)
    np.testing.assert_allclose(there, here @ turn.T, atol=1e-5)
    # the hinge is at low y of the object, so the opened door's points lie there, at low x
    assert opened[blue].mean(0)[1] < rest[blue].mean(0)[1] - 0.2


def test_colours_that_are_missing_are_openshapes_gray():
    np.testing.assert_array_equal(
        openshape.point_clouds(cabinet(colors=(None, None)))[..., 3:], np.float32(0.4)
    )


def test_a_surface_without_area_is_named():
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], [[0, 1, 2]], process=False)
    with pytest.raises(ValueError, match="'line': its surface has no area"):
        openshape.point_clouds(ArticulatedObject((Part("only", flat),), name="line"))


@settings(max_examples=10, deadline=None)
@given(st.floats(0.01, 100), st.tuples(*[st.floats(-10, 10)] * 3))
def test_size_and_place_do_not_matter(scale, shift):
    obj = cabinet()
    moved = obj.transformed(trimesh.transformations.scale_and_translate(scale, shift))
    # the scaled joint may come to lie within a float's width of the first; a hundredth of a percent
    # is seen
    np.testing.assert_allclose(
        openshape.point_clouds(moved, 300), openshape.point_clouds(obj, 300), atol=1e-4
    )


def test_a_picture_is_prepared_as_openclip_does():
    mean, std = np.array(openclip.IMAGE_MEAN), np.array(openclip.IMAGE_STD)
    stripes = np.zeros((20, 60, 3), np.uint8)
    stripes[:, :20], stripes[:, 20:40], stripes[:, 40:] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    found = openshape.prepare(stripes, 10) * std + mean  # the middle third
    assert found.shape == (10, 10, 3)
    np.testing.assert_allclose(found[:, 2:8], np.broadcast_to([0, 1, 0], (10, 6, 3)), atol=1e-6)
    tall = openshape.prepare(np.moveaxis(stripes, 0, 1).copy(), 10) * std + mean
    np.testing.assert_allclose(tall, np.moveaxis(found, 0, 1), atol=1e-6)
    clear = np.full((30, 30, 4), 255, np.uint8)
    clear[..., 3] = 0
    np.testing.assert_allclose(openshape.prepare(clear, 10) * std + mean, 0, atol=1e-6)
    gray = np.full((7, 9, 3), 51, np.uint8)  # enlarged where it must be
    np.testing.assert_allclose(
        openshape.prepare(gray, 10), np.broadcast_to((0.2 - mean) / std, (10, 10, 3)), atol=1e-6
    )


def test_the_reference_is_seen_from_its_front():
    picture = openshape.reference_picture(cabinet())
    assert picture.shape == (448, 448, 4) and picture.dtype == np.uint8
    seen = picture[picture[..., 3] == 255]
    assert (seen[:, 2] > seen[:, 0]).mean() > 0.4  # the blue door is in front
    assert picture[[0, -1], [0, -1], 3].max() == 0


def test_weights_that_are_not_there(tmp_path):
    with pytest.raises(FileNotFoundError, match="uniart convert openshape FOLDER --out DIR"):
        openshape.measure(cabinet(), cabinet(), tmp_path)


def test_failures_cannot_beat_any_prediction():
    assert all(dataclasses.astuple(m)[1:3] == ("higher", -1.0) for m in openshape.METRICS.values())
