"""How a part that stands ajar lies closed, from its joint code and the box around it."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.data.mirror import mirror_codes, mirror_corners
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.closed_pose import closed_boxes, closing, closing_of, moved, undone
from uniart_jax.voxels.joint_code import decode_joint, encode_joint, gauge_variants

BODY = np.array([-0.3, -0.3, -0.4, 0.2, 0.3, 0.4])
# a closed door before the front, hinged at its right edge; it opens by up to 1.8
DOOR = np.array([-0.32, -0.28, -0.35, -0.29, 0.28, 0.3])
HINGE, Z = np.array([-0.305, 0.28, 0.0]), np.array([0.0, 0.0, 1.0])
WAY = -1.0  # about z, in which it opens


def corners_of(box):
    return np.array(list(itertools.product(*box.reshape(2, 3).T)))


def door_at(angle, opens=1.8):
    """Code and corners of the box of the door, shown open by an angle."""
    turned = trimesh.transformations.rotation_matrix(WAY * angle, Z, HINGE)
    corners = trimesh.transform_points(corners_of(DOOR), turned)
    limits = sorted([-WAY * angle, WAY * (opens - angle)])
    joint = Joint(HINGE, Z, angle=tuple(limits))
    box = np.concatenate([corners.min(0), corners.max(0)])
    return encode_joint(joint, (box[:3] + box[3:]) / 2), box


@pytest.mark.parametrize("angle", [0.06, 0.4, np.pi / 4, 1.2, np.pi / 2, 1.75])
def test_an_open_door_goes_back_to_where_it_closes(angle):
    code, box = door_at(angle)
    motions, turns = closing(code[None], box[None], BODY)
    assert abs(turns[0]) == pytest.approx(angle, abs=1e-6)
    there = trimesh.transformations.rotation_matrix(WAY * angle, Z, HINGE)
    shown = trimesh.transform_points(corners_of(DOOR), there)
    np.testing.assert_allclose(moved(motions[:, None], shown[None])[0], corners_of(DOOR), atol=1e-6)
    closed = closed_boxes(motions, turns, code[None], box[None])
    sides = closed[0, 3:] - closed[0, :3], DOOR[3:] - DOOR[:3]  # read off the box around it
    np.testing.assert_allclose(sides[0][1:], sides[1][1:], rtol=0.05)
    assert 0.5 * sides[1][0] < sides[0][0] < 2 * sides[1][0]
    np.testing.assert_allclose(closed[0], DOOR, atol=0.02)
    np.testing.assert_allclose(moved(undone(motions), DOOR[:3]), shown[:1], atol=1e-6)


def test_what_is_shown_closed_lies_as_it_is_shown():
    for angle in (0.0, 0.03):
        code, box = door_at(angle)
        motions, turns = closing(code[None], box[None], BODY)
        assert turns[0] == 0 and (motions[0] == np.eye(3, 4)).all()
        np.testing.assert_allclose(closed_boxes(motions, turns, code[None], box[None])[0], box)


@pytest.mark.parametrize("opens", [1.4, 2.12])
def test_a_leaf_that_is_hinged_at_a_mullion_is_closed_where_it_lies_in_its_frame(opens):
    """Its middle is nearer the frame's once it is open."""
    frame, leaf = np.array([-0.03, -0.5, -0.4, 0.03, 0.5, 0.4]), [-0.02, 0.1, -0.3, 0.02, 0.5, 0.3]
    joint = Joint(np.array([-0.02, 0.1, 0]), Z, angle=(0.0, opens))
    code = encode_joint(joint, np.zeros(3))
    assert closing(code, np.array(leaf), frame)[1] == 0
    for angle in (0.4, 1.2):
        turned = trimesh.transformations.rotation_matrix(angle, Z, joint.origin)
        corners = trimesh.transform_points(corners_of(np.array(leaf)), turned)
        ajar = Joint(joint.origin, Z, angle=(-angle, opens - angle))
        box = np.concatenate([corners.min(0), corners.max(0)])
        _, turn = closing(encode_joint(ajar, np.zeros(3)), box, frame)
        assert turn == pytest.approx(-angle)


def test_limits_are_read_as_a_joint_has_them():
    """A network's limits may not bracket 0; the joint that is read of them does."""
    for low, high in ((-0.5, -0.02), (0.02, 0.5), (-0.3, 0.2)):
        code = door_at(0.0)[0].copy()
        code[7:] = low, high
        joint = decode_joint(code, np.zeros(3))
        one, two = (closing(c, DOOR, BODY)[1] for c in (code, encode_joint(joint, np.zeros(3))))
        assert one == pytest.approx(two)


@pytest.mark.parametrize(
    "joint",
    [
        Joint.fixed(),
        Joint(HINGE, Z, travel=(-0.3, 0.1)),
        Joint(HINGE, Z, angle=(-np.pi, np.pi)),
        Joint(HINGE, Z, angle=(-2.6, 2.6)),  # nearly all round
        Joint(HINGE, np.array([0.3, 0.0, 1.0]), angle=(-1.0, 0.5)),  # along no axis
        Joint((DOOR[:3] + DOOR[3:]) / 2, Z, angle=(-1.0, 0.5)),  # about its middle
        Joint(HINGE, Z, angle=(-1.0, 0.5), travel=(-0.2, 0.1)),
    ],
)
def test_what_is_no_hinged_door_lies_as_it_is_shown(joint):
    code = encode_joint(joint, (DOOR[:3] + DOOR[3:]) / 2)
    motions, turns = closing(code, DOOR, BODY)
    assert turns == 0 and (motions == np.eye(3, 4)).all()


def test_it_is_the_same_in_both_gauges_and_mirrored():
    code, box = door_at(0.7)
    motion, turn = closing(code, box, BODY)
    other = gauge_variants(code)[1]  # the axis turned round
    assert other[3] == -code[3]
    same, back = closing(other, box, BODY)
    np.testing.assert_allclose(same, motion, atol=1e-9)
    assert back == pytest.approx(-turn)
    mirrored = mirror_codes(code), mirror_corners(box), mirror_corners(BODY)
    found = closed_boxes(*closing(*mirrored), mirrored[0], mirrored[1])
    plain = closed_boxes(motion, turn, code, box)
    np.testing.assert_allclose(found, mirror_corners(plain), atol=1e-9)


def test_jax_and_numpy_agree():
    rng = np.random.default_rng(0)
    codes = np.stack([door_at(a)[0] for a in (0.0, 0.5, 1.3)])
    codes = np.concatenate([codes, rng.normal(size=(40, 9))]).astype(np.float32)
    lower = rng.uniform(-0.5, 0.3, (43, 3))
    boxes = np.concatenate([lower, lower + rng.uniform(0.05, 0.3, (43, 3))], 1).astype(np.float32)
    boxes[:3] = [door_at(a)[1] for a in (0.0, 0.5, 1.3)]

    @jax.jit
    def run(codes, boxes, body):
        found = closing(codes, boxes, body, jnp)
        return found, closed_boxes(*found, codes, boxes, jnp)

    one, (two, shut) = closing(codes, boxes, BODY), run(codes, boxes, BODY.astype(np.float32))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-4)
    assert np.isfinite(two[0]).all()
    np.testing.assert_allclose(closed_boxes(*one, codes, boxes), shut, atol=2e-3)


def test_procedural_doors_close():
    """Where a door stands ajar its motion takes it to the rest state."""
    rng, ajar = np.random.default_rng(0), 0
    for family in ("storage_furniture", "refrigerator", "dishwasher", "microwave"):
        for seed in range(900_000, 900_006):
            obj = procedural.generate(family, seed)
            q = [
                rng.uniform(*part.joint.limits) if part.joint.type == "revolute" else 0.0
                for part in obj.parts
            ]
            shown = obj.shown_at(np.array(q)).normalized()
            joints, parents = zip(*((p.joint, p.parent) for p in shown.parts), strict=True)
            motions = closing_of(joints, shown.boxes, parents)
            rest = shown.rest()
            for k, part in enumerate(shown.parts):
                turned = (motions[k] != np.eye(3, 4)).any()
                if part.joint.type == "revolute" and turned:
                    np.testing.assert_allclose(
                        motions[k], part.joint.motion(rest[k])[:3], atol=1e-5
                    )
                    ajar += 1
                else:
                    door = part.joint.type == "revolute" and "knob" not in part.name
                    assert not turned and (not door or abs(rest[k]) < 0.05)
    assert ajar > 20
