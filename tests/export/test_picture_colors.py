"""A picture's colours on the surface that it shows: what is seen takes them, what is hidden does
not, light is divided out."""

import dataclasses

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from uniart_jax.data.cameras import camera_codes
from uniart_jax.export import picture_colors
from uniart_jax.export.atlas import make_atlas
from uniart_jax.export.hidden_colors import Places
from uniart_jax.export.picture_colors import Picture, beside_nearer, guessed, look, paint
from uniart_jax.nn import lifting
from uniart_jax.objects.appearance import linear_to_srgb
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.visual.render import Camera, build_scene, fit, render
from uniart_jax.voxels.camera_code import camera_position, project

FRONT, SIDE, HIDDEN = (
    np.array([0.7, 0.1, 0.1]),
    np.array([0.1, 0.2, 0.7]),
    np.array([0.1, 0.6, 0.1]),
)


def painted(mesh, colors):
    rgba = np.round(255 * np.append(linear_to_srgb(colors), np.ones((len(colors), 1)), 1))
    return trimesh.Trimesh(
        mesh.vertices, mesh.faces, face_colors=rgba.astype(np.uint8), process=False
    )


def pictured(obj, elevation, size):
    """A picture of an object, and its camera's code."""
    camera = fit(obj, Camera(0.5, elevation, 35))
    rgba = np.round(render(obj, camera, size=size, samples=4) * 255).astype(np.uint8)
    row = [[camera.azimuth, camera.elevation, camera.fov_degrees, camera.distance]]
    code = camera_codes(np.array(row), rgba[None])[0]
    return Picture.of(rgba, code, size=size), code


@pytest.fixture(scope="module")
def scene():
    """A box, red in front (-x) and blue beside, before the middle of a green panel."""
    box = trimesh.creation.box((0.3, 0.4, 0.4))
    box.apply_translation((-0.2, 0, 0))
    colors = np.where(box.face_normals[:, :1] < -0.5, FRONT, SIDE)
    panel = trimesh.creation.box((0.05, 0.9, 0.9))
    panel.apply_translation((0.2, 0, 0))
    parts = (
        Part("panel", painted(panel, np.tile(HIDDEN, (12, 1))), -1, Joint.fixed()),
        Part("box", painted(box, colors), 0, Joint.fixed()),
    )
    obj = ArticulatedObject(parts)
    return obj, *pictured(obj, 0.4, 128)


def test_projection_is_the_networks():
    rng = np.random.default_rng(0)
    code = np.array([0.3, 0.9, 0.4, 1.7, 0.4, 0.05, -0.1])
    points = rng.uniform(-0.5, 0.5, (20, 3))
    position, places = camera_position(code), project(code, points)
    (expected,), _ = lifting.project(code[None].astype(np.float32), points.astype(np.float32))
    np.testing.assert_allclose(places, expected, atol=1e-5)
    along = project(code, np.stack([position * 0.2, position * 0.4]))
    np.testing.assert_allclose(along[0], along[1], atol=1e-9)  # one ray through the camera


def sampled(obj, count=4000):
    points, normals, own, colors = [], [], [], []
    for k, part in enumerate(obj.parts):
        place, face = trimesh.sample.sample_surface(part.mesh, count, seed=k)
        points.append(place)
        normals.append(part.mesh.face_normals[face])
        own.append(np.full(count, k))
        colors.append((np.asarray(part.mesh.visual.face_colors)[face, :3] / 255) ** 2.2)
    return tuple(np.concatenate(rows) for rows in (points, normals, own, colors))


def test_what_is_seen_is_believed_and_what_is_hidden_is_not(scene):
    obj, picture, _ = scene
    points, normals, own, _ = sampled(obj)
    _, belief = look(picture, obj, points, normals)
    front = (own == 1) & (normals[:, 0] < -0.5)
    assert np.median(belief[front]) == 1 and not belief[normals[:, 0] > 0.5].any()
    shadowed = (
        (own == 0) & (np.abs(points[:, 1:] - [0.1, -0.12]).max(1) < 0.06) & (normals[:, 0] < -0.5)
    )
    assert shadowed.sum() > 5 and not belief[shadowed].any()  # behind the box


def test_colours_come_from_the_picture_and_light_does_not(scene):
    obj, picture, _ = scene
    points, normals, own, true = sampled(obj)
    gray = np.full_like(true, true.mean())
    found = paint(picture, obj, points, normals, own, gray.__getitem__)
    _, belief = look(picture, obj, points, normals)
    sure = belief > 0.9
    before, after = np.abs(gray - true)[sure].mean(), np.abs(found - true)[sure].mean()
    assert after < 0.4 * before
    lit = [
        np.median(found[(belief > 0.5) & (own == 1) & mine].sum(-1))
        for mine in (normals[:, 0] < -0.5, normals[:, 2] > 0.5)
    ]
    true_lit = FRONT.sum() / SIDE.sum()
    assert abs(np.log(lit[0] / lit[1] / true_lit)) < 0.35
    # the far side of the box mirrors the near one
    near, far = ((own == 1) & (s * normals[:, 1] < -0.5) for s in (1, -1))
    assert not belief[far].any()
    np.testing.assert_allclose(np.median(found[far], 0), np.median(found[near], 0), atol=0.05)
    # and so has the panel's back its front's colour, not the network's gray
    back = (own == 0) & (normals[:, 0] > 0.5)
    assert not belief[back].any()
    off = np.abs(linear_to_srgb(found[back]) - linear_to_srgb(HIDDEN)).mean(-1)
    assert np.median(off) < 0.1


def desk(elevation):
    """A board, red on top and blue beside, its picture and the camera's code."""
    mesh = trimesh.creation.box((0.7, 0.7, 0.3))
    colors = np.where(mesh.face_normals[:, 2:] > 0.5, FRONT, SIDE)
    obj = ArticulatedObject((Part("desk", painted(mesh, colors), -1, Joint.fixed()),))
    return obj, *pictured(obj, elevation, 256)


def test_a_top_that_is_seen_at_a_low_angle_takes_the_pictures_colour():
    obj, picture, _ = desk(0.3)
    points, normals, own, true = sampled(obj)
    found = paint(picture, obj, points, normals, own, np.full_like(true, 0.5).__getitem__)
    top = (normals[:, 2] > 0.5) & (np.abs(points[:, :2]).max(1) < 0.25)  # away from its edges
    off = np.abs(linear_to_srgb(found[top]) - linear_to_srgb(FRONT)).mean(-1)
    assert np.median(off) < 0.05


def test_a_place_that_is_seen_at_a_cosine_of_an_eighth_is_believed_a_little():
    obj, picture, code = desk(0.21)
    points, normals, _, _ = sampled(obj, 20_000)
    towards = camera_position(code) - points
    cosine = (normals * towards).sum(-1) / np.linalg.norm(towards, axis=-1)
    top = (normals[:, 2] > 0.5) & (np.abs(points[:, :2]).max(1) < 0.25)
    some = top & (cosine > 0.115) & (cosine < 0.145)
    _, belief = look(picture, obj, points, normals)
    assert some.sum() > 50 and (belief[some] > 0).all()


def test_a_place_some_pixels_within_the_silhouette_is_believed():
    obj, picture, code = desk(0.3)
    points, normals, _, _ = sampled(obj, 20_000)
    at = ((project(code, points) + 1) * (len(picture.depth) / 2) - 0.5)[:, ::-1].T
    within = ndimage.map_coordinates(picture.depth, at, order=1)
    some = (normals[:, 0] < -0.5) & (within > 0.016) & (within < 0.022)
    _, belief = look(picture, obj, points, normals)
    assert some.sum() > 50 and np.median(belief[some]) == 1


def test_a_picture_of_nothing_changes_nothing(scene):
    obj, picture, code = scene
    points, normals, own, true = sampled(obj, 300)
    away = Picture(picture.pixels, picture.depth, code + np.array([0, 0, 0, 0, 0, 5, 5]))
    np.testing.assert_array_equal(paint(away, obj, points, normals, own, true.__getitem__), true)


def test_the_atlas_of_a_gray_object_takes_the_pictures_colours(scene):
    obj, picture, _ = scene
    parts = [dataclasses.replace(p, mesh=painted(p.mesh, np.full((12, 3), 0.3))) for p in obj.parts]
    gray = ArticulatedObject(tuple(parts))
    plain, shown = (np.asarray(make_atlas(gray, 256, p).texture, float) for p in (None, picture))
    assert np.ptp(plain, axis=-1).max() < 2  # gray throughout
    red, blue = (shown[..., i] > 1.5 * shown[..., j] + 20 for i, j in ((0, 2), (2, 0)))
    assert red.mean() > 0.01 and blue.mean() > 0.01


def test_light_is_what_the_renderer_has_there(scene):
    """Places that look everywhere else have the colours of their faces, in the light and out."""
    obj, picture, _ = scene
    points, normals, own, true = sampled(obj)
    shown, belief = look(picture, obj, points, normals)
    front, beside = normals[:, 0] < -0.5, np.abs(normals[:, 1]) > 0.5
    for mine in (own == 0, (own == 1) & front, (own == 1) & beside):
        sure = mine & (belief > 0.5)
        assert sure.sum() > 50
        off = np.abs(linear_to_srgb(shown[sure]) - linear_to_srgb(true[sure])).mean(-1)
        assert np.median(off) < 0.03 and np.quantile(off, 0.9) < 0.08
    shadow = (own == 0) & (belief > 0.9) & (np.abs(points[:, 1]) < 0.2)  # of the box, on the panel
    before = linear_to_srgb(shown[shadow]) - linear_to_srgb(true[shadow])
    assert shadow.sum() > 20 and abs(np.median(before)) < 0.03


def test_what_light_would_make_too_bright_keeps_its_hue(scene):
    """A dark place of the renderer's light that is bright in the picture, as in soft light."""
    obj, picture, _ = scene
    points, normals, _, _ = sampled(obj)
    tint = np.array([0.8, 0.6, 0.4])
    bright = dataclasses.replace(picture, pixels=np.broadcast_to(tint, picture.pixels.shape))
    shown, belief = look(bright, obj, points, normals)
    found = shown[belief > 0.9]
    assert np.isclose(found.max(-1), 1).any() and found.max() <= 1 + 1e-6
    np.testing.assert_allclose(
        found / found.max(-1, keepdims=True), [tint / 0.8] * len(found), atol=1e-4
    )


def test_nothing_is_believed_close_beside_a_surface_in_front(scene):
    obj, picture, code = scene
    points, normals, own, _ = sampled(obj, 20_000)
    position = camera_position(code)
    _, belief = look(picture, obj, points, normals)
    panel = np.flatnonzero((own == 0) & (normals[:, 0] < -0.5))
    beside = beside_nearer(build_scene(obj)[0], position, points[panel], normals[panel])
    assert 0.02 < beside.mean() < 0.5 and not belief[panel[beside]].any()
    assert (belief[panel[~beside]] > 0.5).mean() > 0.4
    edge = (own == 1) & (normals[:, 0] < -0.5) & (np.abs(points[:, 2]) > 0.19)
    assert (belief[edge] > 0).any()  # what stands in front keeps its edges


def test_what_is_hardly_seen_has_not_the_networks_colour(scene):
    obj, picture, _ = scene
    points, normals, own, true = sampled(obj, 20_000)
    magenta = np.tile([0.8, 0.0, 0.8], (len(points), 1))
    _, belief = look(picture, obj, points, normals)
    found = paint(picture, obj, points, normals, own, magenta.__getitem__)
    off = np.abs(linear_to_srgb(found) - linear_to_srgb(true)).mean(-1)
    for least, most in ((-1, 0), (0, 0.1), (0.1, 0.3), (0.3, 0.6), (0.6, 1)):
        band = (belief > least) & (belief <= most)
        assert band.sum() > 20 and np.median(off[band]) < 0.1


def test_a_few_places_that_are_seen_are_no_error(scene, monkeypatch):
    obj, picture, _ = scene
    points, normals, own, true = sampled(obj, 20_000)
    shown, belief = look(picture, obj, points, normals)
    few = np.zeros_like(belief)
    few[np.flatnonzero(belief > 0.9)[:60]] = 1  # one after the other
    monkeypatch.setattr(picture_colors, "look", lambda *_: (shown, few))
    monkeypatch.setattr(picture_colors, "PLACES", 200)
    found = paint(picture, obj, points, normals, own, true.__getitem__)
    assert np.isfinite(found).all() and (found >= 0).all() and (found <= 1).all()


def test_what_is_hidden_loses_the_networks_blotches(scene):
    obj, picture, _ = scene
    points, normals, parts, _ = sampled(obj)
    colors = np.random.default_rng(1).random((len(points), 3)).astype(np.float32)
    _, belief = look(picture, obj, points, normals)
    made = paint(picture, obj, points, normals, parts, colors.__getitem__)
    for part in range(2):
        hidden = (belief == 0) & (parts == part) & (normals[:, 0] > 0.5)
        assert hidden.sum() > 100
        assert np.std(made[hidden], axis=0).max() < 0.5 * np.std(colors[hidden], axis=0).max()


@pytest.fixture
def guesses_are_decoded(monkeypatch):
    """``hidden_colors`` gives the decoder's colours, sRGB, to the power of 2.2."""
    decoded = lambda places, obj, camera, at: places.decoded[at] ** 2.2  # noqa: E731
    monkeypatch.setattr(picture_colors, "hidden_colors", decoded)


@pytest.mark.usefixtures("guesses_are_decoded")
@pytest.mark.parametrize("moves", [False, True])
def test_a_patch_goes_but_for_windows_of_what_moves(scene, moves):
    part = Part("door", scene[0].parts[0].mesh, 0, Joint((0, 0.5, 0), (0, 0, 1), angle=(0, 1)))
    obj = ArticulatedObject((scene[0].parts[0], part))
    side = np.linspace(-0.5, 0.5, 60)
    points = np.stack([np.zeros(3600), *(a.ravel() for a in np.meshgrid(side, side))], 1)
    normals = np.tile([1.0, 0, 0], (3600, 1))
    middle = np.linalg.norm(points, axis=1)
    # more than half of AROUND, fewer than half of WIDE
    patch = np.argsort(middle, kind="stable")[:40]
    colors = np.full((3600, 3), 0.2)
    colors[patch] = 0.9
    none = np.zeros(3600)
    places = Places(points, normals, np.full(3600, int(moves)), None, colors, none > 0.5)
    found = guessed(places, colors.__getitem__, obj, np.zeros(3), none)
    expected = linear_to_srgb(np.array([0.9 if moves else 0.2])) ** 2.2
    np.testing.assert_allclose(found[patch[:4]], np.tile(expected, (4, 3)), atol=1e-3)


@pytest.mark.usefixtures("guesses_are_decoded")
def test_a_face_of_a_small_part_keeps_its_colour(scene):
    obj, _, _ = scene
    rng = np.random.default_rng(2)
    points = rng.random((80, 3)) * 0.1
    normals = np.where(np.arange(80)[:, None] < 30, [[1.0, 0, 0]], [[-1.0, 0, 0]])
    colors = np.where(np.arange(80)[:, None] < 30, 0.9, 0.2) * np.ones(3)
    none = np.zeros(80)
    places = Places(points, normals, none.astype(int), None, colors, none > 0.5)
    found = guessed(places, colors.__getitem__, obj, np.zeros(3), none)
    np.testing.assert_allclose(found, linear_to_srgb(colors) ** 2.2, atol=1e-3)


def test_the_network_is_asked_for_few_places(scene, monkeypatch):
    obj, picture, _ = scene
    points, normals, own, true = sampled(obj, 20_000)
    asked = []
    monkeypatch.setattr(picture_colors, "PLACES", 500)
    paint(picture, obj, points, normals, own, lambda rows: asked.append(len(rows)) or true[rows])
    assert 0 < sum(asked) < 1000


def test_hidden_places_of_which_none_is_asked_have_the_networks_colours(scene, monkeypatch):
    obj, _, _ = scene
    monkeypatch.setattr(picture_colors, "PLACES", 0)
    monkeypatch.setattr(picture_colors, "FEWEST", 1)
    rng = np.random.default_rng(0)
    points, colors = rng.random((30, 3)), rng.random((30, 3))
    belief = np.zeros(30)
    belief[0] = 1  # the one that is asked
    places = Places(points, points, np.zeros(30, int), None, colors, belief > 0.5)
    found = guessed(places, colors.__getitem__, obj, np.array([-2.0, 0, 0]), belief)
    np.testing.assert_array_equal(found[1:], colors[1:])
    assert not found[0].any()
