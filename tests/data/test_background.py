"""How an object is cut out of its background: the order of the ways, and what each gives."""

import sys
import types

import numpy as np
import pytest
from PIL import Image

from uniart_jax.data import background
from uniart_jax.data.background import cut_out, grabcut, seeds


def photograph(height=90, width=120):
    """A red box before a floor and a wall with shades and noise, and where the box is."""
    rng = np.random.default_rng(0)
    picture = np.empty((height, width, 4), np.uint8)
    shade = np.linspace(70, 190, width)[None, :, None] * np.ones((height, 1, 3))
    shade[height * 3 // 4 :] *= (0.7, 0.8, 0.6)
    box = np.zeros((height, width), bool)
    box[height // 4 : height * 5 // 6, width // 3 : width * 2 // 3] = True
    shade[box] = 200, 40, 30
    picture[..., :3] = np.clip(shade + rng.normal(0, 6, shade.shape), 0, 255)
    picture[..., 3] = 255
    return picture, box


def plain():
    picture = np.full((40, 60, 4), 255, np.uint8)
    picture[10:30, 20:40, :3] = 30, 90, 160
    return picture


def see_through():
    picture, box = photograph()
    picture[..., 3] = np.where(box, 255, 0)
    return picture


@pytest.fixture
def rembg(monkeypatch):
    """A stand-in for rembg that takes what is red for the object -> how it was asked."""
    asked = []

    def remove(picture, *, session, only_mask):
        assert only_mask and picture.mode == "RGB"
        asked.append(session)
        red, green, _ = np.moveaxis(np.asarray(picture).astype(int), -1, 0)
        return Image.fromarray(np.where(red - green > 80, 255, 0).astype(np.uint8))

    module = types.ModuleType("rembg")
    module.remove, module.new_session = remove, lambda model: f"session of {model}"
    monkeypatch.setitem(sys.modules, "rembg", module)
    installed(monkeypatch, "rembg", "onnxruntime")
    background._rembg_session.cache_clear()
    yield asked
    background._rembg_session.cache_clear()


def installed(monkeypatch, *modules):
    monkeypatch.setattr(background, "_installed", lambda *wanted: set(wanted) <= set(modules))


def test_alpha_and_a_plain_background_come_before_all_else(rembg):
    cut, way = cut_out(see_through())
    assert way == "alpha" and (cut == see_through()).all()
    cut, way = cut_out(plain())
    assert way == "plain" and (cut[..., 3] > 0).sum() == 20 * 20
    assert rembg == []


def test_rembg_cuts_a_photograph_out(rembg):
    picture, box = photograph()
    cut, way = cut_out(picture)
    assert way == "rembg" and ((cut[..., 3] == 255) == box).mean() > 0.99
    assert (cut[..., :3] == picture[..., :3]).all() and rembg == ["session of u2net"]


def test_rembg_itself_reads_its_model_and_cuts_out(tmp_path, monkeypatch):
    """The library and its runtime as they are (extra ``photo``, and onnx), on a network of one
    layer in the place of u2net: what is red and not green stands out."""
    how = "pip install 'uniart_jax[photo]' onnx"
    for module in ("onnxruntime", "rembg"):
        pytest.importorskip(module, reason=how)
    onnx = pytest.importorskip("onnx", reason=how)
    floats, helper = onnx.TensorProto.FLOAT, onnx.helper
    weight = helper.make_tensor("w", floats, (1, 3, 1, 1), [1.0, -1.0, 0.0])
    side = (1, 3, 320, 320)
    graph = helper.make_graph(
        [helper.make_node("Conv", ["seen", "w"], ["found"])],
        "u2net",
        [helper.make_tensor_value_info("seen", floats, side)],
        [helper.make_tensor_value_info("found", floats, (1, 1, *side[2:]))],
        [weight],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, tmp_path / f"{background.REMBG_MODEL}.onnx")
    monkeypatch.setenv("U2NET_HOME", str(tmp_path))
    monkeypatch.setenv("MODEL_CHECKSUM_DISABLED", "1")
    background._rembg_session.cache_clear()
    picture, box = photograph()
    try:
        cut, way = cut_out(picture, "rembg")
    finally:
        background._rembg_session.cache_clear()
    assert way == "rembg" and ((cut[..., 3] > 127) == box).mean() > 0.97


def test_rembg_where_it_is_asked_for(rembg):
    cut, way = cut_out(see_through(), "rembg")
    assert way == "rembg" and len(rembg) == 1
    assert (cut[..., 3] <= see_through()[..., 3]).all()  # what was transparent stays so


def test_keep_cuts_nothing_away(rembg):
    for picture, said in ((photograph()[0], "none"), (plain(), "none"), (see_through(), "alpha")):
        cut, way = cut_out(picture, "keep")
        assert way == said and (cut == picture).all()
    assert rembg == []


def test_without_the_extra_it_is_named(monkeypatch):
    installed(monkeypatch)
    with pytest.raises(
        ValueError,
        match=r"^image: --background rembg needs rembg: pip install 'uniart_jax\[photo\]'$",
    ):
        cut_out(plain(), "rembg")
    with pytest.warns(UserWarning, match=r"the whole image .*uniart_jax\[photo\]"):
        cut, way = cut_out(photograph()[0])
    assert way == "none" and (cut[..., 3] == 255).all()


@pytest.mark.parametrize("picture", [plain(), see_through()], ids=["plain", "alpha"])
def test_a_way_that_does_not_exist_is_named_with_those_that_do(rembg, picture):
    line = r"^oven: background 'rembgg' is unknown; choose one of auto, keep, rembg$"
    with pytest.raises(ValueError, match=line):
        cut_out(picture, "rembgg", "oven")
    assert rembg == []


def test_a_failing_rembg_is_one_line_or_passed_over(rembg, monkeypatch):
    def fails(*_, **__):
        raise SystemExit("no backend\nmore")

    monkeypatch.setattr(sys.modules["rembg"], "remove", fails)
    with pytest.raises(ValueError, match=r"^photo: rembg failed \(no backend\)$"):
        cut_out(photograph()[0], "rembg", "photo")
    with pytest.warns(UserWarning) as told:
        assert cut_out(photograph()[0], name="photo")[1] == "none"
    assert "photo: rembg failed (no backend); going on without it" in str(told[0].message)


def test_rembg_that_finds_nothing(rembg):
    picture = photograph()[0]
    picture[..., :3] = picture[..., 1:2]  # gray: the stand-in finds nothing
    with pytest.raises(ValueError, match="rembg found no object"):
        cut_out(picture, "rembg")


def test_seeds_begin_in_the_middle():
    labels = types.SimpleNamespace(GC_BGD=0, GC_FGD=1, GC_PR_BGD=2, GC_PR_FGD=3)
    found = seeds(100, 200, labels)
    assert (found[0] == 0).all() and (found[:, -1] == 0).all()
    assert found[50, 100] == 1 and found[50, 60] == 3 and found[5, 100] == 2
    assert (found == 1).sum() == 10 * 20


def test_only_what_hangs_together_with_the_middle_stays():
    mask = np.zeros((60, 60), bool)
    mask[20:40, 20:40], mask[0:15, 0:60] = True, True
    found = background._middle(mask)
    assert found.sum() == 400 and found[30, 30]
    assert not background._middle(np.zeros((60, 60), bool)).any()


def test_grabcut_cuts_a_photograph_out(monkeypatch):
    pytest.importorskip("cv2", reason="pip install 'uniart_jax[photo]'")
    installed(monkeypatch, "cv2")
    picture, box = photograph()
    before = picture.copy()
    cut, way = cut_out(picture)
    found = cut[..., 3] > 127
    assert way == "grabcut" and (found & box).sum() / (found | box).sum() > 0.95
    assert (picture == before).all() and (grabcut(picture) == cut[..., 3]).all()


def test_the_mask_is_written_as_run_lengths_by_columns():
    picture = np.zeros((3, 4, 4), np.uint8)
    picture[1:, 1, 3] = picture[0, 2, 3] = picture[2, 3, 3] = 255
    # columns: 000 011 100 001
    assert background.run_lengths(picture) == {"size": [3, 4], "counts": [4, 3, 4, 1]}
    picture[..., 3] = 255
    assert background.run_lengths(picture)["counts"] == [0, 12]
    large, box = photograph(600, 800)
    large[..., 3] = np.where(box, 255, 0)
    found = background.run_lengths(large)
    assert found["size"] == [192, 256]
    inside = sum(found["counts"][1::2]) / sum(found["counts"])
    assert sum(found["counts"]) == 192 * 256 and abs(inside - box.mean()) < 0.01


def test_grabcut_gives_up_where_nothing_is_left(monkeypatch):
    """With a stand-in for OpenCV that calls all of the picture background."""
    module = types.ModuleType("cv2")
    module.GC_BGD, module.GC_FGD, module.GC_PR_BGD, module.GC_PR_FGD = range(4)
    module.GC_INIT_WITH_MASK = 1
    module.setRNGSeed = lambda seed: None

    def cut(picture, labels, rect, background, foreground, rounds, mode):
        assert picture.shape[2] == 3 and background.shape == foreground.shape == (1, 65)
        labels[:] = module.GC_PR_BGD

    module.grabCut = cut
    monkeypatch.setitem(sys.modules, "cv2", module)
    installed(monkeypatch, "cv2")
    with pytest.warns(UserWarning, match="the whole image"):
        assert cut_out(photograph()[0])[1] == "none"


def test_the_mask_network_comes_before_grabcut_and_is_loaded_only_where_needed(monkeypatch):
    installed(monkeypatch, "cv2")
    monkeypatch.setattr(background, "grabcut", lambda rgba: pytest.fail("not asked"))
    picture, box = photograph()
    asked = []

    def network():
        asked.append(1)
        return lambda rgba: np.where(box, 255, 0).astype(np.uint8)

    cut, way = cut_out(picture, network=network)
    assert way == "network" and ((cut[..., 3] > 0) == box).all() and asked == [1]
    assert cut_out(see_through(), network=network)[1] == "alpha"
    assert cut_out(picture, "keep", network=network)[1] == "none" and asked == [1]


def test_a_plain_background_is_cut_away_where_the_network_agrees():
    """A shadow is no object, and an object may have the background's colour in places."""
    picture = plain()
    exact = cut_out(picture)[0][..., 3]
    near = exact.copy()
    near[10] = 0  # 19 of 20 rows
    for mask, said in ((exact, "plain"), (near, "plain"), (None, "plain"), (exact // 3, "network")):
        cut, way = cut_out(picture, network=lambda mask=mask: lambda rgba: mask)
        assert way == said
        if way == "plain":
            np.testing.assert_array_equal(cut[..., 3], exact)
    half = np.where(np.arange(60) < 30, exact, 0).astype(np.uint8)
    cut, way = cut_out(picture, network=lambda: lambda rgba: half)
    assert way == "network" and (cut[..., 3] == half).all()


def test_where_the_network_finds_nothing_grabcut_tries(monkeypatch):
    installed(monkeypatch, "cv2")
    picture, box = photograph()
    monkeypatch.setattr(background, "grabcut", lambda rgba: np.where(box, 255, 0).astype(np.uint8))
    assert cut_out(picture, network=lambda: lambda rgba: None)[1] == "grabcut"
