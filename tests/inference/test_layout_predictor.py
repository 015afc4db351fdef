"""Two looks at one picture, as it is and mirrored, become one answer."""

import numpy as np
import pytest

from uniart_jax.data.mirror import mirror_revolutions
from uniart_jax.inference.layouts import joined, last_legs, last_panels, mirror_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.joint_code import encode_joint, gauge_variants

RNG = np.random.default_rng(0)


def outputs(queries=5, legs=4, panels=6, boards=3):
    lower = RNG.uniform(-0.5, 0, (queries, 3))
    feet = RNG.uniform(-0.4, 0.3, (legs, 2))
    rectangle = np.concatenate([feet, feet + 0.1], 1)
    return {
        "corners": np.concatenate([lower, lower + RNG.uniform(0.1, 0.5, (queries, 3))], 1),
        "codes": np.zeros((queries, 9)),
        "exists": RNG.normal(size=queries),
        "colors": RNG.random((queries, 3)),
        "parents": RNG.normal(size=(queries, queries)),
        "camera": RNG.normal(size=7),
        "leg_rows": np.concatenate([rectangle, rectangle, np.tile([-0.5, -0.3], (legs, 1))], 1),
        "leg_exists": RNG.normal(size=legs),
        "leg_plinth": RNG.normal(size=legs),
        "leg_fill": RNG.random(legs),
        "leg_alone": np.float64(0.7),
        "panel_rows": np.sort(RNG.uniform(-0.5, 0.5, (panels, 2, 3)), 1).reshape(panels, 6),
        "panel_exists": RNG.normal(size=panels),
        "panel_share": np.float64(0.9),
        "board_rows": np.sort(RNG.uniform(-0.5, 0.5, (queries, boards, 2, 3)), 2).reshape(
            queries, boards, 6
        ),
        "board_exists": RNG.normal(size=(queries, boards)),
        "board_share": RNG.random(queries),
        "round_axis": RNG.normal(size=(queries, 4)),
        "round_centers": RNG.normal(size=(queries, 3, 2)),
        "round_radii": RNG.random((queries, 3, 8)),
    }


def turned(out, parts, legs, panels):
    """The same answer with its rows in another order."""
    rows = {name: value[legs] for name, value in out.items() if name.startswith("leg_r")}
    for name in ("leg_exists", "leg_plinth", "leg_fill"):
        rows[name] = out[name][legs]
    rounds = ("round_axis", "round_centers", "round_radii")
    for name in ("corners", "codes", "exists", "colors", "board_share", *rounds):
        rows[name] = out[name][parts]
    for name in ("board_rows", "board_exists"):
        rows[name] = out[name][parts][:, ::-1]
    for name in ("panel_rows", "panel_exists"):
        rows[name] = out[name][panels]
    return {**out, **rows, "parents": out["parents"][np.ix_(parts, parts)]}


def test_equal_answers_stay_whatever_their_order_is():
    one = outputs()
    both = joined(one, turned(one, [3, 1, 4, 0, 2], [2, 0, 3, 1], [5, 2, 0, 1, 4, 3]))
    assert both.keys() == one.keys() | {"differences", "certainty"}
    for name, value in one.items():
        np.testing.assert_allclose(both[name], value, atol=1e-6, err_msg=name)


@pytest.mark.parametrize(("sureness", "first"), [(1.0, True), (3.0, False)])
def test_joints_that_differ_are_not_averaged(sureness, first):
    """A hinge at the left in one look, at the right in the other: the surer one's, nothing between;
    small differences are averaged, in one gauge."""
    box = np.array([-0.4, -0.2, -0.1])
    hinges = [Joint([-0.4, y, 0], [0, 0, way], angle=(0, 1.5)) for y, way in ((-0.4, 1), (0, -1))]
    codes = [encode_joint(hinge, box) for hinge in hinges]
    one = outputs()
    one["codes"][:], one["exists"][:] = codes[0], 2.0
    other = {name: np.copy(value) for name, value in one.items()}
    other["codes"][0], other["exists"][:] = codes[1], sureness
    other["codes"][1] = gauge_variants(codes[0])[1] + 0.01
    both = joined(one, other)["codes"]
    off = np.abs(gauge_variants(both[0]) - codes[0 if first else 1]).max(-1).min()
    assert off < 1e-9
    between = np.abs(gauge_variants(both[1]) - codes[0]).max(-1).min()
    assert 0.001 < between < 0.0099


def test_legs_near_each_other_are_averaged_and_of_others_the_surer_stands():
    one = outputs()
    one["leg_exists"] = np.array([2.0, 2.0, 2.0, 2.0])
    other = {name: np.copy(value) for name, value in one.items()}
    other["leg_rows"][0] += 0.02
    other["leg_rows"][3] = one["leg_rows"][3] + np.array([1, 0, 1, 0, 1, 0, 1, 0, 0, 0])
    other["leg_exists"][3] = 4.0
    both = joined(one, other)
    np.testing.assert_allclose(both["leg_rows"][0], one["leg_rows"][0] + 0.01, atol=1e-6)
    np.testing.assert_allclose(both["leg_rows"][3], other["leg_rows"][3], atol=1e-6)
    np.testing.assert_allclose(both["leg_exists"], [2, 2, 2, 3])


def test_panels_near_each_other_are_averaged_and_of_others_the_surer_stands():
    one = outputs(panels=3)
    one["panel_exists"] = np.array([2.0, 2.0, 2.0])
    other = {name: np.copy(value) for name, value in one.items()}
    other["panel_rows"][0] += 0.02
    other["panel_rows"][2] += 2.0
    other["panel_exists"][2], other["panel_share"] = 4.0, 0.5
    both = joined(one, other)
    np.testing.assert_allclose(both["panel_rows"][0], one["panel_rows"][0] + 0.01, atol=1e-6)
    np.testing.assert_allclose(both["panel_rows"][2], other["panel_rows"][2], atol=1e-6)
    np.testing.assert_allclose(both["panel_exists"], [2, 2, 3])
    assert both["panel_share"] == 0.7


def test_boards_are_averaged_with_those_of_the_same_part():
    one = outputs()
    one["board_exists"][:] = 2.0
    other = turned(one, [3, 1, 4, 0, 2], range(4), range(6))
    other["board_rows"][0] += 0.02  # of part 3
    other["board_share"][0] += 0.2
    both = joined(one, other)
    off = both["board_rows"] - one["board_rows"]
    np.testing.assert_allclose(off[3], 0.01, atol=1e-6)
    np.testing.assert_allclose(off[[0, 1, 2, 4]], 0, atol=1e-6)
    share = both["board_share"] - one["board_share"]
    np.testing.assert_allclose(share, [0, 0, 0, 0.1, 0], atol=1e-6)


def test_boards_of_parts_that_are_not_one_are_those_of_the_surer():
    one = outputs()
    one["exists"][:], one["board_exists"][:] = 1.0, 1.0
    other = {name: np.copy(value) for name, value in one.items()}
    other["corners"][[1, 3]] += 0.6
    other["board_rows"] += 0.3
    other["board_exists"] += 2.0
    other["round_axis"] += 2.0
    other["round_radii"] += 0.1
    other["exists"][[1, 3]] = -1.0, 4.0
    both = joined(one, other)
    for part, stands in ((1, one), (3, other)):
        for name in ("board_rows", "board_exists", "board_share", "round_axis", "round_radii"):
            np.testing.assert_allclose(both[name][part], stands[name][part], err_msg=name)


def test_revolutions_are_averaged_with_those_of_the_same_part():
    one = outputs()
    one["exists"][:] = 1.0
    other = turned(one, [3, 1, 4, 0, 2], range(4), range(6))
    for name in ("round_axis", "round_centers", "round_radii"):
        other[name] = np.copy(other[name])
        other[name][0] += 0.02  # of part 3
        off = joined(one, other)[name] - one[name]
        np.testing.assert_allclose(off[3], 0.01, atol=1e-6)
        np.testing.assert_allclose(off[[0, 1, 2, 4]], 0, atol=1e-6)


def test_mirror_images_of_revolutions_are_those_of_their_labels():
    """As ``mirror_revolutions`` has them, whatever the axis is."""
    one = outputs()
    mirrored = mirror_parts(one)
    for axis in range(3):
        centers, radii = (
            [out[f"round_{name}"][:, axis] for out in (one, mirrored)]
            for name in ("centers", "radii")
        )
        rows, wanted = (
            np.concatenate([np.full((5, 1), 1 + axis), centers[k], radii[k]], 1) for k in (0, 1)
        )
        np.testing.assert_allclose(mirror_revolutions(rows), wanted)


def test_mirrored_twice_is_as_before():
    one = outputs()
    mirrored = mirror_parts(one)
    np.testing.assert_allclose(mirrored["leg_rows"][:, [1, 3]], -one["leg_rows"][:, [3, 1]])
    np.testing.assert_allclose(mirrored["panel_rows"][:, [1, 4]], -one["panel_rows"][:, [4, 1]])
    np.testing.assert_allclose(mirrored["board_rows"][..., [1, 4]], -one["board_rows"][..., [4, 1]])
    again = mirror_parts(mirrored)
    rounds = ("round_centers", "round_radii")
    for name in ("corners", "leg_rows", "panel_rows", "board_rows", "camera", *rounds):
        np.testing.assert_allclose(again[name], one[name], atol=1e-12)


@pytest.mark.parametrize("prefix", ["leg_", "panel_", "board_", "round_"])
def test_without_a_set_there_is_none(prefix):
    bare = {name: value for name, value in outputs().items() if not name.startswith(prefix)}
    assert not any(name.startswith(prefix) for name in joined(bare, mirror_parts(bare)))


def test_of_runs_the_last_counts():
    runs = {name: [np.zeros(1), np.ones(1)] for name in ("rows", "exists", "plinth", "fill")}
    assert last_legs({**runs, "alone": np.full(1, 3.0)})["leg_rows"] == 1
    assert last_panels({**runs, "share": np.full(1, 0.7)})["panel_rows"] == 1
    assert last_panels({**runs, "share": np.full(1, 0.7)}, "board")["board_rows"] == 1
