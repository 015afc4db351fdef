"""A hand that pulls at the handle with 25 N opens every joint of light objects and of heavy
ones."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.export.asset import save_asset

FORCE = 25.0  # N
SECONDS = 8.0
OPEN = 0.7  # of the range
OBJECTS = [("oven", 900_001), ("refrigerator", 900_001), ("table", 900_001), ("box", 900_001)]


def pulled(model: mujoco.MjModel, part: dict, report: dict) -> float:
    """Share of the way that a joint comes from rest when its handle is pulled along its path."""
    data = mujoco.MjData(model)
    for name, q in report["rest"].items():
        data.joint(name).qpos[0] = q
    mujoco.mj_forward(model, data)
    joint = model.joint(f"{part['name']}_joint")
    held = part["handle"]
    body = model.body(held["part"]).id
    point = np.array(held["point"])
    local = data.xmat[body].reshape(3, 3).T @ (point - data.xpos[body])
    dof, address = int(joint.dofadr[0]), int(joint.qposadr[0])
    start = float(data.qpos[address])
    low, high = joint.range if joint.limited[0] else (start - np.pi / 2, start + np.pi / 2)
    goal = high if held["opens"] > 0 else low
    jacobian = np.zeros((3, model.nv))
    best = 0.0
    for _ in range(int(SECONDS / model.opt.timestep)):
        at = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local
        mujoco.mj_jac(model, data, jacobian, None, at, body)
        along = jacobian[:, dof] * held["opens"]
        force = FORCE * along / max(float(np.linalg.norm(along)), 1e-9)
        data.qfrc_applied[:] = jacobian.T @ force
        mujoco.mj_step(model, data)
        best = max(best, (data.qpos[address] - start) / (goal - start))
        if best > OPEN:
            break
    return best


@pytest.mark.parametrize("mass", [None, 60.0])
@pytest.mark.parametrize(("family", "seed"), OBJECTS)
def test_a_hand_opens_what_is_written(family, seed, mass, tmp_path):
    obj = procedural.generate(family, seed)
    folder = save_asset(obj, tmp_path / "asset", formats=("mjcf",), motion=False, mass=mass)
    report = json.loads((folder / "report.json").read_text())
    model = mujoco.MjModel.from_xml_path(str(folder / "object.xml"))
    for part in report["parts"]:
        if part["handle"] is None:
            continue
        assert 5 - 1e-6 <= part["handle"]["start_force"] <= 22 + 1e-6, part
        assert pulled(model, part, report) > OPEN, part
