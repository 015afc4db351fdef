"""Programs compiled in less time: what is set, and who asks for it."""

import os
import subprocess
import sys

import jax
import pytest

from uniart_jax.config import load_config
from uniart_jax.runtime import compilation_cache
from uniart_jax.runtime.compilation_cache import QUICK_XLA, quick_compile


@pytest.fixture
def settings(monkeypatch):
    """JAX's setting and XLA's options, put back at the end."""
    before = jax.config.read("jax_disable_most_optimizations")
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
import jax.numpy as jnp
print(float(jnp.tanh(jnp.arange(6.0)).reshape(2, 3).sum()))
"""
    env = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS",)}
    env["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "0"
    found = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=300
    )
    assert found.returncode == 0, found.stderr
    assert float(found.stdout) == pytest.approx(4.7196, abs=1e-3)


def test_only_the_config_that_runs_for_a_moment_compiles_quickly():
    quick = {name: load_config(name).quick_compile for name in ("debug", "nano", "small", "paper")}
    assert quick == {"debug": True, "nano": False, "small": False, "paper": False}
