"""A checkpoint of the Hugging Face hub by its name: with a stand-in for huggingface_hub, and itself
with a cache."""

import fnmatch
import importlib.util
import os
import shutil
import subprocess
import sys
import types

import pytest

from uniart_jax.config import Config
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config


@pytest.fixture
def hub(tmp_path, monkeypatch):
    """A hub with one repository in a folder; what is asked for is copied, as a download is."""
    remote, asked = tmp_path / "remote", []
    write_config(remote, Config(name="theirs"))
    (remote / "structure_vae.safetensors").write_bytes(b"weights")
    (remote / "run.py").write_text("raise SystemExit")

    def snapshot_download(repo_id, *, revision=None, allow_patterns=None):
        asked.append((repo_id, revision))
        if repo_id != "some/model":
            raise RuntimeError("404 Client Error.\n\nRepository Not Found")
        found = [
            p for p in remote.iterdir() if any(fnmatch.fnmatch(p.name, a) for a in allow_patterns)
        ]
        cache = tmp_path / "cache"
        cache.mkdir()
        for path in found:
            shutil.copy(path, cache)
        return str(cache)

    module = types.ModuleType("huggingface_hub")
    module.snapshot_download = snapshot_download
    monkeypatch.setitem(sys.modules, "huggingface_hub", module)
    return asked


def test_a_name_of_the_hub_is_a_folder_of_weights_and_nothing_else(hub):
    checkpoint = Checkpoint.find("hf:some/model@v2")
    assert checkpoint.config.name == "theirs"
    assert sorted(p.name for p in checkpoint.folder.iterdir()) == [
        "config.json",
        "structure_vae.safetensors",
    ]
    assert hub == [("some/model", "v2")]


def test_without_a_revision_the_newest_is_asked_for(hub):
    Checkpoint.find("hf:some/model")
    assert hub == [("some/model", None)]


def test_what_is_not_there_is_one_line(hub):
    with pytest.raises(
        FileNotFoundError,
        match=r"checkpoint 'hf:some/other': not on the hub or not reachable \(404 Client Error.\)$",
    ):
        Checkpoint.find("hf:some/other")


@pytest.mark.parametrize("name", ["hf:model", "hf:a/b/c", "hf:/b", "hf:"])
def test_names_that_cannot_be_are_not_asked_for(hub, name):
    with pytest.raises(ValueError, match="give hf:ORG/NAME"):
        Checkpoint.find(name)
    assert hub == []


def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(ValueError, match=r"needs huggingface_hub: pip install 'uniart_jax\[hub\]'"):
        Checkpoint.find("hf:some/model")


@pytest.mark.skipif(importlib.util.find_spec("huggingface_hub") is None, reason="an extra: hub")
def test_the_hubs_own_cache_is_read_offline(tmp_path):
    """huggingface_hub itself, in a program that has no network: what its cache holds, and what it
    does not hold."""
    revision = "0123456789abcdef0123456789abcdef01234567"
    repository = tmp_path / "models--some--model"
    write_config(repository / "snapshots" / revision, Config(name="theirs"))
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text(revision)
    code = (
        "import sys; from uniart_jax.models.checkpoint import Checkpoint\n"
        "for name in sys.argv[1:]:\n"
        "    try: print(Checkpoint.find(name).config.name)\n"
        "    except FileNotFoundError as error: print(error)"
    )
    names = ["hf:some/model", f"hf:some/model@{revision}", "hf:some/other"]
    told = subprocess.run(
        [sys.executable, "-c", code, *names],
        env={**os.environ, "HF_HUB_CACHE": str(tmp_path), "HF_HUB_OFFLINE": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    *found, missing = told.stdout.splitlines()
    assert found == ["theirs", "theirs"]
    assert missing.startswith("checkpoint 'hf:some/other': not on the hub or not reachable (")
