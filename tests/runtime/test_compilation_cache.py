"""Programs compiled in less time: what is set, and who asks for it."""

import os
import subprocess
import sys
from importlib import metadata

import jax
import pytest

import uniart_jax
from uniart_jax.cli.train import train
from uniart_jax.config import load_config
from uniart_jax.runtime import compilation_cache, program_cache
from uniart_jax.runtime.compilation_cache import QUICK_XLA, TRIED_JAXLIB, quick_compile
from uniart_jax.stages import Trainer

CACHE = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")


@pytest.fixture
def settings(monkeypatch):
    """JAX's setting and XLA's options, put back at the end."""
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", False)
    monkeypatch.setenv("XLA_FLAGS", "--one=1")
    yield monkeypatch
    jax.config.update("jax_disable_most_optimizations", before)


def test_xla_options_are_added_once_and_only_where_they_were_tried(settings):
    settings.setattr(compilation_cache.metadata, "version", lambda name: "99.0")
    quick_compile()
    assert os.environ["XLA_FLAGS"] == "--one=1"
    assert jax.config.read("jax_disable_most_optimizations")
    settings.setattr(
        compilation_cache.metadata, "version", lambda name: compilation_cache.TRIED_JAXLIB
    )
    quick_compile()
    quick_compile()
    assert os.environ["XLA_FLAGS"] == f"{QUICK_XLA} --one=1"


def test_xla_takes_the_options_and_computes_the_same():
    code = """
from uniart_jax.runtime.compilation_cache import quick_compile
quick_compile()
import os, jax, jax.numpy as jnp
print(jax.config.read("jax_disable_most_optimizations"), os.environ.get("XLA_FLAGS", ""))
print(float(jnp.tanh(jnp.arange(6.0)).reshape(2, 3).sum()))
"""
    env = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS",)}
    env["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "0"
    found = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=300
    )
    assert found.returncode == 0, found.stderr
    settings, value = found.stdout.splitlines()
    tried = metadata.version("jaxlib") == TRIED_JAXLIB
    assert settings.strip() == f"True {QUICK_XLA if tried else ''}".strip()
    assert float(value) == pytest.approx(4.719915, abs=1e-5)


def test_only_the_config_that_runs_for_a_moment_compiles_quickly():
    quick = {name: load_config(name).quick_compile for name in ("debug", "nano", "small", "paper")}
    assert quick == {"debug": True, "nano": False, "small": False, "paper": False}


def test_programs_and_notebooks_keep_programs_as_command_lines_do(settings, tmp_path):
    before = {name: getattr(jax.config, name) for name in CACHE}
    folder = program_cache._folder
    settings.setenv("XDG_CACHE_HOME", str(tmp_path))
    try:
        jax.config.update("jax_compilation_cache_dir", None)
        uniart_jax.keep_programs()
        assert not jax.config.read("jax_disable_most_optimizations")
        kept = tmp_path / "uniart_jax"
        assert jax.config.jax_compilation_cache_dir == str(kept / "xla")
        assert program_cache._folder == kept / "programs"
        uniart_jax.keep_programs(quick=True)
        assert jax.config.read("jax_disable_most_optimizations")
    finally:
        program_cache.keep_programs(folder)
        for name, value in before.items():
            jax.config.update(name, value)


@pytest.mark.parametrize("asked", ["quick-compile", "no-quick-compile"])
def test_train_asks_for_it_where_the_config_does(monkeypatch, asked):
    called = []
    monkeypatch.setattr(compilation_cache, "quick_compile", lambda: called.append("quick"))
    monkeypatch.setattr(compilation_cache, "enable_compilation_cache", lambda: None)
    monkeypatch.setattr(Trainer, "fit", lambda self, stages: called.append("fit"))
    train(["--config", "debug", f"--{asked}"])
    assert called == (["fit"] if asked.startswith("no") else ["quick", "fit"])
