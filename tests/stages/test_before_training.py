"""What is refused before anything is trained or written."""

import dataclasses
import types
from pathlib import Path

import pytest
from toy_stages import DEBUG, toy

from uniart_jax import stages
from uniart_jax.cli import load_config
from uniart_jax.config import NETWORKS, MeshConfig
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.runtime.locks import exclusive_lock
from uniart_jax.stages import checks
from uniart_jax.stages.checks import check_found
from uniart_jax.stages.trainer import check_workdir, trainable

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("field", "value", "least"),
    [("accumulate", 0, 1), ("log_every", 0, 1), ("batch_size", -1, 1), ("skip_not_finite", -1, 0)],
)
def test_numbers_that_cannot_be_are_refused_before_any_work(tmp_path, field, value, least):
    config = toy(tmp_path)
    stage = dataclasses.replace(config.uniart_vae, **{field: value})
    with pytest.raises(ValueError, match=f"uniart_vae\\.{field} is {value}; give {least} or more"):
        stages.run(dataclasses.replace(config, uniart_vae=stage), ["uniart_vae"], tmp_path / "w")
    data = dataclasses.replace(config.data, voxel_buckets=())
    with pytest.raises(ValueError, match=r"data\.voxel_buckets is "):
        stages.run(dataclasses.replace(config, data=data), ["uniart_vae"], tmp_path / "w")
    assert not (tmp_path / "w").exists()


def test_a_bucket_is_no_workdir(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for workdir in ("gs://bucket/run", Path("gs://bucket/run")):
        with pytest.raises(ValueError, match=r"workdir 'gs://bucket/run': .* mount the bucket"):
            stages.Trainer(toy(tmp_path), workdir).fit("structure_vae")
    assert not (tmp_path / "gs:").exists()


def test_devices_that_do_not_fit_are_told_before_data_is_made(tmp_path, monkeypatch, capsys):
    config = toy(tmp_path)
    uneven = dataclasses.replace(config, mesh=MeshConfig(data=-1, fsdp=7))
    with pytest.raises(ValueError, match="mesh: data=-1 x fsdp=7 does not make"):
        stages.run(uneven, ["structure_vae"], tmp_path / "w")
    assert not list(tmp_path.iterdir())
    chosen, mesh = [stages.STAGES["structure_vae"]], types.SimpleNamespace(size=8)
    monkeypatch.setattr(checks, "make_mesh", lambda _: mesh)
    batch = dataclasses.replace(config.structure_vae, batch_size=16, accumulate=4)
    config = dataclasses.replace(config, structure_vae=batch)
    checks.check_devices(config, chosen)
    assert "structure_vae: 4 items at once do not divide over 8" in capsys.readouterr().err
    monkeypatch.setattr(checks.jax, "process_count", lambda: 2)
    with pytest.raises(ValueError, match=r"8 devices of 2 processes.* give a multiple of 32"):
        checks.check_devices(config, chosen)
    batch = dataclasses.replace(batch, batch_size=32)
    checks.check_devices(dataclasses.replace(config, structure_vae=batch), chosen)
    assert not capsys.readouterr().err


@pytest.mark.parametrize("kept", ["checkpoints/layout/2", "export/layout.safetensors"])
def test_a_workdir_in_which_nothing_was_trained_may_hold_another_model(tmp_path, kept):
    config, workdir = toy(tmp_path), tmp_path / "w"
    wider = dataclasses.replace(config.model.uniart_vae, width=2 * config.model.uniart_vae.width)
    other = dataclasses.replace(config.model, uniart_vae=wider)
    other = dataclasses.replace(config, model=other, untrained=("uniart_vae.front",))
    check_workdir(other, workdir)
    (workdir / "checkpoints/layout").mkdir(parents=True)
    check_workdir(config, workdir)
    assert Checkpoint(workdir).config == config
    assert Checkpoint.of_workdir(workdir).config == config
    (workdir / kept).mkdir(parents=True)
    with pytest.raises(ValueError, match=r"another model \(different: model\.uniart_vae\)"):
        check_workdir(other, workdir)
    assert Checkpoint(workdir).config == config


def test_a_workdir_is_one_process_s(tmp_path):
    config = toy(tmp_path)
    with exclusive_lock(tmp_path / "w"), pytest.raises(ValueError, match="another process works"):
        stages.run(config, ["structure_vae"], tmp_path / "w")


def test_a_wrong_freeze_is_told_before_the_first_stage_trains(tmp_path):
    config = toy(tmp_path)
    wrong = dataclasses.replace(config.latent_flow, freeze=("trunk",))
    with pytest.raises(ValueError, match=r"^latent_flow\.freeze: no parameter is named 'trunk'"):
        stages.run(dataclasses.replace(config, latent_flow=wrong), NETWORKS, tmp_path / "w")
    assert not (tmp_path / "w").exists()


def test_dinov2_is_not_a_stage_and_features_must_be_there(tmp_path):
    """What configs/paper.py is told before anything is written."""
    config = toy(tmp_path)
    encoder = dataclasses.replace(config.model.image_encoder, architecture="dinov2")
    frozen = dataclasses.replace(
        config, model=dataclasses.replace(config.model, image_encoder=encoder)
    )
    assert trainable(frozen, NETWORKS) == list(NETWORKS[1:])
    with pytest.raises(ValueError, match="uniart convert dinov2"):
        stages.run(frozen, ("image_encoder",), tmp_path / "work")
    paper = load_config(DEBUG.with_name("paper.py"))
    absent = dataclasses.replace(paper.data, records=str(tmp_path / "absent"))
    with pytest.raises(FileNotFoundError, match=r"absent: no such folder; .* uniart prepare"):
        stages.run(dataclasses.replace(paper, data=absent), NETWORKS, tmp_path / "work")
    assert not (tmp_path / "work").exists()


def test_flows_are_told_which_cameras_they_are_trained_through(tmp_path, capsys):
    nano, exported = load_config(ROOT / "configs" / "nano.py"), Checkpoint.of_workdir(tmp_path)
    plain = dataclasses.replace(nano.model.structure_flow, pixel_channels=0)
    without = dataclasses.replace(nano.model, structure_flow=plain)
    found = dataclasses.replace(nano.loss, found=0.5)
    sampled = dataclasses.replace(nano.loss, sampled=0.5)
    for config, name, told in (
        (nano, "structure_flow", True),
        (nano, "latent_flow", True),
        (nano, "uniart_vae", False),
        (dataclasses.replace(nano, loss=sampled), "uniart_vae", True),
        (dataclasses.replace(nano, model=without), "structure_flow", False),
        (dataclasses.replace(nano, loss=found), "structure_flow", False),
    ):
        check_found(config, [stages.STAGES[name]], exported, ["layout"])
        assert ("through the image encoder's cameras" in capsys.readouterr().err) == told
