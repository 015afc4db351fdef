"""``uniart evaluate PRED REF`` from folders to files: every object counts, what was done stays
done, two runs are equal."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
import toy_assets
import trimesh

from uniart_jax.evaluation import compare as frame
from uniart_jax.evaluation import comparison
from uniart_jax.evaluation.compare import compare
from uniart_jax.evaluation.runner import Passing
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part

FAMILIES = {"pose_error": "tiny_figures"}
write_report = frame.write_report


@pytest.fixture(autouse=True)
def report(monkeypatch):
    """Pictures take seconds, so they are left out; ``report.write_report`` has tests of its own."""
    asked = []
    monkeypatch.setattr(frame, "write_report", lambda *given: asked.append(given))
    return asked


@pytest.fixture
def folders(tmp_path):
    """Five references; a right prediction, a wrong one with two samples, one that cannot be read,
    none, and one without colours."""
    pred, ref = tmp_path / "pred", tmp_path / "ref"
    for name in ("right", "two samples", "bad", "missing", "gray"):
        toy_assets.write(ref / name, "body", "lid")
    (ref / "sets.json").write_text('{"right": "closed", "bad": "closed", "gray": "open"}')
    toy_assets.write(pred / "right", "body", "lid")
    toy_assets.write(pred / "two samples" / "sample-0", "body", "lid", "knob")
    toy_assets.write(pred / "two samples" / "sample-1", "body", "lid", height=0.25)
    toy_assets.write(pred / "bad", "body").joinpath("object.urdf").write_text("<robot")
    toy_assets.write(pred / "gray", "gray", "lid")
    return pred, ref, tmp_path / "out"


def run(folders, **options):
    pred, ref, out = folders
    return compare({"ours": pred}, ref, out, families=FAMILIES, **options)


def files(out):
    return {
        p.relative_to(out): p.read_bytes()
        for p in out.rglob("*")
        if p.is_file() and "results" not in p.parts
    }


def test_a_folder_with_everything_that_goes_wrong(folders):
    content = run(folders)
    ours = content["methods"]["ours"]
    objects = ours["objects"]
    assert list(objects) == sorted(["right", "two samples", "bad", "missing", "gray"])
    assert objects["right"] == pytest.approx(
        {
            "pose_error": 0,
            "overlap": 1,
            "hinges": 0,
            "sound": np.nan,
            "joints_work": np.nan,
            "failed": 0,
        },
        nan_ok=True,
    )
    assert objects["two samples"]["pose_error"] == pytest.approx(0.05)  # 0.1 and 0
    assert objects["two samples"]["overlap"] == pytest.approx(0.75)  # 1 and .5
    for name in ("bad", "missing"):
        assert (objects[name]["pose_error"], objects[name]["overlap"]) == (1.0, 0.0)
    assert set(ours["failures"]) == {"bad", "missing"}
    assert "object.urdf" in ours["failures"]["bad"]
    assert ours["failures"]["missing"] == "there is no prediction of this name"
    assert ours["rows"]["failed"]["mean"] == pytest.approx(2 / 5)
    assert ours["rows"]["pose_error"]["mean"] == pytest.approx((0 + 0.05 + 1 + 1 + 0) / 5)
    assert ours["rows"]["pose_error"]["count"] == 5
    assert (
        ours["rows"]["sound"]["count"] == 0
    )  # nobody validated anything: not computed, not failed
    assert ours["uncolored"] == ["gray"]
    assert ours["sets"]["closed"]["pose_error"]["mean"] == pytest.approx(0.5)
    assert ours["sets"]["open"]["pose_error"]["count"] == 1
    # right 2, two samples (3 + 2) / 2, gray 2; of the others the reference's parts are missing: a
    # root and a lid each
    assert ours["confusion"]["revolute"] == {"fixed": 6.5, "missing": 2}
    kept = json.loads((folders[2] / "metrics.json").read_text())
    assert kept["methods"]["ours"]["objects"]["right"]["sound"] is None
    assert kept["methods"]["ours"]["rows"]["overlap"] == ours["rows"]["overlap"]
    assert kept["metrics"]["overlap"]["better"] == "higher"
    table = (folders[2] / "table.md").read_text()
    assert "| ours: closed | 2 |" in table and "- missing: there is no prediction" in table
    assert "1 of 5 objects have no colours" in table and "mean colour of the true part" in table


def test_the_report_draws_what_was_measured(folders, report):
    content = run(folders)
    (out, given, load_pair), *_ = report
    assert given is content
    pred, ref = load_pair("ours", "two samples")
    assert len(pred.parts) == 3 and len(ref.parts) == 2
    assert np.ptp(pred.bounds, axis=0).max() == pytest.approx(1)
    for name in ("bad", "missing"):
        with pytest.raises(ValueError, match=r"no prediction of this name|object\.urdf"):
            load_pair("ours", name)
    assert content["methods"]["ours"]["drawn"] == {
        "two samples": "sample-0"
    }  # the worse of the two
    best = run(folders, samples="best")
    assert best["methods"]["ours"]["drawn"] == {"two samples": "sample-1"}
    assert len(report[-1][2]("ours", "two samples")[0].parts) == 2
    content["methods"]["ours"]["objects"] = {
        "right": content["methods"]["ours"]["objects"]["right"]
    }
    write_report(out, content, load_pair)
    page = (out / "report.html").read_text()
    assert "data:image" in page and "two samples" not in page.split("Failures")[0]


def test_which_samples_count(folders):
    assert (
        run(folders, samples="first")["methods"]["ours"]["objects"]["two samples"]["overlap"] == 1
    )
    best = run(folders, samples="best")["methods"]["ours"]["objects"]["two samples"]
    assert best["pose_error"] == 0 and best["overlap"] == 0.5  # one sample for all figures
    with pytest.raises(ValueError, match="add pose_error"):
        compare({"ours": folders[0]}, folders[1], folders[2], only=["physics"], samples="best")


def test_it_goes_on_where_it_was_stopped_and_computes_anew_what_changed(folders):
    out = folders[2]
    before = run(folders)
    results = {p: p.stat().st_mtime_ns for p in (out / "results").rglob("*.json")}
    assert len(results) == 6  # five objects, one of them twice
    written = files(out)
    known = out / "results" / "ours" / "right" / "0.json"
    marked = json.loads(known.read_text())
    marked["figures"]["overlap"] = 0.125
    known.write_text(json.dumps(marked))
    again = run(folders)["methods"]["ours"]["objects"]
    assert again["right"]["overlap"] == 0.125  # taken, not done anew
    assert all(p.stat().st_mtime_ns == t for p, t in results.items() if p != known)
    known.write_text(known.read_text()[:50])  # cut off
    toy_assets.write(folders[0] / "missing", "body", "lid", "knob")
    again = run(folders)["methods"]["ours"]
    assert again["objects"]["right"]["overlap"] == 1.0 and set(again["failures"]) == {"bad"}
    (folders[0] / "missing" / "object.urdf").unlink()
    np.testing.assert_equal(
        run(folders)["methods"]["ours"]["rows"], before["methods"]["ours"]["rows"]
    )
    (folders[0] / "missing").rmdir()
    run(folders)
    assert files(out) == written


def test_results_of_something_else_are_refused(folders):
    run(folders)
    with pytest.raises(
        ValueError, match="other predictions, references or figures; choose another"
    ):
        compare(
            {"ours": folders[0] / "two samples"},
            folders[1] / "right",
            folders[2],
            families=FAMILIES,
        )
    with pytest.raises(ValueError, match="choose another --out"):
        run(folders, only=["pose_error"])


def test_two_runs_are_equal(folders, tmp_path):
    run(folders)
    compare({"ours": folders[0]}, folders[1], tmp_path / "other", families=FAMILIES)
    assert files(folders[2]) == files(tmp_path / "other")


@pytest.mark.slow
def test_workers_find_the_same_and_one_that_dies_is_a_failure(folders, tmp_path):
    alone = run(folders)["methods"]["ours"]["objects"]
    toy_assets.write(folders[0] / "two samples" / "sample-1", "body", "die")
    pred, ref, _ = folders
    content = compare({"ours": pred}, ref, tmp_path / "other", families=FAMILIES, processes=2)
    ours = content["methods"]["ours"]
    assert "1 of 2 samples: its worker process died" in ours["failures"]["two samples"]
    assert ours["objects"]["two samples"]["overlap"] == 0.5  # 1 and 0
    assert ours["objects"]["two samples"]["hinges"] == 5  # 1 and 9: its truth has a hinge
    for name in set(alone) - {"two samples"}:
        assert ours["objects"][name] == pytest.approx(alone[name], nan_ok=True)


@pytest.mark.parametrize(
    ("part", "said"),
    [("crash", "RuntimeError: the figure fell over"), ("endless", "'overlap' is infinite")],
)
def test_a_figure_that_falls_over(folders, part, said):
    toy_assets.write(folders[0] / "right", "body", part)
    ours = run(folders)["methods"]["ours"]
    assert said in ours["failures"]["right"] and ours["objects"]["right"]["overlap"] == 0


def one_comparison(folders, setup, name="right"):
    pred, ref, out = folders
    reference = comparison.Reference(name, ref / name, "")
    one = comparison.Comparison("ours", 0, pred / name, reference, "", out / "0.json")
    return comparison.compare_one(setup, one)


@pytest.mark.parametrize(
    ("part", "said"), [("slow", "longer than 0.2 seconds"), ("greedy", "MemoryError")]
)
def test_a_failure_that_may_not_come_again_is_not_kept(folders, part, said):
    toy_assets.write(folders[0] / "right", "body", part)
    found = one_comparison(folders, comparison.Setup(FAMILIES, {}, limit=0.2))
    assert isinstance(found, Passing)
    assert said in found.result["failure"] and not found.result["figures"]
    toy_assets.write(folders[0] / "right", "body", "lid")
    found = one_comparison(folders, comparison.Setup(FAMILIES, {}))
    assert not isinstance(found, Passing) and not found["failure"]


def test_what_no_prediction_could_have_is_not_held_against_a_failed_one(folders):
    for name in ("bad", "missing", "right"):
        toy_assets.write(folders[1] / name, "body")  # no joint in the reference
    toy_assets.write(folders[0] / "right", "body", "crash")
    ours = run(folders)["methods"]["ours"]
    for name in ("bad", "missing", "right"):
        assert np.isnan(ours["objects"][name]["hinges"]) and ours["objects"][name]["overlap"] == 0
    assert ours["rows"]["hinges"]["count"] == 2
    assert "(n = 2)" in (folders[2] / "table.md").read_text()


def test_results_may_lie_below_what_is_compared_but_not_in_an_asset(folders):
    pred, ref, _ = folders
    for out in (ref / "right", pred / "two samples" / "sample-1"):
        with pytest.raises(ValueError, match="it holds an asset that is compared; choose another"):
            compare({"ours": pred}, ref, out, families=FAMILIES)
        assert not (out / "settings.json").exists()
    for out in (pred / "out", ref / "right" / "out"):
        run((pred, ref, out))
        made = {p: p.stat().st_mtime_ns for p in (out / "results").rglob("*.json")}
        run((pred, ref, out))
        assert {p: p.stat().st_mtime_ns for p in (out / "results").rglob("*.json")} == made


def test_reading_has_a_limit_that_no_reader_swallows(folders, monkeypatch):
    def read(path, **options):
        try:
            time.sleep(20)
        except Exception as error:  # as readers of meshes do
            raise ValueError("a broken file") from error

    monkeypatch.setattr(comparison, "load_object", read)
    pred, ref, out = folders
    truth = comparison.Reference("right", load_object(ref / "right"), "")
    setup = comparison.Setup(FAMILIES, {}, limit=0.1)
    one = comparison.Comparison("ours", 0, pred / "right", truth, "", out / "0.json")
    found = comparison.compare_one(setup, one)
    assert isinstance(found, Passing)
    assert found.result["failure"] == "it took longer than 0.1 seconds"


def test_an_object_without_extent_is_a_failure(folders, tmp_path):
    obj = load_object(folders[1] / "right")
    dot = trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False)
    point = ArticulatedObject((Part("dot", dot),))
    ours = compare({"ours": {"a": point}}, {"a": obj}, tmp_path / "out", families=FAMILIES)[
        "methods"
    ]["ours"]
    assert "no extent" in ours["failures"]["a"] and ours["objects"]["a"]["overlap"] == 0


def test_the_report_does_not_try_again_what_could_not_be_read(folders, report, monkeypatch):
    run(folders)
    monkeypatch.setattr(comparison, "load_object", lambda *_, **__: pytest.fail("read again"))
    with pytest.raises(ValueError, match=r"object\.urdf"):
        report[0][2]("ours", "bad")


def test_a_bad_reference_is_an_error_that_names_it(folders):
    toy_assets.write(folders[1] / "gray", "body").joinpath("object.urdf").write_text("<robot")
    with pytest.raises(ValueError, match=r"reference 'gray' cannot be used: .*object\.urdf"):
        run(folders)
    assert not (folders[2] / "metrics.json").exists()


def test_several_methods_of_objects_in_memory(folders, tmp_path):
    obj = load_object(folders[1] / "right")
    flat = obj.transformed(np.diag([1, 1, 0.5, 1.0]) @ np.eye(4))
    broken = load_object(folders[1] / "right")
    broken.parts[1].mesh.vertices[0] = np.nan
    content = compare(
        {"exact": {"a": obj, "b": obj}, "flat": {"a": [flat, obj]}, "broken": {"b": broken}},
        {"a": obj, "b": obj},
        tmp_path / "memory",
        families=FAMILIES,
    )
    figures = {name: m["objects"] for name, m in content["methods"].items()}
    assert figures["exact"]["b"]["overlap"] == 1 and figures["flat"]["a"]["overlap"] == 0.75
    assert figures["flat"]["b"]["overlap"] == 0
    assert "not finite" in content["methods"]["broken"]["failures"]["b"]
    assert content["methods"]["exact"]["categories"] == {}


def test_validation_that_assets_bring(folders):
    pred = folders[0]
    joint = {"reached": 0.9, "collision": 0.0}
    said = {
        "engines": {"mujoco": {"loads": {"passed": True}}},
        "geometry": {"watertight": {"passed": False}},
        "joints": {"mujoco": {"a": joint, "b": joint | {"reached": 0.5}, "c": joint | {"collision": None}}},  # noqa: E501
    }  # fmt: skip
    (pred / "right" / "validation.json").write_text(json.dumps(said))
    report = {"validation": {"mujoco": {"loads": {"passed": True}}, "geometry": {}}}
    (pred / "gray" / "report.json").write_text(json.dumps(report))
    (pred / "two samples" / "sample-0" / "validation.json").write_text(
        '{"engines": [3], "joints": 7'
    )
    ours = run(folders)["methods"]["ours"]
    assert ours["objects"]["right"]["sound"] == 0
    assert ours["objects"]["right"]["joints_work"] == pytest.approx(1 / 3)
    assert ours["objects"]["gray"]["sound"] == 1
    for name in ("two samples", "bad"):  # to validate only what is sound does not pay
        assert ours["objects"][name]["sound"] == 0
    assert ours["objects"]["gray"]["joints_work"] == 0
    assert ours["rows"]["sound"]["mean"] == pytest.approx((0 + 1 + 0 + 0 + 0) / 5)
    assert ours["rows"]["joints_work"]["count"] == 5


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"only": ["looks"]}, "no figures are called 'looks'"),
        ({"only": []}, "no figures were chosen"),
        ({"families": {"absent": "uniart_jax.evaluation.absent"}}, "cannot be loaded"),
        ({"families": {"a": "tiny_figures", "b": "tiny_figures"}}, "two families have a figure"),
        ({"only": ["openshape"], "families": {"openshape": "tiny_figures"}}, "need weights"),
    ],
)
def test_figures_that_cannot_be_had(folders, options, said):
    pred, ref, out = folders
    with pytest.raises(ValueError, match=said):
        compare({"ours": pred}, ref, out, **{"families": FAMILIES, **options})
    assert not out.exists()
