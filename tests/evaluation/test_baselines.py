"""All methods on one split: what each is made of, failures, and going on where it was stopped."""

import dataclasses
import functools
import pickle
import types
from pathlib import Path

import numpy as np
import pytest
import toy_assets

from uniart_jax import procedural
from uniart_jax.cli.evaluation import evaluate
from uniart_jax.evaluation import baselines
from uniart_jax.evaluation.baselines import baseline_methods, evaluate_baselines
from uniart_jax.evaluation.compare import compare
from uniart_jax.evaluation.library import Asset, find_assets
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.procedural import HeldOut, held_out
from uniart_jax.evaluation.retrieval import training_objects
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject

pytestmark = pytest.mark.usefixtures("small_pictures")
COUNT = 3
NAMES = ["0000-storage_furniture", "0001-table", "0002-refrigerator"]
METHODS = ["model", "retrieval_true_boxes", "retrieval_predicted_boxes", "rest_only", "mirrored"]


@functools.cache
def drawn(index: int) -> HeldOut:
    """A test object, of few voxels: nobody looks at them."""
    return held_out(index, resolution=16, subdivisions=2)


class Networks:
    """Stands for a checkpoint: of image ``seed`` it makes a microwave; in those of ``empty`` it
    finds nothing."""

    def __init__(self, *empty: int):
        grid = types.SimpleNamespace(resolution=16, subdivisions=2)
        encoder = types.SimpleNamespace(image_size=32)
        model = types.SimpleNamespace(grid=grid, image_encoder=encoder)
        self.config = types.SimpleNamespace(model=model)
        self.empty, self.asked = empty, []

    def __call__(self, image, *, seed, name):
        self.asked.append(seed)
        assert np.array_equal(image, drawn(seed).image)
        if seed in self.empty:
            raise ValueError(f"{name}: the model found no object in the image")
        obj = procedural.generate("microwave", seed)
        bare = tuple(dataclasses.replace(p, label="") for p in obj.parts)
        return dataclasses.replace(obj, parts=bare, name=name)

    def prepare(self, image):
        return image[..., :3]


class ToyCheckpoint:
    """Stands for ``models.checkpoint.Checkpoint`` where there is no folder."""

    @classmethod
    def find(cls, given):
        return cls()

    def digest(self):
        return "toy"


@pytest.fixture(scope="module")
def patch():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baselines, "training_objects", lambda: training_objects(21))
        yield patch


@pytest.fixture(scope="module")
def networks(patch, tmp_path_factory) -> Networks:
    networks = Networks(1)
    patch.setattr(baselines, "load", lambda checkpoint: networks)
    patch.setattr(baselines, "Checkpoint", ToyCheckpoint)
    return networks


@pytest.fixture(scope="module")
def folder(networks, tmp_path_factory) -> Path:
    """Stopped after one object, then three."""
    folder = tmp_path_factory.mktemp("baselines")
    baseline_methods("toy", folder, count=1)
    baseline_methods("toy", folder, count=COUNT)
    return folder


def test_what_every_method_is_made_of(networks, folder, monkeypatch):
    methods, references = baseline_methods("toy", folder, count=COUNT)
    assert networks.asked == [0, 1, 2]  # each once, the failure too
    assert list(references) == NAMES
    assert list(methods) == METHODS
    assert list(methods["model"]) == [NAMES[0], NAMES[2]]
    assert "found no object" in (folder / "objects" / "model" / f"{NAMES[1]}.json").read_text()
    for k, name in enumerate(NAMES):
        assert np.allclose(references[name].boxes, at_rest(drawn(k).obj).boxes)
        assert references[name].category == procedural.SEEN_FAMILIES[k]
        truth = at_rest(references[name])
        retrieved = methods["retrieval_true_boxes"][name]
        assert np.allclose(retrieved.boxes, truth.boxes, atol=1e-6)
        assert np.allclose(retrieved.open(), truth.open())
        assert not same_meshes(retrieved, truth)
        for control in ("rest_only", "mirrored"):
            assert same_meshes(methods[control][name], truth)
    assert list(methods["retrieval_predicted_boxes"]) == list(methods["model"])
    for name, path in methods["model"].items():
        made, retrieved = at_rest(load_object(path)), methods["retrieval_predicted_boxes"][name]
        assert np.allclose(retrieved.boxes, made.boxes, atol=1e-6)
        assert [p.parent for p in retrieved.parts] == [p.parent for p in made.parts]
    with pytest.raises(
        ValueError, match="another checkpoint, split, records, library or size of pictures; choose"
    ):
        baseline_methods("toy", folder, count=COUNT, unseen=True)
    with monkeypatch.context() as patched, pytest.raises(ValueError, match="size of pictures"):
        patched.setattr(baselines, "PICTURE_SIDE", 128)
        baseline_methods("toy", folder, count=COUNT)


def same_meshes(a: ArticulatedObject, b: ArticulatedObject) -> bool:
    pairs = zip(a.parts, b.parts, strict=True)
    return all(
        p.mesh.vertices.shape == q.mesh.vertices.shape
        and np.allclose(p.mesh.vertices, q.mesh.vertices)
        for p, q in pairs
    )


@pytest.mark.slow
def test_all_methods_are_measured(networks, folder, monkeypatch):
    quick = functools.partial(compare, only=("articulation", "pose_error"))
    monkeypatch.setattr(baselines, "compare", quick)
    found = evaluate_baselines("toy", folder, count=2)
    rows = {method: content["rows"] for method, content in found["methods"].items()}
    assert list(rows) == METHODS
    for method, failed in zip(METHODS, (0.5, 0, 0.5, 0, 0), strict=True):
        assert np.isclose(rows[method]["failed"]["mean"], failed)
    pose = {method: row["pose_error"]["mean"] for method, row in rows.items()}
    rest = {method: row["pose_rest"]["mean"] for method, row in rows.items()}
    for control in ("rest_only", "mirrored"):
        assert rest[control] < 1e-6 and pose[control] > 0.02
    assert pose["mirrored"] > pose["rest_only"]
    assert rows["mirrored"]["wrong_way"]["mean"] == 1.0
    assert rows["retrieval_true_boxes"]["part_recall"]["mean"] == 1.0
    # other shapes, the right motion
    assert 0.001 < rest["retrieval_true_boxes"] <= pose["retrieval_true_boxes"] < pose["mirrored"]
    assert (folder / "table.md").is_file()


@pytest.mark.slow
def test_the_nearest_image_is_asked_where_there_are_records(patch, tmp_path, monkeypatch):
    asked = []

    def make(pipeline, records):
        def retrieve(pixels):
            asked.append(pixels.shape)
            return procedural.generate("laptop", 5)

        return retrieve

    monkeypatch.setattr(baselines, "load", lambda checkpoint: Networks(0))
    monkeypatch.setattr(baselines, "Checkpoint", ToyCheckpoint)
    monkeypatch.setattr(baselines, "make_retrieval", make)
    records = Path("records")
    methods, references = baseline_methods("toy", tmp_path, count=1, records=records)
    assert asked == [(256, 256, 3)] and list(methods["nearest_image"]) == list(references)
    found = load_object(methods["nearest_image"][NAMES[0]])
    assert len(found.parts) == len(procedural.generate("laptop", 5).parts)
    monkeypatch.setattr(baselines, "make_retrieval", None)  # no index where nothing is missing
    again, _ = baseline_methods("toy", tmp_path, count=1, records=records)
    assert list(again) == ["model", "nearest_image", *METHODS[1:]] and not again["model"]


@pytest.mark.slow
def test_a_library_of_assets_takes_the_place_of_procedural_parts(patch, tmp_path, monkeypatch):
    """The nearest asset is copied as it lies, and both retrievals of parts take the library's."""
    for name, height in (("low", 0.2), ("tall", 2.0)):
        toy_assets.write(tmp_path / "assets" / name, "body", "lid", height=height)
    (tmp_path / "assets" / "broken.urdf").write_text("<robot")
    library, asked = find_assets(tmp_path / "assets"), []

    def make(pipeline, assets, cache, processes):
        assert list(assets) == library and cache == tmp_path / "out" / "library"
        return lambda pixels: asked.append(pixels.shape) or library[2]

    monkeypatch.setattr(baselines, "load", lambda checkpoint: Networks(1))
    monkeypatch.setattr(baselines, "Checkpoint", ToyCheckpoint)
    monkeypatch.setattr(baselines, "make_asset_retrieval", make)
    monkeypatch.setattr(baselines, "make_library", None)  # no procedural parts
    run = functools.partial(baseline_methods, "toy", tmp_path / "out", count=2)
    methods, references = run(library=library)
    assert list(methods) == ["model", "nearest_asset", *METHODS[1:]]
    assert len(asked) == 2 and list(methods["nearest_asset"]) == list(references)
    copied = methods["nearest_asset"][NAMES[0]]
    assert not isinstance(copied, ArticulatedObject | Path) and pickle.dumps(copied)
    tall = at_rest(load_object(tmp_path / "assets" / "tall"))
    assert same_meshes(copied(), tall) and copied().scale == 1
    for name, truth in references.items():
        found = methods["retrieval_true_boxes"][name]
        assert np.allclose(found.boxes, at_rest(truth).boxes, atol=1e-6)
        assert {len(p.mesh.faces) for p in found.parts} == {12}  # the assets are of boxes
    run(library=library)
    assert len(asked) == 2  # asked once
    with pytest.raises(ValueError, match="another checkpoint, split, records, library or size"):
        run(library=library[1:])
    with pytest.raises(ValueError, match="another checkpoint, split, records, library or size"):
        run()


def test_the_command(tmp_path, monkeypatch):
    asked = {}
    monkeypatch.setattr(baselines, "evaluate_baselines", lambda *a, **k: asked.update(k, args=a))
    evaluate("baselines", out=tmp_path, records=Path("records"), unseen=True, processes=3)
    given = {"count": 128, "unseen": True, "openshape": None, "processes": 3}
    records = Path("records")
    assert asked == {"args": ("nano", tmp_path), "records": records, "library": [], **given}
    references = ({"only": ("surface",)}, {"samples": "best"}, {"ref_front": "+x"})
    for wrong in ({"pictures": 3}, *references):
        with pytest.raises(ValueError, match="evaluate baselines: it takes no --"):
            evaluate("baselines", out=tmp_path, **wrong)
    for wrong, named in (({"allow_outside": True}, "allow-outside"), ({"front": "+x"}, "front")):
        with pytest.raises(ValueError, match=f"without --library: it takes no --{named}"):
            evaluate("baselines", out=tmp_path, **wrong)
    with pytest.raises(ValueError, match="evaluate physics: it takes no --library"):
        evaluate("physics", out=tmp_path, library=tmp_path)
    with pytest.raises(FileNotFoundError, match="library 'nowhere': no such folder"):
        evaluate("baselines", out=tmp_path, library=Path("nowhere"))
    toy_assets.write(tmp_path / "assets" / "door", "body", "lid")
    options = {"library": tmp_path / "assets", "front": "+x", "allow_outside": True}
    evaluate("baselines", out=tmp_path, **options)
    assert asked["library"] == [Asset(str(tmp_path / "assets"), "door", "+x", True)]
    with pytest.raises(ValueError, match="it takes no folder"):
        evaluate("baselines", tmp_path, out=tmp_path)
