"""The exported folder: exact names, float16 on disk, float32 in memory, one error that lists what
differs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from uniart_jax.config import Config, GridConfig, ModelConfig
from uniart_jax.models import checkpoint_files
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import (
    STATISTICS,
    read_network,
    write_config,
    write_network,
    write_statistics,
)

RNG = np.random.default_rng(0)
PARAMS = {
    "blocks": {i: {"kernel": RNG.normal(size=(3, 4)).astype(np.float32)} for i in range(11)},
    "bias": jnp.asarray([0.1, -2.0]),
}
ABSTRACT = jax.eval_shape(lambda: jax.tree.map(jnp.asarray, PARAMS))


@pytest.mark.parametrize(("dtype", "tolerance"), [("float16", 2**-11), ("float32", 0)])
def test_weights_come_back(tmp_path, dtype, tolerance):
    path = write_network(tmp_path / "export", "latent_flow", PARAMS, dtype)
    assert path == tmp_path / "export/latent_flow.safetensors"
    plain = tmp_path / "plain"
    plain.touch()
    assert (
        path.stat().st_mode == plain.stat().st_mode
    )  # others may read what this user's files allow
    stored = load_file(path)
    assert "blocks.10.kernel" in stored
    assert {str(value.dtype) for value in stored.values()} == {dtype}
    for folder in (tmp_path, tmp_path / "export"):  # a WORKDIR or the export folder
        loaded = read_network(Checkpoint.find(folder).path("latent_flow.safetensors"), ABSTRACT)
        assert jax.tree.structure(loaded) == jax.tree.structure(PARAMS)
        for ours, theirs in zip(jax.tree.leaves(loaded), jax.tree.leaves(PARAMS), strict=True):
            assert ours.dtype == np.float32
            np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=0)


def test_kernels_in_8_bits_come_back_to_a_fraction_of_the_largest(tmp_path):
    large = {"a": {"kernel": RNG.normal(size=(6, 50, 8)).astype(np.float32)}, "b": np.ones(3)}
    large["a"]["kernel"][..., 2] *= 1e-3  # each channel has a scale of its own
    large["a"]["kernel"][..., 5] = 0
    path = write_network(tmp_path, "net", large, int8=["a.kernel"])
    assert {str(v.dtype) for v in load_file(path).values()} == {"int8", "float16", "float32"}
    loaded = read_network(path, large)
    for channel in range(8):
        ours, theirs = (p["a"]["kernel"][..., channel] for p in (loaded, large))
        assert np.abs(ours - theirs).max() <= np.abs(theirs).max() / 245
    again = write_network(tmp_path / "again", "net", loaded, int8=["a.kernel"])
    assert again.read_bytes() == path.read_bytes()
    with pytest.raises(ValueError, match=r"not written, no parameter is named c\.kernel"):
        write_network(tmp_path, "other", large, int8=["a.kernel", "c.kernel"])


def test_every_difference_is_listed_in_one_line(tmp_path):
    write_network(tmp_path, "net", {"a": np.ones((2, 3)), "b": np.ones(2), "c": np.ones(1)})
    other = {"a": np.ones((3, 3)), "b": np.ones(2), "d": np.ones(1)}
    with pytest.raises(ValueError) as error:
        read_network(tmp_path / "net.safetensors", other)
    text = str(error.value)
    assert "missing: d; extra: c; mismatched: a is [2, 3], expected [3, 3];" in text
    assert "net.safetensors" in text and "\n" not in text


def test_values_that_are_not_finite_are_neither_written_nor_read(tmp_path):
    bad = {"a": {"x": np.array([1.0, np.nan])}, "b": np.array([1e6]), "c": np.ones(1)}
    with pytest.raises(ValueError, match=r"not finite as float16: a\.x, b"):
        write_network(tmp_path, "net", bad)
    assert list(tmp_path.iterdir()) == []
    save_file({"a": np.array([1.0, np.inf]), "b": np.ones(1)}, tmp_path / "net.safetensors")
    with pytest.raises(ValueError, match="not finite: a;"):
        read_network(tmp_path / "net.safetensors", {"a": np.ones(2), "b": np.ones(1)})


@pytest.mark.parametrize("keep", [0, 4, 100, -1])
def test_a_truncated_file_is_told(tmp_path, keep):
    path = write_network(tmp_path, "net", PARAMS)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError, match=r"net\.safetensors: truncated or not a safetensors file"):
        read_network(tmp_path / "net.safetensors", ABSTRACT)


def test_what_is_not_there_is_told(tmp_path):
    for name in (tmp_path / "none", "", " ", "x" * 300):
        with pytest.raises(FileNotFoundError, match="neither a folder nor a shipped model"):
            Checkpoint.find(name)
    with pytest.raises(FileNotFoundError, match=r"no layout\.safetensors in it; finish"):
        Checkpoint(tmp_path).load("layout", ModelConfig())
    with pytest.raises(FileNotFoundError, match=r"no config\.json"):
        _ = Checkpoint(tmp_path).config


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = write_network(tmp_path, "net", PARAMS)
    before = path.read_bytes()

    def full(_descriptor):
        raise OSError("no space left on device")

    monkeypatch.setattr(checkpoint_files.os, "fsync", full)
    with pytest.raises(OSError, match="no space"):
        write_network(tmp_path, "net", PARAMS)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["net.safetensors"]


def test_configs_come_back_and_bad_ones_are_told(tmp_path):
    config = Config(name="x", model=ModelConfig(grid=GridConfig(resolution=32)))
    path = write_config(tmp_path / "export", config)
    assert Checkpoint.find(tmp_path).config == config
    path.write_text(path.read_text().replace('"resolution"', '"resolutoin"'))
    with pytest.raises(ValueError, match=r"config\.json: .*model\.grid\.resolutoin"):
        _ = Checkpoint.find(tmp_path).config
    text = path.read_text().replace('"auto"', '"atuo"')
    path.write_text(text)
    with pytest.raises(ValueError, match=r"model\.grid\.resolutoin, model\.kernel='atuo'"):
        _ = Checkpoint.find(tmp_path).config
    path.write_text("{")
    with pytest.raises(ValueError, match=r"config\.json: config: not valid JSON"):
        _ = Checkpoint.find(tmp_path).config


def test_weights_that_are_no_real_numbers_are_told(tmp_path):
    """In a line, with every name, though their shapes fit."""
    save_file({"a": np.ones(2, np.int32), "b": np.ones(1, bool)}, tmp_path / "net.safetensors")
    with pytest.raises(
        ValueError, match=r"not floating-point numbers: a \(int32\), b \(bool\);"
    ) as caught:
        read_network(tmp_path / "net.safetensors", {"a": np.ones(2), "b": np.ones(1)})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["[" * 200_000, '{"model": ' * 200_000, '{"seed": ' + "[" * 500 + "]" * 500 + "}"]
)
def test_a_config_that_nests_without_end_is_one_short_line(tmp_path, text):
    (tmp_path / "config.json").write_text(text)
    with pytest.raises(ValueError, match=r"config\.json: config: ") as caught:
        _ = Checkpoint.find(tmp_path).config
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("mean", "std", "words"),
    [
        (np.zeros(3), np.array([1.0, 0, 2]), r"vae\.std is not above 0 in 1 of 3 channels"),
        (np.zeros(2), np.array([1.0, -1]), r"vae\.std is not above 0 in 1 of 2 channels"),
        (np.zeros(2), np.ones(2, np.int32), r"not floating-point numbers: vae\.std \(int32\)"),
        (np.zeros(2), np.ones(3), r"shapes \(2,\) and \(3,\)"),
    ],
)
def test_statistics_that_no_latent_has_are_told(tmp_path, mean, std, words):
    save_file({"vae.mean": mean, "vae.std": std}, tmp_path / STATISTICS)
    with pytest.raises(ValueError, match=rf"latent_stats\.safetensors: .*{words}"):
        Checkpoint.find(tmp_path).statistics("vae")


def test_statistics_of_several_latents_share_a_file(tmp_path):
    folder = tmp_path / "export"
    write_statistics(folder, "structure_vae", np.arange(8.0), np.ones(8))
    write_statistics(folder, "uniart_vae", np.zeros(16), np.full(16, 2.0))
    mean, std = Checkpoint.find(tmp_path).statistics("structure_vae")
    np.testing.assert_array_equal(mean, np.arange(8.0))
    np.testing.assert_array_equal(std, np.ones(8))
    assert Checkpoint.find(tmp_path).statistics("uniart_vae")[1].dtype == np.float32
    with pytest.raises(ValueError, match=r"missing: other\.mean, other\.std"):
        Checkpoint.find(tmp_path).statistics("other")
    with pytest.raises(ValueError, match=r"not finite: x\.std"):
        write_statistics(folder, "x", np.zeros(1), np.array([np.nan]))
