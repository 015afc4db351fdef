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
from uniart_jax.export.separation import MOST_LOST, as_solid, overlaps, separated, width

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


def test_a_plate_that_stands_through_another_is_cut_off_behind_it():
    """What crossing plates share is as thin as they are; an engine pushes by what stands out."""
    wall, shelf = box([0, 0, 0], [0.002, 1, 1]), box([0.42, 0, 0], [0.9, 1, 0.002])
    assert overlaps([(wall,), (shelf,)], LEAST) == {(0, 1): pytest.approx(0.031)}
    apart = separated([(wall,), (shelf,)], LEAST, hull)
    assert not overlaps(apart, LEAST)
    assert volume(apart[0]) == pytest.approx(0.002)
    assert np.asarray(apart[1][0].mesh.vertices)[:, 0].min() > -0.0011


def test_plates_that_only_touch_are_left():
    wall, shelf = box([0, 0, 0], [0.002, 1, 1]), box([0.452, 0, 0], [0.9, 1, 0.002])
    shapes = [(wall,), (shelf,)]
    assert overlaps(shapes, LEAST) == {} and separated(shapes, LEAST, hull) == shapes


def test_what_does_not_overlap_is_left_as_it_is():
    shapes = [
        (box([0, 0, 0], [1, 1, 1]),),
        (box([1.0, 0, 0], [1, 1, 1]), box([0, 0, 2], [1, 1, 1])),
    ]
    apart = separated(shapes, LEAST, hull)
    assert all(
        a is b
        for one, two in zip(shapes, apart, strict=True)
        for a, b in zip(one, two, strict=True)
    )


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


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(2, 5))
def test_a_shape_that_meets_several_keeps_half_of_what_it_was(seed, count):
    rng = np.random.default_rng(seed)
    shapes = [(box([0, 0, 0], [1, 1, 1]),)]
    for _ in range(count):
        at = rng.normal(size=3)
        at *= rng.uniform(0.5, 0.9) / np.abs(at).max()
        corners = rng.uniform(-0.4, 0.4, (12, 3)) + at
        shapes.append((Hull(trimesh.convex.convex_hull(corners)),))
    apart = separated(shapes, LEAST, hull)
    for one, two in zip(shapes, apart, strict=True):
        assert volume(two) >= (1 - MOST_LOST) * volume(one) - 1e-9
    left = overlaps(apart, LEAST * 1.01)
    for a, b in left:  # what is left was refused: either no plane is cheap, or one had given before
        assert refused(apart[a][0], apart[b][0], volume(shapes[a]), volume(shapes[b]))


def refused(one, two, first: float, second: float) -> bool:
    """Whether no cut of the two at a third or half of the way is within what they may lose."""
    a, b = as_solid(one), as_solid(two)
    vertices, faces = triangles(a ^ b)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals = normals[areas > 1e-9 * areas.max()] / areas[areas > 1e-9 * areas.max(), None]
    thinnest = normals[np.ptp(normals @ vertices.T, axis=1).argmin()]
    heights = vertices @ thinnest
    for offset in (heights.min(), (heights.min() + heights.max()) / 2, heights.max()):
        pieces = [s.split_by_plane(tuple(thinnest), float(offset)) for s in (a, b)]
        for side in (0, 1):
            kept, other = pieces[0][side].volume(), pieces[1][1 - side].volume()
            lost = (a.volume() - kept) / first + (b.volume() - other) / second
            if lost < 0.999 * MOST_LOST and min(kept / first, other / second) > 1.001 * (
                1 - MOST_LOST
            ):
                return False
    return True


def test_cuts_of_several_neighbours_add_up():
    """A bar that six plates reach into by an eighth each, from both ends: it gives no more than
    half."""
    bar = box([0, 0, 0], [4, 1, 1])
    plates = []
    for step in range(3):
        for side in (-1, 1):
            plates.append((box([side * (2.75 - 0.5 * step), 0, 0], [2.5, 20, 20]),))
    apart = separated([(bar,), *plates], LEAST, hull)
    assert 0.5 <= volume(apart[0]) / 4 < 0.8


def test_a_part_of_slivers_keeps_its_largest_shape():
    shapes = [
        (box([0, 0, 0], [1, 1, 1]), box([0, 0, 3], [1, 1, 2])),
        (box([0.9, 0, 0], [1, 1, 1]), box([0.9, 0, 3], [1, 1, 2])),
    ]
    apart = separated(shapes, LEAST, lambda piece: None)
    assert [len(own) for own in apart] == [1, 1]
    assert apart[0][0] is shapes[0][1] and apart[1][0] is shapes[1][1]
    whole = separated([*shapes, ()], LEAST, hull)
    assert [len(own) for own in whole] == [2, 2, 0] and not overlaps(whole, 1e-6)


def test_width_is_the_thinnest_extent():
    turned = trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.4, 0.9]))
    from manifold3d import Manifold

    plate = trimesh.creation.box([1, 2, 0.05]).apply_transform(turned)
    assert width(Manifold.hull_points(plate.vertices)) == pytest.approx(0.05, rel=1e-6)


def test_rough_parts_that_cross_do_not_push_each_other():
    """Two noisy blocks whose surfaces cross along a seam, of many faces each, as a network gives
    them."""
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
