"""PartField's files, made by hand: where its points lie in our frame, and every file that is not
its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from hand_records import make_record

from uniart_jax.data import part_features
from uniart_jax.data.part_features import CHANNELS, input_name, on_voxels, read_partfield

NAME = "00000-00002-hand-2"


def framed(points):
    """As PartField's loader moves its input: centre 0, longest side 1.8."""
    low, high = points.min(0), points.max(0)
    return (points - (low + high) / 2) * (1.8 / (high - low).max())


def rows(count):
    """Features that name their row."""
    return np.repeat(np.arange(count, dtype=np.float32)[:, None], CHANNELS, 1)


def write_cloud(folder, features, points, name=NAME):
    np.save(folder / f"part_feat_{name}_0.npy", features)
    text = "\n".join(
        [
            "ply",
            "format ascii 1.0",
            f"element vertex {len(points)}",
            "property float x",
            "property float y",
            "property float z",
            "property uchar red",
            "property uchar green",
            "property uchar blue",
            "end_header",
        ]
    )
    text += "".join(f"\n{x:.9g} {y:.9g} {z:.9g} 1 2 3" for x, y, z in points) + "\n"
    (folder / f"feat_pca_{name}_0.ply").write_text(text)


def write_mesh(folder, features, mesh, name=NAME, stem="feat_pca"):
    np.save(folder / f"part_feat_{name}_0_batch.npy", features)
    mesh.export(folder / f"{stem}_{name}_0.ply")


def assert_nearest(values, points, record):
    """Every voxel names a point that none is nearer to its centre than (some are equally near)."""
    centers = (record.coords + 0.5) / record.resolution - 0.5
    distance = np.linalg.norm(centers[:, None] - points[None], axis=-1)
    assert (values == values[:, :1]).all()
    chosen = distance[np.arange(len(centers)), values[:, 0].astype(int)]
    np.testing.assert_allclose(chosen, distance.min(1), atol=1e-5)


def test_names_are_unique_and_hold_nothing_that_partfield_cuts_off():
    assert input_name(0, 2, "hand-2") == NAME
    assert input_name(3, 11, "Table/1.5 x/a.urdf-0") == "00003-00011-Table_1_5_x_a_urdf-0"
    assert input_name(0, 0, "a/b") != input_name(0, 1, "a_b")


def test_exported_points_lie_on_the_surface_and_come_back(tmp_path):
    record = make_record(2, voxels=60)
    points = part_features.surface_points(record)
    crossed = np.argwhere(np.abs(record.sdf / 127 * 3) <= 0.87)
    assert len(points) == len(crossed)
    voxel, cell = crossed[5]
    inner = (np.array(np.unravel_index(cell, (2, 2, 2))) + 0.5) / 2
    np.testing.assert_allclose(points[5], (record.coords[voxel] + inner) / 8 - 0.5, atol=1e-6)
    assert len(part_features.surface_points(record, 50)) == 50
    part_features.write_points(tmp_path / "a.ply", points)
    cloud = trimesh.load(tmp_path / "a.ply", process=False)
    np.testing.assert_array_equal(np.asarray(cloud.vertices, np.float32), points)
    # through PartField's frame and back: the voxel's feature is that of the point nearest to its
    # centre
    write_cloud(tmp_path, rows(len(points)), framed(points))
    values = on_voxels(record, *read_partfield(tmp_path, NAME))
    assert values.dtype == np.float16 and values.shape == (60, CHANNELS)
    assert_nearest(values, points, record)


def test_meshes_of_faces_or_vertices(tmp_path):
    """A mesh of another scale and place: its frame is found by its own bounding box and the
    record's."""
    whole = make_record(3, voxels=200)
    half = whole.coords[:, 0] >= 4  # so that its centre is not the frame's
    record = dataclasses.replace(whole, coords=whole.coords[half], sdf=whole.sdf[half])
    own = part_features.surface_points(record)
    low, high = own.min(0), own.max(0)
    mesh = trimesh.creation.box(bounds=np.stack([low, high])).subdivide().subdivide()
    moved = trimesh.Trimesh(framed(mesh.vertices * 3 + 5), mesh.faces, process=False)
    write_mesh(tmp_path, rows(len(mesh.faces)), moved)
    points, features = read_partfield(tmp_path, NAME)
    values = on_voxels(record, points, features)
    assert_nearest(values, mesh.triangles_center, record)
    (tmp_path / f"feat_pca_{NAME}_0.ply").unlink()
    write_mesh(tmp_path, rows(len(mesh.vertices)), moved, stem="input")
    values = on_voxels(record, *read_partfield(tmp_path, NAME))
    assert_nearest(values, mesh.vertices, record)


def test_refusals_are_one_line(tmp_path):
    points = framed(np.random.default_rng(0).random((40, 3)))

    def complaint(features=None, at=points):
        write_cloud(tmp_path, rows(len(at)) if features is None else features, at)
        with pytest.raises(ValueError) as error:
            on_voxels(make_record(2), *read_partfield(tmp_path, NAME))
        assert "\n" not in str(error.value) and (
            NAME in str(error.value) or "hand-2" in str(error.value)
        )
        return str(error.value)

    with pytest.raises(
        FileNotFoundError,
        match=f"neither part_feat_{NAME}_0.npy nor part_feat_{NAME}_0_batch.npy; run PartField",
    ):
        read_partfield(tmp_path, NAME)
    assert "float32 [40, 64], but PartField's features are float [n, 448]" in complaint(
        rows(40)[:, :64]
    )
    assert "int64 [40, 448]" in complaint(np.zeros((40, CHANNELS), int))
    assert "39 features, but" in complaint(rows(39))
    assert "not finite" in complaint(np.full((40, CHANNELS), np.nan, np.float32))
    assert "not finite in half precision" in complaint(np.full((40, CHANNELS), 1e6, np.float32))
    assert "not in PartField's frame" in complaint(at=points * 2)
    with pytest.raises(ValueError, match="not an array that can be read"):
        np.save(tmp_path / f"part_feat_{NAME}_0.npy", np.array([{}]), allow_pickle=True)
        read_partfield(tmp_path, NAME)
    (tmp_path / f"feat_pca_{NAME}_0.ply").write_text("nonsense")
    np.save(tmp_path / f"part_feat_{NAME}_0.npy", rows(40))
    with pytest.raises(ValueError, match="cannot be read"):
        read_partfield(tmp_path, NAME)
