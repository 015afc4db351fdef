"""Plain pictures of layouts: what is told is seen, where the camera's code says."""

import dataclasses
import itertools

import numpy as np
import pytest

from uniart_jax.data.images import crop
from uniart_jax.data.layout_renders import PROUD, SEAM, TOP, render_layout, solids
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.camera_code import project
from uniart_jax.voxels.closed_pose import closing_of, moved
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution

BODY = [0, 0, 0, 0.5, 0.6, 1.0]
DRAWER = [-0.05, 0, 0.3, 0.4, 0.5, 0.2]  # its front lies in the body's
SLIDE = Joint((0, 0, 0), (-1, 0, 0), travel=(0, 0.3))
RED, GRAY = (0.8, 0.02, 0.02), (0.4, 0.4, 0.4)


def layout(*rows, joints=(SLIDE,), **more):
    """A body and a red part."""
    boxes = np.array([BODY, *rows], np.float64)
    colors = np.array([GRAY] + [RED] * len(rows))
    joints = (Joint.fixed(), *joints[: len(rows)])
    parents = (-1, *[0] * len(rows))
    return Layout(boxes, joints, parents, colors, np.ones(len(boxes)), **more)


def prisms(*rectangles, top, alone=True):
    corners = np.array(rectangles, np.float64)
    heights = np.tile([-0.5, top], (len(corners), 1))
    ones = np.ones(len(corners))
    return Legs(corners, corners, heights, ones, np.zeros(len(corners), bool), alone)


def corners_of(box):
    """[8, 3] of a box as centre and size."""
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    return np.array(box[:3]) + signs * box[3:]


def reddish(picture):
    return (picture[..., 3] > 0) & (picture[..., 0] > 2.0 * picture[..., 1])


def test_the_code_says_where_the_boxes_are():
    one = layout()
    picture, code = render_layout(one)
    places = project(code, corners_of(one.boxes[0]))
    alpha = np.dstack([picture[..., 3]] * 4)  # a crop is on black
    rows, columns = np.nonzero(crop(alpha, 256)[..., 0] > 127)
    seen = np.array([[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]]) / 128 - 1
    assert np.allclose([places.min(0), places.max(0)], seen, atol=0.01)
    assert picture.shape == (512, 512, 4) and (picture[..., 3] == 0).any()


def test_a_drawer_whose_front_lies_in_the_bodys_is_seen():
    inside = [0.05, 0, 0.3, 0.3, 0.5, 0.2]
    picture, _ = render_layout(layout(DRAWER))
    assert reddish(picture).sum() > 0.05 * (picture[..., 3] > 0).sum()
    assert not reddish(render_layout(layout(inside))[0]).any()
    bounds = solids(layout(DRAWER)).parts[1].mesh.bounds
    assert bounds[0, 0] == pytest.approx(-0.25 - PROUD) and bounds[1, 0] == pytest.approx(0.15)
    assert bounds[:, 2] == pytest.approx([0.2 + SEAM, 0.4 - SEAM])


def test_what_reaches_the_bodys_sides_stays_within_them():
    wide = solids(layout([-0.05, 0, 0.3, 0.4, 0.6, 0.2])).parts[1].mesh.bounds
    assert wide[:, 1] == pytest.approx([-0.3 + SEAM, 0.3 - SEAM])
    hinge = Joint((-0.26, 0.3, 0), (0, 0, -1), angle=(0, 1.5))
    door = solids(layout([-0.24, 0, 0, 0.02, 0.6, 1.0], joints=(hinge,))).parts[1].mesh.bounds
    assert door[0] == pytest.approx([-0.25 - PROUD, -0.3 + SEAM, -0.5 + SEAM])


def test_below_a_tabletop_on_legs_there_is_air():
    legs = prisms([-0.25, -0.3, -0.2, -0.25], [0.2, 0.25, 0.25, 0.3], top=0.4)
    body = solids(layout(legs=legs)).parts[0].mesh
    assert body.volume == pytest.approx(0.5 * 0.6 * 0.1 + 2 * 0.05 * 0.05 * 0.9)
    assert np.allclose(body.bounds, [[-0.25, -0.3, -0.5], [0.25, 0.3, 0.5]])
    beside = dataclasses.replace(legs, alone=False)
    assert solids(layout(legs=beside)).parts[0].mesh.volume > 0.5 * 0.6 * 1.0
    holes = [(render_layout(layout(legs=one))[0][..., 3] > 0).sum() for one in (legs, beside)]
    assert holes[0] < 0.7 * holes[1]


def test_legs_that_reach_the_top_leave_a_top():
    for top in (0.5, 0.6):
        legs = prisms([-0.25, -0.3, -0.2, -0.25], top=top)
        body = solids(layout(legs=legs)).parts[0].mesh
        inside = body.volume - 0.05 * 0.05 * (top + 0.5)
        assert inside == pytest.approx(0.5 * 0.6 * TOP)


def test_a_round_body_is_round():
    outline = Revolution(2, np.zeros(2), np.array([0.25, 0.2]))
    body = solids(layout(revolutions=(outline,))).parts[0].mesh
    assert body.volume == pytest.approx(np.pi * 0.5 * (0.25**2 + 0.2**2), rel=0.01)


def test_what_stands_out_further_stays_there():
    hinge = Joint((-0.29, 0.3, 0), (0, 0, -1), angle=(0, 1.5))
    thin = solids(layout([-0.266, 0, 0, 0.008, 0.6, 1.0], joints=(hinge,))).parts[1].mesh.bounds
    assert thin[:, 0] == pytest.approx([-0.27, -0.262])


def test_panels_stand_for_the_body_and_boards_for_a_part():
    board = np.array([[-0.25, -0.3, -0.5, 0.25, 0.3, -0.4]])
    assert solids(layout(panels=Panels(board, 0.9))).parts[0].mesh.volume == pytest.approx(0.03)
    front = np.array([[-0.26, -0.25, 0.2, -0.24, 0.25, 0.4]])
    told = layout(DRAWER, boards=(None, Panels(front, 0.9)))
    assert solids(told).parts[1].mesh.volume == pytest.approx(0.02 * 0.5 * 0.2)


def test_boards_of_a_door_that_stands_ajar_are_seen_as_it_stands():
    hinge = Joint((-0.25, 0.3, 0.0), (0, 0, -1), angle=(-0.9, 0.7))
    turned = hinge.motion(0.9)
    corners = corners_of(np.array([-0.26, 0, 0, 0.02, 0.6, 1.0]))
    there = corners @ turned[:3, :3].T + turned[:3, 3]
    low, high = there.min(0), there.max(0)
    row = [*(low + high) / 2, *(high - low)]
    closed = Panels(np.array([[-0.27, -0.3, -0.5, -0.25, 0.3, 0.5]]), 0.9)
    one = layout(row, joints=(hinge,), boards=(None, closed))
    mesh = solids(one).parts[1].mesh
    motion = closing_of(one.joints, one.boxes, one.parents)[1]
    assert (motion != np.eye(3, 4)).any()
    back = moved(motion, np.asarray(mesh.vertices))
    assert np.allclose([back.min(0), back.max(0)], closed.boxes.reshape(2, 3))
    assert mesh.bounds[0, 0] < -0.6  # far before the body


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_outline_is_turned_about_its_axis(axis):
    box = np.array([0.1, -0.2, 0.3, 0.2, 0.2, 0.2])
    box[3 + axis] = 0.4
    center = np.delete(box[:3], axis)
    outline = Revolution(axis, center, np.array([0.1, 0.05]))
    mesh = solids(layout(box, revolutions=(None, outline))).parts[1].mesh
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.pi * 0.2 * (0.1**2 + 0.05**2), rel=0.01)
    assert np.allclose(mesh.bounds, [box[:3] - box[3:] / 2, box[:3] + box[3:] / 2], atol=1e-3)
    wide = np.abs(mesh.vertices[:, axis] - (box[axis] - 0.2)) < 1e-9  # its lower end
    away = np.linalg.norm(np.delete(mesh.vertices[wide], axis, 1) - center, axis=1)
    assert away.max() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("joint", "sides", "disc"),
    [
        (Joint((-0.3, 0.1, 0.2), (-1, 0, 0), angle=(0, 4)), (0.1, 0.1), True),
        (Joint((-0.3, 0.1, 0.2), (-1, 0, 0), angle=(0, 4)), (0.1, 0.3), False),
        (Joint((-0.3, 0.14, 0.2), (-1, 0, 0), angle=(0, 4)), (0.1, 0.1), False),
        (Joint((-0.3, 0.1, 0.2), (-1, 0, 0), travel=(0, 0.1)), (0.1, 0.1), False),
    ],
)
def test_what_turns_about_its_middle_is_round(joint, sides, disc):
    one = layout([-0.3, 0.1, 0.2, 0.05, *sides], joints=(joint,))
    part = solids(one).parts[1].mesh
    assert (len(part.vertices) > 8) == disc  # else it is a box
    if disc:
        assert part.volume == pytest.approx(0.05 * 0.05**2 * np.pi, rel=0.01)
