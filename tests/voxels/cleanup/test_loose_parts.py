"""Specks in the air are left out; what is near is moved until it touches; parts that touch, carry
something or are large stay."""

from __future__ import annotations

import numpy as np
import trimesh
from fields import AT, N, assert_same, block, copy_of, field_of, solid_of

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.soundness import gaps
from uniart_jax.voxels.cleanup.loose_parts import (
    with_lost_parts,
    with_parts_joined,
    without_debris,
    without_floating_pieces,
)
from uniart_jax.voxels.isosurface import DenseField


def cube(side: float, at: tuple[float, float, float]) -> trimesh.Trimesh:
    mesh = trimesh.creation.box([side] * 3)
    while len(mesh.vertices) < 3000:
        mesh = mesh.subdivide()
    return mesh.apply_translation(at)


def make(*parts: tuple[str, trimesh.Trimesh, int]) -> ArticulatedObject:
    return ArticulatedObject(tuple(Part(*part) for part in parts))


BASE = ("base", cube(0.6, (0, 0, 0)), -1)


def test_a_speck_in_the_air_is_left_out_and_the_others_are_counted_anew():
    obj = make(
        BASE, ("link_1", cube(0.05, (-0.45, 0, 0)), 0), ("link_2", cube(0.05, (0.325, 0, 0)), 0)
    )
    left = without_debris(obj)
    assert [p.name for p in left.parts] == ["base", "link_1"]
    assert left.parts[1].mesh is obj.parts[2].mesh and left.parts[1].parent == 0


def test_a_speck_that_carries_only_specks_goes_with_them():
    obj = make(
        BASE, ("link_1", cube(0.05, (-0.45, 0, 0)), 0), ("link_2", cube(0.05, (-0.45, 0.2, 0)), 1)
    )
    assert len(without_debris(obj).parts) == 1


def test_what_touches_or_carries_or_is_large_stays():
    for part in (
        ("link_1", cube(0.05, (-0.325, 0, 0)), 0),  # touches
        ("link_1", cube(0.3, (-0.8, 0, 0)), 0),  # large
    ):
        obj = make(BASE, part)
        assert without_debris(obj) is obj
    carrier = make(
        BASE, ("link_1", cube(0.05, (-0.45, 0, 0)), 0), ("link_2", cube(0.5, (1, 0, 0)), 1)
    )
    assert without_debris(carrier) is carrier
    alone = make(BASE)
    assert without_debris(alone) is alone


def turned(part: str, at: tuple[float, float, float], parent: int, **joint) -> tuple:
    return part, cube(0.2, at), parent, Joint((at[0] - 0.1, at[1] - 0.1, at[2]), (0, 0, 1), **joint)


def test_a_part_that_hangs_near_the_others_is_moved_until_it_touches_with_its_joint_and_what_it_carries():  # noqa: E501
    door = turned("link_1", (-0.45, 0, 0), 0, angle=(0, 1.5))
    knob = ("link_2", cube(0.05, (-0.575, 0, 0)), 1)
    obj = make(BASE, door, knob)
    joined = with_parts_joined(obj)
    way = joined.parts[1].mesh.bounds[0] - obj.parts[1].mesh.bounds[0]
    np.testing.assert_allclose(way, [0.05, 0, 0], atol=0.006)
    assert joined.parts[1].mesh.bounds[1, 0] < -0.3  # not into the base
    np.testing.assert_allclose(joined.parts[1].joint.origin - obj.parts[1].joint.origin, way)
    np.testing.assert_allclose(joined.parts[2].mesh.bounds - obj.parts[2].mesh.bounds, [way, way])
    assert joined.parts[0] is obj.parts[0] and "'link_1' hung in the air" in joined.provenance[-1]
    assert gaps(obj)["value"] > 0.02 and gaps(joined)["passed"]


def test_the_way_is_that_at_rest_though_doors_are_shown_open():
    """A box that slides out of a door, the door shown open: what it lacks at rest lies along
    another axis of the object as shown."""
    door = turned("link_1", (-0.4, 0, 0), 0, angle=(0, np.pi / 2))
    box = "link_2", cube(0.1, (-0.605, 0, 0)), 1, Joint((0, 0, 0), (0, 0, 1), travel=(0, 0.4))
    shown = make(BASE, door, box).shown_at(np.array([0, np.pi / 4, 0.3]))
    assert not gaps(shown)["passed"]
    joined = with_parts_joined(shown)
    way = joined.parts[2].mesh.bounds[0] - shown.parts[2].mesh.bounds[0]
    np.testing.assert_allclose(way, [0.035, 0.035, 0], atol=0.006)
    assert gaps(joined)["passed"]


def test_what_touches_or_is_far_is_not_moved():
    for at in ((-0.4, 0, 0), (-0.41, 0, 0), (-0.9, 0, 0)):
        obj = make(BASE, turned("link_1", at, 0, angle=(0, 1.5)))
        assert with_parts_joined(obj) is obj


def test_a_crumb_that_touches_holds_no_part():
    crumb = trimesh.creation.box([0.02] * 3).apply_translation((-0.31, 0, 0))
    name, mesh, parent, joint = turned("link_1", (-0.45, 0, 0), 0, angle=(0, 1.5))
    obj = make(BASE, (name, trimesh.util.concatenate([mesh, crumb]), parent, joint))
    joined = with_parts_joined(obj)
    way = joined.parts[1].mesh.vertices[0] - obj.parts[1].mesh.vertices[0]
    np.testing.assert_allclose(way, [0.05, 0, 0], atol=0.006)


def test_a_part_of_crumbs_alone_is_still_a_part():
    crumbs = [
        trimesh.creation.box([0.02] * 3).apply_translation((-0.35 - 0.05 * i, 0, 0))
        for i in range(12)
    ]
    obj = make(BASE, ("link_1", trimesh.util.concatenate(crumbs), 0, Joint.fixed()))
    way = with_parts_joined(obj).parts[1].mesh.vertices[0] - obj.parts[1].mesh.vertices[0]
    np.testing.assert_allclose(way, [0.04, 0, 0], atol=0.01)  # to the nearest vertex of the base


def test_parts_of_large_triangles_that_touch_stay():
    """Nearest corners lie .057 apart, the faces touch."""
    base, lid = trimesh.creation.box([0.8, 0.8, 0.2]), trimesh.creation.box([0.3, 0.3, 0.1])
    lid.apply_translation([0.21, 0.21, 0.15])
    obj = make(("base", base, -1), ("link_1", lid, 0))
    assert with_parts_joined(obj) is obj
    lid.apply_translation([0, 0, 0.05])
    moved = with_parts_joined(make(("base", base, -1), ("link_1", lid, 0)))
    assert "hung in the air, 0.06" in moved.provenance[0]
    assert abs(moved.parts[1].mesh.bounds[0, 2] - 0.1) < 0.02


def cubes(*lowers, side=4):
    """Distance from cubes at some places, cells."""
    return np.min([block(np.array(low) + 0.3, np.array(low) + side + 0.3) for low in lowers], 0)


BODY = block((20.3,) * 3, (44.3,) * 3)


def test_pieces_in_the_air_go_and_those_that_touch_stay():
    """Touching what does, or at most two cells beside, of whatever part."""
    in_the_air, near, on = (4, 4, 4), (46, 20, 20), (30, 30, 44)
    field = field_of(np.minimum(BODY, cubes(in_the_air, near)), cubes((30, 30, 50)), cubes(on))
    before = copy_of(field)
    after = without_floating_pieces(field, (), 3)
    assert_same(field, before)
    gone = (field.sdf < 0) & (after.sdf > 0)
    np.testing.assert_array_equal(gone, cubes(in_the_air) < 0)
    assert (after.sdf[gone] >= 0.5).all()
    np.testing.assert_array_equal(after.sdf[~gone], field.sdf[~gone])
    for name in ("owner", "source"):
        np.testing.assert_array_equal(getattr(after, name), getattr(field, name))


def test_a_piece_stays_where_two_cells_lie_between_and_goes_where_three_do():
    for between, stays in ((2, True), (3, False)):
        piece = cubes((44 + between, 30, 30))
        after = without_floating_pieces(field_of(np.minimum(BODY, piece)), (), 1)
        assert (after.sdf[piece < 0] < 0).all() == stays, between
        assert (after.sdf[piece < 0] < 0).any() == stays


def test_the_largest_piece_of_each_part_stays_wherever_it_is():
    whole, half = cubes((4, 4, 4), side=6), cubes((4, 54, 4), side=5)
    field = field_of(BODY, np.minimum(whole, half), cubes((54, 54, 54)))
    after = without_floating_pieces(field, (), 3)
    np.testing.assert_array_equal(solid_of(after, 0), BODY < 0)
    np.testing.assert_array_equal(solid_of(after, 1), whole < 0)
    assert solid_of(after, 2).sum() == 64


def test_a_piece_of_the_body_that_touches_only_what_moves_goes():
    drawer, piece = cubes((44, 30, 30)), cubes((48, 30, 30))
    field = field_of(np.minimum(BODY, piece), drawer)
    assert_same(without_floating_pieces(field, (), 2), field)
    after = without_floating_pieces(field, [0], 2)
    np.testing.assert_array_equal(solid_of(after, 0), BODY < 0)
    np.testing.assert_array_equal(solid_of(after, 1), drawer < 0)
    # one that is much of the body stays
    half = np.minimum(BODY, block((48.3, 20.3, 20.3), (60.3, 44.3, 44.3)))
    field = field_of(half, drawer)
    assert_same(without_floating_pieces(field, [0], 2), field)


def test_each_part_of_the_body_keeps_its_largest_piece():
    field = field_of(BODY, cubes((4, 4, 4), (4, 12, 4), side=3))
    after = without_floating_pieces(field, [0, 1], 2)
    assert solid_of(after, 1).sum() == 27


def test_a_part_that_lost_all_its_cells_has_them_again():
    field = field_of(BODY, cubes((48, 30, 30)))
    gone = np.where(solid_of(field, 1), np.float32(0.5), field.sdf)
    gone = DenseField(gone, field.owner, field.source)
    after = with_lost_parts(gone, field)
    assert_same(after, field)
    some = solid_of(field, 1) & (AT[0] > 50)
    less = DenseField(np.where(some, np.float32(0.5), field.sdf), field.owner, field.source)
    assert_same(with_lost_parts(less, field), less)


def test_pieces_of_parts_that_are_not_asked_for_stay():
    field = field_of(BODY, cubes((4, 4, 4), (4, 54, 4)))
    assert_same(without_floating_pieces(field, (), 1), field)
    assert solid_of(without_floating_pieces(field, (), 2), 1).sum() == 64


def test_without_pieces_nothing_goes():
    for field in (
        field_of(BODY),
        field_of(np.full((N + 2,) * 3, 3.0)),
        field_of(AT[0] * 0 + 3, BODY),
    ):
        assert_same(without_floating_pieces(field, (), 3), field)
