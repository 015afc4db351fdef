"""Small rows that voxels hardly show are made of their boxes."""

import dataclasses

import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.stand_ins import needed, stand_in
from uniart_jax.voxels.voxelize import voxelize


def layout_of(box, confidence=0.9, parent=0):
    boxes = np.array([[0, 0, 0, 0.8, 0.8, 0.8], box], np.float64)
    joints = (Joint.fixed(), Joint.fixed())
    return Layout(boxes, joints, (-1, parent), np.full((2, 3), 0.5), np.array([0.9, confidence]))


KNOB = (-0.41, 0.2, 0.3, 0.05, 0.06, 0.06)


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
    ],
)
def test_which_rows_need_one(changes, solid, wanted):
    layout = layout_of(**{"box": KNOB, **changes})
    assert needed(layout, np.array([9999, solid]), 128) == wanted


def test_a_part_that_turns_about_its_middle_is_a_disc_and_others_are_blocks():
    box = np.array([0.1, -0.2, 0.3, 0.04, 0.06, 0.05])
    for axis in range(3):
        direction = np.eye(3)[axis]
        turning = Joint(box[:3], direction, angle=(-1.0, 1.0))
        disc = stand_in(box, turning, np.array([1.0, 0, 0]), 1 / 128)
        assert disc.is_watertight and len(disc.vertices) > 40
        assert len(np.unique(disc.vertices[:, axis].round(9))) == 2  # its two flat sides
        np.testing.assert_allclose(np.ptp(disc.bounds, 0), box[3:], rtol=0.01)
        np.testing.assert_allclose(disc.bounds.mean(0), box[:3], atol=1e-6)
        round_share = np.pi / 4
        assert disc.volume == pytest.approx(round_share * box[3:].prod(), rel=0.02)
        assert (disc.visual.vertex_colors == [255, 0, 0, 255]).all()
    beside = Joint(box[:3] + [0, 0.03, 0], [1.0, 0, 0], angle=(0.0, 1.0))
    slides = Joint(np.zeros(3), [1.0, 0, 0], travel=(0.0, 0.1))
    for joint in (beside, slides, Joint.fixed()):
        block = stand_in(box, joint, np.zeros(3), 1 / 128)
        assert block.is_watertight and block.volume == pytest.approx(box[3:].prod(), rel=1e-5)
    flat = stand_in(np.array([0, 0, 0, 0, 0.1, 0.1]), slides, np.zeros(3), 1 / 128)
    assert flat.is_watertight and np.ptp(flat.bounds, 0)[0] == pytest.approx(1 / 128)


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
    assert sum("made of its box: no voxels show it" in line for line in made.provenance) == len(small)  # fmt: skip
    unsure = dataclasses.replace(layout, confidence=np.full(len(layout), 0.4))
    assert len(assemble_layout(told, unsure).parts) == len(obj.parts) - len(small)
