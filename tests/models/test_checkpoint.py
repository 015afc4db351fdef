"""What a checkpoint folder says of itself: where it lies, what it holds, what may be copied from
it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from uniart_jax.config import NETWORKS, STAGES, Config, LayoutConfig
from uniart_jax.models.checkpoint import PRETRAINED, Checkpoint, set_untrained
from uniart_jax.models.checkpoint_files import write_config, write_statistics


def make(folder: Path, *networks: str, config: Config | None = None) -> Checkpoint:
    """A checkpoint whose networks are a few bytes that differ from one another."""
    folder.mkdir(parents=True)
    for name in networks:
        (folder / f"{name}.safetensors").write_text(name)
    if config is not None:
        write_config(folder, config)
    return Checkpoint(folder)


def test_a_workdir_is_its_export_and_a_folder_of_networks_is_itself(tmp_path):
    exported = make(tmp_path / "work/export", "image_encoder", config=Config(untrained=("x.y",)))
    write_config(tmp_path / "work", Config())  # what its training was asked for
    assert Checkpoint.find(tmp_path / "work") == exported == Checkpoint.find(exported.folder)
    assert Checkpoint.find(tmp_path / "work").untrained() == ("x.y",)
    (tmp_path / "work/layout.safetensors").touch()
    assert Checkpoint.find(tmp_path / "work") == Checkpoint(tmp_path / "work")
    assert Checkpoint.find("nano").folder == PRETRAINED / "nano"


def test_which_networks_it_holds(tmp_path):
    checkpoint = make(tmp_path / "some", "layout", "uniart_vae", "other")
    assert checkpoint.networks() == ["uniart_vae", "layout"]
    assert checkpoint.has("layout", "other") and not checkpoint.has("layout", "latent_flow")
    assert make(tmp_path / "none").networks() == []


def test_what_is_untrained_is_told_network_by_network(tmp_path):
    marks = ("uniart_vae.front", "latent_flow", "uniart_vae.geometry_head")
    make(tmp_path / "a", config=Config(untrained=marks))
    checkpoint = Checkpoint(tmp_path / "a")
    assert checkpoint.untrained() == marks
    assert checkpoint.untrained(["uniart_vae", "layout"]) == (marks[0], marks[2])
    assert checkpoint.untrained([]) == ()
    set_untrained(tmp_path / "a", ["uniart_vae"], ("uniart_vae.new",))
    assert Checkpoint(tmp_path / "a").untrained() == ("latent_flow", "uniart_vae.new")
    assert Checkpoint(tmp_path / "nothing").untrained() == ()


def test_flows_stand_only_beside_their_own_encoder_and_vaes(tmp_path):
    source = make(tmp_path / "source", *NETWORKS)
    assert source.copyable(Config(), ["latent_flow"]) == list(NETWORKS[:-1])
    assert source.copyable(Config(), ["uniart_vae"]) == ["image_encoder", "structure_vae"]
    same = make(tmp_path / "same", "image_encoder", "structure_vae")
    assert source.same_latent_space(same) and not source.same_latent_space(same, ["uniart_vae"])
    assert source.copyable(Config(), [], same) == ["uniart_vae", "structure_flow", "latent_flow"]
    (same.folder / "structure_vae.safetensors").write_text("another")
    assert not source.same_latent_space(same)
    assert source.copyable(Config(), [], same) == ["uniart_vae"]
    assert not make(tmp_path / "flow", "latent_flow").same_latent_space(None)


def test_networks_without_added_layers_and_layouts_nobody_asks_for_stay(tmp_path):
    config = Config()
    source = make(tmp_path / "source", *STAGES, config=config)
    flow = dataclasses.replace(config.model.latent_flow, pixel_channels=8)
    layout = LayoutConfig(queries=4)
    model = dataclasses.replace(config.model, latent_flow=flow, layout=layout)
    assert source.missing_layers("latent_flow", model) == ["pixel_channels"]
    assert source.missing_layers("latent_flow", config.model) == []
    asked = dataclasses.replace(config, model=model)
    assert source.copyable(asked, []) == [n for n in model.networks() if n != "latent_flow"]
    assert source.copyable(config, []) == list(NETWORKS)
    with_legs = dataclasses.replace(model, layout=LayoutConfig(queries=4, legs=8))
    assert source.missing_layers("layout", with_legs) == ["legs"]
    sets = LayoutConfig(queries=4, legs=8, panels=24, boards=12, revolutions=True)
    with_all = dataclasses.replace(model, layout=sets)
    missing = ["legs", "panels", "boards", "revolutions"]
    assert source.missing_layers("layout", with_all) == missing
    assert "layout" not in source.copyable(dataclasses.replace(config, model=with_legs), [])


def test_copies_bring_statistics_and_what_is_untrained(tmp_path):
    marks = ("latent_flow.blocks", "uniart_vae.front")
    source = make(tmp_path / "source", *NETWORKS, config=Config(untrained=marks))
    for latent in ("structure", "latent"):
        write_statistics(source.folder, latent, np.full(3, 2.0), np.ones(3))
    copy = make(tmp_path / "copy", config=Config(untrained=("image_encoder.heads",)))
    source.copy_networks(["latent_flow", "structure_vae"], copy.folder)
    source.copy_networks([], copy.folder)
    copy = Checkpoint(copy.folder)
    assert copy.networks() == ["structure_vae", "latent_flow"]
    assert (copy.folder / "latent_flow.safetensors").read_text() == "latent_flow"
    assert copy.untrained() == ("image_encoder.heads", "latent_flow.blocks")
    np.testing.assert_array_equal(copy.statistics("latent"), [[2.0] * 3, [1.0] * 3])
    with pytest.raises(ValueError, match=r"missing: structure\.mean"):
        copy.statistics("structure")


def test_its_digest_is_of_networks_and_options(tmp_path):
    checkpoint = make(tmp_path / "a", "layout", config=Config())
    before = checkpoint.digest()
    (checkpoint.folder / "notes.txt").touch()
    assert checkpoint.digest() == before and len(before) == 16
    write_config(checkpoint.folder, Config(seed=1))
    assert checkpoint.digest() != before
    (checkpoint.folder / "layout.safetensors").write_text("another")
    assert checkpoint.digest() != before
