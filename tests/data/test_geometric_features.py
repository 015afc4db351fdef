"""Geometric part features: what they say of plates, rods and cubes, and what they may not depend
on."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from hand_records import make_record

from uniart_jax.data.geometric_features import CHANNELS, OF_SCALE, SCALES, geometric_features
from uniart_jax.data.mirror import mirror_record
from uniart_jax.data.records import from_object
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.voxelize import voxelize

NORMAL, LINEAR, PLANAR, SCATTERED = slice(0, 3), 3, 4, 5


def record_of(*boxes: tuple[tuple, tuple]):
    """Of boxes (size, centre), each a part; the first is the root."""
    parts = []
    for k, (size, centre) in enumerate(boxes):
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(centre)
        joint = Joint.fixed() if k == 0 else Joint(np.zeros(3), np.array([0.0, 0, 1]), angle=(0, 1))
        parts.append(Part(f"p{k}", mesh, -1 if k == 0 else 0, joint))
    obj = ArticulatedObject(tuple(parts), name="boxes")
    image = np.zeros((1, 8, 8, 4), np.uint8)
    cameras = np.zeros((1, 4), np.float32)
    return from_object(obj, image, cameras, {"id": "boxes"}, voxelize(obj, 16, 4))


def at(record, values, point):
    """The features of the voxel whose centre is nearest to a point."""
    centers = (record.coords + 0.5) / record.resolution - 0.5
    return values[np.linalg.norm(centers - np.asarray(point), axis=1).argmin()].astype(float)


def test_a_plate_is_planar_and_a_rod_is_linear():
    plate, rod = record_of(((0.4, 0.9, 0.9), (0, 0, 0))), record_of(((0.06, 0.06, 0.9), (0, 0, 0)))
    face, long = geometric_features(plate), geometric_features(rod)
    assert face.shape == (len(plate.coords), CHANNELS) and face.dtype == np.float16
    near = at(plate, face, (-0.2, 0, 0))[:OF_SCALE]
    assert near[PLANAR] > 0.5 and near[PLANAR] > 2 * near[LINEAR]
    for scale, least in ((1, 0.6), (2, 0.75)):
        wide = at(rod, long, (0, 0, 0))[scale * OF_SCALE :]
        assert wide[LINEAR] > least and wide[PLANAR] < 0.2
    for values in (face, long):  # the three shares of one neighbourhood
        shares = (
            values[:, : len(SCALES) * OF_SCALE].astype(float).reshape(-1, len(SCALES), OF_SCALE)
        )
        np.testing.assert_allclose(shares[..., LINEAR : SCATTERED + 1].sum(-1), 1, atol=5e-3)


def test_normals_point_outwards_and_shorten_where_the_surface_bends():
    record = record_of(((0.8, 0.8, 0.8), (0, 0, 0)))
    values = geometric_features(record)
    faces = [(axis, sign) for axis in range(3) for sign in (-1, 1)]
    for axis, sign in faces:
        normal = at(record, values, 0.4 * sign * np.eye(3)[axis])[NORMAL]
        np.testing.assert_allclose(normal, sign * np.eye(3)[axis], atol=0.05)
    corner = at(record, values, (0.4, 0.4, 0.4))[NORMAL]
    assert (corner > 0.2).all() and np.linalg.norm(corner) < 0.8


def test_height_and_thickness():
    record = record_of(((0.05, 0.8, 0.9), (-0.4, 0, 0)), ((0.5, 0.8, 0.3), (0.1, 0, -0.3)))
    values = geometric_features(record).astype(float)
    assert at(record, values, (-0.4, 0, 0.45))[-2] == 1
    assert at(record, values, (0.1, 0, -0.45))[-2] == pytest.approx(0, abs=0.1)
    thin, thick = at(record, values, (-0.42, 0, 0)), at(record, values, (0.1, 0, -0.15))
    assert thin[-1] < 0.35 and thick[-1] > 0.9


def test_they_follow_from_the_shape_alone_and_differ_within_a_part():
    boxes = (((0.1, 0.9, 0.9), (-0.3, 0, 0)), ((0.4, 0.5, 0.1), (0.1, 0, -0.3)))
    record = record_of(*boxes)
    values = geometric_features(record)
    other = dataclasses.replace(
        record, owner=0 * record.owner, voxel_part=0 * record.voxel_part, codes=0 * record.codes
    )
    np.testing.assert_array_equal(geometric_features(other), values)
    mine = values[record.voxel_part == 0].astype(float)
    assert (mine.std(0) > 0.02).sum() > CHANNELS // 2


def test_a_mirrored_record_has_mirrored_features():
    record = record_of(((0.3, 0.5, 0.7), (0.1, -0.1, 0)), ((0.1, 0.3, 0.2), (-0.2, 0.3, 0.2)))
    values, mirrored = geometric_features(record), geometric_features(mirror_record(record))
    coords = record.coords.copy()
    coords[:, 1] = record.resolution - 1 - coords[:, 1]
    order = np.lexsort(coords.T[::-1])
    signs = np.ones(CHANNELS)
    signs[[scale * OF_SCALE + 1 for scale in range(len(SCALES))]] = -1
    np.testing.assert_allclose(mirrored, values[order] * signs, atol=5e-3)


def test_any_record_has_finite_features():
    for seed in range(4):
        record = make_record(seed, voxels=1 + 13 * seed)
        assert np.isfinite(geometric_features(record)).all()
