"""What scripts of benchmarks/ make of their measurements, by numbers known beforehand."""

import dataclasses
import math
import os
import subprocess
import sys
from pathlib import Path

import collectives
import collision_budget
import jax
import mujoco
import numpy as np
import predict_training
import pytest
import sampling
import spread
import standing
import step_overhead
import stepped_copies
import trimesh

from uniart_jax.config import Config, FlowConfig, ModelConfig, StageConfig
from uniart_jax.models.network import build
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.procedural import generate


def test_saves_are_counted_as_often_as_a_run_has_them():
    in_run = step_overhead.in_run
    times = [10.0 + i for i in range(41)]  # 40 steps of a second, two of them with a save in it
    times = [t + 3 * (t > 15) + 3 * (t > 35) for t in times]
    held = [(2.0, 9.0), (15.5, 3.0), (38.9, 3.0), (90.0, 5.0)]  # the first and last outside
    loop, save = in_run(times, held, save_every=20)
    assert (loop, save) == pytest.approx((46.0, 3.0))
    assert in_run(times, held, save_every=400)[0] == pytest.approx(40.3)
    assert in_run(times, [], save_every=400) == pytest.approx((46.0, 0.0))


def test_stages_of_sampling_are_called_after_what_the_program_tells():
    lines = ("· loading the model\n", "· oven.png: 9731 voxels\n", "· a: b.png: structure\n")
    names = [sampling._stage(line) for line in lines]
    assert names == ["loading the model", "voxels", "structure"]
    used, peak = sampling._used(os.getpid())
    assert 0 < used < 1e5 and 0.05 < peak < 50


def test_what_samples_agree_on_is_counted_by_joints_and_drawn_by_objects():
    sure, torn, none = (
        np.array([[2, 1.0], [2, 1]]),
        np.array([[1, 0.0], [1, 1], [2, 0]]),
        np.zeros((0, 2)),
    )
    alone, both = spread.by_agreement([sure, torn, none], 2)
    assert (alone["joints"], alone["right"]) == (2, 0.5)
    assert (both["joints"], both["right"]) == (3, pytest.approx(2 / 3))
    assert both["least"] == 0 and both["most"] == 1
    assert alone["least"] == alone["most"] == 0.5  # of one object alone
    truth = generate("microwave", 0)
    rows = spread.agreement([truth, truth, truth], truth)
    moving = sum(part.joint.type != "fixed" for part in truth.parts)
    np.testing.assert_array_equal(rows, [[3, 1]] * (3 * moving))
    turned = next(k for k, part in enumerate(truth.parts) if part.joint.type != "fixed")
    parts = list(truth.parts)
    parts[turned] = dataclasses.replace(parts[turned], joint=Joint.fixed())
    other = dataclasses.replace(truth, parts=tuple(parts))
    rows = spread.agreement([truth, other], truth)
    assert (rows[:, 0] == 1).sum() == 1 and (rows[:, 1] == 1).all()


def test_a_field_of_copies_shares_meshes_and_each_has_its_own_joint(tmp_path):
    block = trimesh.creation.box([0.4, 0.4, 0.4])
    lid = trimesh.creation.icosphere(1, 0.2).apply_translation([0, 0, 0.41])  # a hull: a mesh
    turn = Joint([0.2, 0, 0.2], [0, 1, 0], (0, 1.0))
    obj = ArticulatedObject((Part("block", block), Part("lid", lid, 0, turn)))
    asset = obj.save(tmp_path / "a", formats=("mjcf",), motion=False)
    text = stepped_copies.many(asset, 5)
    model = mujoco.MjModel.from_xml_string(text, stepped_copies.files(asset))
    assert model.nbody == 1 + 5 * 3 and model.nexclude == 5  # two and a ball
    assert model.nmesh == 1 and model.ngeom == 5 * 3 and model.ntex == 0
    assert {model.joint(f"{i}/lid_joint").range[1] for i in range(5)} == {1.0}
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    places = np.array([data.body(f"{i}/block").xpos for i in range(5)])
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)[np.triu_indices(5, 1)]
    assert apart.min() > 0.8 and data.ncon == 0
    assert stepped_copies.speed(asset, 2) > 0


@pytest.mark.parametrize(("copies", "models"), [(300, [100] * 3), (20, [20])])
def test_copies_stand_in_models_of_a_hundred(tmp_path, monkeypatch, copies, models):
    body = "<body><geom size='1'/></body>"
    made = lambda asset, n: f"<mujoco><worldbody>{body * n}</worldbody></mujoco>"  # noqa: E731
    monkeypatch.setattr(stepped_copies, "many", made)
    pairs = stepped_copies.fields(tmp_path, copies)
    assert [model.nbody - 1 for model, _ in pairs] == models
    assert len({id(part) for pair in pairs for part in pair}) == 2 * len(models)


@pytest.mark.slow
def test_what_takes_too_long_is_left_out():
    block = trimesh.creation.box([0.4, 0.4, 0.4])
    work = (ArticulatedObject((Part("block", block),)), None, "merged", False, 2)
    assert collision_budget.within(1, *work) is None
    found = collision_budget.within(120, *work)
    assert found is not None and (found["shapes"], found["balls"]) == (1, [])


def test_a_table_of_shapes_has_a_row_for_each_setting(capsys):
    chosen = collision_budget.settings(32, ["no-budget", "merged", "hull"])
    assert chosen == {
        "no budget": (None, "merged"),
        "budget 32": (32, "merged"),
        "hull": (32, "hull"),
    }
    one = {"shapes": 4, "MB": 1.0, "error": 0.1, "seconds": 2.0}
    one |= {"balls": [True, False], "speed": 1000.0}
    two = one | {"shapes": 8, "seconds": 4.0, "balls": []}
    lines = collision_budget.table({"real": {"hull": [one, two]}}).splitlines()
    assert lines[2] == "| real, hull | 2 | 6, 8 | 1.00 | 0.100 | 3.0 | 1 of 2 | 1,000 |"
    del one["seconds"]  # of folders that lie there
    lines = collision_budget.table({"generated": {"as written": [one]}}).splitlines()
    assert lines[2] == "| generated, as written | 1 | 4, 4 | 1.00 | 0.100 | – | 1 of 2 | 1,000 |"


def test_a_training_is_predicted_from_its_compiled_step():
    flow = FlowConfig(model_channels=32, num_blocks=1, num_heads=2, cond_channels=16)
    stage = StageConfig(batch_size=16, steps=86_400)
    config = Config(model=ModelConfig(structure_flow=flow), structure_flow=stage)
    parameters, beside = predict_training.program("structure_flow", config, 1)
    assert parameters == sum(
        math.prod(p.shape)
        for p in jax.tree.leaves(build("structure_flow", config.model).abstract())
    )
    assert beside > 4 * 16**3 * 32  # a layer's activations at the least
    assert predict_training.useful_flops("structure_flow", config) > 6 * 16**3 * parameters / 2

    machine = predict_training.Machine("two", 2, peak=1e12, memory=2.76, link=1e9)
    cost = {"flops": 1e10, "parameters": 10**6, "first": 2**30, "more": 2**28}
    row = predict_training.predict("structure_flow", config, machine, cost, share=0.5)
    assert row["step s"] == pytest.approx(16e10 / (2 * 1e12 * 0.5))  # longer than the exchange
    assert row["all-reduce s"] == pytest.approx(0.004)
    gib = [2.75 + 16e6 / n / 2**30 for n in (1, 2)]
    assert (row["GiB"], row["GiB, fsdp"]) == pytest.approx(gib)
    assert (row["fits"], row["days"]) == ("with fsdp", pytest.approx(row["step s"]))


HLO = """
%body (p: (s32[], f32[8,100])) -> (s32[], f32[8,100]) {
  %g = bf16[8,100]{1,0} all-gather(bf16[1,100]{1,0} %x), channel_id=1, replica_groups=[1,8]<=[8], dimensions={0}
}

%cond (p: (s32[], f32[8,100])) -> pred[] {
  %c = pred[] compare(s32[] %a, s32[] %b), direction=LT
}

ENTRY %main (p: f32[100]) -> f32[100] {
  %w = (s32[], f32[8,100]{1,0}) while((s32[], f32[8,100]{1,0}) %t), condition=%cond, body=%body, backend_config={"known_trip_count":{"n":"3"}}
  %r = (f32[100]{0}, f32[4]{0}) all-reduce(f32[100]{0} %p, f32[4]{0} %q), replica_groups={{0,1,2,3},{4,5,6,7}}, to_apply=%add
  ROOT %s = f32[25]{0} reduce-scatter(f32[100]{0} %p), replica_groups=[2,4]<=[8], dimensions={0}, to_apply=%add
}
"""  # noqa: E501


def test_what_a_device_receives_is_read_off_a_program():
    moved = collectives.received(HLO, 8)
    assert moved["all-gather"] == 3 * 1600 * 7 // 8  # of eight, three times
    assert moved["all-reduce"] == 2 * 416 * 3 // 4  # of four, both results
    assert moved["reduce-scatter"] == 100 * 3
    assert set(moved) == {"all-gather", "all-reduce", "reduce-scatter"}


SPLIT = """
import jax
from collectives import received
mesh = jax.make_mesh((2, 4), ("data", "fsdp"), axis_types=(jax.sharding.AxisType.Auto,) * 2)
rows = jax.ShapeDtypeStruct((8, 4), "float32", sharding=jax.NamedSharding(mesh, jax.P("data")))
weights = jax.ShapeDtypeStruct((4, 4), "float32", sharding=jax.NamedSharding(mesh, jax.P()))
step = jax.jit(jax.grad(lambda w, x: jax.numpy.square(x @ w).sum()))
print(dict(received(step.lower(weights, rows).compile().as_text(), 8)))
"""


def test_the_gradient_by_whole_weights_of_split_rows_is_one_sum():
    """As XLA writes its programs: of two devices at a time, as the rows are split over one axis of
    the mesh."""
    env = {**os.environ, "JAX_PLATFORMS": "cpu", "JAX_NUM_CPU_DEVICES": "8"}
    where = Path(__file__).parent.parent / "benchmarks"
    ran = subprocess.run(
        [sys.executable, "-c", SPLIT], env=env, cwd=where, text=True, capture_output=True
    )
    assert ran.stdout.strip() == str({"all-reduce": 2 * 64 * 1 // 2}), ran.stderr


def test_an_asset_with_legs_on_one_side_leans_and_one_without_any_sinks(tmp_path):
    legs = [trimesh.creation.box((0.05, 0.05, 0.4)) for _ in range(4)]
    for leg, (x, y) in zip(legs, ((-1, -1), (-1, 1), (1, -1), (1, 1)), strict=True):
        leg.apply_translation([0.3 * x, 0.4 * y, 0])
    top = trimesh.creation.box((0.7, 0.9, 0.05)).apply_translation([0, 0, 0.22])
    table = trimesh.boolean.union([top, *legs], engine="manifold")
    ArticulatedObject((Part("base", table),)).save(tmp_path / "a", formats=("mjcf",), motion=False)
    path = tmp_path / "a" / "object.xml"
    sunk, leaning, names = standing.dropped(path)
    assert abs(sunk) < 0.005 and leaning < 0.5 and names == {"base"}
    spec = mujoco.MjSpec.from_file(str(path))
    low = [g for g in spec.geoms if g.group == 3 and g.size[2] > 0.1]  # the legs
    assert len(low) == 4
    found = []
    for gone in (1, -1):
        for geom in [g for g in low if g.pos[1] * gone > 0]:
            spec.delete(geom)
        spec.compile()
        path.write_text(spec.to_xml())
        found.append(standing.dropped(path))
    assert found[0][1] > 5 and found[1][0] > 0.3 and found[1][1] < 1
