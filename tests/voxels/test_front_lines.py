"""Doors and drawers of one front get common edges; all else stays as it is."""

import dataclasses

import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.front_lines import GAP, fronts_of, with_common_edges
from uniart_jax.voxels.joint_code import encode_object
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution

OUT = np.array([-1.0, 0, 0])  # fronts face -x
BODY = np.array([0, 0, 0, 0.6, 1.0, 1.0])


def box(lower, upper):
    lower, upper = np.array(lower, float), np.array(upper, float)
    return np.concatenate([(lower + upper) / 2, upper - lower])


def drawer(low, high, face=-0.3):
    """(box, joint) of a closed drawer between (y, z) corners."""
    joint = Joint(np.zeros(3), OUT, travel=(0.0, 0.3))
    return box([face, *low], [face + 0.5, *high]), joint


def door(low, high, face=-0.3, angle=(0.0, 1.5)):
    """(box, joint) of a door whose hinge is at its lower y."""
    joint = Joint(np.array([face, low[0], 0.1]), np.array([0, 0, 1.0]), angle=angle)
    return box([face, *low], [face + 0.03, *high]), joint


def layout(*parts, boards=()):
    boxes = np.stack([BODY, *(b for b, _ in parts)])
    count = len(boxes)
    joints = (Joint.fixed(), *(joint for _, joint in parts))
    parents = (-1, *[0] * (count - 1))
    return Layout(boxes, joints, parents, np.ones((count, 3)), np.ones(count), boards=boards)


def edges(given):
    """Lower and upper corners [K, 3] of all parts but the body."""
    boxes = given.boxes[1:]
    return boxes[:, :3] - boxes[:, 3:] / 2, boxes[:, :3] + boxes[:, 3:] / 2


def uneven(rng, columns=2, rows=3):
    """A chest of drawers in a grid, every edge off by .008 at most."""
    parts = []
    for column in range(columns):
        for row in range(rows):
            low = np.array([-0.45 + 0.45 * column, -0.45 + 0.3 * row])
            off = rng.uniform(-0.008, 0.008, (2, 2))
            parts.append(drawer(low + off[0], low + [0.44, 0.29] + off[1]))
    return layout(*parts)


@pytest.mark.parametrize("seed", range(4))
def test_drawers_of_a_grid_have_common_edges_and_even_gaps(seed):
    given = uneven(np.random.default_rng(seed))
    found = with_common_edges(given)
    lower, upper = (corners.reshape(2, 3, 3) for corners in edges(found))
    for corners in (lower, upper):
        assert np.ptp(corners[..., 1], axis=1).max() < 1e-12  # of a column
        assert np.ptp(corners[..., 2], axis=0).max() < 1e-12  # of a row
    for gap in (lower[1, :, 1] - upper[0, :, 1], lower[:, 1:, 2] - upper[:, :-1, 2]):
        assert GAP[0] - 1e-12 <= gap.min() and gap.max() <= GAP[1] + 1e-12
    assert 0 < np.abs(found.boxes - given.boxes).max() < 0.02
    np.testing.assert_array_equal(found.boxes[:, [0, 3]], given.boxes[:, [0, 3]])
    again = with_common_edges(found)
    np.testing.assert_allclose(again.boxes, found.boxes, atol=1e-12)


def test_a_drawer_that_is_drawn_out_has_the_edges_of_the_others():
    """What it is out by does not matter; where it would not be flush when closed, it is none."""
    out = dataclasses.replace(drawer([0, 0], [1, 1])[1], travel=(-0.2, 0.1))
    pulled = box([-0.5, 0.01, 0.02], [0.0, 0.44, 0.3]), out
    given = layout(drawer([0.0, -0.31], [0.45, 0.0]), pulled)
    lower, upper = edges(with_common_edges(given))
    np.testing.assert_allclose(lower[:, 1], 0.005)
    np.testing.assert_allclose(upper[:, 1], 0.445)
    assert lower[1, 2] - upper[0, 2] == pytest.approx(0.02)
    assert lower[1, 0] == -0.5
    far = layout(
        drawer([0.0, -0.31], [0.45, 0.0]), (box([-0.7, 0.01, 0.02], [-0.2, 0.44, 0.3]), out)
    )
    assert with_common_edges(far) is far


def test_what_is_no_closed_front_stays_as_it_is():
    """A door that stands open, a drawer that lies behind the others, a button, a front on another
    side, and a rail between two fronts."""
    button = (box([-0.32, 0.015, 0.33], [-0.3, 0.035, 0.35]), drawer([0, 0], [1, 1])[1])
    beside = (box([-0.2, 0.45, 0.02], [0.2, 0.48, 0.3]), Joint([0, 0.48, 0], [1, 0, 0], (0, 1.5)))
    others = [
        door([0.012, 0.02], [0.3, 0.3], angle=(-0.8, 0.8)),
        drawer([0.013, 0.02], [0.44, 0.3], face=-0.1),
        button,
        beside,
    ]
    alone = layout(drawer([0.0, 0.0], [0.45, 0.31]), *others)
    assert not fronts_of(alone) and with_common_edges(alone) is alone
    parts = drawer([-0.45, 0.0], [0.4, 0.2]), drawer([-0.45, 0.26], [0.4, 0.45])
    railed = layout(*parts, *others)
    found = with_common_edges(railed)
    assert [rows.tolist() for _, rows in fronts_of(railed)] == [[1, 2]]
    np.testing.assert_array_equal(found.boxes, railed.boxes)


def test_a_hinge_and_boards_go_with_their_door():
    boards = (None, None, Panels(np.array([[-0.3, 0.02, 0, -0.27, 0.05, 0.3]]), 0.9))
    given = layout(door([-0.4, 0.0], [0.0, 0.3]), door([0.03, 0.01], [0.43, 0.31]), boards=boards)
    middle = given.boxes[2, 1:3]
    rounds = (None, None, Revolution(0, middle + [0.02, 0], np.array([0.1])))
    given = dataclasses.replace(given, revolutions=rounds)
    found = with_common_edges(given)
    lower, upper = edges(found)
    assert lower[1, 1] - upper[0, 1] == pytest.approx(GAP[1])
    for k in (1, 2):
        assert found.joints[k].origin[1] == pytest.approx(lower[k - 1, 1])
        assert found.joints[k].origin[0] == pytest.approx(given.joints[k].origin[0])
    np.testing.assert_allclose(lower[:, 2], 0.005)
    stretch = found.boxes[2, 4] / given.boxes[2, 4]
    shifted = found.boxes[2, 1] + (np.array([0.02, 0.05]) - given.boxes[2, 1]) * stretch
    np.testing.assert_allclose(found.boards[2].boxes[0, [1, 4]], shifted)
    assert found.boards[1] is None and found.boards[2].share == 0.9
    wider = found.boxes[2, 4:].sum() / given.boxes[2, 4:].sum()
    assert wider != pytest.approx(1, abs=1e-3)
    np.testing.assert_allclose(found.revolutions[2].radii, 0.1 * wider)
    np.testing.assert_allclose(found.revolutions[2].center, found.boxes[2, 1:3] + [0.02 * wider, 0])
    assert found.revolutions[:2] == (None, None)


def test_what_is_behind_a_front_is_none():
    rack = drawer([-0.42, 0.02], [-0.02, 0.1], face=-0.27)
    given = layout(door([-0.45, 0.0], [0.0, 0.3]), rack, drawer([0.02, 0.01], [0.4, 0.31]))
    assert [rows.tolist() for _, rows in fronts_of(given)] == [[1, 3]]
    found = with_common_edges(given)
    np.testing.assert_array_equal(found.boxes[2], given.boxes[2])
    alone = layout(door([-0.45, 0.0], [0.0, 0.3]), rack)
    assert with_common_edges(alone) is alone


def test_thin_drawers_of_a_column_keep_apart():
    rng = np.random.default_rng(0)
    lows = np.arange(6) * 0.035
    parts = [drawer([-0.4, low], [0.4, low + 0.03 + rng.uniform(-0.004, 0.004)]) for low in lows]
    lower, upper = edges(with_common_edges(layout(*parts)))
    assert np.diff(lower[:, 2]).min() > 0.02 and np.diff(upper[:, 2]).min() > 0.02


def test_one_front_below_two_of_unlike_height_does_not_run_into_either():
    parts = (
        drawer([-0.4, -0.2], [0.4, 0.1]),
        *(drawer([y, low], [y + 0.39, 0.4]) for y, low in ((-0.4, 0.09), (0.01, 0.125))),
    )
    found = with_common_edges(layout(*parts))
    lower, upper = edges(found)
    assert (lower[1:, 2] - upper[0, 2]).min() >= GAP[0] - 1e-12


def test_what_hangs_on_a_front_goes_with_it():
    given = layout(drawer([-0.45, 0.0], [0.0, 0.3]), drawer([0.03, 0.02], [0.43, 0.32]))
    knob = box([-0.33, 0.2, 0.15], [-0.3, 0.24, 0.19])
    turn = Joint(knob[:3], OUT, angle=(0, 2.0))
    given = dataclasses.replace(
        given,
        boxes=np.concatenate([given.boxes, knob[None]]),
        joints=(*given.joints, turn),
        parents=(*given.parents, 2),
        colors=np.ones((4, 3)),
        confidence=np.ones(4),
    )
    found = with_common_edges(given)
    moved = found.boxes[3] - knob
    assert np.abs(moved[3:]).max() < 1e-12 and np.abs(moved[1:3]).min() > 0.001
    assert np.abs(moved).max() < 0.02
    np.testing.assert_allclose(found.joints[3].origin - turn.origin, moved[:3], atol=1e-12)


def test_true_layouts_stay_right():
    """What is even already hardly moves, nor do rails of face frames."""
    fronts = 0
    for seed in range(900_300, 900_312):
        obj = procedural.generate("storage_furniture", seed)
        boxes, _, parents = encode_object(obj)
        parents = [-1 if parent == k else int(parent) for k, parent in enumerate(parents)]
        count = len(parents)
        true = Layout(boxes, tuple(obj.joints), tuple(parents), np.ones((count, 3)), np.ones(count))
        found = with_common_edges(true)
        fronts += sum(len(rows) for _, rows in fronts_of(true))
        assert np.abs(found.boxes - true.boxes).max() < 0.01
        assert compare_parts(found.to_object(), true.to_object()).right.all()
    assert fronts > 12
