"""Small rows that voxels hardly show are made of their boxes."""

import dataclasses

import numpy as np
import pytest
import trimesh
from fields import AT, N, field_of, place_of

from uniart_jax import procedural
from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.primitive_parts import (
    doubles,
    in_front,
    needed,
    primitive_part,
    side_by_side,
)
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.voxelize import voxelize


def layout_of(box, confidence=0.9, parent=0, joint=None):
    boxes = np.array([[0, 0, 0, 0.8, 0.8, 0.8], box], np.float64)
    joints = (Joint.fixed(), joint or Joint.fixed())
    return Layout(boxes, joints, (-1, parent), np.full((2, 3), 0.5), np.array([0.9, confidence]))


KNOB = (-0.41, 0.2, 0.3, 0.05, 0.06, 0.06)


def turning(at, direction=(1, 0, 0)):
    return Joint(np.array(at), direction, angle=(-1.0, 1.0))


TABLE = (0.1, 0.0, -0.3, 0.4, 0.38, 0.04)
ENDLESS = Joint(np.array((0.1, 0.0, 0.0)), (0, 0, 1), angle=(-np.pi, np.pi))
IN_ITS_MIDDLE = turning((0.3, 0.205, 0.295))  # wherever along its axis


@pytest.mark.parametrize(
    ("changes", "solid", "wanted"),
    [
        ({}, 0, [1]),
        ({}, 20, [1]),  # of some 380
        ({}, 60, []),  # shown
        ({"confidence": 0.4}, 0, []),
        ({"box": (-0.41, 0.2, 0.3, 0.05, 0.2, 0.06)}, 0, []),  # large
        ({"box": (-0.6, 0.2, 0.3, 0.05, 0.06, 0.06)}, 0, []),  # in the air
        ({"parent": -1}, 0, []),
        # what turns about its middle is a disc, shown or not
        ({"joint": IN_ITS_MIDDLE}, 60, [1]),
        ({"joint": IN_ITS_MIDDLE}, 380, [1]),
        ({"joint": IN_ITS_MIDDLE, "box": (-0.41, 0.2, 0.3, 0.05, 0.06, 0.03)}, 380, [1]),
        ({"joint": IN_ITS_MIDDLE, "box": (-0.41, 0.2, 0.3, 0.05, 0.06, 0.02)}, 380, []),  # a bar
        ({"joint": IN_ITS_MIDDLE, "confidence": 0.4}, 380, []),
        ({"joint": IN_ITS_MIDDLE, "box": (-0.6, 0.2, 0.3, 0.05, 0.06, 0.06)}, 380, []),
        ({"joint": IN_ITS_MIDDLE, "box": (-0.41, 0.2, 0.3, 0.05, 0.16, 0.16)}, 9999, []),
        ({"joint": turning((-0.41, 0.22, 0.3))}, 380, []),  # beside its middle
        ({"joint": turning((-0.41, 0.2, 0.3), (1, 0.5, 0))}, 380, []),  # aslant
        ({"joint": Joint(np.zeros(3), (1, 0, 0), travel=(0, 0.1))}, 380, []),
        # so is what turns without end within its parent, if it is low
        ({"joint": ENDLESS, "box": TABLE}, 9999, [1]),
        ({"joint": ENDLESS, "box": TABLE}, 3000, []),  # blades: a quarter of the box
        ({"joint": ENDLESS, "box": TABLE}, 100, [1]),  # hardly shown
        ({"joint": ENDLESS, "box": (*TABLE[:4], 0.3, 0.04)}, 9999, []),  # longer than wide
        ({"joint": ENDLESS, "box": (*TABLE[:2], 0.44, *TABLE[3:])}, 9999, []),  # above its parent
        ({"joint": ENDLESS, "box": (*TABLE[:5], 0.2)}, 60_000, []),  # a drum
        ({"joint": ENDLESS, "box": (*TABLE[:3], 0.8, 0.8, 0.04)}, 50_000, []),  # a seat
        ({"joint": dataclasses.replace(ENDLESS, angle=(-1, 1)), "box": TABLE}, 9999, []),
        ({"joint": turning(TABLE[:3]), "box": (*TABLE[:3], 0.04, 0.4, 0.4)}, 9999, []),  # a fan
    ],
)
def test_which_rows_need_one(changes, solid, wanted):
    layout = layout_of(**{"box": KNOB, **changes})
    assert needed(layout, np.array([9999, solid]), 128) == wanted


def test_a_part_that_turns_about_its_middle_is_a_disc_and_others_are_blocks():
    """As wide as its box is on average, around its axis."""
    box = np.array([0.1, -0.2, 0.3, 0.04, 0.06, 0.05])
    for axis in range(3):
        direction, across = np.eye(3)[axis], np.delete(np.arange(3), axis)
        beside = np.where(np.arange(3) == axis, 0.7, [0.004, -0.003, 0.002])
        for toward in (direction, -direction):
            joint = Joint(box[:3] + beside, toward, angle=(-1.0, 1.0))
            disc = primitive_part(box, joint, np.array([1.0, 0, 0]), 1 / 128)
            assert disc.is_watertight and disc.volume > 0 and len(disc.vertices) > 40
            assert len(np.unique(disc.vertices[:, axis].round(9))) == 2  # its two flat sides
            width = box[3:][across].mean()
            size = np.where(np.arange(3) == axis, box[3 + axis], width)
            np.testing.assert_allclose(np.ptp(disc.bounds, 0), size, rtol=0.01)
            centre = np.where(np.arange(3) == axis, box[:3], joint.origin)
            np.testing.assert_allclose(disc.bounds.mean(0), centre, atol=1e-6)
            # nothing of it leaves its place as it turns
            away = np.hypot(*(disc.vertices - joint.origin)[:, across].T)
            assert away.max() == pytest.approx(width / 2)
            assert disc.volume == pytest.approx(np.pi / 4 * size.prod(), rel=0.02)
            assert (disc.visual.vertex_colors == [255, 0, 0, 255]).all()
    np.testing.assert_array_equal(box, [0.1, -0.2, 0.3, 0.04, 0.06, 0.05])
    beside = Joint(box[:3] + [0, 0.03, 0], [1.0, 0, 0], angle=(0.0, 1.0))
    slides = Joint(np.zeros(3), [1.0, 0, 0], travel=(0.0, 0.1))
    for joint in (beside, slides, Joint.fixed()):
        block = primitive_part(box, joint, np.zeros(3), 1 / 128)
        assert block.is_watertight and block.volume == pytest.approx(box[3:].prod(), rel=1e-5)
    flat = primitive_part(np.array([0, 0, 0, 0, 0.1, 0.1]), slides, np.zeros(3), 1 / 128)
    assert flat.is_watertight and np.ptp(flat.bounds, 0)[0] == pytest.approx(1 / 128)


@pytest.mark.slow
def test_a_knob_that_voxels_lost_is_there_and_said():
    obj = procedural.generate("oven", 3)
    grid = voxelize(obj, 32, 4)
    layout = Layout.of_object(obj)
    small = [
        k
        for k, p in enumerate(obj.parts)
        if p.joint.rotates and p.parent >= 0 and layout.boxes[k, 3:].max() < 0.15
    ]
    assert small
    lost = np.isin(grid.owner, small)
    told = dataclasses.replace(grid, sdf=np.where(lost, 3.0, grid.sdf).astype(np.float32)).gather()
    made = assemble_layout(told, layout)
    assert len(made.parts) == len(obj.parts)
    scores = compare_parts(made, obj)
    assert scores.right.all() and scores.tree_right
    assert sum("made of its box" in line for line in made.provenance) == len(small)  # fmt: skip
    unsure = dataclasses.replace(layout, confidence=np.full(len(layout), 0.4))
    assert len(assemble_layout(told, unsure).parts) == len(obj.parts) - len(small)


def test_a_disc_turns_within_itself_though_its_axis_is_tilted():
    joint = Joint((0.1, 0.2, 0.31), (1.0, 0.15, -0.1), angle=(-np.pi, np.pi))
    box = np.array([0.1, 0.2, 0.3, 0.03, 0.06, 0.06])
    mesh = primitive_part(box, joint, np.full(3, 0.5), 1 / 128)
    turned = trimesh.transform_points(mesh.vertices, joint.motion(4 * np.pi / 32))
    apart = np.linalg.norm(turned[:, None] - mesh.vertices, axis=-1).min(1)
    assert apart.max() < 1e-6


@pytest.mark.parametrize("side", [1, -1])
def test_a_disc_stands_on_the_surface_that_it_is_set_into(side):
    """One that reaches 6 cells into a block, and 6 out of it; a disc that is all inside stays."""
    solid = side * (32.3 - AT[0])  # a block above, or below, the middle
    field = field_of(solid)
    surface = place_of((32.3, 0, 0))[0]
    box = np.array([surface, 0, 0, 12 / N, 10 / N, 10 / N])
    joint = Joint(box[:3], (1, 0, 0), angle=(-np.pi, np.pi))
    cut = in_front(primitive_part(box, joint, np.full(3, 0.5), 1 / N), joint, field)
    ends = cut.bounds[:, 0] - surface
    inner, outer = (ends[1], ends[0]) if side > 0 else (ends[0], ends[1])
    assert abs(inner) < 1.01 / N and abs(outer) == pytest.approx(6 / N)
    assert cut.is_watertight
    buried = Joint(box[:3] + (side * 0.2, 0, 0), (1, 0, 0), angle=(-np.pi, np.pi))
    inside = primitive_part(
        box + side * np.array([0.2, 0, 0, 0, 0, 0]), buried, np.full(3, 0.5), 1 / N
    )
    np.testing.assert_array_equal(in_front(inside, buried, field).vertices, inside.vertices)


def test_discs_that_would_touch_are_made_smaller():
    knobs = np.array([[0, y, 0.1, 0.04, 0.08, 0.08] for y in (0, 0.06, 0.3, 0.31)])
    joints = [Joint((0, knob[1], 0.1), (1, 0, 0), angle=(-np.pi, np.pi)) for knob in knobs]
    made = side_by_side(knobs, joints)
    radii = made[:, 4:].mean(1) / 2
    assert radii[0] == radii[1] == pytest.approx(0.027)
    np.testing.assert_array_equal(made[2:], knobs[2:])  # too near: one thing told twice
    np.testing.assert_array_equal(made[:, :4], knobs[:, :4])
    behind = knobs + np.array([[0.1], [0], [0], [0]]) * np.eye(6)[0]
    np.testing.assert_array_equal(side_by_side(behind, joints)[0], behind[0])


def test_of_a_disc_that_is_found_twice_the_surer_one_is_kept():
    boxes = np.array([[0, 0, 0, 1, 1, 1], *([0, y, 0.1, 0.04, 0.08, 0.08] for y in (0, 0.01, 0.1))])
    joints = [Joint.fixed(), *(Joint(b[:3], (1, 0, 0), angle=(-1.0, 1.0)) for b in boxes[1:])]
    confidence = np.array([1, 0.6, 0.9, 0.7])
    layout = Layout(boxes, tuple(joints), (-1, 0, 0, 0), np.full((4, 3), 0.5), confidence)
    assert doubles(layout, [1, 2, 3]) == [1]
    assert doubles(layout, [1, 3]) == []
    across = (*joints[:2], Joint(boxes[2, :3], (0, 1, 0), angle=(-1.0, 1.0)), joints[3])
    assert doubles(dataclasses.replace(layout, joints=across), [1, 2, 3]) == []


def test_three_discs_in_a_row_all_find_room():
    """The axis of one is a little beside its box's middle; it is a disc for all that."""
    knobs = np.array([[0, y, 0.1, 0.04, 0.08, 0.08] for y in (0, 0.045, -0.046)])
    axes = knobs[:, 1] + (0, 0, 0.008)
    joints = [Joint((0, y, 0.1), (1, 0, 0), angle=(-np.pi, np.pi)) for y in axes]
    made = side_by_side(knobs, joints)
    for i, k in ((0, 1), (0, 2), (1, 2)):
        radii = (made[i, 4:].mean() + made[k, 4:].mean()) / 2
        assert radii <= abs(axes[i] - axes[k]) * 0.9 + 1e-9
