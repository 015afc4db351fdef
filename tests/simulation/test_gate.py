"""The published gate: a sound asset passes, and every rule catches the fault that it is there for,
by name."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco", reason="pip install 'uniart_jax[mujoco]'")

from planted_assets import cabinet  # noqa: E402

from uniart_jax.simulation import gate as module  # noqa: E402
from uniart_jax.simulation.reading import Description  # noqa: E402
from uniart_jax.simulation.validate import gate  # noqa: E402

RULES = {
    "shapes", "inertia", "anchor", "gravity", "mobility", "finite", "initial_penetration",
    "self_penetration", "support", "settle_shift", "settle_turn", "floor",
}  # fmt: skip
BLOCK = '<geom type="box" size=".2 .2 .2"/>'
DOOR = (
    '<joint name="hinge" axis="0 0 1" pos="0 .2 0" range="0 1.5"/><geom type="box" size=".02 .19 '
    '.15"/>'
)


def body(name: str, inner: str, place: str = "") -> str:
    return f'<body name="{name}" {place}>{inner}</body>'


def model(world: str, more: str = "") -> str:
    return f'<mujoco><compiler angle="radian"/><worldbody>{world}</worldbody>{more}</mujoco>'


def chest(root: str = "", door: str = DOOR, more: str = "", inner: str = "") -> str:
    """A block with a door on its front, 3 cm off."""
    return model(
        body("block", root + BLOCK + body("door", door, 'pos="-.25 0 0"') + inner, 'pos="0 0 1"'),
        more,
    )


@pytest.fixture
def judge(tmp_path):
    """A function: MJCF text -> what the gate says of it."""

    def call(text: str) -> dict:
        folder = tmp_path / "asset"
        folder.mkdir(exist_ok=True)
        path = folder / "model.xml"
        path.write_text(text)
        description = Description(path, False)
        description.read()
        return module.judge(path, description.plan)

    return call


def failed(found: dict) -> set[str]:
    assert set(found["checks"]) == RULES
    return {name for name, verdict in found["checks"].items() if not verdict["passed"]}


def test_a_sound_asset_passes(judge):
    found = judge(chest())
    assert failed(found) == set() and found["articulated"]
    assert not judge(model(body("block", BLOCK)))["articulated"]


def test_where_the_file_has_its_origin_and_its_own_floor_do_not_matter(judge):
    """It is put on the gate's floor with nothing that holds it, from wherever it is."""
    floor = '<geom type="plane" size="1 1 1" pos="0 0 .9"/>'
    assert failed(judge(chest().replace("<worldbody>", f"<worldbody>{floor}"))) == set()
    assert failed(judge(chest(root="<freejoint/>"))) == set()


ROUND = (
    '<geom type="sphere" size=".2"/><inertial pos=".15 0 0" mass="5" diaginertia=".05 .05 .05"/>'
)
TWO = body(
    "a", '<geom type="box" size=".1 .1 .1"/><joint type="slide" range="0 .1"/>', 'pos=".5 0 0"'
)
OTHER = body(
    "b", '<geom type="box" size=".1 .1 .1"/><joint type="slide" range="0 .1"/>', 'pos=".5 .{} 0"'
)


@pytest.mark.parametrize(
    ("text", "rules", "words"),
    [
        (model(body("ball", ROUND)), {"settle_shift", "settle_turn"}, ""),
        (
            chest(inner=TWO + OTHER.format("195")),
            {"initial_penetration", "self_penetration"},
            "'a' and 'b' share 5 mm",
        ),
        (
            chest(
                inner=TWO + OTHER.format("195"),
                more='<contact><exclude body1="a" body2="b"/></contact>',
            ),
            {"initial_penetration", "self_penetration"},
            "'a' and 'b'",
        ),
        (chest(root='<joint name="swing" axis="0 0 1"/>'), {"anchor", "support"}, "joint 'swing'"),
        (
            chest(more='<equality><weld body1="block"/></equality>'),
            {"anchor", "support"},
            "an equality holds 'block'",
        ),
        (
            chest().replace("<worldbody>", "<worldbody>" + BLOCK),
            {"anchor"},
            "belongs to the world",
        ),
        (
            chest().replace("<worldbody>", "<worldbody>" + body("other", BLOCK, 'pos="2 0 1"')),
            {"anchor"},
            "bodies 'other', 'block'",
        ),
        (
            chest(inner=body("sensor", '<inertial pos="0 0 0" mass=".1" diaginertia=".1 .1 .1"/>')),
            {"shapes"},
            "body 'sensor' has no shape",
        ),
        (
            model(
                body("block", BLOCK.replace("/>", ' solref=".6 1" solimp=".01 .01 1" priority="1"/>'))  # noqa: E501
            ),
            {"floor"},
            "",
        ),
        (
            chest(door=DOOR.replace("hinge", "slide", 1).replace('axis', 'type="slide" axis').replace('range="0 1.5"', "")),  # noqa: E501
            {"mobility"},
            "joint 'slide' slides without an end",
        ),
        (chest().replace('name="door"', 'name="door" gravcomp="1"'), {"gravity"}, "body 'door'"),
    ],
)  # fmt: skip
def test_every_fault_is_caught_by_its_rule(judge, text, rules, words):
    found = judge(text)
    assert failed(found) == rules, found["checks"]
    assert any(words in found["checks"][rule].get("reason", "") for rule in rules)


def test_parts_that_one_joint_links_may_touch(judge):
    """As in the published gate, where a joint's two bodies do not collide."""
    assert failed(judge(chest(door=DOOR.replace('size=".02', 'size=".06')))) == set()


def test_parts_that_run_into_each_other_later_are_seen(judge):
    """A block falls along its slide, onto another that has room below it at the start."""
    heavy = (
        '<joint type="slide" axis="0 0 -1" range="0 .3"/>'
        '<geom type="box" size=".1 .1 .05" mass="200" solref=".1 1"/>'
    )
    light = '<joint type="slide" axis="1 0 0" range="0 .1"/><geom type="box" size=".1 .1 .05"/>'
    inner = body("above", heavy, 'pos=".5 0 .3"') + body("below", light, 'pos=".5 0 0"')
    found = judge(chest(inner=inner).replace('size=".2 .2 .2"', 'size=".2 .2 .2" mass="900"'))
    assert "self_penetration" in failed(found) and "initial_penetration" not in failed(found)
    assert "'above' and 'below'" in found["checks"]["self_penetration"]["reason"]


def test_a_joint_starts_where_its_limits_allow(judge):
    """A slide from .1 on is at .1, out of the way of what stands where its zero is."""
    inner = body("a", TWO.partition(">")[2].removesuffix("</body>"), 'pos=".5 0 0"') + body(
        "b", '<geom type="box" size=".1 .1 .1"/><joint type="slide" axis="0 1 0" range=".25 .4"/>',
        'pos=".5 0 0"',
    )  # fmt: skip
    assert failed(judge(chest(inner=inner))) == set()


def test_a_range_that_is_not_the_description_s_is_seen(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(chest())
    description = Description(path, False)
    description.read()
    (hinge,) = description.plan.joints
    for joint, words in (
        (dataclasses.replace(hinge, hi=1.6), "joint 'hinge' goes from 0 to 1.5"),
        (dataclasses.replace(hinge, name="gone"), "joint 'gone' is not there"),
    ):
        plan = dataclasses.replace(description.plan, joints=(joint,))
        verdict = module.judge(path, plan)["checks"]["mobility"]
        assert not verdict["passed"] and verdict["reason"] == words
    assert not module.judge(path, None)["checks"]["mobility"]["passed"]


@pytest.mark.parametrize(
    ("moments", "mass", "possible"),
    [
        ((1, 1, 1), 1, True),
        ((1, 1, 2), 1, True),
        ((1, 1, 2.1), 1, False),
        ((0, 1, 1), 1, False),
        ((1, 1, 1), 0, False),
        ((1, 1, np.nan), 1, False),
    ],
)
def test_an_inertia_that_no_solid_has_is_refused(moments, mass, possible):
    compiled = mujoco.MjModel.from_xml_string(chest())
    compiled.body_inertia[2], compiled.body_mass[2] = moments, mass
    verdict = module._inertia(compiled)
    assert verdict["passed"] == possible
    assert possible or "body 'door'" in verdict["reason"]


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ('type="box" size=".1 .2 .3"', 0.3 * np.cos(0.4) + 0.2 * np.sin(0.4)),
        ('type="sphere" size=".25"', 0.25),
        ('type="capsule" size=".1 .3"', 0.1 + 0.3 * np.cos(0.4)),
        ('type="cylinder" size=".1 .3"', 0.3 * np.cos(0.4) + 0.1 * np.sin(0.4)),
        ('type="ellipsoid" size=".1 .2 .3"', np.hypot(0.3 * np.cos(0.4), 0.2 * np.sin(0.4))),
        ('type="mesh" mesh="m"', 0.3 * np.cos(0.4) + 0.2 * np.sin(0.4)),
    ],
)
def test_the_lowest_point_of_every_shape(shape, expected):
    corners = " ".join(
        f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3)
    )
    text = (
        f'<mujoco><compiler angle="radian"/><asset><mesh name="m" vertex="{corners}"/></asset>'
        f'<worldbody><body pos="0 0 1"><geom {shape} euler=".4 0 0"/></body></worldbody></mujoco>'
    )
    compiled = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    assert module._lowest(compiled, data) == pytest.approx(1 - expected)


def test_a_simulation_that_breaks_down_is_no_pass(judge):
    found = judge(chest(door=DOOR.replace("<joint", '<joint stiffness="-1e7"')))
    assert not found["checks"]["finite"]["passed"]
    assert "breaks down after" in found["checks"]["finite"]["reason"]


def test_an_asset_folder_through_the_gate(tmp_path):
    """In a process of its own; what MuJoCo refuses is a rule that failed, with its reason."""
    found = gate(cabinet(tmp_path / "a"), out=tmp_path / "out")
    assert found["gate"]["name"] == "affordcraft" and found["gate"]["passed"]
    assert set(found["gate"]["checks"]) == RULES | {"loads"}
    assert json.loads((tmp_path / "out" / "validation.json").read_text()) == found
    path = tmp_path / "b.xml"
    path.write_text(
        model(body("x", '<inertial pos="0 0 0" mass="1" diaginertia="1 1 5"/>' + BLOCK))
    )
    refused = gate(path)["gate"]
    assert not refused["passed"] and set(refused["checks"]) == {"loads"}
    assert "inertia" in refused["checks"]["loads"]["reason"]
    with pytest.raises(ValueError, match="no gate is called 'x'; choose of affordcraft"):
        gate(path, name="x")
