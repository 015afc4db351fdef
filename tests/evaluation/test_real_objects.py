"""Folders of assets as test objects for layouts."""

import dataclasses
import json

import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.evaluation import layout as judging
from uniart_jax.evaluation.real import real_objects
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.layout import Layout

pytestmark = pytest.mark.usefixtures("small_pictures")
PLAIN = {"formats": (), "collision": "hull", "motion": False}  # only the URDF is read


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    for category, family in (("Oven", "oven"), ("Table", "table")):
        procedural.generate(family, 7).save(folder / category / "1", **PLAIN)
    still = procedural.generate("oven", 8)
    flat = procedural.generate("table", 9)
    sheet = flat.parts[1].mesh.copy()
    sheet.vertices[:, 0] = sheet.vertices[:, 0].min()  # as real drawers are that are mere fronts
    parts = (flat.parts[0], dataclasses.replace(flat.parts[1], mesh=sheet), *flat.parts[2:])
    dataclasses.replace(flat, parts=parts).save(folder / "Table" / "2", **PLAIN)
    fixed = [dataclasses.replace(p, joint=Joint.fixed()) for p in still.parts]
    dataclasses.replace(still, parts=tuple(fixed)).save(folder / "Oven" / "2", **PLAIN)
    (folder / "Table" / "3").mkdir()
    (folder / "Table" / "3" / "object.urdf").write_text("<robot")
    return folder


def test_truth_pictures_and_refusals(root, tmp_path):
    tests, refused = real_objects(root, tmp_path / "kept", image_size=64)
    names = [("Oven/1", "Oven"), ("Table/1", "Table"), ("Table/2", "Table")]
    assert [(t.name, t.family) for t in tests] == names
    assert list(refused) == ["Oven/2", "Table/3"] and "nothing" in refused["Oven/2"]
    for test in tests:
        assert test.image.shape == (64, 64, 4) and 0.02 < (test.image[..., 3] > 0).mean() < 0.9
        assert np.ptp(test.obj.bounds, axis=0).max() == pytest.approx(1, abs=1e-4)
    again, _ = real_objects(root, tmp_path / "kept", image_size=64)
    for one, other in zip(again, tests, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
        np.testing.assert_allclose(one.obj.boxes, other.obj.boxes, atol=1e-5)
    other, _ = real_objects(root, tmp_path / "new", image_size=64, count=1)
    np.testing.assert_array_equal(other[0].image, tests[0].image)  # a function of the path alone


def test_command_judges_a_folder(root, tmp_path):
    tests, _ = real_objects(root, tmp_path / "kept")
    pred = tmp_path / "pred"
    pred.mkdir()
    for index, test in enumerate(tests):
        (pred / f"{index}.json").write_text(Layout.of_object(test.obj).to_json())
    found = judging.evaluate_layout(
        "nano", tmp_path / "out", root=root, pred=pred, cache=tmp_path / "kept"
    )
    assert found["all"]["parts_right"] == found["all"]["count"] == 1.0
    assert set(found["families"]) == {"Oven", "Table"}
    kept = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert kept["settings"]["count"] == 3 and "Table/3" in kept["settings"]["refused"]
    with pytest.raises(FileNotFoundError, match="no such folder"):
        judging.evaluate_layout("nano", tmp_path / "more", root=tmp_path / "absent", pred=pred)
