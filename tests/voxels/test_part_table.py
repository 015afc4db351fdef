"""Part tables: padding, colours of surfaces, and the table of a layout."""

import numpy as np
import pytest

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.joint_code import encode_joint
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.part_table import EMPTY, ROWS, part_table, surface_colors


def make_layout():
    joint = Joint(np.array([0.1, 0.2, 0.0]), np.array([0.0, 0.0, 1.0]), angle=(0.0, 1.0))
    boxes = np.array([[0, 0.2, 0, 0.1, 0.2, 0.3], [0, 0, 0, 1, 1, 1], [0.1, 0, 0, 0.2, 0.1, 0.1]])
    return Layout(
        boxes, (joint, Joint.fixed(), joint), (1, -1, 0), np.eye(3), np.array([0.4, 0.2, 0.9])
    )


def test_tables_are_padded_with_zeros():
    rows = make_layout().rows(5)
    table = part_table([rows, EMPTY], 4)
    assert table.counts.tolist() == [3, 0]
    for name in ROWS:
        np.testing.assert_allclose(getattr(table, name)[0, :3], rows[name], atol=1e-6)
        assert not getattr(table, name)[0, 3:].any() and not getattr(table, name)[1].any()
    with pytest.raises(ValueError, match="3 parts, the model holds 2"):
        part_table([rows], 2)


def test_the_surest_parts_of_a_layout_are_kept_with_the_root():
    layout = make_layout()
    rows = layout.rows(3)
    assert rows["parents"].tolist() == [1, 1, 0]
    np.testing.assert_allclose(
        rows["codes"][0], encode_joint(layout.joints[0], layout.boxes[0, :3])
    )
    rows = layout.rows(2)  # the first goes, and the third hangs on the root
    np.testing.assert_array_equal(rows["boxes"], layout.boxes[[1, 2]])
    assert rows["parents"].tolist() == [0, 0]


def test_colours_are_those_of_the_surface():
    sdf = np.array([[0.2, -0.5, 2.0], [0.1, -3.0, 0.9]])
    owner = np.array([[0, 1, 1], [0, 0, 1]])
    color = np.arange(18.0).reshape(2, 3, 3)
    found = surface_colors(sdf, color, owner, 3)
    np.testing.assert_allclose(found[0], (color[0, 0] + color[1, 0]) / 2)
    np.testing.assert_allclose(found[1], (color[0, 1] + color[1, 2]) / 2)
    np.testing.assert_allclose(found[2], color[[0, 0, 1, 1], [0, 1, 0, 2]].mean(0))
