"""Drawers and doors of layouts that tell of boxes alone get the boards that they usually have."""

import dataclasses

import numpy as np
import pytest

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution
from uniart_jax.voxels.usual_boards import DEEP, FLAT, FRONT, HEIGHT, WALL, with_usual_boards
from uniart_jax.voxels.voxelize import voxelize

BODY = [0, 0, 0, 0.5, 0.8, 1.0]
DRAWER = [-0.05, 0.1, 0.2, 0.4, 0.5, 0.2]
DOOR = [-0.26, 0, -0.2, 0.02, 0.6, 0.5]
HINGE = Joint((-0.26, 0.3, 0), (0, 0, -1), angle=(0, 1.5))


def slide(*direction, travel=(0, 0.3)):
    return Joint((0, 0, 0), direction, travel=travel)


def boards_of(box, joint):
    one = Layout(
        np.array([BODY, box]), (Joint.fixed(), joint), (-1, 0), np.ones((2, 3)), np.ones(2)
    )
    body, found = with_usual_boards(one).boards
    assert body is None
    return None if found is None else found.boxes


@pytest.mark.parametrize(
    ("joint", "axis", "side", "x"),
    [
        (slide(-1, 0, 0), 0, -1, -0.05),
        (slide(1, 0, 0, travel=(-0.3, 0.05)), 0, -1, -0.05),
        (slide(-1, 0, 0, travel=(-0.25, 0.1)), 0, -1, -0.3),  # drawn half open
        (slide(1, 0, 0), 0, 1, 0.05),
        (slide(0, 1, 0), 1, 1, -0.05),
    ],
)
def test_a_drawer_is_open_above_and_has_its_front_where_it_opens(joint, axis, side, x):
    box = [x, *DRAWER[1:]]
    boards = boards_of(box, joint)
    low, high = (
        np.array(box[:3]) - np.array(box[3:]) / 2,
        np.array(box[:3]) + np.array(box[3:]) / 2,
    )
    assert np.allclose(boards[:, :3].min(0), low) and np.allclose(boards[:, 3:].max(0), high)
    assert (boards[:, 3:] > boards[:, :3]).all()
    cells = low + (np.indices((40, 50, 40)).reshape(3, -1).T + 0.5) / [40, 50, 40] * (high - low)
    held = ((cells[:, None] > boards[:, :3]) & (cells[:, None] < boards[:, 3:])).all(-1).any(1)
    held = held.reshape(40, 50, 40)
    assert held[..., 0].all()  # a floor
    inner = held[5:-5, 5:-5, 5:]
    assert not inner.any()
    front, back = (np.moveaxis(held, axis, 0)[::side][i] for i in (-1, 0))
    assert front.all() and not back[..., 35:].any() and back[..., :29].all()
    assert front.shape[-1] == 40 and HEIGHT == 0.75 and WALL < FRONT


def test_a_flat_part_that_turns_is_a_plate_and_a_box_is_none():
    assert np.allclose(boards_of(DOOR, HINGE), [[-0.27, -0.3, -0.45, -0.25, 0.3, 0.05]])
    thick = [*DOOR[:3], 1.1 * FLAT, *DOOR[4:]]
    assert boards_of(thick, HINGE) is None
    assert boards_of(DOOR, Joint((0, 0, 0), (0, 0, -1), angle=(-0.8, 0.7))) is None  # ajar


def test_what_is_no_drawer_has_no_boards():
    assert boards_of(DRAWER, slide(0, 0, 1)) is None
    assert boards_of(DRAWER, slide(-0.8, 0.6, 0)) is None
    assert boards_of([*DRAWER[:3], 0.9 * DEEP, *DRAWER[4:]], slide(-1, 0, 0)) is None
    assert boards_of(DRAWER, Joint.fixed()) is None


def test_a_sliding_door_is_a_plate():
    door = [-0.26, 0.1, 0, 0.02, 0.4, 0.9]
    assert np.allclose(boards_of(door, slide(0, 1, 0)), [[-0.27, -0.1, -0.45, -0.25, 0.3, 0.45]])
    tray = [-0.05, 0, 0.1, 0.4, 0.5, 0.015]
    assert len(boards_of(tray, slide(-1, 0, 0))) == 1


def test_knobs_and_turntables_have_no_boards():
    plate = [0, 0, 0, 0.3, 0.3, 0.01]
    assert boards_of(plate, Joint((0, 0, 0), (0, 0, 1), angle=(0, 6))) is None
    knob = [-0.256, 0, 0, 0.012, 0.06, 0.06]
    assert boards_of(knob, Joint((-0.25, 0, 0), (-1, 0, 0), angle=(0, 4.7))) is None


def test_walls_are_as_thick_as_furnitures():
    one = Layout(
        np.array([BODY, DRAWER]),
        (Joint.fixed(), slide(-1, 0, 0)),
        (-1, 0),
        np.ones((2, 3)),
        np.ones(2),
    )
    small, large = (with_usual_boards(one, side).boards[1].boxes[0] for side in (0.5, 1.2))
    assert small[3] - small[0] == pytest.approx(FRONT / 0.5)
    assert large[3] - large[0] == pytest.approx(FRONT / 1.2)


def test_boards_and_outlines_that_are_told_stay():
    boxes = np.array([BODY, DRAWER, DOOR, DRAWER])
    joints = Joint.fixed(), slide(-1, 0, 0), HINGE, slide(-1, 0, 0)
    outline = Revolution(2, np.array([-0.26, 0.0]), np.array([0.1, 0.1]))
    one = Layout(boxes, joints, (-1, 0, 0, 0), np.ones((4, 3)), np.ones(4))
    told = Panels(np.array([[-0.25, -0.1, 0.1, 0.15, 0.3, 0.3]]), 1.0)
    found = with_usual_boards(
        dataclasses.replace(
            one, boards=(None, told, None, None), revolutions=(None, None, outline, None)
        )
    ).boards
    assert found[1] is told and found[2] is None and len(found[3]) == 5


def test_they_are_followed_whatever_voxels_show():
    """A network's boards are not, where voxels show a half of the drawer's width."""
    boxes = np.array([BODY, [-0.45, *DRAWER[1:]]])
    joints = Joint.fixed(), slide(-1, 0, 0)
    one = Layout(boxes, joints, (-1, 0), np.ones((2, 3)), np.ones(2)).normalized()[0]
    drawn = one.boxes.copy()
    drawn[1, [1, 4]] += [0.125, -0.25]
    grid = voxelize(dataclasses.replace(one, boxes=drawn).to_object(), 16, 4).gather()
    told = with_usual_boards(one)
    found = dataclasses.replace(
        told, boards=(None, dataclasses.replace(told.boards[1], estimate=True))
    )
    exact, voted = (assemble_layout(grid, layout) for layout in (told, found))
    drawer = exact.parts[1].mesh
    assert drawer.is_watertight and np.ptp(drawer.bounds, 0)[1] == pytest.approx(0.5, abs=0.03)
    assert drawer.volume < 0.5 * voted.parts[1].mesh.volume
    noted = [any("boards" in note for note in each.provenance) for each in (exact, voted)]
    assert noted == [False, True]
