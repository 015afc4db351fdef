"""Rough parts that run into each other on a joint's way lose cells; doors that only have to be
opened do not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

pytest.importorskip("mujoco")

from uniart_jax.export.physics import Body
from uniart_jax.export.voxel_boxes import CELLS, as_cells
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.carving import MOST_LOST, carve
from uniart_jax.simulation.collider import Collider

SLIDE = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0.0, 0.4))
DOOR = Joint([-0.45, -0.42, 0], [0, 0, 1], (0.0, 1.6))


def boxes(*bounds) -> trimesh.Trimesh:
    return trimesh.util.concatenate([trimesh.creation.box(bounds=b) for b in bounds])


def shelf(sill: float, scale: float = 1.0) -> ArticulatedObject:
    """A floor with a sill before a block that slides over it."""
    floor = boxes([[-0.5, -0.4, -0.1], [0.5, 0.4, 0.0]], [[-0.3, -0.4, -0.02], [-0.2, 0.4, sill]])
    block = boxes([[-0.15, -0.3, 0.02], [0.45, 0.3, 0.3]])
    return ArticulatedObject((Part("floor", floor), Part("block", block, 0, SLIDE)), scale=scale)


def cupboard() -> ArticulatedObject:
    """A case without a front, a door before it, and a rack that slides out once the door is
    open."""
    case = boxes(
        [[-0.4, -0.45, -0.45], [0.4, -0.42, 0.45]],
        [[-0.4, 0.42, -0.45], [0.4, 0.45, 0.45]],
        [[-0.4, -0.45, -0.45], [0.4, 0.45, -0.42]],
        [[0.37, -0.45, -0.45], [0.4, 0.45, 0.45]],
    )
    door = boxes([[-0.46, -0.45, -0.45], [-0.42, 0.45, 0.45]])
    rack = boxes([[-0.38, -0.38, -0.1], [0.3, 0.38, -0.05]])
    return ArticulatedObject(
        (Part("case", case), Part("door", door, 0, DOOR), Part("rack", rack, 0, SLIDE))
    )


def depths(obj: ArticulatedObject, cells, state) -> dict:
    # ty: ignore
    bodies = [Body(1.0, np.zeros(3), np.eye(3), own, None) for own in cells.shapes(obj.scale)]
    return Collider(obj, bodies).depths(obj.forward_kinematics(state))


def deepest(obj: ArticulatedObject, cells, part: str, states=40) -> float:
    """Of all pairs over the part's range, the others at rest; share of the object."""
    k = obj.index(part)
    found = [0.0]
    for q in np.linspace(*obj.joints[k].limits, states):
        state = obj.rest().copy()
        state[k] = q
        found += depths(obj, cells, state).values()
    return max(found) / obj.scale


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 0.02])
def test_a_sill_in_the_way_is_cut_down(scale):
    obj = shelf(0.06, scale)
    cells = as_cells(obj, [p.mesh for p in obj.parts])
    assert deepest(obj, cells, "block") > 0.02
    cut, (line,) = carve(obj, cells)
    assert deepest(obj, cut, "block") < 0.01  # what ``validate`` allows
    assert "'floor' and 'block'" in line
    kept = cut.full.sum((1, 2, 3)) / cells.full.sum((1, 2, 3))
    assert kept[1] == 1 and 0.9 < kept[0] < 1  # the sill is less of the floor than of the block
    assert not (cut.full & ~cells.full).any() and not (cut.spare & ~cells.spare).any()


def test_free_joints_take_no_cell():
    obj = shelf(0.0)
    cells = as_cells(obj, [p.mesh for p in obj.parts])
    cut, lines = carve(obj, cells)
    assert lines == () and np.array_equal(cut.full, cells.full)


def test_a_door_that_should_be_open_is_left_whole():
    obj = cupboard()
    cells = as_cells(obj, [p.mesh for p in obj.parts])
    cut, lines = carve(obj, cells)
    assert np.array_equal(cut.full[1], cells.full[1]) and np.array_equal(cut.full[2], cells.full[2])
    # a door without a hinge has to give way instead, or the rack
    fixed = dataclasses.replace(obj.parts[1], joint=Joint.fixed())
    shut = dataclasses.replace(obj, parts=(obj.parts[0], fixed, obj.parts[2]))
    cut, lines = carve(shut, cells)
    assert cut.full[1].sum() < cells.full[1].sum() and any("'door' and 'rack'" in x for x in lines)


@pytest.mark.slow
def test_no_part_loses_more_than_half():
    """A bar through a wall that is hardly larger."""
    bar = boxes([[-0.1, -0.2, -0.2], [0.3, 0.2, 0.2]])
    wall = boxes([[-0.3, -0.22, -0.22], [-0.2, 0.22, 0.22]])
    obj = ArticulatedObject((Part("wall", wall), Part("bar", bar, 0, SLIDE)))
    cells = as_cells(obj, [p.mesh for p in obj.parts])
    cut, lines = carve(obj, cells)
    kept = cut.full.sum((1, 2, 3)) / cells.full.sum((1, 2, 3))
    assert (kept >= 1 - MOST_LOST).all() and lines == ()


@pytest.mark.slow
def test_parts_side_by_side_do_not_touch_where_one_is_turned():
    """A square knob beside another: its corners sweep over the gap."""
    wall = boxes([[-0.05, -0.5, -0.5], [0.0, 0.5, 0.5]])
    turn = Joint([-0.1, -0.1, 0], [1, 0, 0], (0.0, 1.5))
    knob = boxes([[-0.1, -0.2, -0.1], [-0.05, 0.0, 0.1]])
    other = boxes([[-0.1, 0.01, -0.1], [-0.05, 0.2, 0.1]])
    obj = ArticulatedObject(
        (Part("wall", wall), Part("knob", knob, 0, turn), Part("other", other, 0))
    )
    cells = as_cells(obj, [p.mesh for p in obj.parts])
    first = max(depths(obj, cells, [0, q, 0]).get((1, 2), 0.0) for q in np.linspace(0, 1.5, 40))
    cut, _ = carve(obj, cells)
    left = max(depths(obj, cut, [0, q, 0]).get((1, 2), 0.0) for q in np.linspace(0, 1.5, 40))
    assert first > 0.01 and left < 0.1 / CELLS


@pytest.mark.slow
def test_what_meets_only_while_both_are_open_is_cut_too():
    """Two blocks that slide into one corner from two sides and share a layer of cells there."""
    plate = boxes([[-0.5, -0.5, -0.2], [0.5, 0.5, -0.15]])
    first = boxes([[-0.4, 0.2, -0.1], [-0.2, 0.4, 0.1]])
    second = boxes([[0.11, -0.4, -0.1], [0.31, -0.2, 0.1]])
    obj = ArticulatedObject(
        (
            Part("plate", plate),
            Part("first", first, 0, Joint([0, 0, 0], [1, 0, 0], (0, 0), (0, 0.325))),
            Part("second", second, 0, Joint([0, 0, 0], [0, 1, 0], (0, 0), (0, 0.6))),
        )
    )
    cells = as_cells(obj, [p.mesh for p in obj.parts])
    both = obj.open()
    assert max(depths(obj, cells, both).values()) > 0.005
    assert max(deepest(obj, cells, part) for part in ("first", "second")) < 0.005
    cut, (line,) = carve(obj, cells)
    assert not depths(obj, cut, both)
    assert "'first' and 'second'" in line and cut.full[0].sum() == cells.full[0].sum()
