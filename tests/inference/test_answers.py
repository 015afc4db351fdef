"""What a vision-language model answers, read."""

import copy
import json

import numpy as np
import pytest

from uniart_jax.inference.answers import read_answer
from uniart_jax.inference.ask_layout import prompt

CHEST = {
    "view": {"azimuth": 35, "elevation": 20},
    "parts": [
        {
            "name": "body",
            "parent": None,
            "box": {"center": [0, 0, 0.21], "size": [0.5, 1.0, 0.42]},
        },
        {
            "name": "lid",
            "parent": "body",
            "box": {"center": [0, 0, 0.45], "size": [0.51, 1.02, 0.06]},
            "joint": {
                "origin": [0.25, 0, 0.42],
                "direction": [0, 1, 0],
                "angle": [0, 1.5],
                "shown": 0.7,
            },
        },
    ],
}


def test_an_answer_is_a_layout_in_object_units_as_the_picture_shows_it_and_a_view():
    layout, view = read_answer(json.dumps(CHEST))
    assert layout.names == ("body", "lid") and not layout.metres
    low, high = layout.boxes[:, :3] - layout.boxes[:, 3:] / 2, layout.boxes[:, :3]
    high = high + layout.boxes[:, 3:] / 2
    assert np.ptp([low.min(0), high.max(0)], axis=0).max() == pytest.approx(1)
    assert layout.size == pytest.approx(1.02)
    assert layout.joints[1].angle == pytest.approx((-0.7, 0.8))
    np.testing.assert_allclose(np.degrees(view), [35, 20])
    told = json.loads(json.dumps(CHEST)) | {"units": "object", "size": 0.3}
    assert read_answer(json.dumps(told))[0].size == 0.3


@pytest.mark.parametrize(
    "text",
    [
        "Here it is, {as you asked}:\n```json\n%s\n```\nThe lid stands open.",
        '{"reasoning": "a chest"}\n%s',
        "%s {",
    ],
)
def test_words_around_the_json_are_passed_over(text):
    assert len(read_answer(text % json.dumps(CHEST))[0]) == 2


def test_the_example_in_the_prompt_is_an_answer():
    layout, view = read_answer(prompt())
    assert layout.names == ("body", "lid", "handle") and layout.boards[1] is not None
    assert layout.tubes[2] is not None and layout.parents[2] == 1
    assert layout.joints[1].angle == pytest.approx((-0.7, 0.8)) and len(view) == 2


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda a: a["parts"][0].update(seen=[1, 2, 3]), "part 0: no entry 'seen'; there are name"),
        (lambda a: a.update(view=35), "view: give an object"),
        (lambda a: a.update(view={"azimuth": 35}), "view: elevation must be 1 finite numbers"),
        (lambda a: a.update(view={"azimuth": 35, "elevation": 120}), "are no degrees of a camera"),
        (lambda a: a["parts"][1]["joint"].update(shown=3), "shown 3 is not within angle"),
        (lambda a: a["parts"][1].update(parent="chest"), "parent 'chest' is no row"),
        (lambda a: a.update(parts=[]), "must be a list of 1 to 256 parts"),
        (lambda a: a.update(parts={}), "must be a list of 1 to 256 parts"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(change, problem):
    answer = copy.deepcopy(CHEST)
    change(answer)
    with pytest.raises(ValueError, match=problem) as error:
        read_answer(json.dumps(answer))
    assert "\n" not in str(error.value)


def test_what_holds_no_json_is_refused():
    for text in ("", "I cannot see a picture.", "{", json.dumps({"rows": []})):
        with pytest.raises(ValueError, match="there is no JSON object"):
            read_answer(text)
    with pytest.raises(ValueError, match="not valid JSON"):
        read_answer(json.dumps(CHEST)[:-5])
