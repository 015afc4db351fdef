"""The mesh, where arrays go, and that any split of the devices trains the same network."""

import socket
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
import toy_run
from jax.sharding import AbstractMesh, AxisType
from safetensors.numpy import load_file

from uniart_jax.config import MeshConfig
from uniart_jax.training.export import flat_names
from uniart_jax.training.sharding import make_mesh, put_batch, state_sharding

TOLERANCE = 1e-5


@pytest.fixture(scope="module")
def one_device(tmp_path_factory):
    state = toy_run.train(
        tmp_path_factory.mktemp("one"), toy_run.make_stage(5, 100), toy_run.make_batches()
    )
    return {name: np.asarray(leaf) for name, leaf in flat_names(state).items()}


def on_eight(workdir: Path, fsdp: int) -> dict[str, np.ndarray]:
    out = workdir / "state.npz"
    program = [sys.executable, toy_run.__file__, str(workdir), "5", "100", "--devices", "8"]
    subprocess.run([*program, "--fsdp", str(fsdp), "--out", str(out)], check=True)
    return dict(np.load(out))


def check(expected, found):
    assert expected.keys() == found.keys()
    for name, leaf in expected.items():
        np.testing.assert_allclose(found[name], leaf, rtol=0, atol=TOLERANCE, err_msg=name)


def test_one_device_equals_eight(tmp_path, one_device):
    check(one_device, on_eight(tmp_path, 2))


@pytest.mark.slow
@pytest.mark.parametrize("fsdp", [1, 4, 8])
def test_every_split_of_eight(tmp_path, one_device, fsdp):
    check(one_device, on_eight(tmp_path, fsdp))


@pytest.mark.slow
def test_a_checkpoint_of_one_device_goes_on_on_eight(tmp_path, one_device):
    toy_run.train(tmp_path, toy_run.make_stage(2, 2), toy_run.make_batches())
    check(one_device, on_eight(tmp_path, 4))


@pytest.mark.slow
def test_two_processes_equal_one_and_resume(tmp_path, one_device):
    def run(steps: int) -> None:
        with socket.socket() as probe:
            probe.bind(("localhost", 0))
            port = str(probe.getsockname()[1])
        program = [sys.executable, toy_run.__file__, str(tmp_path / "run"), str(steps), "100"]
        program += ["--devices", "2", "--fsdp", "2", "--processes", "2", "--port", port]
        outs = [["--process", str(i), "--out", str(tmp_path / f"{i}.npz")] for i in range(2)]
        processes = [subprocess.Popen([*program, *out]) for out in outs]
        assert [process.wait(timeout=300) for process in processes] == [0, 0]

    run(2)
    assert len(list((tmp_path / "run/checkpoints/toy/2/data").glob("process_*.json"))) == 2
    run(5)
    for i in range(2):
        check(one_device, dict(np.load(tmp_path / f"{i}.npz")))
    exported = load_file(tmp_path / "run/export/toy.safetensors")
    averaged = {n[4:]: v for n, v in one_device.items() if n.startswith("ema.")}
    check(averaged, exported)
    steps = [line.split(",")[0] for line in (tmp_path / "run/metrics/toy.jsonl").open()]
    assert steps == [f'{{"step": {i}' for i in range(1, 6)]


def test_state_is_split_over_its_largest_axis_that_divides():
    mesh = AbstractMesh((2, 4), ("data", "fsdp"), axis_types=(AxisType.Auto,) * 2)
    shapes = {"wide": (8, 16), "tall": (16, 6), "odd": (5, 7), "bias": (8,), "scalar": ()}
    abstract = {name: jax.ShapeDtypeStruct(shape, np.float32) for name, shape in shapes.items()}
    specs = {name: tuple(s.spec) for name, s in state_sharding(mesh, abstract, 64).items()}
    assert specs == {"wide": (None, "fsdp"), "tall": ("fsdp",), "odd": (), "bias": (), "scalar": ()}
    assert all(not s.spec for s in state_sharding(mesh, abstract).values())  # all are small


def test_mesh_sizes():
    count = jax.device_count()
    mesh = make_mesh(MeshConfig())
    assert dict(mesh.shape) == {"data": count, "fsdp": 1}
    assert set(mesh.axis_types) == {AxisType.Auto}
    for bad in (MeshConfig(data=count + 1), MeshConfig(data=-1, fsdp=-1), MeshConfig(fsdp=0)):
        with pytest.raises(ValueError, match=r"set mesh\.data and mesh\.fsdp"):
            make_mesh(bad)


def test_batches_keep_values_and_structure():
    batch = {"x": np.arange(6).reshape(3, 2), "plan": (np.zeros((0, 4), np.int32), np.float32(2))}
    placed = put_batch(batch, make_mesh(MeshConfig()))
    assert jax.tree.structure(placed) == jax.tree.structure(batch)
    for ours, theirs in zip(jax.tree.leaves(placed), jax.tree.leaves(batch), strict=True):
        np.testing.assert_array_equal(np.asarray(ours), theirs)
