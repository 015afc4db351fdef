"""Which figure sees which mistake: controls (the truth with one planted mistake) under the field's
figures and under ours.

    python benchmarks/evaluation_controls.py [--count 64] [--unseen] [--processes 2]

Every control of ``evaluation.controls`` of held-out procedural objects, measured against the object
itself. An object in which a control finds nothing to plant (no hinge at a side) is left out of that
control's means; intervals are 95 % bootstraps over objects. First of all a toy: a unit box and a
door of 1 x 1 x .05 that opens by 90 degrees about its left edge.

Writes docs/evaluation.png (not with --unseen) and prints the tables of docs/evaluation.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import trimesh

from uniart_jax.evaluation import articulation, pose_error, singapo
from uniart_jax.evaluation.controls import CONTROLS, changed
from uniart_jax.evaluation.metric import Figures, resting
from uniart_jax.evaluation.procedural import held_out
from uniart_jax.evaluation.summary import interval
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.runtime.processes import map_ordered, process_pool
from uniart_jax.runtime.progress import track

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "evaluation.png"
FAMILIES = (singapo, articulation, pose_error)
# Shown, in order; the field's first.
COLUMNS = {
    "compat_rs_dgiou": "RS-dgIoU compat",
    "compat_as_dgiou": "AS-dgIoU compat",
    "compat_as_dcdist": "AS-dcDist compat",
    "compat_as_dcd": "AS-dCD compat",
    "compat_graph": "graph compat",
    "fixed_as_dgiou": "AS-dgIoU fixed",
    "fixed_as_dcdist": "AS-dcDist fixed",
    "axis_mean": "axis °",
    "range_iou": "range IoU",
    "pose_error": "pose error",
}
NOISY = ("compat_as_dgiou", "compat_as_dcd", "fixed_as_dgiou", "fixed_as_dcd")
PANELS = {
    "compat_as_dgiou": "AS-dgIoU as SINGAPO's code computes it",
    "fixed_as_dgiou": "AS-dgIoU put right",
    "pose_error": "pose error",
}
NAMES = {
    "exact": "exact",
    "mirrored": "opens the\nwrong way",
    "wrong_hinge_side": "hinge at the\nother side",
    "rest_only": "never\nmoves",
    "half_range": "half\nthe range",
    "missing_part": "a part\nis missing",
}
Rows = dict[str, list[Figures]]  # control -> figures of the objects that it changes


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=64, help="held-out objects")
    parser.add_argument("--unseen", action="store_true", help="families never trained on")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    toy = measure_controls(toy_door())
    print(f"\nThe toy door\n\n{table({name: [figures] for name, figures in toy.items()})}\n")
    print(f"{noise(toy_door())}\n")
    rows: Rows = {name: [] for name in CONTROLS}
    with process_pool(args.processes) as submit:
        run = functools.partial(measure_held_out, unseen=args.unseen)
        found = map_ordered(submit, run, range(args.count), 2 * args.processes)
        for figures in track(found, "controls", args.count):
            for name, values in figures.items():
                rows[name].append(values)
    print(f"\n{args.count} held-out objects\n\n{table(rows)}")
    if not args.unseen:
        draw(rows, PICTURE)


def toy_door() -> ArticulatedObject:
    """A unit box and a door in front of it (-x) that opens outwards by 90 degrees about its left
    edge (+y, seen from the front at -x), where it touches the box."""
    body = trimesh.creation.box((1, 1, 1))
    door = trimesh.creation.box(
        (0.05, 1, 1), trimesh.transformations.translation_matrix((-0.525, 0, 0))
    )
    hinge = Joint(np.array([-0.5, 0.5, 0]), np.array([0, 0, -1]), (0, np.pi / 2))
    return ArticulatedObject((Part("body", body), Part("door", door, 0, hinge)), name="toy")


def measure_held_out(index: int, unseen: bool) -> dict[str, Figures]:
    """In the grid's units, the longest side about 1, as the toy is; ``compat`` would count
    metres."""
    return measure_controls(dataclasses.replace(held_out(index, unseen=unseen).obj, scale=1.0))


def measure_controls(obj: ArticulatedObject) -> dict[str, Figures]:
    """Control -> figures, of the controls that change this object, and of the exact one."""
    truth = resting(obj)
    found = {}
    for name, control in CONTROLS.items():
        prediction = control(obj)
        if name == "exact" or changed(prediction, obj):
            found[name] = {}
            for family in FAMILIES:
                shown = prediction.normalized(), truth.normalized()
                own = {"own": (prediction, truth)} if family is singapo else {}
                found[name] |= family.measure(*shown, **own)
    return found


def noise(obj: ArticulatedObject) -> str:
    """What sampling adds to SINGAPO's figures: the door that never moves, by 20 seeds."""
    own = CONTROLS["rest_only"](obj), resting(obj)
    shown = own[0].normalized(), own[1].normalized()
    found = [singapo.measure(*shown, seed=seed, own=own) for seed in range(20)]
    spread = {key: np.std([f[key] for f in found], ddof=1) for key in NOISY}
    return "Standard deviation over 20 seeds, rest_only: " + ", ".join(
        f"{key} {value:.1e}" for key, value in spread.items()
    )


def table(rows: Rows) -> str:
    """Markdown, a line a control: objects, then the mean of each figure."""
    lines = ["| control | objects | " + " | ".join(COLUMNS.values()) + " |"]
    lines.append("|" + "---|" * (len(COLUMNS) + 2))
    for name in NAMES:
        cells = [cell(mean(rows[name], key)) for key in COLUMNS]
        lines.append(f"| {name} | {len(rows[name])} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def mean(rows: list[Figures], key: str) -> float:
    values = known(rows, key)
    return float(values.mean()) if len(values) else float("nan")


def known(rows: list[Figures], key: str) -> np.ndarray:
    values = np.array([row[key] for row in rows])
    return values[~np.isnan(values)]


def cell(value: float) -> str:
    if np.isnan(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.4f}".replace("-0.0000", "0.0000")


def draw(rows: Rows, path: Path) -> None:
    figure, axes = plt.subplots(1, len(PANELS), figsize=(13.5, 4.2), constrained_layout=True)
    colors = ["#9aa0a6", *["#c0392b"] * 4, "#5b7c99"]
    place = np.arange(len(NAMES))
    for ax, (key, title) in zip(axes, PANELS.items(), strict=True):
        values = np.array([mean(rows[name], key) for name in NAMES])
        ends = np.array([interval(known(rows[name], key)) for name in NAMES])
        bars = np.abs(ends - values[:, None]).T
        ax.bar(place, values, color=colors, width=0.7)
        ax.errorbar(place, values, yerr=bars, fmt="none", ecolor="black", capsize=3, lw=1)
        for x, value, (_, top) in zip(place, values, ends, strict=True):
            ax.text(x, top, f" {value:.3f}", ha="center", va="bottom", fontsize=9)
        ax.set_title(title)
        ax.set_xticks(place, list(NAMES.values()), fontsize=7.5)
        ax.set_ylim(0, 1.12 * np.nanmax(ends))
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("0 = perfect")
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
