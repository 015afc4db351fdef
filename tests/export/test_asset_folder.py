"""The folder of an asset: complete or absent, and nothing that is in use is replaced."""

import pytest
from asset_objects import FILES
from PIL import Image

from uniart_jax.export import asset as asset_module
from uniart_jax.export import folder as folder_module
from uniart_jax.export import mjcf as mjcf_module
from uniart_jax.export.asset import save_asset


def test_a_folder_in_use_is_refused_and_kept(block, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    with pytest.raises(ValueError, match="not empty") as error:
        save_asset(block, tmp_path / "out")
    assert "\n" not in str(error.value)
    assert [p.name for p in tmp_path.rglob("*")] == ["out", "mine.txt"]


def test_overwrite_replaces_the_whole_folder(block, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.json").write_text("old")
    assert save_asset(block, tmp_path / "out", overwrite=True) == tmp_path / "out"
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_only_an_asset_is_replaced(block, tmp_path):
    """Not a folder of other things, though asked to; and no folder that holds what is in use."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.doc").write_text("mine")
    with pytest.raises(ValueError, match=r"holds no asset.*; choose another --out") as error:
        save_asset(block, tmp_path / "out", overwrite=True)
    assert "\n" not in str(error.value)
    assert [p.name for p in tmp_path.rglob("*")] == ["out", "thesis.doc"]


@pytest.mark.parametrize("place", ["work", "home"])
@pytest.mark.parametrize("depth", ["", "deep/deeper"])
def test_no_folder_in_use_is_replaced(block, tmp_path, monkeypatch, place, depth):
    inner = tmp_path / "out" / depth
    inner.mkdir(parents=True)
    (tmp_path / "out" / "report.json").write_text("{}")
    if place == "work":
        monkeypatch.chdir(inner)
    else:
        monkeypatch.setenv("HOME", str(inner))
    with pytest.raises(ValueError, match=f"holds the {place}.* directory; choose another --out"):
        save_asset(block, tmp_path / "out", overwrite=True)
    with pytest.raises(ValueError, match="choose another --out"):
        save_asset(block, "/", overwrite=True)
    assert (tmp_path / "out" / "report.json").is_file()


def test_roots_and_folders_that_hold_the_input_are_refused(block, tmp_path, monkeypatch):
    image = tmp_path / "out" / "inputs" / "photo.png"
    image.parent.mkdir(parents=True)
    Image.new("RGB", (8, 8)).save(image)
    (tmp_path / "out" / "object.urdf").write_text("")
    for path in (image, str(image)):
        with pytest.raises(ValueError, match=r"holds the input .*photo.png; choose another --out"):
            save_asset(block, tmp_path / "out", image=path, overwrite=True)
    assert image.is_file()
    monkeypatch.setattr(folder_module.os.path, "ismount", lambda path: True)
    with pytest.raises(ValueError, match="root of a file system; choose another --out"):
        save_asset(block, tmp_path / "new")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_what_came_meanwhile_is_kept(tmp_path):
    with (
        pytest.raises(ValueError, match="not empty"),
        folder_module.complete_folder(tmp_path / "out"),
    ):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "mine.txt").write_text("mine")
    assert [p.name for p in tmp_path.rglob("*")] == ["out", "mine.txt"]


def test_an_empty_folder_is_taken(block, tmp_path):
    (tmp_path / "out").mkdir()
    save_asset(block, tmp_path / "out", motion=False)
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES - {"motion.gif"}


def test_a_folder_behind_a_link_is_written_where_it_leads(block, tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    save_asset(block, tmp_path / "link", motion=False)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "object.urdf").is_file()


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize(
    "stage", ["write_urdf", "write_mjcf", "write_glb", "write_page", "write_report", "_swap"]
)
def test_a_failure_leaves_everything_as_it_was(block, tmp_path, monkeypatch, stage, overwrite):
    def fail(*_, **__):
        raise OSError("disk full")

    old = tmp_path / "out"
    if overwrite:
        old.mkdir()
        (old / "report.json").write_text("old")
    target = old if overwrite else tmp_path / "new" / "deep" / "out"
    module = {"_swap": folder_module, "write_mjcf": mjcf_module}.get(stage, asset_module)
    monkeypatch.setattr(module, stage, fail)
    with pytest.raises(OSError, match="disk full"):
        save_asset(block, target, overwrite=overwrite, motion=False)
    left = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*")}
    assert left == ({"out", "out/report.json"} if overwrite else set())


def test_the_old_folder_comes_back_if_the_new_one_cannot_take_its_place(
    block, tmp_path, monkeypatch
):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.json").write_text("old")
    rename = folder_module.Path.rename

    def fail_once(self, target):
        if ".new-" in self.name:
            raise OSError("no")
        return rename(self, target)

    monkeypatch.setattr(folder_module.Path, "rename", fail_once)
    with pytest.raises(OSError):
        save_asset(block, tmp_path / "out", overwrite=True, motion=False)
    assert (tmp_path / "out" / "report.json").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_bad_targets_and_images_are_one_line(block, tmp_path):
    (tmp_path / "file").write_text("x")
    for folder, image in (
        (tmp_path / "file", None),
        (tmp_path / "file" / "under", None),
        (tmp_path / "out", tmp_path / "absent.png"),
        (tmp_path / "out", tmp_path / "file"),
    ):
        with pytest.raises(ValueError) as error:
            save_asset(block, folder, image=image)
        assert "\n" not in str(error.value)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
