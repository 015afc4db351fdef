"""A drawer holds a ball that is dropped into it while it opens, and carries it along: cavities survive in the collision shapes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.export.asset import save_asset

DRAWERS = [("storage_furniture", 1_000_000), ("table", 1_000_004), ("oven", 1_000_002)]
DENSITY = 500.0


def first_drawer(family: str, seed: int):
    """The first held-out object from ``seed`` on that has a drawer, and that part's index."""
    for number in range(seed, seed + 40):
        obj = procedural.generate(family, number)
        for k, part in enumerate(obj.parts):
            if part.label == "drawer" and part.joint.type == "prismatic":
                return obj, k
    raise AssertionError(f"no {family} with a drawer")


def drop(obj, k: int, folder, radius: float):
    """[n, 3] the ball's place in the drawer's frame, metres from the drawer's box centre, while the drawer opens, stops and closes."""
    asset = save_asset(obj, folder, formats=("mjcf",), motion=False)
    spec = mujoco.MjSpec.from_file(str(asset / "object.xml"))
    part = obj.parts[k]
    end = part.joint.limits[1] * obj.scale
    start = 0.5 * end  # half open, the ball in the air above the half that stands out
    center, size = part.box[:3] * obj.scale, part.box[3:] * obj.scale
    front = center - np.array([size[0] / 2 - 0.25 * end, 0, 0])
    place = front + part.joint.direction * start + [0, 0, size[2] / 2 + 2 * radius]
    ball = spec.worldbody.add_body(name="the ball", pos=place)
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], density=DENSITY)
    model = spec.compile()
    data = mujoco.MjData(model)
    joint = model.joint(f"{part.name}_joint").id
    address, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    data.qpos[address] = start
    mass = float(model.body_subtreemass[model.jnt_bodyid[joint]])
    body = model.body("the ball").id
    track = []
    for i in range(int(5.0 / model.opt.timestep)):
        t = i * model.opt.timestep
        # opens for 1.5 s, waits, then closes to the half
        goal = start + (end - start) * np.clip(t / 1.5, 0, 1) * (1 if t < 3 else np.clip(4.5 - t, 0, 1.5) / 1.5)  # fmt: skip
        error = goal - data.qpos[address]
        data.qfrc_applied[dof] = mass * (900 * error - 60 * data.qvel[dof])
        mujoco.mj_step(model, data)
        moved = center + part.joint.direction * data.qpos[address]
        track.append(data.xpos[body] - moved)
    return np.array(track), size


@pytest.mark.parametrize(("family", "seed"), DRAWERS)
def test_a_drawer_holds_a_ball_while_it_moves(family, seed, tmp_path):
    obj, k = first_drawer(family, seed)
    size = obj.parts[k].box[3:] * obj.scale
    radius = 0.12 * float(size.min())
    track, size = drop(obj, k, tmp_path / "asset", radius)
    assert np.isfinite(track).all()
    settled = track[len(track) // 10 :]
    assert (np.abs(settled) <= size / 2 + 1e-3).all()  # inside the drawer's own box from .5 s on
    bottom = -size[2] / 2 + radius
    assert settled[-1, 2] < bottom + 0.35 * size[2]  # on its floor, not on a lid of hulls
