"""Each engine against what mechanics says, on assets whose numbers are known: depths, friction,
damping, screws, energy, the hand."""

from __future__ import annotations

import functools
import gc
from pathlib import Path

import numpy as np
import pytest
from planted_assets import cabinet, chest, corner, jar, joint, link, robot, slider, solid, write

from uniart_jax.export.physics import GRAVITY
from uniart_jax.simulation.planning import plan_asset
from uniart_jax.simulation.primitives import FORCE, _hand, compound, drive
from uniart_jax.simulation.reading import Description, descriptions
from uniart_jax.simulation.stand import leave_alone
from uniart_jax.simulation.summary import is_sound
from uniart_jax.simulation.sweep import opens_beside, sweep
from uniart_jax.simulation.validate import validate
from uniart_jax.simulation.worker import load

pytest.importorskip("mujoco", reason="pip install 'uniart_jax[mujoco]'")
both = pytest.mark.parametrize(
    "name", ["mujoco", pytest.param("pybullet", marks=pytest.mark.pybullet)]
)
MASS = solid([([0, 0, 0], [0.1, 0.1, 0.1])])[0]  # of the slider's block


def loaded(name: str, asset: Path):
    description: Description = descriptions(asset, False)[name]
    description.read()
    staged, why = description.stage(name, asset / f"staged-{name}")
    assert staged is not None and description.plan is not None, why
    return load(name, staged, description.plan)


def run(engine, seconds: float, push=None) -> None:
    for _ in range(round(seconds / engine.timestep)):
        if push is not None:
            at, _ = engine.point("block", np.zeros(3))
            engine.push("block", at, np.array(push))
        engine.step()


@both
def test_depths_are_those_of_the_boxes(name, tmp_path):
    engine = loaded(name, slider(tmp_path / "a"))
    way = sweep(engine, engine.plan.joints[0], engine.depths({}))
    assert engine.plan.size == pytest.approx(1.0)
    expected = np.maximum(0, way.values - 0.1)  # metres, of an object one metre long
    assert way.depth == pytest.approx(expected, abs=1e-3)
    assert way.free == pytest.approx(0.5, abs=1e-6) and set(way.pairs[-1] or ()) == {
        "block",
        "rail",
    }


@pytest.mark.pybullet
def test_an_engine_that_is_let_go_gives_its_memory_back(tmp_path):
    import pybullet

    engine = loaded("pybullet", slider(tmp_path / "a"))
    client = engine.sim.client
    assert pybullet.getConnectionInfo(client)["isConnected"]
    del engine
    gc.collect()
    assert not pybullet.getConnectionInfo(client)["isConnected"]


@both
def test_what_is_posed_leaves_the_simulation_as_it_is(name, tmp_path):
    engine = loaded(name, slider(tmp_path / "a", wall=0.5, damping=1.0))
    engine.reset({"slide": 0.05})
    run(engine, 0.1, (0.5, 0, 0))
    before = engine.coordinates(), engine.point("block", np.zeros(3))[1]
    path = engine.path("slide", np.array([0.0, 0.2]), "block", np.array([0.0, 0, 0.02]))
    engine.depths({"slide": 0.2})
    assert path == pytest.approx(
        np.array([[0, 0, 0.02], [0.2, 0, 0.02]]), abs=1e-6
    )  # PyBullet scales in float32
    assert engine.coordinates() == before[0]
    assert (engine.point("block", np.zeros(3))[1] == before[1]).all() and before[1][0] > 0


@both
def test_a_child_in_its_moving_parent_is_seen_whatever_the_filters(name, tmp_path):
    asset = write(
        tmp_path / "a",
        robot(
            link("rail", [([0, 0, -0.2], [1.0, 0.2, 0.02])]),
            link("block", [([0, 0, 0], [0.1, 0.1, 0.1])]),
            link("pin", [([0, 0, 0.075], [0.02, 0.02, 0.05])]),
            joint("slide", "prismatic", "rail", "block", [0, 0, 0], [1, 0, 0], (0, 0.2)),
            joint("press", "prismatic", "block", "pin", [0, 0, 0], [0, 0, -1], (0, 0.02)),
        ),
    )
    engine = loaded(name, asset)
    assert engine.depths({"slide": 0.1}).get(("block", "pin"), 0.0) < 1e-4
    assert engine.depths({"press": 0.02})["block", "pin"] == pytest.approx(0.02, abs=1e-4)


@both
def test_masses_are_those_of_the_file(name, tmp_path):
    asset = slider(tmp_path / "a")
    path = asset / "object.urdf"
    text = path.read_text()
    before = text.rpartition("<inertia ")[2].partition("/>")[0]
    path.write_text(text.replace(before, 'ixx=".03" iyy=".05" izz=".04" ixy="0" ixz="0" iyz="0"'))
    (block,) = loaded(name, asset).inertias()
    assert block.link == "block" and block.mass == pytest.approx(MASS)
    assert np.sort(block.moments) == pytest.approx([0.03, 0.04, 0.05])


@pytest.mark.slow
@both
@pytest.mark.parametrize("parts", [1, 2])
def test_an_asset_without_a_moving_joint_stands(name, tmp_path, parts):
    foot = [
        link("foot", [([0, 0, 0], [0.1, 0.1, 0.1])]),
        joint("held", "fixed", "top", "foot", [0, 0, -0.1], None),
    ]
    asset = write(
        tmp_path / "a", robot(link("top", [([0, 0, 0], [0.3, 0.3, 0.1])]), *foot[: 2 * parts - 2])
    )
    result = validate(asset, engines=[name])
    assert is_sound(result), result
    assert {"loads", "overlap", "stands"} <= set(result["engines"][name])


@both
def test_a_point_moves_as_fast_as_it_goes(name, tmp_path):
    engine = loaded(name, chest(tmp_path / "a", friction=0.0))
    engine.reset({"flip": 1.25})
    corner = engine.local("lid", [-0.3, 0.4, 0.5])
    for _ in range(100):
        before = engine.point("lid", corner)[0]
        engine.step()
    after, velocity = engine.point("lid", corner)
    assert velocity == pytest.approx((after - before) / engine.timestep, abs=0.02)
    assert np.linalg.norm(velocity) > 0.3


@both
def test_dry_friction_holds_or_slows(name, tmp_path):
    weight = MASS * GRAVITY
    held = loaded(name, slider(tmp_path / "a", friction=1.3 * weight, axis=(0, 0, -1)))
    held.reset({})
    run(held, 0.3)
    fall = GRAVITY * 0.09 / 2
    assert 0 <= held.coordinates()["slide"] < fall / 50  # MuJoCo's dry friction creeps
    falling = loaded(name, slider(tmp_path / "b", friction=0.5 * weight, axis=(0, 0, -1), travel=2))
    falling.reset({"slide": 0.2})
    run(falling, 0.3)
    assert falling.coordinates()["slide"] - 0.2 == pytest.approx(0.5 * fall, rel=0.03)


@both
def test_damping_gives_the_terminal_speed(name, tmp_path):
    engine = loaded(name, slider(tmp_path / "a", damping=5.0, wall=5, travel=3))
    engine.reset({})
    run(engine, 0.6, (1.0, 0, 0))
    assert engine.point("block", np.zeros(3))[1] == pytest.approx([0.2, 0, 0], abs=4e-3)
    assert engine.damping("slide") == pytest.approx(5.0)
    assert engine.friction("slide") == 0.0
    assert engine.inertia("slide") == pytest.approx(MASS, rel=1e-6)


@both
@pytest.mark.parametrize("pitch", [0.02, 0.004])
def test_a_screw_follows_its_mimic_under_load(name, tmp_path, pitch):
    engine = loaded(name, jar(tmp_path / "a", pitch=pitch))
    (turn,) = engine.plan.joints
    assert turn.kind == "screw" and turn.part == "cap"
    motion = drive(engine, [turn], engine.depths({}))
    assert motion.passed and motion.reached[0] == pytest.approx(1, abs=0.03)
    if (
        name == "mujoco"
    ):  # a URDF cannot say how stiff: MuJoCo's default lets a cap sink once nobody holds it
        engine.reset({"turn": 3.0})
    q = engine.coordinates()["turn"]
    cap = engine.point("cap", np.zeros(3))[0]
    assert q > 2 and cap == pytest.approx([0, 0, 0.2 + pitch * q], abs=1e-3)
    path = engine.path("turn", np.array([0.0, 1.0]), "cap", np.zeros(3))
    assert path[:, 2] == pytest.approx([0.2, 0.2 + pitch], abs=1e-6)


@both
def test_a_free_swing_keeps_its_energy(name, tmp_path):
    engine = loaded(name, chest(tmp_path / "a", friction=0.0))
    engine.reset({"flip": 1.25})
    energy = [engine.energy()]
    for _ in range(300):
        engine.step()
        energy.append(engine.energy())
    swing = MASS * 20 * GRAVITY * 0.3
    assert np.ptp(energy) < 0.01 * swing and engine.coordinates()["flip"] < 1.2


@both
def test_the_hand_is_soft_and_bounded(name, tmp_path):
    engine = loaded(name, slider(tmp_path / "a", wall=0.5))
    free = drive(engine, engine.plan.joints, {})
    assert free.passed and free.reached[0] == pytest.approx(1, abs=0.02)
    most = 5.77 * 0.2 / 1.5**2 * MASS  # the acceleration of a move without jerk
    assert max(free.force) == pytest.approx(most, rel=0.3)
    stuck = loaded(name, slider(tmp_path / "b", wall=0.5, damping=1e5, friction=1e4))
    motion = drive(stuck, stuck.plan.joints, {})
    limit = FORCE + 2 * MASS * GRAVITY
    assert abs(motion.reached[0]) < 0.02 and max(motion.force) == pytest.approx(limit, rel=1e-3)


@both
def test_a_hand_turns_a_light_part_that_rubs(name, tmp_path):
    """A spring as soft as its mass asks for would stay behind by more than the way."""
    weight = MASS * GRAVITY
    engine = loaded(name, slider(tmp_path / "a", wall=0.5, friction=10 * weight, travel=0.008))
    assert engine.friction("slide") == pytest.approx(10 * weight)
    (found,) = drive(engine, engine.plan.joints, {}).reached
    assert found > 0.9
    joint = engine.plan.joints[0]
    engine.reset({})
    hand = _hand(engine, joint, engine.local(joint.hand, joint.point))
    assert 10 * weight / hand.stiffness < 0.1 * 0.008  # how far it stays behind


@both
def test_a_heavy_lid_falls_and_a_stiff_one_stands(name, tmp_path):
    stiff = loaded(name, chest(tmp_path / "a", friction=30.0))
    assert leave_alone(stiff, {"flip": 0.65}).moved["flip"] < 0.05
    loose = loaded(name, chest(tmp_path / "b", friction=0.0))
    fell = leave_alone(loose, {"flip": 0.65})
    assert fell.moved["flip"] > 0.3 and fell.speed > 0.5 and fell.growth < 0.02


def plan_of(asset: Path):
    description = descriptions(asset, False)["mujoco"]
    description.read()
    assert description.robot is not None and description.obj is not None
    return plan_asset(description.robot, description.obj)


def test_a_hand_holds_the_handle_else_what_is_far_from_the_axis(tmp_path):
    door, drawer = plan_of(cabinet(tmp_path / "a")).joints
    assert drawer.hand == "drawer_handle"
    assert drawer.point == pytest.approx([-0.33, 0, -0.25])
    assert door.hand == "door" and abs(door.point[1] - 0.375) < 1e-9  # the free edge
    assert "drawer_handle" in drawer.moved and "drawer" not in door.moved


def test_flip_and_rotate_takes_a_chain_where_there_is_one(tmp_path):
    none = {"flip": (), "rotate": (), "door_hinge": (), "drawer_slide": ()}

    def chosen(joints, together):
        return [j.name for j in compound(joints, none, together) or ()]

    chain, apart = plan_of(chest(tmp_path / "a")).joints, plan_of(cabinet(tmp_path / "b")).joints
    assert chosen(chain, lambda a, b: True) == ["flip", "rotate"]
    assert chosen(chain, lambda a, b: False) == ["flip", "rotate"]  # never passed over
    assert chosen(apart, lambda a, b: True) == ["door_hinge", "drawer_slide"]
    assert chosen(apart, lambda a, b: a.name == "drawer_slide") == ["drawer_slide", "door_hinge"]
    assert chosen(apart, lambda a, b: False) == ["door_hinge", "drawer_slide"]
    assert compound(plan_of(jar(tmp_path / "c")).joints, {"turn": ()}, lambda a, b: True) is None


@both
def test_flip_and_rotate_leaves_out_joints_that_bar_each_other(name, tmp_path):
    engine = loaded(name, corner(tmp_path))
    first, second, third = engine.plan.joints
    at_rest = engine.depths({})
    beside = functools.partial(opens_beside, engine, at_rest=at_rest)
    assert not beside(first, second) and not beside(second, first)
    assert beside(first, third) and beside(third, second)
    none = {joint.name: () for joint in engine.plan.joints}
    assert compound(engine.plan.joints, none, beside) == (first, third)
    assert drive(engine, (first, third), at_rest).passed
    assert not drive(engine, (first, second), at_rest).passed
