"""``validation.png``: one page for people. Every joint swept, how deep parts dig into each other on
the way, what a hand did and felt."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.simulation.engine import Plan
from uniart_jax.simulation.primitives import REACH
from uniart_jax.simulation.summary import summary, verdicts
from uniart_jax.simulation.sweep import DEPTH
from uniart_jax.visual.diagram import picture
from uniart_jax.visual.render import Camera, fit

FRAMES = 5  # of a sweep
MOST = 6  # joints that are drawn
ROOM = 1.3  # beside the object at rest, for what opens
TILE = 220  # pixels a side
VIEW = Camera(azimuth=np.deg2rad(-32), elevation=np.deg2rad(20), fov_degrees=30)
STYLE = {"mujoco": "-", "pybullet": "--"}
GOOD, BAD = "#2a7f4f", "#b3261e"


def write_figure(
    result: dict, obj: ArticulatedObject | None, plan: Plan | None, path: Path
) -> None:
    """Draw a result of ``validate.validate``.

    Args:
      obj, plan: of the asset; None where our reader does not take it: then there are only verdicts.
      path: the PNG to write.
    """
    joints = list(plan.joints[:MOST]) if plan is not None else []
    rows = max(1, len(joints))
    figure = Figure(figsize=(15, 2.2 * rows + 0.35 * _lines(result) / 2 + 1.2), dpi=90)
    FigureCanvasAgg(figure)
    heights = [2.2 * rows, 0.35 * _lines(result) / 2 + 0.3]
    upper, lower = figure.subfigures(2, 1, height_ratios=heights)
    left, right = upper.subfigures(1, 2, width_ratios=[FRAMES, 5.2])
    figure.suptitle(f"{result['asset']}: {summary(verdicts(result))}", fontsize=13, y=0.995)
    if obj is not None and plan is not None and joints:
        _frames(left, obj, plan, joints, _order(result))
        _curves(right, result, [j.name for j in joints], len(plan.joints))
    _verdicts(lower, result)
    figure.savefig(path, format="png")


def _lines(result: dict) -> int:
    return max(len(checks) for checks in verdicts(result).values()) + 2


def _order(result: dict) -> dict[str, list[str]]:
    """Joint -> those that are opened before it, as the first engine has it."""
    told = next(iter(result["joints"].values()), {})
    return {name: numbers["after"] for name, numbers in told.items()}


def _frames(figure, obj: ArticulatedObject, plan: Plan, joints: list, order: dict) -> None:
    """A row a joint: pictures from rest to its goal, the others at rest or open as in the sweep."""
    names = [p.name for p in obj.parts]
    shown = obj.normalized()
    rest = shown.rest()
    near = fit(shown, VIEW)
    camera = dataclasses.replace(near, distance=ROOM * near.distance)
    axes = figure.subplots(len(joints), FRAMES, squeeze=False)
    figure.subplots_adjust(0.01, 0.02, 0.99, 1 - 0.25 / len(joints), wspace=0.02, hspace=0.25)
    by_name = {j.name: j for j in plan.joints}
    for row, joint in zip(axes, joints, strict=True):
        k = names.index(joint.part) if joint.part in names else None
        first = [by_name[n] for n in order.get(joint.name, ()) if by_name[n].part in names]
        for i, axis in enumerate(row):
            axis.axis("off")
            q = rest.copy()
            for other in first:
                at = names.index(other.part)
                q[at] = _coordinate(shown, at, rest[at], other, 1.0)
            if k is not None:
                q[k] = _coordinate(shown, k, rest[k], joint, i / (FRAMES - 1))
            axis.imshow(picture(shown, camera, TILE, q, parts=True, axes=i == FRAMES - 1))
        row[0].set_title(f"{joint.name} ({joint.kind})", fontsize=9, loc="left")


def _coordinate(obj: ArticulatedObject, k: int, rest: float, joint, share: float) -> float:
    """The object's own coordinate of a part on its way to the goal."""
    if joint.kind == "continuous":
        return rest + share * (joint.goal - joint.rest)
    lo, hi = obj.parts[k].joint.limits
    at = joint.rest + share * (joint.goal - joint.rest)
    return lo + (at - joint.lo) / joint.span * (hi - lo)


def _curves(figure, result: dict, joints: list[str], count: int) -> None:
    """A row a joint: depth over range, position and force over time, every engine."""
    axes = figure.subplots(len(joints), 3, squeeze=False)
    figure.subplots_adjust(
        0.05, 0.1 / len(joints), 0.99, 1 - 0.25 / len(joints), wspace=0.28, hspace=0.45
    )
    for row, name in zip(axes, joints, strict=True):
        for engine, told in result["joints"].items():
            style = STYLE[engine]
            if name not in told:
                continue
            row[0].plot(told[name]["values"], told[name]["depth"], style, label=engine)
            for motion in result["motions"][engine]:
                whole = [*told[name]["after"], name]
                if motion["joints"] == whole and motion["time"]:
                    row[1].plot(motion["time"], motion["position"][-1], style)
                    row[2].plot(motion["time"], motion["force"], style)
                    break
        row[0].axhline(DEPTH, color=BAD, lw=0.8)
        row[1].axhline(REACH, color=GOOD, lw=0.8)
        for axis in row:
            axis.tick_params(labelsize=7)
            axis.margins(y=0.15)
    titles = ("depth / size over range", "share of the way over time (s)", "force (N)")
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=9)
    handles, labels = axes[0][0].get_legend_handles_labels()
    if handles:
        axes[0][0].legend(handles, labels, fontsize=7)
    if count > len(joints):
        axes[-1][0].set_xlabel(f"and {count - len(joints)} more joints", fontsize=8)


def _verdicts(figure, result: dict) -> None:
    """A column an engine, one for the geometry, one for plausibility."""
    columns = verdicts(result)
    axes: list[Axes] = list(figure.subplots(1, len(columns), squeeze=False)[0])
    figure.subplots_adjust(0.02, 0.02, 0.99, 0.98)
    lines = _lines(result)
    for axis, (title, checks) in zip(axes, columns.items(), strict=True):
        axis.axis("off")
        axis.set_xlim(0, 1)
        axis.set_ylim(-lines, 0)
        axis.text(0, -0.6, title, fontsize=11, weight="bold")
        for i, (name, check) in enumerate(checks.items()):
            told = f"{name}: {check['value']:.3g} (limit {check['limit']:.3g})"
            why = check.get("reason", "")
            color = GOOD if check["passed"] else BAD
            axis.text(
                0,
                -i - 1.7,
                f"{told}   {why[:70]}",
                fontsize=8,
                color=color,
                parse_math=False,
                clip_on=True,
            )
