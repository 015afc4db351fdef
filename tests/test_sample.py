"""sample.py end to end with the shipped weights, and what it says about bad input."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy
from PIL import Image

from uniart_jax.pipeline import PRETRAINED

ROOT = Path(__file__).parent.parent
shipped = pytest.mark.skipif(
    not (PRETRAINED / "nano" / "config.json").is_file(),
    reason="no shipped weights here; make them with: python train.py --config configs/nano.py",
)
EXAMPLE = ROOT / "examples" / "images" / "cabinet.png"


def sample(*arguments, expect=0):
    command = [sys.executable, str(ROOT / "sample.py"), *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert result.returncode == expect, result.stderr[-2000:]
    return result


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    out = tmp_path_factory.mktemp("sample") / "asset"
    sample(EXAMPLE, "--out", out, "--steps", 4)
    return out


@shipped
def test_everything_is_there(asset):
    for name in ("object.urdf", "object.glb", "meshes", "preview.png", "motion.gif", "report.json"):
        assert (asset / name).exists(), name
    assert Image.open(asset / "preview.png").size[0] > 400
    assert Image.open(asset / "motion.gif").n_frames > 8


@shipped
def test_report_matches_the_urdf(asset):
    report = json.loads((asset / "report.json").read_text())
    robot = yourdfpy.URDF.load(str(asset / "object.urdf"))
    assert {p["name"] for p in report["parts"]} <= set(robot.link_map)
    assert all(p["watertight"] and p["mass"] > 0 for p in report["parts"])
    assert sum(p["parent"] is None for p in report["parts"]) == 1
    assert report["seed"] == 0 and report["checkpoint"] == "nano"
    for path in sorted((asset / "meshes").glob("*.obj")):
        mesh = trimesh.load(path, force="mesh", process=True)
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        assert len(mesh.faces) > 0


@shipped
def test_mujoco_opens_it(asset):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(asset / "object.urdf"))
    data = mujoco.MjData(model)
    for _ in range(10):
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()


@shipped
def test_same_seed_same_object(asset, tmp_path):
    sample(EXAMPLE, "--out", tmp_path / "again", "--steps", 4)
    assert (tmp_path / "again" / "object.urdf").read_bytes() == (asset / "object.urdf").read_bytes()


@shipped
def test_a_full_folder_is_left_alone(asset):
    before = sorted(p.name for p in asset.iterdir())
    result = sample(EXAMPLE, "--out", asset, expect=2)
    assert "not empty" in result.stderr and "--overwrite" in result.stderr
    assert sorted(p.name for p in asset.iterdir()) == before


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (lambda p: None, "no such file"),
        (lambda p: p.write_bytes(b""), "empty"),
        (lambda p: p.write_bytes(b"hello"), "not an image"),
        (lambda p: Image.new("RGB", (1, 1)).save(p), "too small"),
        (lambda p: Image.new("RGBA", (64, 64)).save(p), "transparent"),
    ],
)
def test_bad_images_are_one_line(tmp_path, write, says):
    image = tmp_path / "image.png"
    write(image)
    result = sample(image, "--out", tmp_path / "out", expect=2)
    assert says in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1 and result.stderr.startswith("error: ")
    assert not (tmp_path / "out").exists()


def test_unknown_checkpoint(tmp_path):
    result = sample(EXAMPLE, "--out", tmp_path / "out", "--checkpoint", "absent", expect=2)
    assert (
        "neither a folder nor a shipped model" in result.stderr and not (tmp_path / "out").exists()
    )


@shipped
def test_truncated_checkpoint(tmp_path):
    import shutil

    folder = tmp_path / "broken"
    shutil.copytree(PRETRAINED / "nano", folder)
    path = folder / "latent_flow.safetensors"
    path.write_bytes(path.read_bytes()[:1000])
    result = sample(EXAMPLE, "--out", tmp_path / "out", "--checkpoint", folder, expect=2)
    assert "truncated" in result.stderr and not (tmp_path / "out").exists()
