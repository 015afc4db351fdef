"""Convex shapes of two parts that overlap are cut apart, at little cost, and stay convex."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.export.collision import collision_shapes
from uniart_jax.export.convex_split import triangles
from uniart_jax.export.physics import Box, Hull
from uniart_jax.export.separation import MOST_LOST, overlaps, separated, width

LEAST = 0.004


def box(center, size) -> Box:
    return Box(np.asarray(center, float), np.asarray(size, float), np.eye(3))


def hull(piece) -> Hull:
    vertices, _ = triangles(piece)
    return Hull(trimesh.convex.convex_hull(vertices))


def volume(shapes) -> float:
    return sum(
        float(np.prod(s.size)) if isinstance(s, Box) else float(s.mesh.volume) for s in shapes
    )


def test_two_blocks_that_overlap_share_the_loss():
    shapes = [(box([0, 0, 0], [1, 1, 1]),), (box([0.95, 0, 0], [1, 1, 1]),)]
    assert overlaps(shapes, LEAST) == {(0, 1): pytest.approx(0.05)}
    apart = separated(shapes, LEAST, hull)
    assert not overlaps(apart, 1e-6)
    assert volume(apart[0]) + volume(apart[1]) == pytest.approx(1.95)
    assert all(isinstance(s, Hull) and s.mesh.is_convex for own in apart for s in own)


def test_what_does_not_overlap_is_left_as_it_is():
    shapes = [
        (box([0, 0, 0], [1, 1, 1]),),
        (box([1.0, 0, 0], [1, 1, 1]), box([0, 0, 2], [1, 1, 1])),
    ]
    apart = separated(shapes, LEAST, hull)
    assert all(a is b for one, two in zip(shapes, apart, strict=True) for a, b in zip(one, two, strict=True))  # fmt: skip


def test_shapes_of_one_part_may_overlap():
    shapes = [(box([0, 0, 0], [1, 1, 1]), box([0.5, 0, 0], [1, 1, 1]))]
    assert overlaps(shapes, LEAST) == {} and separated(shapes, LEAST, hull) == shapes


def test_an_axle_through_a_block_is_not_cut():
    shapes = [(box([0, 0, 0], [1, 1, 1]),), (box([0, 0, 0], [3, 0.4, 0.4]),)]
    apart = separated(shapes, LEAST, hull)
    assert apart[0][0] is shapes[0][0] and apart[1][0] is shapes[1][0]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_any_two_hulls_end_apart_or_as_they_were(seed):
    rng = np.random.default_rng(seed)
    hulls = [
        Hull(trimesh.convex.convex_hull(rng.normal(size=(12, 3)) * 0.3 + at))
        for at in ([0, 0, 0], rng.uniform(-0.8, 0.8, 3))
    ]
    shapes = [(hulls[0],), (hulls[1],)]
    before = overlaps(shapes, LEAST)
    apart = separated(shapes, LEAST, hull)
    if all(a[0] is b[0] for a, b in zip(shapes, apart, strict=True)):
        return
    assert before and not overlaps(apart, 1e-5)
    for one, two in zip(shapes, apart, strict=True):
        assert volume(two) >= (1 - MOST_LOST) * volume(one) - 1e-9
        cut = trimesh.Trimesh(two[0].mesh.vertices, two[0].mesh.faces)
        inside = trimesh.proximity.signed_distance(one[0].mesh, cut.vertices)
        assert inside.min() > -1e-6  # nothing was added


def test_width_is_the_thinnest_extent():
    turned = trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.4, 0.9]))
    from manifold3d import Manifold

    plate = trimesh.creation.box([1, 2, 0.05]).apply_transform(turned)
    assert width(Manifold.hull_points(plate.vertices)) == pytest.approx(0.05, rel=1e-6)


def test_rough_parts_that_cross_do_not_push_each_other():
    """Two noisy blocks whose surfaces cross along a seam, of many faces each, as a network gives them."""
    rng = np.random.default_rng(0)
    meshes = []
    for at in (-0.25, 0.24):
        ball = trimesh.creation.box([0.5, 0.8, 0.6])
        for _ in range(5):
            ball = ball.subdivide()
        ball.vertices += rng.normal(size=ball.vertices.shape) * 0.003 + [at, 0, 0]
        meshes.append(ball)
    shapes = collision_shapes(meshes, 1.0)
    assert max(overlaps(shapes, 1e-3).values(), default=0.0) < 2 * LEAST
    assert volume(shapes[0]) > 0.85 * meshes[0].volume
