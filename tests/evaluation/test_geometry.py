"""Hand-computed distances and overlaps."""

import numpy as np
import pytest
import trimesh

from uniart_jax.evaluation.geometry import (
    mesh_iou,
    object_chamfer,
    part_iou,
)
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def box(size, center):
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))


def test_iou_of_shifted_cubes():
    assert mesh_iou(box((1, 1, 1), (0, 0, 0)), box((1, 1, 1), (0.5, 0, 0))) == pytest.approx(
        1 / 3, abs=0.02
    )
    assert mesh_iou(box((1, 1, 1), (0, 0, 0)), box((1, 1, 1), (0, 0, 0))) == 1.0


def test_object_distances():
    obj = ArticulatedObject(
        (
            Part("body", box((1, 1, 1), (0, 0, 0))),
            Part(
                "lid", box((1, 1, 0.1), (0, 0, 0.55)), 0, Joint([0, 0, 0], [0, 0, 1], travel=(0, 1))
            ),
        )
    )
    assert object_chamfer(obj, obj) < 0.02  # sampling noise only
    assert object_chamfer(obj, obj, np.array([0, 1.0])) > 0.1
    np.testing.assert_allclose(part_iou(obj, obj), 1)
