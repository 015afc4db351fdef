"""``uniart prepare``: which options go with which source."""

from inspect import signature

import pytest

from uniart_jax.cli.data import OPTIONS, SHARED, prepare


def test_every_option_goes_with_a_source():
    named = set(SHARED).union(*OPTIONS.values())
    assert named == set(signature(prepare).parameters)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("layouts", "--views", "3"), "layouts: it takes no --views, which goes with procedural, "),
        (("procedural", "--split", "holdout"), "which goes with partnet-mobility, urdf"),
        (("urdf", "x", "--start-seed", "1"), "takes no --start-seed, which goes with procedural"),
        (("procedural", "x"), "procedural: it takes no ROOT"),
        (("urdf",), "uniart prepare urdf ROOT --out OUT"),
        (("layouts", "--first-block", "-1"), "--first-block must be at least 0"),
        (("procedural", "--count", "0"), "--count must be at least 1"),
        (("procedural", "--world", "wide", "--families", "oven"), "instead of --families"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(run, tmp_path, arguments, said):
    code, out, err = run("prepare", *arguments, "--out", tmp_path / "out")
    assert code == 2 and said in err and err.count("\n") == 1 and not out
    assert not (tmp_path / "out").exists()
