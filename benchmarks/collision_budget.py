"""What a budget of collision shapes costs and gains:  python benchmarks/collision_budget.py
[--count 20] [--real ROOT] [--sampled 0] [--budget 64] [--copies 100]

A table over procedural objects (validation seeds, families in turn), with --real over as many URDF
and MJCF files by others, and with --sampled over what the shipped model makes of rendered images:
shapes an object, MB of its MJCF with meshes, error of their volume, whether drawers hold a ball,
MuJoCo's steps of one object a second in a model of many copies.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np

from uniart_jax import procedural
from uniart_jax.data.sources import find_entries
from uniart_jax.export.asset import save_asset
from uniart_jax.export.budget import shape_count
from uniart_jax.export.placement import place
from uniart_jax.export.volume_error import volume_error
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.simulation.refine import mend

SEED = 900_000  # of validation; held-out objects are for figures of the model
DENSITY = 500.0  # kg / m^3 of the ball
STEPS = 200
SPACING = 3.0  # metres between copies


def drawers(obj: ArticulatedObject) -> list[int]:
    """The parts that are drawers by their label and slide."""
    return [
        k
        for k, part in enumerate(obj.parts)
        if part.label == "drawer" and part.joint.type == "prismatic"
    ]


def drop(
    asset: Path, obj: ArticulatedObject, k: int, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """[n, 3] the ball's place in drawer k, metres from the drawer's box centre, while it opens,
    stops and closes; [3] the drawer's size.

    Args:
      asset: folder with ``object.xml``. obj: as it is written there (``export.placement``).
    """
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
        goal = start + (end - start) * np.clip(t / 1.5, 0, 1) * (
            1 if t < 3 else np.clip(4.5 - t, 0, 1.5) / 1.5
        )
        error = goal - data.qpos[address]
        data.qfrc_applied[dof] = mass * (900 * error - 60 * data.qvel[dof])
        mujoco.mj_step(model, data)
        moved = center + part.joint.direction * data.qpos[address]
        track.append(data.xpos[body] - moved)
    return np.array(track), size


def ball_radius(obj: ArticulatedObject, k: int) -> float:
    return 0.12 * float(obj.parts[k].box[3:].min()) * obj.scale


def holds(track: np.ndarray, size: np.ndarray, radius: float) -> bool:
    """Whether the ball stayed in the drawer's box from .5 s on and came to lie near its floor, not
    on a lid of hulls."""
    settled = track[len(track) // 10 :]
    inside = np.isfinite(track).all() and (np.abs(settled) <= size / 2 + 1e-3).all()
    return bool(inside and settled[-1, 2] < -size[2] / 2 + radius + 0.35 * size[2])


def speed(asset: Path, copies: int) -> float:
    """Steps of one object a second, of a model of many that stand in a field with a ball dropped on
    each."""
    one = mujoco.MjSpec.from_file(str(asset / "object.xml"))
    for key in list(one.keys):
        one.delete(key)
    world = mujoco.MjSpec()
    world.memory = 2**28
    side = int(np.ceil(copies**0.5))
    for i in range(copies):
        at = [SPACING * (i % side), SPACING * (i // side), 0.0]
        frame = world.worldbody.add_frame(pos=at)
        world.attach(one.copy(), frame=frame, prefix=f"{i}/")
        ball = world.worldbody.add_body(pos=[at[0], at[1], 1.5])
        ball.add_freejoint()
        ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0], density=DENSITY)
    model = world.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    start = time.perf_counter()
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
    return STEPS * copies / (time.perf_counter() - start)


def sampled(count: int) -> list[ArticulatedObject]:
    """What the shipped model makes of images of validation objects."""
    import uniart_jax as ua
    from uniart_jax.data.images import PICTURE_SIDE
    from uniart_jax.objects.states import sample_state
    from uniart_jax.pipeline import enable_compilation_cache
    from uniart_jax.render import render, sample_camera

    enable_compilation_cache()
    pipeline = ua.load("nano")
    objects = []
    for index, (family, seed) in enumerate(_drawn(count)):
        rng = np.random.default_rng([seed, 1])
        shown = sample_state(procedural.generate(family, seed), rng)
        picture = render(shown, sample_camera(rng), size=PICTURE_SIDE, samples=4)
        objects.append(pipeline(np.round(picture * 255).astype(np.uint8), seed=index))
    return objects


def read(root: Path, count: int) -> list[ArticulatedObject]:
    """``count`` of the assets below a folder that can be read, evenly taken from all."""
    entries = find_entries(root, "urdf")
    objects = []
    for entry in entries[:: max(1, len(entries) // count)]:
        try:
            objects.append(load_object(root / entry.path, allow_outside=True))
        except ValueError as error:
            print(f"left out: {error}", flush=True)
    return objects[:count]


def _drawn(count: int) -> list[tuple[str, int]]:
    families = procedural.SEEN_FAMILIES
    return [(families[i % len(families)], SEED + i) for i in range(count)]


def figures(obj: ArticulatedObject, budget: int | None, generated: bool, copies: int) -> dict:
    """Of one object, written with a budget, or without."""
    kept: list = []

    def watched(obj, bodies, meshes, budget=None, collision="merged"):
        mended = mend if generated else _as_they_are
        obj, bodies = mended(obj, bodies, meshes, budget)
        kept[:] = bodies, meshes, obj
        return obj, bodies

    with tempfile.TemporaryDirectory() as folder:
        asset = save_asset(
            obj,
            Path(folder) / "asset",
            formats=("mjcf",),
            motion=False,
            mend=watched,
            collision_budget=budget,
        )
        bodies, meshes, written = kept
        errors = [
            volume_error(m.copy().apply_scale(obj.scale), b.shapes)
            for m, b in zip(meshes, bodies, strict=True)
        ]
        weights = [b.mass for b in bodies]
        files = [p for p in (asset / "meshes").rglob("*") if p.is_file()] + [asset / "object.xml"]
        placed = place(written).obj
        balls = []
        for k in () if generated else drawers(placed):
            radius = ball_radius(placed, k)
            balls.append(holds(*drop(asset, placed, k, radius), radius))
        return {
            "shapes": shape_count(bodies),
            "MB": sum(p.stat().st_size for p in files) / 1e6,
            "error": float(np.average(errors, weights=weights)),
            "balls": balls,
            "speed": speed(asset, copies),
        }


def _as_they_are(obj, bodies, meshes, budget):
    from uniart_jax.export.budget import within_budget

    return obj, bodies if budget is None else within_budget(obj, bodies, meshes, budget)


def table(rows: dict[str, dict[str, list[dict]]]) -> str:
    lines = [
        "| | objects | shapes (median, most) | MB (median) | volume error (mean) | drawers that hold a ball | steps/s (median) |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, found in rows.items():
        for budget, objects in found.items():
            column = {
                key: np.array([o[key] for o in objects])
                for key in ("shapes", "MB", "error", "speed")
            }
            balls = [held for o in objects for held in o["balls"]]
            told = f"{sum(balls)} of {len(balls)}" if balls else "–"
            lines.append(
                f"| {name}, {budget} | {len(objects)} | {np.median(column['shapes']):.0f}, {column['shapes'].max()} | {np.median(column['MB']):.2f} | {column['error'].mean():.3f} | {told} | {np.median(column['speed']):,.0f} |"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--sampled", type=int, default=0)
    parser.add_argument("--budget", type=int, default=64)
    parser.add_argument("--copies", type=int, default=100)
    options = parser.parse_args()
    given = {
        "procedural": [procedural.generate(*drawn) for drawn in _drawn(options.count)],
        "real": read(options.real, options.count) if options.real else [],
        "what nano makes": sampled(options.sampled) if options.sampled else [],
    }
    rows: dict[str, dict[str, list[dict]]] = {}
    for name, objects in given.items():
        for i, obj in enumerate(objects):
            for label, budget in (
                ("no budget", None),
                (f"budget {options.budget}", options.budget),
            ):
                found = figures(obj, budget, name == "what nano makes", options.copies)
                rows.setdefault(name, {}).setdefault(label, []).append(found)
                print(f"{name} {i}, {label}: {found}", flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
