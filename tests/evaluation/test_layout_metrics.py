"""Judging layouts: the truth is right, and each kind of error is seen."""

import dataclasses
import itertools
import json

import numpy as np
import pytest

from uniart_jax.evaluation import layout as judging
from uniart_jax.evaluation.procedural import held_out
from uniart_jax.objects.kinematics import Joint
from uniart_jax.visual.layout_picture import draw_layout
from uniart_jax.voxels.camera_code import project
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution


@pytest.fixture(scope="module")
def tests():
    return [held_out(index, image_size=64, resolution=16) for index in (2, 4)]


def judge(tests, change=lambda layout: layout):
    return judging.judge([change(Layout.of_object(t.obj)) for t in tests], tests)["all"]


def test_the_truth_is_right(tests):
    found = judge(tests)
    names = ("parts_right", "recall", "count", "tree", "type_accuracy")
    assert [found[name] for name in names] == [1.0] * 5
    assert found["box_median"] == found["opens_wrong_way"] == found["calibration"] == 0
    assert found["parts_right_interval"] == [1.0, 1.0]


def test_a_shifted_box_is_found_but_not_right(tests):
    move = np.array([0.12, 0, 0, 0, 0, 0])
    found = judge(tests, lambda one: dataclasses.replace(one, boxes=one.boxes + move))
    assert found["parts_right"] == 0 and found["recall"] > 0
    assert found["box_median"] == pytest.approx(0.12, abs=1e-6)


def test_a_joint_that_opens_inwards_is_seen(tests):
    def turn(one):
        joints = [
            j if j.type == "fixed" else Joint(j.origin, -j.direction, j.angle, j.travel)
            for j in one.joints
        ]
        return dataclasses.replace(one, joints=tuple(joints))

    found = judge(tests, turn)
    assert found["parts_right"] < 0.5 and found["opens_wrong_way"] > 0.5


def test_a_lost_part_costs_the_count(tests):
    def lose(one):
        rows = [k for k in range(len(one)) if k != len(one) - 1]
        pick = lambda values: tuple(values[k] for k in rows)  # noqa: E731
        return Layout(
            one.boxes[rows],
            pick(one.joints),
            pick(one.parents),
            one.colors[rows],
            one.confidence[rows],
        )

    found = judge(tests, lose)
    assert found["count"] == 0 and found["recall"] < 1


def test_parts_that_the_picture_hides_are_judged_apart(tests):
    score = judging.score_layout(Layout.of_object(tests[0].obj), tests[0])[0]
    moving = np.flatnonzero(score.moving)
    right = np.ones_like(score.right)
    right[moving[0]] = False
    wrong = dataclasses.replace(score, right=right, count_right=False)
    hidden, all_seen = np.ones(len(right)), np.ones(len(right))
    hidden[moving[0]] = judging.SEEN / 2
    found = judging.by_sight([wrong, score], [hidden, all_seen])
    assert found["parts"]["hidden"] == {"recall": 1.0, "parts_right": 0.0, "moving_parts": 1}
    assert found["parts"]["seen"]["moving_parts"] == 2 * len(moving) - 1
    assert found["parts"]["seen"]["parts_right"] == 1.0
    assert found["objects"]["hidden"]["count"] == 0.0 and found["objects"]["seen"]["count"] == 1.0
    said = judging.sight_line(found)
    assert "moving parts hidden in the picture (1): 1.00 found, 0.00 right" in said
    assert "nan" not in judging.sight_line(judging.by_sight([score], [all_seen]))


def test_the_picture_of_a_held_out_object_says_which_parts_it_shows(tests):
    for test in tests:
        opaque = (test.image[..., 3] > 127).mean()
        assert test.sight.shape == (len(test.obj.parts),)
        assert test.sight.sum() == pytest.approx(opaque, abs=0.03)


def test_calibration_error():
    sure = np.array([0.9, 0.9, 0.9, 0.9, 0.2, 0.2])
    hits = np.array([1, 1, 1, 0, 0, 0])
    assert judging.calibration_error(sure, hits) == pytest.approx((0.6 + 0.4) / 6)


def test_command_writes_figures_and_pictures(tmp_path, tests):
    def read(images):
        raise AssertionError("predictions come from files")

    folder = tmp_path / "pred"
    folder.mkdir()
    for index in range(2):
        test = held_out(index, image_size=32, resolution=16)
        (folder / f"{index}.json").write_text(Layout.of_object(test.obj).to_json())
    found = judging.evaluate_layout("nano", tmp_path / "out", count=2, pred=folder)
    kept = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert kept["all"]["parts_right"] == found["all"]["parts_right"] == 1.0
    assert (tmp_path / "out" / "layouts.png").stat().st_size > 1000
    assert kept["settings"]["unseen"] is False and set(kept["families"]) == {
        "storage_furniture",
        "table",
    }
    with pytest.raises(FileNotFoundError, match=r"no '.*2\.json'"):
        judging.evaluate_layout("nano", tmp_path / "more", count=3, pred=folder)


def test_layouts_in_metres_and_rows_that_are_fixed_are_judged_as_objects_have_them(tmp_path):
    test = held_out(0, image_size=32, resolution=16)
    true = Layout.of_object(test.obj)
    rows, root = json.loads(true.to_json()), true.parents.index(-1)
    own = rows["parts"][root]["box"]
    center, (x, y, z) = np.array(own["center"]), own["size"]
    foot = {"center": (center - [0, 0, 0.375 * z]).tolist(), "size": [x, y, z / 4]}
    own |= {"center": (center + [0, 0, z / 8]).tolist(), "size": [x, y, 0.75 * z]}
    rows["parts"].append({"name": "foot", "parent": root, "box": foot})
    split = Layout.from_json(json.dumps(rows))
    np.testing.assert_allclose(judging.without_fixed(split).boxes, true.boxes, atol=1e-5)
    assert judging.without_fixed(true).parents == true.parents
    (tmp_path / "pred").mkdir()
    metres = dataclasses.replace(split.moved(np.array([0.2, 0, 0.1]), 2.0), metres=True)
    (tmp_path / "pred/0.json").write_text(metres.to_json())
    found = judging.evaluate_layout("nano", tmp_path / "out", count=1, pred=tmp_path / "pred")
    assert found["all"]["parts_right"] == found["all"]["count"] == found["all"]["tree"] == 1


def test_a_vision_language_model_is_judged(tmp_path, capsys):
    (tmp_path / "told").mkdir()
    test = held_out(0, image_size=32, resolution=16)
    (tmp_path / "told/0.json").write_text(Layout.of_object(test.obj).to_json())
    ask = f"cat {tmp_path}/told/{{name}}.json"
    found = judging.evaluate_layout("nano", tmp_path / "out", count=1, ask=ask, predictor=Box())
    assert found["all"]["parts_right"] == 1
    kept = json.loads((tmp_path / "out/metrics.json").read_text())
    assert kept["settings"]["ask"] == ask
    found = judging.evaluate_layout("nano", tmp_path / "two", count=1, ask="false", predictor=Box())
    assert found["all"]["parts_right"] == 0
    assert json.loads((tmp_path / "two/metrics.json").read_text())["settings"]["unanswered"] == [0]
    assert "object 0: ask: 'false' ended with 1" in capsys.readouterr().err
    with pytest.raises(ValueError, match="give --pred or --ask, not both"):
        judging.evaluate_layout("nano", tmp_path, pred=tmp_path, ask="false")


def test_families_are_drawn_by_name(tmp_path):
    found = judging.evaluate_layout(
        "nano", tmp_path / "out", count=3, families=("kettle", "jar"), first_seed=900_500,
        predictor=Box(),
    )  # fmt: skip
    assert set(found["families"]) == {"kettle", "jar"}
    kept = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert kept["settings"]["families"] == ["kettle", "jar"]
    assert kept["settings"]["first_seed"] == 900_500
    assert found["families"]["kettle"]["objects"] == 2
    with pytest.raises(ValueError, match="no family 'mug'; there are"):
        judging.evaluate_layout(
            "nano", tmp_path / "no", count=1, families=("mug",), predictor=Box()
        )


class Box:
    """A layout network that finds one part; ``seen``: the crops that it is shown."""

    image_size, crop_margin = 64, 1.1

    def __call__(self, crops):
        self.seen = crops
        one = {
            "corners": np.array([[-0.5] * 3 + [0.5] * 3]), "codes": np.zeros((1, 9)),
            "exists": np.ones(1), "colors": np.zeros((1, 3)), "parents": np.ones((1, 1)),
            "camera": np.array([0, 1, 0.3, 1.2, 0.4, 0, 0]),
        }  # fmt: skip
        return [one for _ in crops]


def test_objects_are_cut_out_of_backgrounds_again(tmp_path, monkeypatch):
    masks = []

    def find(rgba):
        masks.append(np.zeros(rgba.shape[:2], np.uint8))
        masks[-1][100:200, 100:200] = 255
        return masks[-1]

    monkeypatch.setattr(judging, "load_mask_predictor", lambda checkpoint: find)
    monkeypatch.setattr("uniart_jax.data.background._installed", lambda *modules: False)
    network = Box()
    judging.evaluate_layout("nano", tmp_path, count=2, predictor=network, backgrounds=True)
    kept = json.loads((tmp_path / "metrics.json").read_text())["settings"]
    assert (
        len(masks) == 2 and kept["backgrounds"] == {"network": 2} and 0 < kept["mask_overlap"] < 0.9
    )
    for crop in network.seen:  # a tenth of it is margin, all else the square that was found
        seen = (crop.max(-1) > 16).mean()  # resampling leaves traces outside
        assert seen == pytest.approx(1 / 1.21, abs=0.05)
    with pytest.raises(ValueError, match="no --backgrounds with --pred"):
        judging.evaluate_layout("nano", tmp_path, pred=tmp_path, backgrounds=True)


def test_drawing_projects_as_networks_do(tests):
    from uniart_jax.nn.lifting import project as of_networks

    code = np.array([0.3, 0.9, 0.4, 1.6, 0.3, 0.1, -0.2])
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    places, _ = of_networks(code[None].astype(np.float32), points.astype(np.float32))
    np.testing.assert_allclose(project(code, points), places[0], atol=1e-5)
    layout = dataclasses.replace(Layout.of_object(tests[0].obj), camera=code)
    blank = np.zeros((64, 64, 3), np.uint8)
    without = draw_layout(blank, dataclasses.replace(layout, camera=None))
    drawn = np.asarray(draw_layout(blank, layout), int)
    assert np.abs(drawn - np.asarray(without, int)).max() > 90
    square = np.array([[-0.1, -0.1, 0.1, 0.1]])
    legs = Legs(square, square, np.array([[-0.5, -0.3]]), np.ones(1), np.zeros(1, bool), True)
    on_legs = np.asarray(draw_layout(blank, dataclasses.replace(layout, legs=legs)), int)
    assert 30 < (on_legs != drawn).any(-1).sum() < 3000
    panels = Panels(np.array([[-0.1, -0.1, -0.5, 0.1, 0.1, -0.3]]), 1.0)
    on_panels = draw_layout(blank, dataclasses.replace(layout, panels=panels))
    np.testing.assert_array_equal(np.asarray(on_panels, int), on_legs)  # the same box


def test_boards_of_an_open_door_are_drawn_where_it_is_shown():
    code = np.array([0.3, 0.9, 0.4, 1.6, 0.3, 0.1, -0.2])
    boxes = np.array([[0, 0, 0, 0.6, 0.6, 0.8], [-0.6, 0.3, 0, 0.6, 0.03, 0.8]])
    hinge = Joint(np.array([-0.3, 0.3, 0]), np.array([0.0, 0, 1]), angle=(0.0, np.pi / 2))
    layout = Layout(boxes, (Joint.fixed(), hinge), (-1, 0), np.full((2, 3), 0.5), np.ones(2), code)
    told = np.array([[-0.31, -0.3, -0.4, -0.28, 0.3, 0.4]])  # as it lies closed
    blank, side = np.zeros((64, 64, 3), np.uint8), 384
    plain = np.asarray(draw_layout(blank, layout), int)
    boarded = dataclasses.replace(layout, boards=(None, Panels(told, 1.0)))
    drawn = (np.asarray(draw_layout(blank, boarded), int) != plain).any(-1)
    assert drawn.any()
    turned = np.linalg.inv(hinge.motion(np.pi / 2))  # back to where it is shown
    corners = np.array(list(itertools.product(*told.reshape(2, 3).T)))
    shown = corners @ turned[:3, :3].T + turned[:3, 3]
    places = (project(code, shown) + 1) * side / 2
    rows, columns = np.nonzero(drawn)
    low, high = places.min(0) - 3, places.max(0) + 3
    assert (columns >= low[0]).all() and (columns <= high[0]).all()
    assert (rows >= low[1]).all() and (rows <= high[1]).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_outlines_are_drawn_as_circles_about_their_axes(axis):
    code, side = np.array([0.3, 0.9, 0.4, 1.6, 0.3, 0.1, -0.2]), 384
    box = np.array([[0.02, -0.03, 0.05, 0.5, 0.5, 0.5]])
    layout = Layout(box, (Joint.fixed(),), (-1,), np.full((1, 3), 0.5), np.ones(1), code)
    round_one = Revolution(axis, np.delete(box[0, :3], axis), np.array([0.1, 0.2]))
    blank = np.zeros((64, 64, 3), np.uint8)
    plain, circled = (
        np.asarray(draw_layout(blank, dataclasses.replace(layout, revolutions=own)), int)
        for own in ((), (round_one,))
    )
    drawn = (circled != plain).any(-1)
    turn, met = np.linspace(0, 2 * np.pi, 9), []
    for end, radius in ((-0.25, 0.1), (0.25, 0.2)):
        points = np.empty((len(turn), 3))
        points[:, np.delete(np.arange(3), axis)] = (
            round_one.center + radius * np.stack([np.cos(turn), np.sin(turn)], -1)
        )  # fmt: skip
        points[:, axis] = box[0, axis] + end
        for x, y in np.round((project(code, points) + 1) * side / 2).astype(int):
            met.append(drawn[y - 3 : y + 4, x - 3 : x + 4].any())
    assert np.mean(met) > 0.7  # boxes are drawn over some
    assert 300 < drawn.sum() < 12_000
