"""Real assets through voxels: figures by category, and what does not come through."""

from __future__ import annotations

import json

import pytest

from uniart_jax import procedural
from uniart_jax.evaluation.assets import evaluate_assets

pytestmark = pytest.mark.usefixtures("small_pictures")


def test_round_trip_of_a_folder(tmp_path, capsys):
    for family, seed in (("microwave", 3), ("table", 4)):
        procedural.generate(family, seed).save(
            tmp_path / "in" / family / "0", formats=(), collision="hull", motion=False
        )
    (tmp_path / "in" / "broken.urdf").write_text("<robot/>")
    made = evaluate_assets(tmp_path / "in", tmp_path / "out", resolutions=(8, 16))
    assert set(made["objects"]) == {"microwave/0", "table/0"} and set(made["errors"]) == {
        "broken.urdf"
    }
    rows = made["rows"]
    assert [name.split(",")[0] for name in rows][-1] == "all"
    for category in ("microwave", "table", "all"):
        coarse, fine = rows[f"{category}, 8"], rows[f"{category}, 16"]
        assert fine["chamfer"] < coarse["chamfer"] < 0.05
        assert fine["parts_right"] == 1 and fine["opens_wrong_way"] == 0
        assert fine["axis_median"] < 0.1
    assert rows["all, 16"]["chamfer"] == pytest.approx(
        (rows["microwave, 16"]["chamfer"] + rows["table, 16"]["chamfer"]) / 2
    )
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["rows"].keys() == rows.keys()
    assert (tmp_path / "out" / "table.md").read_text().count("\n") == 8
    captured = capsys.readouterr()
    assert "| table, 16 | 1 |" in captured.out and "1 of 3 assets" in captured.err
    with pytest.raises(ValueError, match="no asset came through"):
        (tmp_path / "bad").mkdir()
        (tmp_path / "bad" / "a.urdf").write_text("<robot/>")
        evaluate_assets(tmp_path / "bad", tmp_path / "out2")
    assert not (tmp_path / "out2").exists()
