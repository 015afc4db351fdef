"""What a layout network says of one picture -> Layout: rows that exist, their tree, and joints with
their closed end first; knobs turn clockwise, doors and drawers side by side have common edges."""

from __future__ import annotations

import dataclasses

import networkx as nx
import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.camera_code import camera_position
from uniart_jax.voxels.front_lines import with_common_edges
from uniart_jax.voxels.joint_code import (
    FIXED_AXIS,
    KAPPA,
    NETWORK_TOLERANCE,
    box_corners,
    decode_part,
)
from uniart_jax.voxels.layout import ROOT, Layout
from uniart_jax.voxels.leg_table import read_legs
from uniart_jax.voxels.opening_direction import ALONG_LATTICE, round_about, still_parts
from uniart_jax.voxels.panel_table import Panels, read_boards, read_panels
from uniart_jax.voxels.part_table import SMALLEST_SIDE, THRESHOLD
from uniart_jax.voxels.revolution_table import Revolution, read_revolution

KNOB = 0.15  # object units; what turns far and is no larger is a knob
FAR = np.deg2rad(144)
OFF_AXIS = 0.3  # of a knob's largest side, that its axis passes its centre at most
NEARLY = 0.95  # least cosine of a short axis with a side of its part's box that it goes along
LEAST_AXIS = 0.05  # length of a code's axis from which on it says that a part moves
PLATE = 2.5  # least width, and length, of a plate over its thickness
BESIDE = (0.4, 0.62)  # from a plate's middle, shares of its width: hinges between are at its edge
NEAREST_EYE = 0.8  # object units from the origin; a camera that is nearer is none
ALIKE = 0.01  # of a volume
UNDECIDED = 0.5  # least ratio of a knob's turns to both sides where its state is not known


def read_layout(outputs: dict[str, np.ndarray], threshold: float = THRESHOLD) -> Layout:
    """What a layout network says of one picture.

    Args:
      outputs: corners [Q, 6] (lower, upper), codes [Q, 9], exists [Q] logits, colors [Q, 3] linear
        RGB, parents [Q, Q] logits child -> parent (the diagonal: that it is the root), camera [7];
        of two looks certainty [] too.
      threshold: of the probability that a row exists; the surest row is always taken.

    Returns:
      A layout whose tree is the arborescence of the highest total score. Knobs turn clockwise
      (``_knobs_turn_clockwise``), hinges of plates lie at their edges (``_at_edge``), and closed
      fronts have common edges (``front_lines``).
    """
    probability = 1 / (1 + np.exp(-np.asarray(outputs["exists"], np.float64)))
    rows = np.flatnonzero(probability > threshold)
    rows = rows if len(rows) else np.array([int(probability.argmax())])
    corners = np.asarray(outputs["corners"], np.float64)[rows]
    size = np.maximum(corners[:, 3:] - corners[:, :3], SMALLEST_SIDE)
    boxes = np.concatenate([(corners[:, :3] + corners[:, 3:]) / 2, size], 1)
    camera = np.asarray(outputs["camera"], np.float64)
    eye = camera_position(camera)
    parents = _best_tree(np.asarray(outputs["parents"], np.float64)[np.ix_(rows, rows)])
    joints = tuple(
        Joint.fixed()
        if parents[k] < 0
        else _knobs_turn_clockwise(
            _decoded(np.asarray(outputs["codes"][row], np.float64), boxes[k]),
            boxes[k],
            boxes[parents[k]],
            eye,
        )
        for k, row in enumerate(rows)
    )
    joints = tuple(
        joint if parents[k] < 0 else _closed_first(_at_edge(joint, boxes[k]), boxes[k], boxes[up])
        for k, (joint, up) in enumerate(zip(joints, parents, strict=True))
    )
    colors = np.clip(np.asarray(outputs["colors"], np.float64)[rows], 0, 1)
    legs = read_legs(outputs) if "leg_rows" in outputs else None
    panels = read_panels(outputs) if "panel_rows" in outputs else None
    boards: tuple[Panels | None, ...] = ()
    if "board_rows" in outputs:
        still = still_parts(parents, joints)
        boards = tuple(
            None
            if k in still or round_about(boxes[k, :3], boxes[k, 3:], joints[k]) is not None
            else read_boards(outputs, row, boxes[k])
            for k, row in enumerate(rows.tolist())
        )
    revolutions: tuple[Revolution | None, ...] = ()
    if "round_axis" in outputs:
        revolutions = tuple(read_revolution(outputs, row) for row in rows.tolist())
    found = Layout(
        boxes,
        joints,
        parents,
        colors,
        probability[rows],
        camera,
        legs,
        panels,
        boards,
        revolutions,
        float(outputs["certainty"]) if "certainty" in outputs else None,
    )
    return with_common_edges(found)


def _decoded(code: np.ndarray, box: np.ndarray) -> Joint:
    """The joint of a code [9]; one whose axis is short, but not nothing, is read with a whole axis
    that passes its part's ``box`` [6], along a side of the box where it nearly is.

    A network that cannot tell a hinge on the left from one on the right says a short axis, which
    ``decode_part`` takes for a fixed joint. Of the parts found in 512 validation pictures 12 had
    such an axis, and all of them move.
    """
    length = float(np.linalg.norm(code[1:4]))
    if not LEAST_AXIS < length < FIXED_AXIS:
        return decode_part(code[None], box[:3], NETWORK_TOLERANCE)
    whole = np.concatenate([code[:1], code[1:7] / length, code[7:]])
    joint = decode_part(whole[None], box[:3], NETWORK_TOLERANCE)
    near = np.clip(joint.origin, box[:3] - box[3:] / 2, box[:3] + box[3:] / 2)
    along = np.abs(joint.direction).max() > NEARLY
    direction = np.round(joint.direction) if along else joint.direction
    return dataclasses.replace(joint, origin=near, direction=direction)


def _at_edge(joint: Joint, box: np.ndarray) -> Joint:
    """The joint of a door: a hinge that lies in a plate and near its edge is moved to the edge.

    Args:
      box: [6] centre and size of the part at the shown state.

    Returns:
      The joint; as it is for other joints, and for doors that are shown aslant.
    """
    axis = int(np.abs(joint.direction).argmax())
    across = np.delete(np.arange(3), axis)
    wide, thick = across[np.argsort(-box[3 + across])]
    at = (joint.origin[wide] - box[wide]) / max(box[3 + wide], SMALLEST_SIDE)
    plate = min(box[3 + wide], box[3 + axis]) > PLATE * box[3 + thick]
    upright = abs(joint.direction[axis]) > ALONG_LATTICE
    if joint.type != "revolute" or not (plate and upright) or not BESIDE[0] < abs(at) < BESIDE[1]:
        return joint
    origin = np.array(joint.origin)
    origin[wide] = box[wide] + np.sign(at) * box[3 + wide] / 2
    return dataclasses.replace(joint, origin=origin)


def _closed_first(joint: Joint, box: np.ndarray, parent: np.ndarray) -> Joint:
    """The joint of a slider, turned so that its lower end is the closed one: where the box around
    its part and its parent is smaller. Other joints, and those whose ends are alike, as they are.

    The sign of a code's direction does not say which end is closed. ``ArticulatedObject.rest``
    takes the lower end where an object is as large at both, as with a rack behind an open door.

    Args:
      box, parent: [6] centre and size of the part and of its parent at the shown state.
    """
    if joint.type != "prismatic":
        return joint
    part, around = box_corners(box), box_corners(parent)
    volumes = []
    for end in joint.travel:
        moved = part + np.tile(end * joint.direction, 2)
        lower, upper = np.minimum(around, moved)[:3], np.maximum(around, moved)[3:]
        volumes.append(float((upper - lower).prod()))
    return joint.reversed() if volumes[1] < (1 - ALIKE) * volumes[0] else joint


def _knobs_turn_clockwise(
    joint: Joint, box: np.ndarray, parent: np.ndarray, eye: np.ndarray
) -> Joint:
    """The joint of a knob, which turns clockwise as seen from outside, from its lower end on; other
    joints as they are.

    A picture often shows no more than that a knob turns: a picture of a knob that points upwards is
    its own mirror image, and half of the pictures of a training are mirrored. A network then gives
    a turn to one side or the other, a turn to both sides, or, as the code of a joint has a slide
    half-way between the two turns, a slide along the axis. Of procedural knobs two in three are
    shown at their stop, and all turn clockwise from there. A knob that is shown more than half way
    on is read as its mirror image.

    Args:
      box, parent: [6] centre and size of the part and of its parent, object units.
      eye: [3] where the camera is; it sees the outside of a knob.
    """
    largest = box[3:].max()
    if largest > KNOB or joint.type not in ("revolute", "prismatic"):
        return joint
    turn = joint
    if joint.type == "prismatic":
        axis = int(np.abs(joint.direction).argmax())
        reach = abs(box[axis] - parent[axis]) + box[3 + axis] / 2
        if reach < parent[3 + axis] / 2:  # it slides along its parent
            return joint
        half = (joint.travel[1] - joint.travel[0]) * KAPPA * np.pi / 2
        turn = Joint(box[:3], joint.direction, angle=(-half, half))
    low, high = turn.angle
    arm = np.cross(turn.direction, box[:3] - turn.origin)
    if turn.type != "revolute" or high - low < FAR or np.linalg.norm(arm) > OFF_AXIS * largest:
        return joint
    outwards = eye - box[:3]
    if not np.isfinite(eye).all() or np.linalg.norm(eye) < NEAREST_EYE:
        outwards = box[:3] - parent[:3]
    turn = turn if outwards @ turn.direction < 0 else turn.reversed()
    back, forth = -turn.angle[0], turn.angle[1]  # about the way inwards, clockwise is forth
    if min(back, forth) >= UNDECIDED * max(back, forth):
        back, forth = 0.0, back + forth
    elif back > forth:
        back, forth = forth, back
    return dataclasses.replace(turn, angle=(-back + 0.0, forth + 0.0))


def _best_tree(scores: np.ndarray) -> tuple[int, ...]:
    """[K] parents, -1 for the one root, that maximise the sum of log-softmax scores [child,
    parent]."""
    scores = scores - scores.max(1, keepdims=True)
    scores = scores - np.log(np.exp(scores).sum(1, keepdims=True))
    count = len(scores)
    single = 2 * (np.abs(scores).sum() + 1)  # a second root costs more than any tree gains
    graph = nx.DiGraph()
    for child in range(count):
        graph.add_edge(ROOT, child, weight=single - scores[child, child])
        for parent in range(count):
            if parent != child:
                graph.add_edge(parent, child, weight=-scores[child, parent])
    tree = nx.minimum_spanning_arborescence(graph)
    return tuple(int(next(iter(tree.predecessors(k)))) for k in range(count))
