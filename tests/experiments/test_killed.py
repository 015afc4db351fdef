"""``kill -9`` in the middle of a training: the same command goes on, and ends with what an
undisturbed one ends with, to the last digit."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILE = """
import dataclasses
from pathlib import Path
from uniart_jax.cli import load_config
from uniart_jax.experiments.design import Arm, Experiment, Records

def experiment(size):
    config = load_config(Path({debug!r}))
    model = dataclasses.replace(config.model, grid=dataclasses.replace(config.model.grid, resolution=16))
    data = dataclasses.replace(config.data, records={records!r}, validation="", procedural=0, voxel_buckets=(4096,))
    stage = dataclasses.replace(config.uniart_vae, steps=30, save_every=2)
    config = dataclasses.replace(config, model=model, data=data, uniart_vae=stage)
    records = Records({records!r}, families=("bottle",), count=2, views=1)
    arms = {{"uniart": Arm(config, ("uniart_vae",), "vae")}}
    return Experiment(arms, "uniart", ("as_chamfer",), seeds=1, count=1, records=(records,))
"""  # noqa: E501


def start(file: Path, out: Path, log: Path) -> subprocess.Popen:
    code = "from uniart_jax.cli import main; main()"
    env = {**os.environ, "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}
    with log.open("w") as stream:
        return subprocess.Popen(
            [sys.executable, "-c", code, "experiment", str(file), "--out", str(out)],
            stdout=stream,
            stderr=stream,
            env=env,
            cwd=ROOT,
        )


@pytest.mark.slow
def test_a_killed_experiment_goes_on(tmp_path):
    file = tmp_path / "toy.py"
    file.write_text(FILE.format(debug=str(ROOT / "configs/debug.py"), records=str(tmp_path / "r")))
    log = tmp_path / "log"
    killed, straight = tmp_path / "killed", tmp_path / "straight"
    process = start(file, killed, log)
    saved = killed / "uniart/seed-0/checkpoints/uniart_vae"
    while process.poll() is None and not any(p.name.isdigit() for p in saved.glob("*")):
        time.sleep(0.05)
    process.kill()
    process.wait()
    assert not list(killed.glob("uniart/seed-0/figures/*")), log.read_text()
    assert start(file, killed, log).wait() == 0, log.read_text()
    assert "resumed at step" in log.read_text()
    assert start(file, straight, log).wait() == 0, log.read_text()
    for name in ("table.md", "metrics.json", "uniart/settings.json"):
        assert (killed / name).read_bytes() == (straight / name).read_bytes()
