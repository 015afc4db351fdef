"""Pictures compared: golden PSNR, the frame of the views, motion seen by AS alone, materials for
predictions without any."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import SimpleMaterial

from uniart_jax import procedural
from uniart_jax.evaluation import appearance
from uniart_jax.evaluation.appearance import (
    CAMERAS,
    CAP,
    METRICS,
    SIZE,
    compare,
    measure,
    psnr,
    views,
)
from uniart_jax.evaluation.materials import painted, surface_colors, uncolored, with_materials
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.objects.appearance import srgb_to_linear
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.visual.render import render

BODY, DOOR = (200, 120, 40), (30, 60, 160)


def box(lo, hi, color=None) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(bounds=[lo, hi])
    if color is not None:
        rgba = np.tile(np.uint8([*color, 255]), (len(mesh.faces), 1))
        mesh.visual = ColorVisuals(mesh, face_colors=rgba)
    return mesh


def cupboard(angle: float = np.pi / 2, body=BODY, door=DOOR, side: int = 1) -> ArticulatedObject:
    """A block with a door before its front, hinged at y = .4 * side, that turns by ``angle``; the
    front is -x."""
    joint = Joint([-0.32, 0.4 * side, 0], [0, 0, 1], (min(0, angle), max(0, angle)))
    parts = (
        Part("body", box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5], body)),
        Part("door", box([-0.34, -0.4, -0.5], [-0.3, 0.4, 0.5], door), 0, joint),
    )
    return at_rest(ArticulatedObject(parts))


@pytest.fixture
def fewer_pixels(monkeypatch):
    """For figures whose meaning does not hang on the pictures' size."""
    monkeypatch.setattr(appearance, "SIZE", SIZE // 3)


def pictures(value: float, alpha: float = 1.0) -> np.ndarray:
    image = np.full((2, 6, 6, 4), value, np.float32)
    image[..., 3] = alpha
    return image


@given(st.floats(0.002, 1.0))
def test_a_constant_difference_has_the_psnr_of_the_formula(d):
    flat = np.zeros((3, 5, 7, 3))
    np.testing.assert_allclose(psnr(flat + d, flat), 20 * np.log10(1 / d), atol=1e-9)


def test_psnr_is_capped_and_masked_by_hand():
    a, b = np.zeros((1, 2, 2, 3)), np.zeros((1, 2, 2, 3))
    assert psnr(a, b)[0] == pytest.approx(CAP)
    b[0, 0, 0] = [1, 0, 0]  # 1 of 12 values
    assert psnr(a, b)[0] == pytest.approx(10 * np.log10(12))
    mask = np.zeros((1, 2, 2), bool)
    mask[0, 0] = True
    assert psnr(a, b, mask)[0] == pytest.approx(10 * np.log10(6))


def test_compare_by_hand():
    ref, pred = pictures(1.0, 0.0), pictures(1.0, 0.0)
    ref[0, :3, :, :3], ref[0, :3, :, 3] = 0.5, 1  # upper half gray
    pred[0, :, :2, :3], pred[0, :, :2, 3] = 0.5, 1  # left third gray
    whole, masked, overlap = compare(pred, ref)  # 18 and 12 pixels, 6 of them shared; 18 differ
    expected = -10 * np.log10(0.25 * 18 / 36)
    assert whole == pytest.approx((expected + CAP) / 2)  # the second picture is empty on both sides
    assert masked == pytest.approx(-10 * np.log10(0.25 * 18 / 24))
    assert overlap == pytest.approx(6 / 24)


def test_nothing_in_any_picture_is_nothing_to_compare():
    empty = pictures(1.0, 0.0)
    whole, masked, overlap = compare(empty, empty)
    assert whole == pytest.approx(CAP) and np.isnan([masked, overlap]).all()


def test_the_views_are_the_cameras_own_pictures():
    obj = cupboard()
    q = obj.open(0.6)
    drawn = views(obj, q)
    assert drawn.shape == (len(CAMERAS), SIZE, SIZE, 4)
    for camera, view in zip(CAMERAS, drawn, strict=True):
        rgba = render(obj, camera, SIZE, q, samples=1)
        white = rgba[..., :3] * rgba[..., 3:] + 1 - rgba[..., 3:]
        np.testing.assert_allclose(view[..., :3], white, atol=1e-6)
        np.testing.assert_array_equal(view[..., 3], rgba[..., 3])
    front = drawn[0, SIZE // 2, SIZE // 2]
    assert front[3] == 1 and front[0] > front[2]  # the door is open: the orange body is seen
    closed = views(obj, obj.open(0))[0, SIZE // 2, SIZE // 2]
    assert closed[2] > closed[0]


def test_cameras_are_symmetric_and_stand_as_written():
    places = {(round(np.rad2deg(c.azimuth)) % 360, round(np.rad2deg(c.elevation))) for c in CAMERAS}
    assert places == {(-a % 360, e) for a, e in places}
    assert {a for a, e in places if e < 60} == {0, 45, 90, 135, 180, 225, 270, 315}
    assert {(c.distance, c.fov_degrees) for c in CAMERAS} == {(3.5, 40.0)}
    corners = np.array(list(itertools.product([-0.5, 0.5], repeat=3)))
    for camera in CAMERAS:  # all of an object at rest is in the picture
        assert np.all(np.abs(camera.project(corners, SIZE) - SIZE / 2) < SIZE / 2)


@pytest.mark.usefixtures("fewer_pixels")
def test_identical_objects_get_the_cap():
    obj = at_rest(procedural.generate("microwave", 3))
    figures = measure(obj, obj)
    assert set(figures) == set(METRICS)
    assert figures == pytest.approx(
        {k: 1.0 if k.endswith("silhouette") else CAP for k in METRICS}, abs=1e-9
    )


@pytest.mark.usefixtures("fewer_pixels")
def test_a_door_that_opens_wrongly_is_seen_by_articulated_states_alone():
    truth = cupboard()
    degrees = (90, 84, 75, 60, 40, 15)
    found = [measure(cupboard(np.deg2rad(d)), truth) for d in degrees]
    for figures in found:
        assert figures["rs_psnr"] == figures["rs_psnr_object"] == pytest.approx(CAP)
        assert figures["rs_silhouette"] == 1
    for name in ("as_psnr", "as_psnr_object", "as_silhouette"):
        values = [f[name] for f in found]
        assert all(a > b for a, b in itertools.pairwise(values)), (name, values)
    inwards = measure(cupboard(-np.pi / 2), truth)
    assert inwards["as_psnr"] < found[1]["as_psnr"] - 3
    other_side = measure(cupboard(-np.pi / 2, side=-1), truth)
    assert other_side["rs_psnr"] == pytest.approx(CAP)
    assert other_side["as_psnr"] < found[1]["as_psnr"] - 3


@pytest.mark.usefixtures("fewer_pixels")
def test_articulated_figures_are_the_mean_of_five_states_and_rest_is_one_of_them():
    truth, pred = cupboard(), cupboard(np.deg2rad(50), door=(90, 60, 160))
    rows = [
        compare(views(pred, pred.open(s)), views(truth, truth.open(s)))
        for s in (0.0, 0.25, 0.5, 0.75, 1.0)
    ]
    figures = measure(pred, truth)
    for column, name in enumerate(("psnr", "psnr_object", "silhouette")):
        values = [row[column] for row in rows]
        assert figures[f"rs_{name}"] == pytest.approx(values[0])
        assert figures[f"as_{name}"] == pytest.approx(np.mean(values))
        assert abs(np.mean(values) - np.mean(values[1:])) > 0.001


@pytest.mark.slow
@settings(max_examples=3)
@given(st.permutations([0, 1, 2]), st.floats(0.2, 5))
def test_part_order_scale_and_place_do_not_matter(order, scale):
    root = Part("r", box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.3], BODY))
    slides = [
        Part(f"d{i}", box([-0.35, -0.4, z], [-0.3, 0.4, z + 0.2], (50 * i, 200, 90)), 0,
             Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.1 * (i + 1))))
        for i, z in enumerate((-0.5, -0.2, 0.1))
    ]  # fmt: skip
    one = ArticulatedObject((root, *slides))
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = [1, -2, 3]
    other = ArticulatedObject((root, *(slides[i] for i in order))).transformed(matrix)
    figures = measure(at_rest(other), at_rest(one))
    assert figures["as_psnr"] > 45 and figures["as_silhouette"] > 0.99


def stripped(obj: ArticulatedObject, visual=None) -> ArticulatedObject:
    parts = []
    for part in obj.parts:
        mesh = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
        if visual is not None:
            mesh.visual = visual(mesh)
        parts.append(dataclasses.replace(part, mesh=mesh))
    return dataclasses.replace(obj, parts=tuple(parts))


def gray_texture(mesh: trimesh.Trimesh) -> TextureVisuals:
    material = SimpleMaterial(image=Image.new("RGB", (4, 4), (153, 153, 153)))
    return TextureVisuals(uv=np.zeros((len(mesh.vertices), 2)), material=material)


NO_COLORS = {
    "no visual": None,
    "loader's gray": lambda m: ColorVisuals(m, face_colors=[153, 153, 153, 255]),
    "vertex gray": lambda m: ColorVisuals(m, vertex_colors=[102, 102, 102, 255]),
    "white": lambda m: ColorVisuals(m, face_colors=[255, 255, 255, 255]),
    "OBJ's default": lambda m: TextureVisuals(material=SimpleMaterial(diffuse=[204, 204, 204])),
    "blank texture": gray_texture,
}


@functools.cache
def with_colors(degrees: int):
    """Figures of a cupboard in its own colours, ``fewer_pixels``."""
    return measure(cupboard(np.deg2rad(degrees)), cupboard())


@pytest.mark.usefixtures("fewer_pixels")
@pytest.mark.parametrize("name", NO_COLORS)
def test_a_prediction_without_colours_is_given_the_truths(name):
    truth = cupboard()
    plain = stripped(truth, NO_COLORS[name])
    assert uncolored(plain) and not uncolored(truth)
    assert measure(plain, truth) == with_colors(90)
    turned = stripped(cupboard(np.deg2rad(50)), NO_COLORS[name])
    assert measure(turned, truth) == with_colors(50)


@pytest.mark.usefixtures("fewer_pixels")
def test_what_has_colours_keeps_them():
    truth = cupboard()
    assert not uncolored(cupboard(body=(140, 140, 140), door=(160, 160, 160)))  # two grays
    assert not uncolored(cupboard(body=(150, 150, 140), door=(150, 150, 140)))  # not a gray
    wrong = cupboard(body=(20, 220, 20))
    assert not uncolored(wrong)
    assert measure(wrong, truth)["rs_psnr"] < CAP - 20


def test_every_procedural_object_has_colours():
    for i, family in enumerate(procedural.FAMILIES):
        assert not uncolored(procedural.generate(family, i)), family


def test_materials_go_to_the_matched_part_and_to_surplus_parts_from_the_nearest():
    truth = cupboard()
    extra = Part("knob", box([-0.4, -0.4, -0.05], [-0.33, -0.3, 0.05]), 1)
    pred = stripped(truth)
    pred = dataclasses.replace(pred, parts=(*pred.parts, extra))
    given_colors = [
        tuple(p.mesh.visual.face_colors[0, :3]) for p in with_materials(pred, truth).parts
    ]
    assert given_colors == [BODY, DOOR, DOOR]


def test_materials_go_one_to_one_before_they_go_to_the_nearest():
    shelf = lambda z, color=None: box([-0.5, -0.4, z], [0.5, 0.4, z + 0.05], color)  # noqa: E731
    ref = ArticulatedObject((Part("a", shelf(0, BODY)), Part("b", shelf(0.5, DOOR), 0)))
    pred = ArticulatedObject((Part("a", shelf(0)), Part("b", shelf(0.2), 0)))  # both nearer to a
    painted_parts = with_materials(pred, ref).parts
    assert [tuple(p.mesh.visual.face_colors[0, :3]) for p in painted_parts] == [BODY, DOOR]


def test_a_missing_door_is_not_painted_onto_the_box():
    truth = cupboard()
    block = ArticulatedObject((Part("all", box([-0.34, -0.4, -0.5], [0.3, 0.4, 0.5])),))
    colors = with_materials(at_rest(block), truth).parts[0].mesh.visual.face_colors
    assert len(np.unique(colors, axis=0)) == 1


def test_surface_colors_are_the_texture_and_always_the_same():
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    image = Image.fromarray(np.repeat(np.uint8([[[255, 0, 0], [0, 0, 255]]]), 2, 0))
    mesh.visual = TextureVisuals(uv=mesh.vertices[:, :2], material=SimpleMaterial(image=image))
    colors = surface_colors(mesh)
    np.testing.assert_array_equal(colors, surface_colors(mesh))
    np.testing.assert_allclose(colors.mean(0), [0.5, 0, 0.5], atol=0.04)
    obj = painted(ArticulatedObject((Part("p", mesh),)), np.uint8([[10, 20, 30]]))
    expected = srgb_to_linear(np.array([10, 20, 30]) / 255)
    np.testing.assert_allclose(surface_colors(obj.parts[0].mesh).mean(0), expected, atol=1e-6)


@pytest.mark.usefixtures("fewer_pixels")
def test_figures_are_the_same_every_time():
    truth = at_rest(procedural.generate("laptop", 1))
    pred = at_rest(procedural.generate("laptop", 2))
    first = measure(pred, truth)
    assert first == measure(pred, truth)
    assert all(np.isfinite(v) and v > METRICS[k].worst for k, v in first.items())
