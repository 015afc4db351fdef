"""One texture for all parts: closed geometry, charts inside the texture, colours of the source."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from asset_objects import hollow_box, marching_cubes_block, painted_box, textured_plate
from scipy import ndimage
from skimage import measure

from uniart_jax.export import atlas
from uniart_jax.export.atlas import (
    FACE_BUDGET,
    Atlas,
    Surface,
    _grid_charts,
    make_atlas,
    rasterize,
    simplify,
)
from uniart_jax.export.collision import collision_shapes
from uniart_jax.export.wavefront import TEXTURE_FILE, write_material, write_textured
from uniart_jax.objects.appearance import linear_to_srgb, sample_color
from uniart_jax.objects.object import ArticulatedObject, Part


def as_object(*meshes: trimesh.Trimesh) -> ArticulatedObject:
    """Parts fixed to the first mesh."""
    return ArticulatedObject(
        tuple(Part(f"part{k}", mesh, 0 if k else -1) for k, mesh in enumerate(meshes))
    )


def color_errors(source: trimesh.Trimesh, result: trimesh.Trimesh) -> np.ndarray:
    """[n, 3] sRGB differences, in [0, 1], between points of the result and the source surface
    nearest to them."""
    points, faces = trimesh.sample.sample_surface(result, 2000, seed=0)
    weights = trimesh.triangles.points_to_barycentric(result.triangles[faces], points)
    nearest, _, triangle = trimesh.proximity.closest_point(source, points)
    at = trimesh.triangles.points_to_barycentric(source.triangles[triangle], nearest)
    seen = linear_to_srgb(sample_color(result, faces, weights))
    return np.abs(seen - linear_to_srgb(sample_color(source, triangle, at)))


@pytest.fixture(scope="module")
def mixed() -> tuple[ArticulatedObject, Atlas]:
    """Vertex colours, a texture, face colours and no colour at all, over one atlas."""
    obj = as_object(
        painted_box([0, 0, 0], [0.5, 0.4, 0.3]),
        textured_plate([0.6, 0, 0], [1.0, 0.4, 0.1]),
        hollow_box([0, 0.5, 0], [0.4, 1.0, 0.4], 0.03),
        trimesh.creation.icosphere(2, 0.1),
    )
    return obj, make_atlas(obj, 512)


def test_baked_colors_are_the_sources(mixed):
    obj, atlas = mixed
    for part, surface in zip(obj.parts, atlas.surfaces, strict=True):
        errors = color_errors(part.mesh, surface.textured(atlas.texture))
        assert errors.mean() < 0.02, part.name
        if part.mesh.visual.kind in (
            "face",
            None,
        ):  # flat colours have no edges to be blurred: no seam may bleed
            assert errors.max() < 0.02, part.name


def test_geometry_within_the_budget_is_untouched_and_closed(mixed):
    obj, atlas = mixed
    for part, surface in zip(obj.parts, atlas.surfaces, strict=True):
        assert len(surface.faces) == len(part.mesh.faces)
        assert surface.mesh.is_watertight
        assert surface.mesh.volume == pytest.approx(part.mesh.volume)


def test_charts_do_not_overlap_and_lie_inside(mixed):
    _, atlas = mixed
    width, height = atlas.texture.size
    taken = np.zeros((height, width), int)
    for surface in atlas.surfaces:
        assert surface.uv.min() >= 0 and surface.uv.max() <= 1
        rows, columns, _, weights = rasterize(surface, width, height)
        np.testing.assert_allclose(weights.sum(1), 1, atol=1e-5)
        np.add.at(taken, (rows, columns), 1)
    assert (taken > 0).mean() > 0.3
    assert (taken > 1).mean() < 0.01  # only texels on an edge that two triangles share


def test_dense_surfaces_are_simplified_and_stay_closed():
    block = marching_cubes_block(64)
    assert len(block.faces) > FACE_BUDGET
    atlas = make_atlas(as_object(block), 256)
    surface = atlas.surfaces[0]
    assert len(surface.faces) <= FACE_BUDGET
    assert surface.mesh.is_watertight
    assert surface.mesh.volume == pytest.approx(block.volume, rel=0.03)
    np.testing.assert_allclose(surface.mesh.bounds, block.bounds, atol=1 / 64)
    assert color_errors(block, surface.textured(atlas.texture)).mean() < 0.03


def test_closed_surfaces_count_their_faces_once():
    """Only open ones get a second side: closed parts of 5,120 faces together, and such that touch
    along an edge, are within a budget of 6,000."""
    ball = trimesh.creation.icosphere(4)
    twins = [trimesh.creation.box((1, 1, 1)).apply_translation([i, i, 0]) for i in (0, 1)]
    touching = trimesh.util.concatenate(twins)
    parts = [ball, touching]
    for part, (_, faces) in zip(parts, simplify(parts, 2.0, budget=6000), strict=True):
        assert len(faces) == len(part.faces)


def test_dense_open_surfaces_are_thinned_too():
    block = marching_cubes_block(64)
    block.update_faces(np.arange(len(block.faces)) > 0)
    atlas = make_atlas(as_object(block), 256)
    mesh = atlas.surfaces[0].mesh
    assert 1000 < len(mesh.faces) <= FACE_BUDGET
    np.testing.assert_allclose(mesh.bounds, block.bounds, atol=1 / 64)
    assert mesh.area == pytest.approx(block.area, rel=0.05)


def test_rough_surfaces_do_not_keep_xatlas_busy():
    ball = trimesh.creation.icosphere(5, 0.5)
    rng = np.random.default_rng(0)
    ball.vertices *= 1 + 0.08 * rng.normal(size=(len(ball.vertices), 1))
    color = np.concatenate(
        [128 + 90 * np.sin(ball.vertices * 4), np.full((len(ball.vertices), 1), 255)], 1
    )
    ball.visual = trimesh.visual.ColorVisuals(ball, vertex_colors=color.astype(np.uint8))
    atlas = make_atlas(as_object(ball))
    (surface,) = atlas.surfaces
    assert len(surface.uv) == 3 * len(surface.faces)  # a chart for every triangle
    assert surface.mesh.is_watertight
    assert color_errors(ball, surface.textured(atlas.texture)).mean() < 0.03


def test_large_triangles_among_many_small_ones_get_many_texels():
    ball = trimesh.creation.icosphere(5, 0.05)
    rng = np.random.default_rng(0)
    ball.vertices *= 1 + 0.08 * rng.normal(size=(len(ball.vertices), 1))
    plate = trimesh.creation.box((1, 1, 0.02))
    size, geometry = 768, [(np.asarray(m.vertices), m.faces) for m in (ball, plate)]
    layout, width, height = _grid_charts(geometry, 1.0, size)
    assert max(width, height) < 2 * size
    of_plate = layout[1][0].reshape(-1, 3, 2) * [width, height]
    front = of_plate[plate.area_faces > 0.4]
    assert (np.ptp(front, axis=1) > 100).all()  # texels
    taken = np.zeros((height, width), int)
    for uv, uv_faces in layout:
        surface = Surface(np.zeros((3, 3)), np.zeros((len(uv_faces), 3), int), uv, uv_faces)
        rows, columns, _, _ = rasterize(surface, width, height)
        np.add.at(taken, (rows, columns), 1)
    assert taken.max() == 1


def test_flat_and_degenerate_parts_get_texels():
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    sliver = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False)
    atlas = make_atlas(as_object(sheet, sliver), 64)
    assert [len(mesh.faces) for mesh in atlas.unclosed] == [2, 1]
    assert [len(s.faces) for s in atlas.surfaces] == [
        2 + 2 + 4 * 2,
        1 + 1 + 3 * 2,
    ]  # both sides and a rim
    assert all(s.mesh.is_watertight for s in atlas.surfaces)
    assert np.isfinite(np.concatenate([s.uv for s in atlas.surfaces])).all()


def test_obj_files_are_closed_and_colored(mixed, tmp_path):
    obj, atlas = mixed
    write_material(tmp_path)
    atlas.texture.save(tmp_path / TEXTURE_FILE)
    for part, surface in zip(obj.parts, atlas.surfaces, strict=True):
        write_textured(surface, tmp_path / f"{part.name}.obj", 2.0)
        text = (tmp_path / f"{part.name}.obj").read_text()
        assert text.count("\nv ") == len(surface.vertices)
        assert text.count("\nvt ") == len(surface.uv)
        loaded = trimesh.load_mesh(tmp_path / f"{part.name}.obj")
        assert color_errors(part.mesh, loaded.copy().apply_scale(0.5)).mean() < 0.02
        loaded.merge_vertices(merge_tex=True, merge_norm=True)
        assert loaded.is_watertight
        assert loaded.volume == pytest.approx(8 * part.mesh.volume, rel=1e-6)


def test_an_open_surface_with_an_odd_number_of_faces_does_not_crash():
    """manifold3d does, with a signal, when it is given one."""
    ball = trimesh.creation.icosphere(3)
    odd = trimesh.Trimesh(ball.vertices, ball.faces[:-1], process=False)
    ((vertices, faces),) = simplify([odd], 1.0, budget=100)
    assert len(faces) and np.isfinite(vertices).all()
    assert collision_shapes([odd])


@pytest.mark.slow
def test_sheets_that_come_to_touch_do_not_keep_all_faces():
    """A bumpy solid full of thin places, where simplifying brings vertices of two sheets into one
    place."""
    rng = np.random.default_rng(0)
    grid = (np.arange(64) + 0.5) / 64 - 0.5
    at = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), -1)
    field = (np.abs(at) - 0.4).max(-1) * 64 + 4 * ndimage.gaussian_filter(
        rng.normal(size=(64,) * 3), 1
    ) * 8
    field = np.pad(field, 1, constant_values=9.0)
    vertices, faces, _, _ = measure.marching_cubes(field, 0)
    bumpy = max(trimesh.Trimesh(vertices / 64, faces).split(), key=lambda m: len(m.faces))
    ((points, corners),) = simplify([bumpy], 1.0, budget=4000)
    assert len(corners) < len(bumpy.faces) / 4
    assert trimesh.Trimesh(points, corners).is_watertight


def test_the_last_closed_level_is_kept(monkeypatch):
    """A level that merging opens does not cost those before it."""
    ball = trimesh.creation.icosphere(5)  # 20,480 faces
    monkeypatch.setattr(atlas, "_closed", lambda faces: len(faces) > 4000)
    ((_, faces),) = simplify([ball], 2.0, budget=1000)
    assert 4000 < len(faces) < len(ball.faces) / 2
