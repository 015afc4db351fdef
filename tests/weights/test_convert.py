"""``uniart convert`` as a user runs it, on a toy checkpoint folder in TRELLIS's layout."""

import dataclasses
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from official import GAUSSIANS, NETWORKS, torch_state, upstream, write_folder, write_network
from PIL import Image
from rich.console import Console
from safetensors.numpy import load_file, save_file

from uniart_jax import cli
from uniart_jax.config import GaussianConfig, ImageEncoderConfig, ModelConfig
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.gaussian_decoder import offset_perturbation
from uniart_jax.models.network import build
from uniart_jax.nn.embeddings import grid_coords, position_embedding
from uniart_jax.weights import conversion
from uniart_jax.weights.dinov2 import TABLE
from uniart_jax.weights.mapping import _compiled, _filled, flatten

TABLE_32 = np.asarray(position_embedding(grid_coords(4), 32))
OFFSETS = offset_perturbation(GaussianConfig(num_gaussians=GAUSSIANS["num_gaussians"]))
BUFFERS = {"ss_flow_img": {"pos_emb": TABLE_32}, "slat_dec_gs": {"offset_perturbation": OFFSETS}}
PIPELINE = {
    "name": "TrellisImageTo3DPipeline",
    "args": {
        "sparse_structure_sampler": {"params": {"steps": 12, "cfg_strength": 7.5, "cfg_interval": [0.5, 0.95], "rescale_t": 3}},  # noqa: E501
        "slat_normalization": {"mean": [0.5] * 8, "std": [2] * 8},
    },
}  # fmt: skip


def run(capsys, monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["uniart", "convert", *map(str, arguments)])
    monkeypatch.setattr(conversion, "console", Console(stderr=True, highlight=False, width=200))
    with pytest.raises(SystemExit) as error:
        cli.main()
    return error.value.code, " ".join(capsys.readouterr().err.split())


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trellis")
    write_folder(folder, buffers=BUFFERS)
    for name, kind in (
        ("slat_dec_mesh", "ElasticSLatMeshDecoder"),
        ("ss_flow_txt", "SparseStructureFlowModel"),
    ):
        write_network(folder / "ckpts" / name, kind, {"cond_channels": 768}, {"w": np.zeros(2)})
    return folder


@pytest.fixture(scope="module")
def converted(published, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "checkpoint"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys, "argv", ["uniart", "convert", "trellis", str(published), "--out", str(out)]
        )
        with pytest.raises(SystemExit) as error:
            cli.main()
    assert error.value.code == 0
    return out


def test_a_folder_becomes_a_checkpoint(converted):
    config = Checkpoint(converted).config
    model = config.model
    networks = ("structure_vae", "structure_flow", "uniart_vae", "latent_flow", "gaussian_decoder")
    files = {f"{name}.safetensors" for name in (*networks, "latent_stats")} | {"config.json"}
    assert {path.name for path in converted.iterdir()} == files
    for name in networks:  # each fits the config that is beside it
        Checkpoint(converted).load(name)
    assert model.grid.resolution == 16 and model.latent_flow.io_channels == (16,)
    assert model.image_encoder.architecture == "dinov2" and model.image_encoder.width == 24
    assert set(config.untrained) == {
        f"uniart_vae.{name}"
        for name in ("front", "geometry_head", "segmentation_head", "articulation_head")
    }
    assert config.sample_structure.guidance == config.sample_latent.guidance == 5.0
    assert config.sample_latent.steps == 25 and config.sample_latent.rescale_t == 3.0
    assert config.sample_latent.guidance_interval == (0.5, 1.0)
    mean, std = Checkpoint(converted).statistics("structure")
    np.testing.assert_array_equal([mean, std], [[0] * 8, [1] * 8])
    mean, std = Checkpoint(converted).statistics("latent")
    np.testing.assert_allclose(mean[[0, 7]], [-2.16875, 1.20394], atol=1e-5)
    np.testing.assert_allclose(std[[0, 7]], [2.37765, 2.68452], atol=1e-5)


def test_numbers_and_widths_are_as_they_were(converted):
    kind, args = NETWORKS["slat_flow_img"]
    state = upstream(kind, args, seed=list(NETWORKS).index("slat_flow_img"))
    stored = load_file(converted / "latent_flow.safetensors")
    for name, dtype in (("blocks.1.mlp.mlp.0", np.float16), ("input_layer", np.float32)):
        kernel = stored[f"{name}.kernel"]
        assert kernel.dtype == dtype
        np.testing.assert_array_equal(kernel, state[f"{name}.weight"].T)
    assert sum(v.size for v in stored.values()) == sum(v.size for v in state.values())


def test_the_report(published, tmp_path, capsys, monkeypatch):
    code, told = run(capsys, monkeypatch, "trellis", published, "--out", tmp_path / "out")
    assert code == 0
    for part in (
        "structure_vae SparseStructureDecoder, SparseStructureEncoder 84",
        "structure_flow: pos_emb: checked, computed here",
        "gaussian_decoder: offset_perturbation: checked, computed here",
        "24 rows of visual features",
        "out of scope: slat_dec_mesh.safetensors (SLatMeshDecoder): meshes come from",
        "out of scope: ss_flow_txt.safetensors (SparseStructureFlowModel): conditioned on text",
    ):
        assert part in told
    assert "not there" not in told


def test_parts_of_it_and_its_pipeline(tmp_path, capsys, monkeypatch):
    write_folder(tmp_path / "in", ["ss_dec", "slat_flow_img"], pipeline=PIPELINE)
    # the folder of the files themselves will do: pipeline.json is looked for above it too
    code, told = run(
        capsys, monkeypatch, "trellis", tmp_path / "in" / "ckpts", "--out", tmp_path / "out"
    )
    assert code == 0
    assert (
        "not there: SparseStructureEncoder, SparseStructureFlowModel, SLatEncoder, "
        "SLatGaussianDecoder"
    ) in told
    checkpoint = Checkpoint(tmp_path / "out")
    config = checkpoint.config
    assert config.untrained == ("structure_vae.encoder",)
    assert config.sample_structure.steps == 12 and config.sample_structure.guidance == 7.5
    assert config.sample_structure.guidance_interval == (0.5, 0.95)
    assert config.sample_latent.steps == 25
    np.testing.assert_array_equal(checkpoint.statistics("latent"), [[0.5] * 8, [2] * 8])
    params = checkpoint.load("structure_vae")
    assert np.asarray(params["encoder"]["input_layer"]["kernel"]).any()


def test_a_full_output_folder(published, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    code, told = run(capsys, monkeypatch, "trellis", published, "--out", out)
    assert code == 2 and "not empty" in told and "--overwrite" in told
    code, told = run(capsys, monkeypatch, "trellis", published, "--out", out, "--overwrite")
    assert code == 2 and "not replaced" in told and (out / "notes.txt").exists()
    (out / "config.json").write_text("{}")
    code, _ = run(capsys, monkeypatch, "trellis", published, "--out", out, "--overwrite")
    assert (
        code == 0 and not (out / "notes.txt").exists() and (out / "uniart_vae.safetensors").exists()
    )


def wrong(folder, name, change):
    """One mistake that people make, in a folder with one flow."""
    path = folder / "ckpts" / name
    card, weights = path.with_name(f"{name}.json"), path.with_name(f"{name}.safetensors")
    if change == "no card":
        card.unlink()
    elif change == "no json":
        card.write_text("{")
    elif change == "strange card":
        card.write_text("[1]")
    elif change == "strange class":
        card.write_text(json.dumps({"name": "UNet", "args": {}}))
    elif change == "truncated":
        weights.write_bytes(weights.read_bytes()[:-9])
    elif change == "nan":
        state = {k: np.array(v) for k, v in load_file(weights).items()}
        state["out_layer.bias"][0] = np.nan
        save_file(state, weights)
    elif change == "other size":
        kind, args = NETWORKS[name]
        card.write_text(json.dumps({"name": kind, "args": args | {"num_blocks": 3}}))
    elif change == "twice":
        write_network(folder / "again", *NETWORKS[name], upstream(*NETWORKS[name]))
    elif change == "pipeline":
        (folder / "pipeline.json").write_text('{"args": {"slat_normalization": {"mean": [1, 2]}}}')
    elif change == "channels":
        (folder / "pipeline.json").write_text(
            '{"args": {"slat_normalization": {"mean": [1, 2], "std": [1, 2]}}}'
        )


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ("no card", ["slat_flow_img.safetensors", "slat_flow_img.json is not beside it"]),
        ("no json", ["slat_flow_img.json", "not valid JSON"]),
        ("strange card", ["slat_flow_img.json", "must hold a name and args"]),
        ("strange class", ["slat_flow_img.json", "UNet is not a network of TRELLIS"]),
        ("truncated", ["slat_flow_img.safetensors", "truncated"]),
        ("nan", ["latent_flow.safetensors", "not finite", "out_layer.bias"]),
        ("other size", ["slat_flow_img.safetensors", "missing: blocks.2.adaLN_modulation.1.bias"]),
        ("twice", ["again.safetensors and slat_flow_img.safetensors are both a SLatFlowModel"]),
        ("pipeline", ["pipeline.json: args.slat_normalization needs as many"]),
        ("channels", ["latent flow has 8 channels, its normalisation 2"]),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(tmp_path, capsys, monkeypatch, change, parts):
    source, out = tmp_path / "in", tmp_path / "out" / "deep"
    write_folder(source, ["slat_flow_img"])
    wrong(source, "slat_flow_img", change)
    code, told = run(capsys, monkeypatch, "trellis", source, "--out", out)
    assert code == 2 and told.startswith("error: ") and told.count("error:") == 1
    for part in parts:
        assert part in told
    assert not out.parent.exists()


def test_folders_without_anything_for_us(tmp_path, capsys, monkeypatch):
    code, told = run(capsys, monkeypatch, "trellis", tmp_path / "no", "--out", tmp_path / "out")
    assert code == 2 and "no such folder" in told
    code, told = run(capsys, monkeypatch, "trellis", tmp_path, "--out", tmp_path / "out")
    assert code == 2 and "no .safetensors in it" in told
    write_network(tmp_path / "mesh", "SLatMeshDecoder", {}, {"w": np.zeros(1)})
    code, told = run(capsys, monkeypatch, "trellis", tmp_path, "--out", tmp_path / "out")
    assert code == 2 and "none of its networks has a place here" in told


ENCODER = ImageEncoderConfig(
    architecture="dinov2", image_size=28, width=64, num_blocks=2, num_heads=1
)


def dinov2_state(encoder=ENCODER):
    rng = np.random.default_rng(0)
    state = {}
    tree = build("image_encoder", ModelConfig(image_encoder=encoder)).abstract()
    for path, leaf in flatten(tree).items():
        rule, match = next((r, m) for r in TABLE if (m := _compiled(r.path).fullmatch(path)))
        value = rng.normal(0, 0.1, leaf.shape).astype(np.float32)
        order = {2: (1, 0), 4: (3, 2, 0, 1)}.get(rule.layout.axes, range(value.ndim))
        state[_filled(rule.pattern, match)] = np.ascontiguousarray(value.transpose(order))
    return state


def test_dinov2_from_a_pickled_file_and_from_safetensors(tmp_path, capsys, monkeypatch):
    state = dinov2_state()
    torch_state(tmp_path / "dinov2.pth", state)
    save_file(state, tmp_path / "dinov2.safetensors")
    found = []
    for suffix in ("pth", "safetensors"):
        out = tmp_path / suffix / "image_encoder.safetensors"
        code, told = run(capsys, monkeypatch, "dinov2", tmp_path / f"dinov2.{suffix}", "--out", out)
        assert code == 0 and "28 pixels, patches of 14, 4 registers, width 64, 2 blocks" in told
        found.append(out.read_bytes())
        params = Checkpoint(out.parent).load("image_encoder", ModelConfig(image_encoder=ENCODER))
        np.testing.assert_array_equal(
            params["patch_embed"]["proj"]["kernel"][3, 5, 1], state["patch_embed.proj.weight"][:, 1, 3, 5]  # noqa: E501
        )  # fmt: skip
    assert found[0] == found[1]
    code, told = run(
        capsys, monkeypatch, "dinov2", tmp_path / "dinov2.pth", "--out", tmp_path / "pth"
    )
    assert code == 2 and "exists" in told and "--overwrite" in told


@pytest.mark.slow
def test_dinov2_joins_a_converted_checkpoint(converted, tmp_path, capsys, monkeypatch):
    folder = tmp_path / "checkpoint"
    folder.mkdir()
    for path in converted.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    save_file(dinov2_state(), tmp_path / "wide.safetensors")
    before = (folder / "config.json").read_bytes()
    code, told = run(capsys, monkeypatch, "dinov2", tmp_path / "wide.safetensors", "--out", folder)
    assert code == 2 and "width 64 is not the 24 that structure_flow" in told
    assert (folder / "config.json").read_bytes() == before
    assert not (folder / "image_encoder.safetensors").exists()
    narrow = dataclasses.replace(ENCODER, width=24)
    save_file(dinov2_state(narrow), tmp_path / "fits.safetensors")
    code, told = run(capsys, monkeypatch, "dinov2", tmp_path / "fits.safetensors", "--out", folder)
    assert code == 0 and "config.json says so now" in told
    checkpoint = Checkpoint(folder)
    assert checkpoint.config.model.image_encoder == dataclasses.replace(
        narrow, crop_margin=1.2
    )  # as its flows know it
    checkpoint.load("image_encoder")
    samples_as_the_docs_say(folder, tmp_path, capsys, monkeypatch)


def samples_as_the_docs_say(folder, tmp_path, capsys, monkeypatch):
    """TRELLIS's own path on the converted weights; an object is refused, as the heads are new."""
    page = (Path(__file__).parents[2] / "docs" / "weights.md").read_text()
    section = page.split("## TRELLIS's and DINOv2's weights")[1].split("\n## ")[0]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    rgba = np.zeros((40, 50, 4), np.uint8)
    rgba[10:30, 15:40] = (200, 120, 40, 255)
    picture = tmp_path / "photo.png"
    Image.fromarray(rgba).save(picture)
    names: dict = {}
    exec(code.replace("weights/trellis", str(folder)).replace("photo.png", str(picture)), names)
    voxels = names["coords"]
    assert voxels.shape[1] == 3 and len(voxels) and voxels.max() < 16
    assert names["latent"].shape == (len(voxels), 8) and np.isfinite(names["latent"]).all()
    shapes = {name: values.shape for name, values in names["gaussians"].items()}
    assert shapes["xyz"] == (4 * len(voxels), 3) and shapes["opacity"][0] == 4 * len(voxels)
    monkeypatch.setattr(
        sys,
        "argv",
        [
            "uniart",
            "sample",
            str(picture),
            "--out",
            str(tmp_path / "object"),
            "--checkpoint",
            str(folder),
        ],
    )
    with pytest.raises(SystemExit) as error:
        cli.main()
    told = capsys.readouterr().err
    assert (
        error.value.code == 2 and "not trained yet" in told and not (tmp_path / "object").exists()
    )


def test_not_dinov2(tmp_path, capsys, monkeypatch):
    state = dinov2_state()
    del state["register_tokens"]
    save_file(state, tmp_path / "plain.safetensors")
    code, told = run(
        capsys, monkeypatch, "dinov2", tmp_path / "plain.safetensors", "--out", tmp_path / "out"
    )
    assert code == 2 and "image_encoder.safetensors" in told
    out = tmp_path / "image_encoder.safetensors"
    code, told = run(capsys, monkeypatch, "dinov2", tmp_path / "plain.safetensors", "--out", out)
    assert code == 2 and "plain.safetensors" in told and "dinov2_vit{s,b,l}14_reg" in told
    state = dinov2_state() | {"blocks.0.mlp.w12.weight": np.zeros((2, 2), np.float32)}
    save_file(state, tmp_path / "giant.safetensors")
    code, told = run(capsys, monkeypatch, "dinov2", tmp_path / "giant.safetensors", "--out", out)
    assert code == 2 and "extra: blocks.0.mlp.w12.weight" in told and not out.exists()
