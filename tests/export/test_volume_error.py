"""The error of convex shapes is measured right."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.export.physics import Box
from uniart_jax.export.volume_error import is_open, volume_error


def slab(lo, hi) -> Box:
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    return Box((lo + hi) / 2, hi - lo, np.eye(3))


def test_the_error_is_what_is_too_much_and_too_little():
    block = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    assert volume_error(block, [slab([0, 0, 0], [1, 1, 1])]) == 0
    half = volume_error(block, [slab([0, 0, 0], [1, 1, 0.5])])
    double = volume_error(block, [slab([0, 0, 0], [1, 1, 2])])
    assert half == pytest.approx(0.5, abs=0.01)
    assert double == pytest.approx(1.0, abs=0.01)


def test_of_a_surface_with_a_rim_finer_shapes_tell_what_is_full():
    block = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    cup = trimesh.Trimesh(block.vertices, block.faces[block.face_normals[:, 2] < 0.5])
    assert is_open(cup) and not is_open(block)
    apart = trimesh.Trimesh(block.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert not is_open(apart)  # each face has corners of its own
    whole, floor = [slab([0, 0, 0], [1, 1, 1])], [slab([0, 0, 0], [1, 1, 0.1])]
    assert volume_error(cup, whole) == 0
    assert volume_error(cup, floor, floor) == 0
    assert volume_error(cup, whole, floor) == pytest.approx(0.9, abs=0.01)


def test_what_lies_between_the_plates_of_a_flat_surface_is_too_much():
    panels = [trimesh.creation.box(bounds=[[x, 0, 0], [x + 0.3, 0.3, 1]]) for x in (0, 2)]
    flat = trimesh.util.concatenate([p.slice_plane([0, 0, 0.5], [0, 0, 1]) for p in panels])
    flat = trimesh.Trimesh(flat.vertices * [1, 1, 0], flat.faces[flat.face_normals[:, 2] > 0.5])
    for turn in (np.eye(4), trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])):
        mesh = flat.copy().apply_transform(turn)

        def plate(lo, hi, turn=turn) -> Box:
            center = np.array([(lo + hi) / 2, 0.15, 0])
            return Box(turn[:3, :3] @ center, np.array([hi - lo, 0.3, 0.002]), turn[:3, :3])

        two, one = [plate(0, 0.3), plate(2, 2.3)], [plate(0, 2.3)]
        assert volume_error(mesh, two, two) == 0
        assert volume_error(mesh, one, two) == pytest.approx(1.7 / 2.3, abs=0.01)


@pytest.mark.parametrize("turned", [False, True])
def test_faces_that_exist_twice_close_no_surface(turned):
    block = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    cup = block.faces[block.face_normals[:, 2] < 0.5]
    twice = np.concatenate([cup, cup[:, ::-1] if turned else cup])
    assert is_open(trimesh.Trimesh(block.vertices, twice, process=False))


def test_blocks_that_share_a_face_are_closed():
    box = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    above = box.copy().apply_transform(np.diag([1.0, 1, -1, 1])).apply_translation([0, 0, 2])
    both = trimesh.util.concatenate([box, above])
    both.merge_vertices()
    assert len(both.vertices) == 12 and not is_open(both)
