"""The table as text: what a person leaves is as it was read, what is changed is followed."""

import dataclasses
import json

import numpy as np
import pytest
from toy_pipeline import toy_layout

from uniart_jax.app.examples import example_tables
from uniart_jax.app.table import LONGEST, followed_layout, is_told, table_text
from uniart_jax.app.table_box import example_text
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution

LEG = np.array([[0.1, 0.1, 0.2, 0.3]])
KNOB = [-0.32, 0.3, 0.3, 0.04, 0.1, 0.1]


def read_off() -> Layout:
    """A drawer with boards, a knob on it, and a body with panels and legs; the root second."""
    toy = toy_layout()
    turn = Joint(KNOB[:3], [-1, 0, 0], (-np.pi, np.pi))
    drawer = Panels(np.array([[-0.32, -0.45, -0.15, -0.31, 0.45, 0.15]]), 0.9)
    return dataclasses.replace(
        toy,
        boxes=np.concatenate([toy.boxes, [KNOB]]),
        joints=(*toy.joints, turn),
        parents=(1, -1, 0),
        colors=np.full((3, 3), 0.123456),
        confidence=np.array([0.9, 1.0, 0.7]),
        boards=(drawer, None, None),
        revolutions=(None, None, Revolution(0, np.full(2, 0.3), np.array([0.04, 0.05]), True)),
        legs=Legs(LEG, LEG, np.array([[-0.4, -0.3]]), np.ones(1), np.array([False]), True),
        panels=Panels(np.array([[-0.3, -0.5, -0.4, 0.3, 0.5, 0.4]]), 0.95),
        certainty=0.8,
    )


def changed(change, read=None):
    """What is followed after a change of the table's text."""
    read = read or read_off()
    data = json.loads(table_text(read))
    change(data)
    return followed_layout(json.dumps(data), read)


def test_the_text_is_a_layout_with_a_part_a_line():
    text = table_text(read_off())
    again = Layout.from_json(text)
    assert again.names == ("base", "drawer_1", "knob_1") and again.parents == (-1, 0, 1)
    np.testing.assert_allclose(again.boxes, read_off().boxes[[1, 0, 2]], atol=1e-4)
    np.testing.assert_allclose(again.camera, read_off().camera, atol=1e-4)
    assert sum('"name"' in line for line in text.splitlines()) == 3
    assert '"parent": "drawer_1"' in text and "null" not in text.replace('"parent": null', "")
    numbers = [n for n in text.replace("[", " ").replace(",", " ").split() if "." in n]
    assert max(len(n.strip("]}-")) for n in numbers) <= len("0.1235")


def test_a_text_that_says_the_same_is_what_was_read():
    read = read_off()
    for text in ("", None, "  \n", table_text(read), json.dumps(json.loads(table_text(read)))):
        assert followed_layout(text, read) is read
    assert read.certainty == 0.8


def test_an_edited_one_is_followed_without_certainty():
    def wider(data):
        data["parts"][1]["joint"]["travel"] = [0, 0.2]
        data["parts"][2]["name"] = "dial"
        del data["camera"]

    one = changed(wider)
    assert one.joints[1].travel == (0, 0.2) and one.certainty is None
    assert one.names == ("part_0", "part_1", "dial")  # the others are named by what they are
    np.testing.assert_array_equal(one.camera, read_off().camera)
    np.testing.assert_array_equal(changed(lambda d: d["parts"].pop()).camera, read_off().camera)
    turned = changed(lambda data: data["camera"].__setitem__(2, 0.5))
    assert turned.camera is not None and turned.camera[2] == 0.5


def test_rows_come_and_go():
    def less(data):
        data["parts"][2]["parent"] = "base"
        del data["parts"][1]

    one = changed(less)
    assert one.parents == (-1, 0) and one.joints[1].type == "continuous" and one.boards == ()

    def more(data):
        deep = {**data["parts"][1], "name": "second", "boards": None}
        deep["box"] = {"center": [0, 0, -0.3], "size": [0.5, 0.8, 0.1]}
        data["parts"].append(deep)

    one = changed(more)
    assert len(one) == 4 and len(one.boards[3]) == 5  # as drawers usually have
    assert len(one.boards[1]) == 1 and one.boards[2] is None


def test_boards_outlines_legs_and_panels_go_along_with_their_boxes():
    def moved(data):
        for row, center, size in ((0, [0, 0, 0.1], [1.2, 1, 0.8]), (1, [-0.31, 0, 0.2], None)):
            data["parts"][row]["box"]["center"] = center
            data["parts"][row]["box"]["size"] = size or data["parts"][row]["box"]["size"]
        data["parts"][2]["box"] = {"center": [-0.32, 0.2, 0.3], "size": [0.04, 0.05, 0.05]}

    one, read = changed(moved), read_off()
    np.testing.assert_allclose(one.boards[1].boxes[0], [-0.32, -0.45, 0.05, -0.31, 0.45, 0.35])
    np.testing.assert_allclose(one.panels.boxes[0], [-0.6, -0.5, -0.3, 0.6, 0.5, 0.5])
    np.testing.assert_allclose(one.legs.lower[0], [0.2, 0.1, 0.4, 0.3])
    np.testing.assert_allclose(one.legs.heights[0], [-0.3, -0.2])
    outline = one.revolutions[2]
    np.testing.assert_allclose(outline.center, [0.2, 0.3])
    np.testing.assert_allclose(outline.radii, [0.02, 0.025])
    assert not outline.estimate and read.revolutions[2].estimate

    def own(data):
        moved(data)
        data["parts"][1]["boards"]["rows"][0]["lower"][0] = -0.33
        data["panels"]["rows"][0]["lower"][0] = -0.2

    one = changed(own)  # what a person wrote stays
    np.testing.assert_allclose(one.boards[1].boxes[0], [-0.33, -0.45, -0.15, -0.31, 0.45, 0.15])
    np.testing.assert_allclose(one.panels.boxes[0], [-0.2, -0.5, -0.4, 0.3, 0.5, 0.4])


def test_boards_of_a_door_that_stands_ajar_do_not_go_along():
    read = toy_layout()
    hinge = Joint([-0.3, 0.45, 0], [0, 0, 1], (-1.2, 0.4))
    read = dataclasses.replace(
        read,
        boxes=np.array([[-0.6, 0.4, 0, 0.6, 0.1, 0.6], read.boxes[1]]),
        joints=(hinge, Joint.fixed()),
        boards=(Panels(np.array([[-0.32, -0.2, -0.3, -0.3, 0.4, 0.3]]), 0.9), None),
    )
    higher = lambda data: data["parts"][1]["box"]["center"].__setitem__(2, 0.1)  # noqa: E731
    assert changed(higher, read).boards == ()
    redder = lambda data: data["parts"][1].update(color=[1, 0, 0])  # noqa: E731
    assert len(changed(redder, read).boards[1]) == 1


def test_a_table_alone_keeps_its_lengths_and_names():
    for path in example_tables():
        one = followed_layout(path.read_text(), None)
        given = Layout.from_json(path.read_text())
        np.testing.assert_array_equal(one.boxes, given.boxes)
        assert one.names == given.names and one.certainty is None
    assert example_text(0) == example_tables()[0].read_text()
    for number in (-1, 99, "0", None, True):
        with pytest.raises(ValueError, match="no such example"):
            example_text(number)


def tiny(data):
    data["parts"] = [{**data["parts"][0], "box": {"center": [0, 0, 0], "size": [1e-320] * 3}}]


def test_answers_of_a_vision_language_model_are_told_from_tables_that_were_read():
    text = table_text(read_off())
    data = json.loads(text)
    assert not is_told(text) and not is_told("") and not is_told(None) and not is_told("{")
    metres = {name: data[name] for name in ("schema", "parts")} | {"units": "m"}
    assert is_told(json.dumps(metres))
    answer = f"Here it is:\n{json.dumps({'parts': data['parts'], 'view': {}})}"
    assert is_told(answer) and not is_told("x" * LONGEST + answer)
    answer = json.dumps(metres | {"view": {"azimuth": 30, "elevation": 20}})
    alone = followed_layout(answer, None)  # without a picture it needs no camera
    assert not alone.metres
    words = followed_layout(f"Here:\n{json.dumps(metres)}", None)
    assert words.size == alone.size
    assert alone.size == pytest.approx(read_off().normalized()[1])


@pytest.mark.parametrize(
    ("text", "alone", "says"),
    [
        ("", True, "table: it is empty"),
        ([1], False, "table: give a text"),
        ("x" * (LONGEST + 1), False, "table: 200,001 characters; 200,000 are the most"),
        ('{"schema": 1', False, "layout: not valid JSON"),
        ("[" * 100_000, False, "layout: not valid JSON"),
        ("9" * 5000, False, "layout: not valid JSON"),
        (lambda d: d["parts"][1].update(parent="bas"), False, "part 1: parent 'bas' is no row"),
        (lambda d: d["parts"][1]["box"].pop("size"), False, "part 1: size must be 3"),
        (lambda d: d["parts"][1]["box"].update(size=[10**400] * 3), False, "part 1: size must"),
        (lambda d: d["parts"][1]["box"].update(size=[1, 1, 3]), False, "'drawer_1' reaches 1.5"),
        (tiny, True, "table: no box is longer than 1e-06"),
    ],
)
def test_what_cannot_be_followed_is_one_line(text, alone, says):
    if callable(text):
        data = json.loads(table_text(read_off()))
        text(data)
        text = json.dumps(data)
    with pytest.raises(ValueError) as caught:
        followed_layout(text, None if alone else read_off())
    told = str(caught.value)
    assert says in told and "\n" not in told
