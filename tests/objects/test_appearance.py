"""Colours read off meshes, and kept when meshes are merged."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from uniart_jax.objects import appearance
from uniart_jax.objects.appearance import (
    GRAY,
    corner_weights,
    linear_to_srgb,
    merge_meshes,
    sample_color,
    srgb_to_linear,
)

MIDDLE = np.full((1, 3), 1 / 3)


def quad(uv, image: np.ndarray | None = None, **material) -> trimesh.Trimesh:
    """Two triangles whose four corners have the given UVs."""
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    picture = None if image is None else Image.fromarray(np.asarray(image, np.uint8))
    visual = TextureVisuals(uv=uv, material=SimpleMaterial(image=picture, **material))
    return trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def at(mesh: trimesh.Trimesh, face: int, weights) -> np.ndarray:
    return sample_color(mesh, np.array([face]), np.array([weights], dtype=float))[0]


def test_srgb_round_trip_and_known_values():
    values = np.linspace(0, 1, 257)
    np.testing.assert_allclose(linear_to_srgb(srgb_to_linear(values)), values, atol=1e-6)
    assert srgb_to_linear(np.array(0.5)) == pytest.approx(0.21404, abs=1e-5)
    np.testing.assert_allclose(linear_to_srgb(np.array([-1.0, 2.0])), [0, 1])


def test_v_points_up_and_u_to_the_right():
    image = np.zeros((2, 2, 3))
    image[0, 0], image[0, 1], image[1, 0], image[1, 1] = (
        [255, 0, 0],
        [0, 255, 0],
        [0, 0, 255],
        [255, 255, 255],
    )
    for uv, expected in (
        ((0.25, 0.75), [1, 0, 0]),  # upper left: the image's first row
        ((0.75, 0.75), [0, 1, 0]),
        ((0.25, 0.25), [0, 0, 1]),
        ((0.75, 0.25), [1, 1, 1]),
        ((-0.75, 1.75), [1, 0, 0]),  # repeats
    ):
        mesh = quad([uv] * 4, image)
        np.testing.assert_allclose(at(mesh, 0, [1, 0, 0]), expected, atol=1e-6)


def test_texels_are_mixed_bilinearly_in_linear_light():
    image = np.zeros((1, 2, 3))
    image[0, 1] = 255
    np.testing.assert_allclose(at(quad([(0.5, 0.5)] * 4, image), 0, [1, 0, 0]), 0.5, atol=1e-6)
    np.testing.assert_allclose(at(quad([(0.375, 0.5)] * 4, image), 0, [1, 0, 0]), 0.25, atol=1e-6)
    np.testing.assert_allclose(at(quad([(0.0, 0.5)] * 4, image), 0, [1, 0, 0]), 0.5, atol=1e-6)


def test_plain_colours():
    mesh = trimesh.creation.box()
    np.testing.assert_allclose(at(mesh, 3, [1, 0, 0]), srgb_to_linear(np.array(GRAY)))
    mesh.visual.face_colors = [[10 * i, 0, 255, 255] for i in range(12)]
    np.testing.assert_allclose(
        at(mesh, 3, [1, 0, 0]), srgb_to_linear(np.array([30, 0, 255]) / 255), atol=1e-6
    )
    mesh = trimesh.creation.box()
    mesh.visual.vertex_colors = [[0, 0, 0, 255]] * 7 + [[255, 255, 255, 255]]
    face = int(np.flatnonzero((mesh.faces == 7).any(1))[0])
    np.testing.assert_allclose(at(mesh, face, [1 / 3] * 3), 1 / 3, atol=1e-6)
    mesh = quad(np.zeros((4, 2)), diffuse=[255, 0, 128, 255])
    np.testing.assert_allclose(
        at(mesh, 0, [1, 0, 0]), srgb_to_linear(np.array([255, 0, 128]) / 255), atol=1e-6
    )


def test_materials_multiply_their_texture_by_a_factor_only_if_it_is_one():
    image = Image.new("RGB", (2, 2), (255, 255, 255))
    mesh = quad(np.full((4, 2), 0.3))
    mesh.visual.material = PBRMaterial(baseColorTexture=image, baseColorFactor=[0, 255, 255, 255])
    np.testing.assert_allclose(at(mesh, 0, [1, 0, 0]), [0, 1, 1], atol=1e-6)
    mesh.visual.material = SimpleMaterial(
        image=image, diffuse=[10, 10, 10, 255]
    )  # an exporter's Kd
    np.testing.assert_allclose(at(mesh, 0, [1, 0, 0]), 1, atol=1e-6)


def textured(rng: np.random.Generator, repeats: float) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=1)
    image = Image.fromarray(rng.integers(0, 256, (*rng.integers(1, 12, 2), 3), dtype=np.uint8))
    uv = rng.uniform(-repeats, 1 + repeats, (len(mesh.vertices), 2))
    mesh.visual = TextureVisuals(uv=uv, material=SimpleMaterial(image=image))
    return mesh


def painted(rng: np.random.Generator, kind: str) -> trimesh.Trimesh:
    mesh = trimesh.creation.box()
    if kind == "vertex":
        mesh.visual.vertex_colors = rng.integers(0, 256, (8, 4))
    elif kind == "face":
        mesh.visual.face_colors = rng.integers(0, 256, (12, 4))
    elif kind == "plain":
        mesh.visual = TextureVisuals(material=SimpleMaterial(diffuse=rng.integers(0, 256, 4)))
    return mesh


def same_colors(meshes: list[trimesh.Trimesh], merged: trimesh.Trimesh, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first = 0
    for mesh in meshes:
        count = len(mesh.faces)
        faces, weights = rng.integers(0, count, 60), rng.dirichlet([1, 1, 1], 60)
        np.testing.assert_allclose(
            sample_color(merged, faces + first, weights),
            sample_color(mesh, faces, weights),
            atol=1e-3,
        )
        first += count
    assert len(merged.faces) == first
    assert merged.area == pytest.approx(sum(m.area for m in meshes))


@given(st.integers(0, 10**6))
def test_colours_survive_an_atlas(seed):
    rng = np.random.default_rng(seed)
    meshes = [textured(rng, rng.choice([0.0, 2.0])) for _ in range(rng.integers(1, 4))]
    meshes += [painted(rng, k) for k in ("face", "plain", "none")[: rng.integers(0, 4)]]
    rng.shuffle(meshes)
    same_colors(meshes, merge_meshes(meshes), seed)


@given(st.lists(st.sampled_from(["face", "plain", "none", "vertex"]), min_size=1, max_size=4))
def test_colours_survive_without_textures(kinds):
    rng = np.random.default_rng(len(kinds))
    meshes = [painted(rng, k) for k in kinds]
    same_colors(meshes, merge_meshes(meshes), 0)


def test_one_texture_for_all_is_kept_as_it_is():
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3))
    meshes = [
        quad([(0, 0), (3, 0), (3, 2), (0, 2)], image),
        quad([(0, 0), (1, 0), (1, 1), (0, 1)], image),
    ]
    merged = merge_meshes(meshes)
    assert merged.visual.material.image.size == (7, 5)
    same_colors(meshes, merged, 0)


def test_vertex_colours_beside_a_texture_become_one_a_face():
    mesh = trimesh.creation.box()
    mesh.visual.vertex_colors = np.tile([40, 80, 120, 255], (8, 1))
    rng = np.random.default_rng(0)
    same_colors(
        [mesh, textured(rng, 0)], merge_meshes([mesh, textured(np.random.default_rng(0), 0)]), 0
    )


def test_huge_textures_shrink_and_many_repeats_stay_in_bounds(monkeypatch):
    monkeypatch.setattr(appearance, "MAX_ATLAS", 128)
    whole = [(0, 0), (1, 0), (1, 1), (0, 1)]
    meshes = [quad(whole, np.full((100, 100, 3), 200 + k)) for k in range(3)]
    meshes.append(quad(np.multiply(whole, 900), np.full((64, 64, 3), 90)))
    merged = merge_meshes(meshes)
    assert max(merged.visual.material.image.size) <= 256
    for k, expected in enumerate((200, 201, 202, 90)):
        color = srgb_to_linear(np.array(expected / 255))
        np.testing.assert_allclose(at(merged, 2 * k, MIDDLE[0]), color, atol=0.01)


def test_nothing_cannot_be_merged():
    with pytest.raises(ValueError, match="no meshes"):
        merge_meshes([])


@pytest.mark.filterwarnings("error")
def test_corner_weights_give_points_back_and_know_triangles_without_area():
    rng = np.random.default_rng(0)
    triangles = rng.normal(size=(20, 3, 3))
    expected = rng.dirichlet(np.ones(3), 20)
    points = (expected[..., None] * triangles).sum(1)
    np.testing.assert_allclose(corner_weights(triangles, points), expected, atol=1e-9)
    flat = np.repeat(triangles[:, :1], 3, axis=1)
    np.testing.assert_allclose(corner_weights(flat, flat[:, 0]), 1 / 3)
