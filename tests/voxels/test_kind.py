"""What kind of thing a layout is called."""

import dataclasses
import runpy
from pathlib import Path

import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.data.layouts import shown_object
from uniart_jax.objects.kinematics import Joint
from uniart_jax.procedural import HELD_OUT_SEED, SEEN_FAMILIES
from uniart_jax.voxels.kind import MOVING, NAMELESS, Kind, KindTable, features, joint_kinds, kind_of
from uniart_jax.voxels.layout import Layout

ROOT = Path(__file__).parents[2]
MIRROR = np.array([1, -1, 1])


def mirrored(layout):
    """The layout as a mirror shows it, left for right."""
    boxes = layout.boxes * np.r_[MIRROR, 1, 1, 1]
    joints = [
        Joint(j.origin * MIRROR, -j.direction * MIRROR, j.angle, (-j.travel[0], -j.travel[1]))
        if j.rotates
        else Joint(j.origin * MIRROR, j.direction * MIRROR, j.angle, j.travel)
        for j in layout.joints
    ]
    return dataclasses.replace(layout, boxes=boxes, joints=tuple(joints))


@pytest.fixture(scope="module")
def held_out():
    """[(family, true layout)] of three held-out objects of each of the seven families."""
    found = []
    for seed in range(HELD_OUT_SEED, HELD_OUT_SEED + 3):
        for family in SEEN_FAMILIES:
            obj, _ = shown_object(seed, (family,), np.random.default_rng(seed))
            found.append((family, Layout.of_object(obj)))
    return found


def test_held_out_objects_are_called_what_they_are(held_out):
    kinds = [(family, kind_of(layout)) for family, layout in held_out]
    assert sum(kind.family == family for family, kind in kinds) >= 0.75 * len(kinds)
    named = [(family, kind) for family, kind in kinds if str(kind) != NAMELESS]
    assert len(named) >= 0.5 * len(kinds)
    assert sum(kind.family == family for family, kind in named) >= 0.85 * len(named)


def test_left_is_as_right_and_rows_have_no_order(held_out):
    for _, layout in held_out[:7]:
        row = features(layout)
        np.testing.assert_allclose(features(mirrored(layout)), row, atol=1e-9)
        order = np.random.default_rng(0).permutation(len(layout))
        place = {int(k): new for new, k in enumerate(order)} | {-1: -1}
        shuffled = dataclasses.replace(
            layout,
            boxes=layout.boxes[order],
            joints=tuple(layout.joints[k] for k in order),
            parents=tuple(place[layout.parents[k]] for k in order),
        )
        np.testing.assert_allclose(features(shuffled), row, atol=1e-9)


def test_drawers_side_by_side_have_no_order():
    drawers = [[-0.3, y, 0.1, 0.3, 0.3, 0.2] for y in (-0.33, 0.0, 0.33)]
    joint = Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.2))
    rows = []
    for order in ([0, 1, 2], [0, 2, 1], [1, 2, 0]):
        boxes = np.array([[0.0, 0, 0, 0.9, 1.0, 0.7], *(drawers[k] for k in order)])
        joints = (Joint.fixed(), joint, joint, joint)
        layout = Layout(boxes, joints, (-1, 0, 0, 0), np.zeros((4, 3)), np.ones(4))
        rows.append(features(layout))
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(rows[0], rows[2])


def test_parts_are_named_by_what_they_do():
    axis, boxes = [1, 0, 0], np.tile([0.0, 0, 0, 0.1, 0.1, 0.1], (6, 1))
    boxes[3, 3:] = 0.3
    joints = (
        Joint.fixed(),
        Joint.fixed(),
        Joint([0, 0, 0], axis, angle=(0, 2)),
        Joint([0, 0, 0], axis, angle=(0, 2)),
        Joint([0, 0, 0], axis, travel=(0, 0.2)),
        Joint([0, 0, 0], axis, angle=(0, 2), travel=(0, 0.1)),
    )
    layout = Layout(boxes, joints, (-1, 0, 0, 0, 0, 0), np.zeros((6, 3)), np.ones(6))
    assert joint_kinds(layout) == ["base", "fixed", "knob", "hinge", "slider", "screw"]
    np.testing.assert_allclose(features(layout)[MOVING], np.log(2))  # one of each
    one = dataclasses.replace(layout, boxes=boxes[:1], joints=joints[:1], parents=(-1,))
    assert np.isfinite(features(one)).all() and len(features(one)) == len(features(layout))


@pytest.mark.parametrize(
    ("family", "named", "said"),
    [
        ("oven", True, "an oven-like object"),
        ("washer", True, "a washing-machine-like object"),
        ("storage_furniture", True, "a cabinet-like object"),
        ("oven", False, "an object"),
        ("assemblies", True, "an object"),
    ],
)
def test_a_kind_in_words(family, named, said):
    assert str(Kind(family, 0.9, named)) == said


def test_a_kind_is_named_from_the_tables_probability_on(held_out):
    width = len(features(held_out[0][1]))
    weights = np.zeros((width + 1, 3))
    weights[-1] = np.log([0.7, 0.2, 0.1])
    table = KindTable(("oven", "box", "safe"), np.zeros(width), np.ones(width), weights, 0.69)
    kind = table.kind(held_out[0][1])
    assert kind.probability == pytest.approx(0.7) and str(kind) == "an oven-like object"
    assert str(dataclasses.replace(table, threshold=0.71).kind(held_out[0][1])) == NAMELESS
    layout = held_out[0][1]
    still = dataclasses.replace(layout, joints=tuple(Joint.fixed() for _ in layout.joints))
    assert str(table.kind(still)) == NAMELESS  # nothing of it moves
    again = KindTable.from_json(table.to_json())
    assert again.kind(held_out[0][1]).probability == pytest.approx(0.7, abs=0.01)
    np.testing.assert_array_equal(again.mean, table.mean)


def test_every_family_that_is_trained_on_has_a_word():
    from uniart_jax.voxels import kind

    assert set(kind._table().families) == set(procedural.WORLDS["wide"])
    assert set(kind.WORDS) <= set(procedural.FAMILIES)
    said = {str(Kind(name, 1.0, True)) for name in procedural.WORLDS["wide"]}
    assert len(said) == len(set(procedural.WORLDS["wide"])) and not any("_" in x for x in said)


def test_a_table_is_fitted_and_names_what_it_is_sure_of():
    tool = runpy.run_path(str(ROOT / "tools/fit_kinds.py"), run_name="tool")
    rng = np.random.default_rng(0)

    def rows(count, mistaken=0.0):
        """Doors that turn about z, called "door", and sliding panels, called "box"."""
        made = []
        for _ in range(count):
            box = [-0.4, 0, 0, 0.05, *rng.uniform(0.3, 0.9, 2)]
            turns = rng.random() < 0.5
            moves = {"angle": (0, 1.5)} if turns else {"travel": (0, 0.3)}
            joint = Joint([-0.4, 0.3, 0], [0, 0, 1] if turns else [1, 0, 0], **moves)
            boxes = np.array([[0, 0, 0, 0.8, 0.9, 1], box])
            layout = Layout(boxes, (Joint.fixed(), joint), (-1, 0), np.zeros((2, 3)), np.ones(2))
            family = "door" if turns != (rng.random() < mistaken) else "box"
            made.append(tool["Row"](family, True, features(layout)))
        return made

    table, others = tool["fit"](rows(40)), rows(20)
    names, sure = tool["kinds_of"](table, others)
    assert names.tolist() == [row.family for row in others] and len(set(names)) == 2
    least, strange = tool["least_probability"](table, others, np.array([0.6, 0.2, 0.2, 0.2]))
    assert 0.3 <= least <= sure.min() and strange == 0.25
    assert tool["least_probability"](table, others, np.array([0.6, 0.0]))[0] == 0.61
    with pytest.raises(ValueError, match="95% are right"):
        tool["least_probability"](table, rows(100, mistaken=0.5), np.zeros(1))
    assert tool["strangers"](rows(40), others) == pytest.approx(np.ones(20))  # one family is left
