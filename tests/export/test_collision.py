"""Convex pieces: closed, convex, hollow where the part is hollow."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from asset_objects import hollow_box, painted_box

from uniart_jax.export.collision import collision_pieces


def test_convex_part_is_its_hull():
    (piece,) = collision_pieces(painted_box([0, 0, 0], [1, 2, 3]))
    assert piece.volume == pytest.approx(6)


def test_hollow_box_is_its_walls():
    mesh = hollow_box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5], 0.04)
    pieces = collision_pieces(mesh)
    assert len(pieces) == 5
    assert sum(p.volume for p in pieces) == pytest.approx(mesh.volume, rel=1e-6)
    assert all(p.is_convex and p.is_watertight for p in pieces)
    for piece in pieces:  # the hollow stays free
        lo, hi = piece.bounds
        assert not ((lo < 0) & (hi > 0)).all()


def test_slanted_hollow_part_is_its_hull():
    mesh = hollow_box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5], 0.04)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5, [1, 1, 1]))
    (piece,) = collision_pieces(mesh)
    assert piece.volume == pytest.approx(mesh.convex_hull.volume)


@pytest.mark.parametrize(
    "vertices",
    [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]],
    ids=["sheet", "line"],
)
def test_flat_part_is_a_thin_box(vertices):
    mesh = trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], process=False)
    (piece,) = collision_pieces(mesh)
    assert piece.is_watertight and piece.volume > 0
    assert np.all(piece.bounds[1] >= mesh.bounds[1])
