"""What ``sample`` says and reports of one sample beside its figures."""

import dataclasses

import numpy as np
import pytest
import trimesh

from uniart_jax.cli.sample import _layout, details, lines
from uniart_jax.cli.words import moving_words
from uniart_jax.config import SampleConfig
from uniart_jax.data.layouts import shown_object
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.pipeline import Sample
from uniart_jax.procedural import HELD_OUT_SEED
from uniart_jax.voxels.kind import kind_of
from uniart_jax.voxels.layout import Layout

HINGE = Joint((-0.5, 0.5, 0), (0, 0, 1), (0, 1.5), (0, 0))
SLIDER = Joint((0, 0, 0), (-1, 0, 0), (0, 0), (0, 0.3))
KNOB = Joint((-0.5, 0, 0.3), (1, 0, 0), (-2, 2), (0, 0))


def disc(y):
    mesh = trimesh.creation.cylinder(0.04, 0.04)
    mesh.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
    return mesh.apply_translation((-0.52, y, 0.3))


def thing(*parts):
    body = Part("body", trimesh.creation.box((1, 1, 1)))
    return ArticulatedObject([body, *parts])


def cooker():
    door = trimesh.creation.box(
        (0.02, 0.9, 0.5), trimesh.transformations.translation_matrix((-0.5, 0, -0.2))
    )
    knobs = [
        Part(f"b{i}", disc(y), 0, Joint((-0.5, y, 0.3), KNOB.direction, KNOB.angle, KNOB.travel))
        for i, y in enumerate((-0.2, 0.2))
    ]
    return thing(*knobs, Part("door", door, 0, HINGE), Part("foot", door, 0))


def one(obj, background=(), cut=()):
    flow = SampleConfig(steps=1)
    both, calls = {"structure": flow, "latent": flow}, {"structure": 1, "latent": 1}
    return Sample(obj, both, calls, {"structure": 0, "latent": 0}, None, background, cut)


def test_moving_parts_in_words():
    assert moving_words(cooker()) == "1 door, 2 knobs"
    assert moving_words(thing()) == "no moving part"
    drawer = trimesh.creation.box((0.5, 0.5, 0.2))
    assert (
        moving_words(thing(Part("a", drawer, 0, SLIDER), Part("b", drawer, 0, SLIDER)))
        == "2 drawers"
    )


def test_the_last_line_says_what_was_found_and_where_to_click(tmp_path):
    made = one(cooker())
    said = f"found: {made.kind}: 1 door, 2 knobs"
    assert list(lines("x.png", made, tmp_path, []))[-1] == said  # no page was asked for
    (tmp_path / "view.html").touch()
    look = f"open {tmp_path / 'view.html'} in a browser: a slider for every joint"
    assert list(lines("x.png", made, tmp_path, []))[-1] == f"{said}; {look}"


def test_the_kind_is_that_of_the_layout_that_was_found(tmp_path):
    oven, _ = shown_object(HELD_OUT_SEED + 1, ("oven",), np.random.default_rng(0))
    found = Layout.of_object(oven)
    made = dataclasses.replace(one(cooker()), layout=found)
    assert made.kind == kind_of(found) and made.kind.family == "oven"
    assert list(lines("x.png", made, tmp_path, []))[-1].startswith("found: an oven-like object: ")
    told = details([made], 0)["kind"]
    assert told["words"] == "an oven-like object" and told["family"] == "oven"
    assert told["probability"] == pytest.approx(made.kind.probability, abs=1e-4)
    assert one(cooker()).kind == kind_of(Layout.of_object(cooker()))  # where none was found


@pytest.mark.parametrize(("sure", "low"), [(0.81, False), (0.2, True)])
def test_how_sure_the_parts_are(tmp_path, sure, low):
    made = one(cooker())
    assert "certainty" not in details([made], 0)
    assert not [line for line in lines("x.png", made, tmp_path, []) if "certainty" in line]
    layout = dataclasses.replace(Layout.of_object(cooker()), certainty=sure)
    made = dataclasses.replace(made, layout=layout)
    assert details([made], 0)["certainty"] == sure
    said = [line for line in lines("x.png", made, tmp_path, []) if "certainty" in line]
    assert len(said) == 1 and f"certainty {sure:.2f}" in said[0]
    assert ("low" in said[0]) == low


def test_of_a_layout_in_a_file_no_certainty_is_known(tmp_path):
    layout = dataclasses.replace(Layout.of_object(cooker()), certainty=0.9)
    (tmp_path / "edited.json").write_text(layout.to_json())
    assert _layout(tmp_path / "edited.json", True, True).certainty is None


@pytest.mark.parametrize(("ways", "said"), [(("alpha", "plain"), False), (("grabcut",), True)])
def test_how_the_object_was_cut_out(tmp_path, ways, said):
    made = [one(cooker(), ways)]
    assert details(made, 0)["background"] == list(ways)
    told = [line for line in lines("x.png", made[0], tmp_path, []) if "cut out" in line]
    assert "mask" not in details(made, 0)
    cut = np.zeros((2, 3, 4), np.uint8)
    cut[:, 1, 3] = 255
    masked = details([one(cooker(), ways, (cut,))], 0)["mask"]
    assert masked == [{"size": [2, 3], "counts": [2, 2, 2]}]
    assert told == (["  cut out of its background by grabcut: look at preview.png"] if said else [])
