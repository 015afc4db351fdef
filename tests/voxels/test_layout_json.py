"""A layout in other units, and written by hand."""

import dataclasses
import functools
import json

import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax import procedural
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution, revolution_rows
from uniart_jax.voxels.voxelize import voxelize

SLIDE = {"origin": [0, 0, 0], "direction": [-2, 0, 0], "travel": [0, 0.3]}


def similar(layout: Layout, side: float, by: np.ndarray) -> Layout:
    """A layout ``side`` times as large, then moved."""
    matrix = np.diag([side] * 3 + [1.0])
    matrix[:3, 3] = by
    flat = np.tile(by[:2], 2)
    panels = lambda p: dataclasses.replace(p, boxes=p.boxes * side + np.tile(by, 2))  # noqa: E731
    outline = layout.revolutions[1]
    center = outline.center * side + np.delete(by, outline.axis)
    return dataclasses.replace(
        layout,
        boxes=np.concatenate([layout.boxes[:, :3] * side + by, layout.boxes[:, 3:] * side], 1),
        joints=tuple(joint.transformed(matrix) for joint in layout.joints),
        legs=dataclasses.replace(
            layout.legs,
            lower=layout.legs.lower * side + flat,
            upper=layout.legs.upper * side + flat,
            heights=layout.legs.heights * side + by[2],
        ),
        panels=panels(layout.panels),
        boards=(None, panels(layout.boards[1])),
        revolutions=(
            None,
            dataclasses.replace(outline, center=center, radii=outline.radii * side),
        ),
    )


@given(st.floats(0.01, 100), st.integers(0, 1000), st.integers(0, 2))
@settings(max_examples=30, deadline=None)
def test_a_layout_in_metres_becomes_one_in_object_units(side, seed, axis):
    rng = np.random.default_rng(seed)
    boxes = np.array([[0, 0, 0, 0.5, 0.6, 1.0], [-0.1, 0.05, 0.2, 0.3, 0.2, 0.1]])
    rows = rng.uniform(-0.5, 0.5, (2, 4))
    legs = Legs(rows, rows, rng.uniform(-0.5, 0, (2, 2)), np.ones(2), np.zeros(2, bool), True)
    one = Layout(
        boxes,
        (Joint.fixed(), Joint(rng.normal(size=3), (0, 0, 1), angle=(0, 1), travel=(0, 0.1))),
        (-1, 0),
        np.full((2, 3), 0.5),
        np.ones(2),
        legs=legs,
        panels=Panels(rng.uniform(-0.5, 0.5, (3, 6)), 0.8),
        boards=(None, Panels(rng.uniform(-0.5, 0.5, (2, 6)), 0.8)),
        revolutions=(None, Revolution(axis, rng.uniform(-0.2, 0.2, 2), np.linspace(0.1, 0.3, 8))),
    )
    found, longest = similar(one, side, rng.uniform(-9, 9, 3)).normalized()
    assert longest == pytest.approx(side)
    close = functools.partial(np.testing.assert_allclose, rtol=1e-6, atol=1e-6)
    close(found.boxes, one.boxes)
    close(found.joints[1].motion(0.7), one.joints[1].motion(0.7))
    close(found.legs.table(4), legs.table(4))
    for mine, theirs in ((found.panels, one.panels), (found.boards[1], one.boards[1])):
        close(mine.boxes, theirs.boxes)
    close(revolution_rows(found.revolutions, 2), revolution_rows(one.revolutions, 2))


def test_what_a_joint_does_not_do_may_be_left_out():
    rows = [
        {"parent": None, "box": {"center": [0, 0, 0], "size": [1, 1, 1]}},
        {
            "parent": 0,
            "box": {"center": [0, 0, 0], "size": [0.5, 0.5, 0.5]},
            "joint": SLIDE,
        },
    ]
    read = lambda: Layout.from_json(json.dumps({"schema": 1, "parts": rows}))  # noqa: E731
    joint = read().joints[1]
    assert joint.type == "prismatic" and joint.travel == (0, 0.3) and joint.direction[0] == -1
    rows[1]["joint"] = {"origin": [0, 0, 0], "direction": [0, 0, 1], "angle": [0, 1]}
    assert read().joints[1].type == "revolute"
    rows[1]["joint"]["angle"] = [0]
    with pytest.raises(ValueError, match="part 1: angle must be 2 finite numbers"):
        read()


def as_text(*rows, **more):
    return json.dumps({"schema": 1, "parts": rows, **more})


CUBE = {"center": [0, 0, 0], "size": [1, 1, 1]}
BODY = {"parent": None, "box": CUBE}
TRAY = {"parent": 0, "box": CUBE, "joint": SLIDE}


def test_a_parent_may_be_told_by_its_name():
    box = {"center": [0, 0, 0], "size": [1, 1, 1]}
    rows = [
        {"name": "knob", "parent": "door", "box": box, "joint": SLIDE},
        {"name": "door", "parent": "part_2", "box": box, "joint": SLIDE},
        {"parent": None, "box": box},
    ]
    read = lambda: Layout.from_json(json.dumps({"schema": 1, "parts": rows}))  # noqa: E731
    assert read().parents == (1, 2, -1)
    rows[1]["parent"] = "lid"
    with pytest.raises(ValueError, match="part 1: parent 'lid' is no row of the table"):
        read()
    rows[2]["name"] = "body"
    rows[1]["parent"] = "body"
    assert read().parents == (1, 2, -1)


def test_a_number_that_no_float_holds_is_refused_in_one_line():
    box = {"center": [0, 0, 10**400], "size": [1, 1, 1]}
    for center in (10**400, 1e300, -(10**13)):
        box["center"][2] = center
        rows = [{"parent": None, "box": box}]
        with pytest.raises(ValueError, match="part 0: center must be 3 finite numbers"):
            Layout.from_json(json.dumps({"schema": 1, "parts": rows}))
    with pytest.raises(ValueError, match="layout: not valid JSON"):
        Layout.from_json("9" * 5000)


def test_names_are_kept_and_told_apart():
    bare = Layout.from_json(as_text(BODY, TRAY))
    assert bare.names == () and bare.name(1) == "part_1"
    assert Layout.from_json(bare.to_json()).names == ()
    again = Layout.from_json(Layout.from_json(as_text(BODY, TRAY | {"name": "a\ntray"})).to_json())
    assert again.names == ("part_0", "a tray")
    assert [part.name for part in again.to_object().parts] == ["part_0", "a tray"]
    assert again.taken([0]).names == ("part_0",)
    counted = BODY | {"name": "part_0"}, TRAY | {"name": "part_1"}, TRAY | {"name": "part_1"}
    assert Layout.from_json(as_text(*counted)).names == ()  # a row that was copied
    for bad in (7, False, ["a"], "", " \n", "base"):
        with pytest.raises(ValueError, match="part 1: name"):
            Layout.from_json(as_text(BODY | {"name": "base"}, TRAY | {"name": bad}))


@pytest.mark.parametrize(
    ("rows", "more", "says"),
    [
        ((BODY,), {"units": "cm"}, "units 'cm'; give \"m\""),
        (
            (BODY | {"box": {"center": [0, 0, 45], "size": [60, 60, 90]}},),
            {"units": "m"},
            "90 m long",
        ),
        ((BODY | {"box": CUBE | {"size": [1, 1, 500]}},), {}, "lengths are object units"),
        ((BODY,), {"unit": "m"}, "layout: no entry 'unit'; there are schema, frame, units"),
        ((BODY | {"box": CUBE | {"rotation": [0, 0, 1]}},), {}, "box: no entry 'rotation'"),
        ((BODY, TRAY | {"colour": [1, 0, 0]}), {}, "part 1: no entry 'colour'"),
        ((BODY, TRAY | {"joint": SLIDE | {"angles": [0, 1]}}), {}, "no entry 'angles'"),
        ((BODY, TRAY | {"joint": {"type": "revolute"}}), {}, "part 1: joint has no range"),
        ((BODY, TRAY | {"joint": SLIDE | {"angle": [0, 90]}}), {}, "part 1: angle .* give radians"),
    ],
)
def test_what_is_probably_a_mistake_is_refused(rows, more, says):
    with pytest.raises(ValueError, match=says) as caught:
        Layout.from_json(as_text(*rows, **more))
    assert "\n" not in str(caught.value)


def test_what_may_be_left_out():
    shelf = {"parent": 0, "box": CUBE}
    slide = {"direction": [-1, 0, 0], "travel": [0, 0.3]}
    made = Layout.from_json(as_text(BODY, shelf, TRAY | {"joint": slide}, units="m"))
    assert [joint.type for joint in made.joints] == ["fixed", "fixed", "prismatic"]
    assert made.metres and Layout.from_json(made.to_json()).metres
    assert not made.normalized()[0].metres
    np.testing.assert_array_equal(made.joints[2].origin, [0, 0, 0])


def test_names_reach_the_asset_and_no_other_folder(tmp_path):
    obj = procedural.generate("oven", 11)
    names = ("oven", "../the door", *(f"knob/{k}" for k in range(2, len(obj.parts))))
    layout = dataclasses.replace(Layout.of_object(obj), names=names)
    made = assemble_layout(voxelize(obj, 24, 4).gather(), layout)
    assert sorted(part.name for part in made.parts) == sorted(names)
    made.save(tmp_path / "asset", formats=("mjcf",), motion=False)
    assert [path.name for path in tmp_path.iterdir()] == ["asset"]
    links = yourdfpy.URDF.load(str(tmp_path / "asset/object.urdf")).link_map
    assert "oven" in links and any("the door" in name for name in links)


def test_a_screw_may_be_rounded():
    screw = {"direction": [0, 0, 1], "angle": [-1.2346, 2.3457], "travel": [-0.0123, 0.0235]}
    joint = Layout.from_json(as_text(BODY, TRAY | {"joint": screw})).joints[1]
    assert joint.type == "screw" and joint.pitch == pytest.approx(0.01, rel=0.01)
    with pytest.raises(ValueError, match="not proportional"):
        Layout.from_json(as_text(BODY, TRAY | {"joint": screw | {"travel": [0, 0.3]}}))
