"""How sure a layout is follows from how far two looks differ, and the tool fits that."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from uniart_jax.inference.certainty import FAR, LEAST, certainty, differences
from uniart_jax.inference.layouts import joined

ROOT = Path(__file__).resolve().parents[2]
ROWS = np.arange(4)


def look():
    rng = np.random.default_rng(0)
    lower = rng.uniform(-0.5, 0, (4, 3))
    return {
        "corners": np.concatenate([lower, lower + rng.uniform(0.2, 0.5, (4, 3))], 1),
        "codes": np.zeros((4, 9)),
        "exists": np.array([6.0, 5.0, 4.0, -9.0]),
        "colors": rng.random((4, 3)),
        "parents": rng.normal(size=(4, 4)),
        "camera": rng.normal(size=7),
    }


def changed(**more):
    return {name: value + more.get(name, 0) for name, value in look().items()}


def test_equal_looks_do_not_differ_whatever_the_order_of_their_rows():
    order = np.array([2, 0, 3, 1])
    other = {**look(), "corners": look()["corners"][order], "exists": look()["exists"][order]}
    np.testing.assert_allclose(differences(look(), other, ROWS, np.argsort(order)), 0, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "field"), [({"corners": 0.02}, 0), ({"exists": -4.0}, 1), ({"camera": 0.1}, 2)]
)
def test_what_differs_is_told_and_lowers_the_certainty(change, field):
    same, apart = (differences(look(), changed(**c), ROWS, ROWS) for c in ({}, change))
    assert apart[field] > 0 and (np.delete(apart, field) == np.delete(same, field)).all()
    assert 0 < certainty(apart) < certainty(same) < 1
    np.testing.assert_allclose(differences(changed(**change), look(), ROWS, ROWS), apart)


def test_sizes_are_in_object_units_and_bounded():
    shifted = differences(look(), changed(corners=0.02), ROWS, ROWS)
    assert shifted[0] == pytest.approx(0.02, rel=1e-4)
    assert differences(look(), changed(corners=9.0), ROWS, ROWS)[0] == pytest.approx(FAR, rel=1e-4)
    assert differences(look(), changed(camera=0.1), ROWS, ROWS)[2] == pytest.approx(0.7)


def test_rows_that_do_not_exist_hardly_count():
    other = look()
    other["corners"][3] += 0.2  # the probability of this row is .0001
    assert differences(look(), other, ROWS, ROWS)[0] < 1e-4


def test_the_answer_of_two_looks_holds_it():
    both = joined(look(), changed(corners=0.01))
    np.testing.assert_allclose(both["differences"][0], 0.01, rtol=1e-3)
    assert both["certainty"] == certainty(both["differences"])


def test_the_tool_finds_the_numbers_that_made_the_rows_and_sorts_by_them():
    tool = runpy.run_path(str(ROOT / "tools/fit_certainty.py"), run_name="tool")
    rng = np.random.default_rng(0)
    differ = np.exp(rng.normal(-3, 1, (4000, 3)))
    slopes = np.array([-0.9, -0.1, -0.5])
    told = 1 / (1 + np.exp(4.0 - np.log(differ + LEAST) @ slopes))
    moving = rng.integers(0, 6, 4000)
    rows = tool["Rows"](differ, moving, rng.binomial(moving, told))
    intercept, found = tool["fit"](rows)
    assert intercept == pytest.approx(-4.0, abs=0.3)
    np.testing.assert_allclose(found, slopes, atol=0.1)
    table = tool["quarters"](rows, told)
    np.testing.assert_allclose(table["right"], table["certainty"], atol=0.05)
    assert sorted(table["right"], reverse=True) == table["right"]
