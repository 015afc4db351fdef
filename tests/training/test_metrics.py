"""Part readings under the true segmentation."""

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.training.metrics import part_readings, summarize_readings
from uniart_jax.voxels.joint_code import encode_joint

BOXES = np.array([[0, 0, 0, 1, 1, 1], [-0.5, 0, 0, 0.05, 1, 1], [0.2, 0, 0, 0.5, 0.5, 0.5]])
JOINTS = [
    Joint.fixed(),
    Joint([-0.5, 0.5, 0], [0, 0, 1], angle=(0, 1.5)),
    Joint([0, 0, 0], [1, 0, 0], travel=(-0.4, 0)),
]
CODES = np.stack(
    [np.zeros(9), *(encode_joint(j, b[:3]) for j, b in zip(JOINTS[1:], BOXES[1:], strict=True))]
)
PARENTS = np.array([0, 0, 0])
PARTS = np.repeat([0, 1, 2], 10)


def readings(codes=CODES, boxes=BOXES):
    return part_readings(codes[PARTS], boxes[PARTS], PARTS, BOXES, CODES, PARENTS)


def test_the_truth_is_right_and_the_root_is_not_counted():
    rows = readings()
    assert len(rows) == 2
    summary = summarize_readings(rows)
    assert summary["parts/right"] == summary["parts/found"] == summary["parts/type"] == 1
    assert summary["parts/axis"] < 1e-5 and summary["parts/pivot"] < 1e-6


def test_a_door_that_opens_inwards_is_found_but_not_right():
    codes = CODES.copy()
    codes[1, 7:9] = -codes[1, 8], -codes[1, 7]
    door, drawer = readings(codes)
    assert door["found"] == 1 and door["right"] == 0 and door["axis"] > 170
    assert drawer["right"] == 1


def test_collapse_to_fixed_is_seen():
    rows = readings(np.zeros_like(CODES))
    assert summarize_readings(rows)["parts/type"] == 0 and "parts/axis" not in summarize_readings(
        rows
    )


def test_shifted_boxes():
    moved = BOXES + np.array([0.15, 0, 0, 0, 0, 0])
    assert [(r["found"], r["right"]) for r in readings(boxes=moved)] == [(1, 0), (1, 0)]
    assert summarize_readings([]) == {}
