"""Objects that follow a layout: the table's joints and tree, closed meshes, rows without voxels left out."""

import dataclasses

import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.voxels.follow import assemble_layout, row_of_subcells
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.voxelize import voxelize


@pytest.fixture(scope="module")
def oven():
    obj = procedural.generate("oven", 11)
    return obj, voxelize(obj, 32, 4)


def test_true_voxels_and_true_layout_give_the_object(oven):
    obj, grid = oven
    made = assemble_layout(grid.gather(), Layout.of_object(obj))
    scores = compare_parts(made, obj)
    assert scores.right.all() and scores.tree_right
    assert all(part.mesh.is_watertight for part in made.parts)


def test_noise_in_what_voxels_say_of_their_parts_is_borne(oven):
    obj, grid = oven
    told = grid.gather()
    noise = np.random.default_rng(0).normal(0, 0.1, told.own_box.shape).astype(np.float32)
    vague = dataclasses.replace(
        told,
        own_box=told.own_box + noise,
        joint_code=np.zeros_like(told.joint_code),
        parent_box=np.zeros_like(told.parent_box),
    )
    scores = compare_parts(assemble_layout(vague, Layout.of_object(obj)), obj)
    assert scores.right.all() and scores.tree_right


def test_the_layouts_joints_are_taken_whatever_the_voxels_say(oven):
    obj, grid = oven
    wrong = dataclasses.replace(grid, codes=np.zeros_like(grid.codes)).gather()
    made = assemble_layout(wrong, Layout.of_object(obj))
    assert sorted(j.type for j in made.joints) == sorted(j.type for j in obj.joints)


def test_a_row_that_no_voxel_shows_is_left_out_and_said(oven):
    obj, grid = oven
    true = Layout.of_object(obj)
    far = np.array([0.9, 0.9, 0.9, 0.02, 0.02, 0.02])
    child = next(k for k in range(len(true)) if true.parents[k] >= 0)
    count = len(true)
    more = Layout(
        np.concatenate([true.boxes, far[None]]),
        (*true.joints, true.joints[child]),
        tuple(count if k == child else p for k, p in enumerate((*true.parents, 0))),
        np.concatenate([true.colors, true.colors[:1]]),
        np.append(true.confidence, 0.6),
    )
    made = assemble_layout(grid.gather(), more)
    assert len(made.parts) == count
    assert any(f"part {count} of the layout (confidence 0.60)" in line for line in made.provenance)
    assert compare_parts(made, obj).tree_right  # its child hangs on its parent


def test_rows_are_the_owners_on_true_voxels(oven):
    obj, grid = oven
    rows = row_of_subcells(grid.gather(), Layout.of_object(obj).boxes)
    solid = grid.sdf < 0
    assert (rows == grid.owner)[solid].mean() > 0.99


def test_no_voxels_is_one_line(oven):
    obj, grid = oven
    told = grid.gather()
    fields = ("coords", "sdf", "color", "own_box", "joint_code", "parent_box")
    empty = dataclasses.replace(told, **{name: getattr(told, name)[:0] for name in fields})
    with pytest.raises(ValueError, match="empty"):
        assemble_layout(empty, Layout.of_object(obj))
