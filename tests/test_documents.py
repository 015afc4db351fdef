"""What the README and the benchmarks show runs as it stands there."""

import importlib.util
import re
from pathlib import Path

import jax
import pytest

from uniart_jax.cli import load_config
from uniart_jax.config import NETWORKS

ROOT = Path(__file__).parent.parent


def test_the_readmes_research_example(monkeypatch):
    section = (ROOT / "README.md").read_text().split("## Research")[1].split("\n## ")[0]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    monkeypatch.chdir(ROOT)
    names: dict = {}
    exec(code, names)
    assert names["velocity"].shape == names["x"].shape


@pytest.mark.parametrize("name", NETWORKS)
def test_benchmark_cases_fit_the_networks(name):
    path = ROOT / "benchmarks" / "networks.py"
    spec = importlib.util.spec_from_file_location("networks", path)
    assert spec is not None and spec.loader is not None
    networks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(networks)
    model = load_config(ROOT / "configs" / "nano.py").model
    network, loss, inputs = networks.case(name, model, 1)
    assert jax.eval_shape(loss, network.abstract(), *inputs).shape == ()
