"""The mesh, where arrays go, and that any split of the devices trains the same network."""

import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
import toy_run
from collectives import least, received
from jax.sharding import AbstractMesh, AxisType

from uniart_jax.config import MeshConfig
from uniart_jax.models.network import flat_names
from uniart_jax.training.sharding import make_mesh, put_batch, split_words, state_sharding

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


@pytest.mark.slow  # by day two processes of four devices (test_distributed.py)
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


BORN = """
import sys
import jax, numpy as np
jax.config.update("jax_num_cpu_devices", 8)
from uniart_jax.config import MeshConfig, StageConfig
from uniart_jax.training.sharding import make_mesh
from uniart_jax.training.state import create_state, make_optimizer

def init(key):
    return {n: jax.random.normal(jax.random.fold_in(key, i), (512, 256)) for i, n in enumerate("abc")}

fsdp = int(sys.argv[1])
state = create_state(init, make_optimizer(StageConfig()), jax.random.key(0), make_mesh(MeshConfig(fsdp=fsdp)))
jax.block_until_ready(state)
held = np.zeros(8, int)
for array in jax.live_arrays():  # whatever was left behind counts too
    for shard in array.addressable_shards:
        held[shard.device.id] += shard.data.nbytes
whole = sum(leaf.nbytes for leaf in jax.tree.leaves(state))
assert whole > 4 * 3 * 512 * 256 * 4  # weights, two moments, average
print(held.max() / whole)
"""  # noqa: E501


@pytest.mark.parametrize("fsdp", [2, pytest.param(8, marks=pytest.mark.slow)])
def test_no_device_holds_more_than_its_part_of_the_state(fsdp):
    program = [sys.executable, "-c", BORN, str(fsdp)]
    share = subprocess.run(program, check=True, text=True, capture_output=True).stdout
    assert float(share) < 1.01 / fsdp


STEP = """
import dataclasses, os, sys
from pathlib import Path
cheap = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {cheap}"
import jax
jax.config.update("jax_num_cpu_devices", 4)
folder, accumulate = Path(sys.argv[1]), int(sys.argv[2])
sys.path[:0] = sys.argv[3:]
import tiny_run
tiny_run.make_records(folder)
import jax.numpy as jnp
from uniart_jax.models.network import build
from uniart_jax.stages import STAGES
from uniart_jax.stages.train_network import make_put, make_step, stage_batches
from uniart_jax.training.sharding import make_mesh
from uniart_jax.training.state import create_state, make_optimizer
config = tiny_run.make_config(folder)
stage = dataclasses.replace(config.uniart_vae, accumulate=accumulate)
config = dataclasses.replace(config, uniart_vae=stage)
mesh, network, optimizer = make_mesh(config.mesh), build("uniart_vae", config.model), make_optimizer(stage)
batch = next(iter(stage_batches(STAGES["uniart_vae"], config, folder)))
batch = make_put(STAGES["uniart_vae"], mesh, config.model, accumulate)(batch)
parts = batch if accumulate > 1 else (batch,)
assert all(len(p.inverse) == 4 for part in parts for p in part.plans.values())
step = make_step(STAGES["uniart_vae"], network, optimizer, config, folder, mesh, {})
zeros = lambda key: jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), network.abstract())
state = create_state(zeros, optimizer, jax.random.key(0), mesh)
print(sum(leaf.size for leaf in jax.tree.leaves(state.params)))
print(step.compile(state, batch, jax.random.key(0)).call.as_text())
"""  # noqa: E501


@pytest.mark.parametrize("accumulate", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_step_as_train_makes_it_sends_no_tokens(tmp_path, accumulate):
    """From the batches that a stage reads to its compiled program: plans of a share a device,
    traced where the mesh is known."""
    where = [str(Path(toy_run.__file__).parent), str(Path(__file__).parents[1] / "data")]
    program = [sys.executable, "-c", STEP, str(tmp_path), str(accumulate), *where]
    text = subprocess.run(program, check=True, text=True, capture_output=True).stdout
    parameters, _, text = text.partition("\n")
    moved = received(text, 4)
    assert set(moved) <= {"all-reduce"}
    needed = accumulate * least(int(parameters), 4)  # once a micro-batch
    assert 0.95 < moved["all-reduce"] / needed < 1.02


def test_state_is_split_over_its_largest_axis_that_divides():
    mesh = AbstractMesh((2, 4), ("data", "fsdp"), axis_types=(AxisType.Auto,) * 2)
    shapes = {"wide": (8, 16), "tall": (16, 6), "odd": (5, 7), "bias": (8,), "scalar": ()}
    abstract = {name: jax.ShapeDtypeStruct(shape, np.float32) for name, shape in shapes.items()}
    specs = {name: tuple(s.spec) for name, s in state_sharding(mesh, abstract, 64).items()}
    assert specs == {"wide": (None, "fsdp"), "tall": ("fsdp",), "odd": (), "bias": (), "scalar": ()}
    assert all(not s.spec for s in state_sharding(mesh, abstract).values())  # all are small


def test_what_is_split_is_told():
    mesh = AbstractMesh((2, 4), ("data", "fsdp"), axis_types=(AxisType.Auto,) * 2)
    shapes = {"wide": (4000, 4000), "bias": (4, 500_000)}
    abstract = {name: jax.ShapeDtypeStruct(shape, np.float32) for name, shape in shapes.items()}

    def told(mesh, least):
        places = state_sharding(mesh, abstract, least)
        return split_words(mesh, jax.tree.map(lambda a, s: a.update(sharding=s), abstract, places))

    assert told(mesh, MeshConfig().min_split) == "fsdp 4: 100 % of 18 M numbers split"
    assert told(mesh, 3_000_000) == "fsdp 4: 89 % of 18 M numbers split"
    one = AbstractMesh((8, 1), ("data", "fsdp"), axis_types=(AxisType.Auto,) * 2)
    assert told(one, 1) == ""


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
