"""What kinds of collision shapes cost and gain:  python benchmarks/collision_budget.py [--count 20]
[--real ROOT] [--generated ROOT] [--budget 64] [--copies 1000]
[--kinds no-budget merged boxes hull coacd] [--limit SECONDS]

A table over procedural objects (validation seeds, families in turn), with --real over as many URDF
and MJCF files by others, and with --generated over asset folders that sample.py wrote. Each object
is written without a budget, with it, and with other kinds of shapes: shapes an object, MB of its
folder (URDF, MJCF, meshes, texture, a picture), error of their volume, processor time to write all
of it (with --limit each time in a new process), whether drawers hold a ball, MuJoCo's steps of one
object a second where many copies stand in models of a hundred (one model of all takes minutes to
compile). The last row of generated objects is of the folders as they lie there. What is not there
is told and left out, and with --limit what takes more seconds of processor time.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from stepped_copies import DENSITY, speed

from uniart_jax import procedural
from uniart_jax.data.sources import find_entries
from uniart_jax.export.asset import save_asset
from uniart_jax.export.budget import within_budget
from uniart_jax.export.collision_kinds import check_collision
from uniart_jax.export.placement import place
from uniart_jax.export.volume_error import volume_error
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.refine import mend

SEED = 900_000  # of validation; held-out objects are for figures of the model
KINDS = ["no-budget", "merged", "boxes", "hull", "coacd"]  # the first two: without and with it
DEEP = 0.1  # of the object's size: a shallower sliding part without a name is no drawer


def drawers(obj: ArticulatedObject) -> list[int]:
    """The parts that slide and are called drawers; where no part has a name of its own, those that
    slide along x and are deep."""
    unnamed = not any(part.label for part in obj.parts)
    size = float(np.ptp(obj.bounds, axis=0).max())
    found = []
    for k, part in enumerate(obj.parts):
        called = "drawer" in (part.label or part.name).lower()
        along = abs(part.joint.direction[0]) > 0.9 and part.box[3:].min() > DEEP * size
        if part.joint.type == "prismatic" and (called or (unnamed and along)):
            found.append(k)
    return found


def holds_a_ball(asset: Path, obj: ArticulatedObject, k: int) -> bool | None:
    """Whether drawer k holds a ball that is dropped into it: from 1 s on it is in the drawer's box
    and near the floor that one sees, not on a lid of hulls. None where the drawer has no room for
    it.

    Args:
      asset: folder with ``object.xml``. obj: as it is written there (``export.placement``).
    """
    part = obj.parts[k]
    end, along = part.joint.limits[1] * obj.scale, part.joint.direction
    center, size = part.box[:3] * obj.scale, part.box[3:] * obj.scale
    radius = min(0.12 * float(size.min()), 0.2 * end)
    start = along * (np.abs(along) @ size / 2 - 0.5 * end)  # of what stands out, from the centre
    start = start + [0, 0, size[2] / 2 + 2 * radius]
    mesh = part.mesh.copy().apply_scale(obj.scale)
    below = mesh.ray.intersects_location([center + start], [[0.0, 0.0, -1.0]])[0]
    floor = float((below[:, 2] - center[2]).max(initial=-np.inf))
    if not -size[2] / 2 <= floor <= size[2] / 2 - 2 * radius:
        return None
    track = _drop(asset, part, center, start, end, radius)
    settled = track[len(track) // 5 :]
    inside = np.isfinite(track).all() and (np.abs(settled) <= size / 2 + 1e-3).all()
    return bool(inside and settled[:, 2].max() < floor + radius + 0.1 * size[2])


def _drop(
    asset: Path, part: Part, center: np.ndarray, start: np.ndarray, end: float, radius: float
) -> np.ndarray:
    """[n, 3] the ball's place, metres from the drawer's box centre, while the drawer stands open,
    closes to the half and opens again."""
    spec = mujoco.MjSpec.from_file(str(asset / "object.xml"))
    along = part.joint.direction
    ball = spec.worldbody.add_body(name="the ball", pos=center + along * end + start)
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], density=DENSITY)
    model = spec.compile()
    data = mujoco.MjData(model)
    joint = model.joint(f"{part.name}_joint").id
    address, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    data.qpos[address] = end
    mass = float(model.body_subtreemass[model.jnt_bodyid[joint]])
    body = model.body("the ball").id
    track = []
    for i in range(int(5.0 / model.opt.timestep)):
        goal = end * np.interp(i * model.opt.timestep, [1.0, 2.5, 4.0], [1.0, 0.5, 1.0])
        error = goal - data.qpos[address]
        data.qfrc_applied[dof] = mass * (900 * error - 60 * data.qvel[dof])
        mujoco.mj_step(model, data)
        track.append(data.xpos[body] - center - along * data.qpos[address])
    return np.array(track)


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


def generated(root: Path, count: int) -> list[tuple[Path, ArticulatedObject]]:
    """Asset folders below a root, by name, and what they hold."""
    found = []
    for path in sorted(p.parent for p in root.rglob("object.xml"))[:count]:
        try:
            found.append((path, load_object(path)))
        except ValueError as error:
            print(f"left out: {error}", flush=True)
    return found


def figures(
    obj: ArticulatedObject, budget: int | None, kind: str, sampled: bool, copies: int
) -> dict:
    """Of one object, written by a kind of shapes, with a budget or without."""
    kept: list = []

    def watched(obj, bodies, meshes, budget=None, collision="merged"):
        mended = mend if sampled else _as_they_are
        obj, bodies = mended(obj, bodies, meshes, budget, collision)
        kept[:] = bodies, meshes, obj
        return obj, bodies

    with tempfile.TemporaryDirectory() as folder:
        before = time.process_time()
        asset = save_asset(
            obj,
            Path(folder) / "asset",
            formats=("mjcf",),
            motion=False,
            mend=watched,
            collision=kind,
            collision_budget=budget,
        )
        seconds = time.process_time() - before
        bodies, meshes, written = kept
        errors = [
            volume_error(m.copy().apply_scale(obj.scale), b.shapes)
            for m, b in zip(meshes, bodies, strict=True)
        ]
        weights = [b.mass for b in bodies]
        return {
            "shapes": sum(len(body.shapes) for body in bodies),
            "MB": megabytes(asset),
            "error": float(np.average(errors, weights=weights)),
            "seconds": seconds,
            "balls": balls(asset, place(written).obj),
            "speed": speed(asset, copies),
        }


def within(seconds: int, *args) -> dict | None:
    """``figures(*args)`` by a process of its own; None if that takes more seconds of processor
    time, its imports (three or so) among them."""
    spawn = multiprocessing.get_context("spawn")
    ours, its = spawn.Pipe(duplex=False)
    process = spawn.Process(target=_bounded, args=(seconds, its, args))
    process.start()
    its.close()
    try:
        return ours.recv()
    except EOFError:
        return None
    finally:
        process.join()


def _bounded(seconds: int, pipe, args: tuple) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    pipe.send(figures(*args))


def as_written(asset: Path, obj: ArticulatedObject, copies: int) -> dict:
    """Figures of an asset folder of ours as it lies there."""
    parts = json.loads((asset / "report.json").read_text("utf-8"))["parts"]
    shapes, errors, weights = (
        [part.get(key, np.nan) for part in parts] for key in ("shapes", "volume_error", "mass")
    )
    return {
        "shapes": int(np.sum(shapes)),
        "MB": megabytes(asset),
        "error": float(np.average(np.nan_to_num(errors), weights=weights)),
        "balls": balls(asset, place(obj).obj),
        "speed": speed(asset, copies),
    }


def megabytes(folder: Path) -> float:
    """Of all files of a folder, 10^6 bytes."""
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e6


def balls(asset: Path, obj: ArticulatedObject) -> list[bool]:
    """Of each drawer with room for a ball, whether it holds one."""
    found = [holds_a_ball(asset, obj, k) for k in drawers(obj)]
    return [held for held in found if held is not None]


def _as_they_are(obj, bodies, meshes, budget, collision):
    if budget is None:
        return obj, bodies
    return obj, within_budget(obj, bodies, meshes, budget, boxes=collision == "boxes")


def table(rows: dict[str, dict[str, list[dict]]]) -> str:
    lines = [
        "| | objects | shapes (median, most) | MB (median) | volume error (mean) | "
        "CPU seconds (median) | drawers that hold a ball | steps/s (median) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, found in rows.items():
        for setting, objects in found.items():
            column = {
                key: np.array([o[key] for o in objects])
                for key in ("shapes", "MB", "error", "speed")
            }
            seconds = [o["seconds"] for o in objects if "seconds" in o]
            held = [ball for o in objects for ball in o["balls"]]
            told = f"{sum(held)} of {len(held)}" if held else "–"
            cells = [
                f"{name}, {setting}",
                f"{len(objects)}",
                f"{np.median(column['shapes']):.0f}, {column['shapes'].max()}",
                f"{np.median(column['MB']):.2f}",
                f"{column['error'].mean():.3f}",
                f"{np.median(seconds):.1f}" if seconds else "–",
                told,
                f"{np.median(column['speed']):,.0f}",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def settings(budget: int, kinds: list[str]) -> dict[str, tuple[int | None, str]]:
    """{row: (budget, kind)}; kinds whose program is not installed are told and left out."""
    found: dict[str, tuple[int | None, str]] = {}
    for kind in kinds:
        if kind == "no-budget":
            found["no budget"] = (None, "merged")
            continue
        try:
            check_collision(kind)
        except ValueError as error:
            print(f"left out: {error}", flush=True)
            continue
        found[f"budget {budget}" if kind == "merged" else kind] = (budget, kind)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=20, help="objects of each sort")
    parser.add_argument("--real", type=Path, help="a folder of URDFs and MJCFs by others")
    parser.add_argument("--generated", type=Path, help="a folder of assets that sample.py wrote")
    parser.add_argument("--budget", type=int, default=64)
    parser.add_argument("--copies", type=int, default=1000)
    parser.add_argument("--limit", type=int, help="seconds of processor time a row")
    parser.add_argument("--kinds", nargs="*", default=KINDS, help=" ".join(KINDS))
    parser.add_argument("--no-procedural", action="store_true", help="the other sorts alone")
    options = parser.parse_args()
    for root in (options.real, options.generated):
        if root is not None and not root.is_dir():
            print(f"left out: {root}: no such folder", flush=True)
    there = options.generated is not None and options.generated.is_dir()
    folders = generated(options.generated, options.count) if there else []
    count = 0 if options.no_procedural else options.count
    given = {
        "procedural": [procedural.generate(*drawn) for drawn in _drawn(count)],
        "real": read(options.real, options.count)
        if options.real is not None and options.real.is_dir()
        else [],
        "generated": [obj for _, obj in folders],
    }
    rows: dict[str, dict[str, list[dict]]] = {}
    chosen = settings(options.budget, options.kinds)
    for name, objects in given.items():
        made = name == "generated"
        for i, obj in enumerate(objects):
            for label, (budget, kind) in chosen.items():
                if options.limit:
                    found = within(options.limit, obj, budget, kind, made, options.copies)
                else:
                    found = figures(obj, budget, kind, made, options.copies)
                if found is None:
                    print(f"{name} {i}, {label}: left out, over {options.limit} s", flush=True)
                    continue
                rows.setdefault(name, {}).setdefault(label, []).append(found)
                print(f"{name} {i}, {label}: {json.dumps(found)}", flush=True)
    for path, obj in folders:
        found = as_written(path, obj, options.copies)
        rows.setdefault("generated", {}).setdefault("as written", []).append(found)
        print(f"{path.name}, as written: {json.dumps(found)}", flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
