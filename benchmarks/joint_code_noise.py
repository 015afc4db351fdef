"""How much noise the joint code bears: share of trees recovered and joint errors against the
noise's standard deviation.

    python benchmarks/joint_code_noise.py [--objects 40]

Gaussian noise of standard deviation sigma is added to every number of every voxel's 21 (joint code
9, own box 6, parent box 6); a part has as many voxels as in its grid (random trees: 4 to 200), its
joint is decoded as in ``assemble`` (gauge-aligned median), its boxes by the median, and the tree by
the arborescence. "shared" adds one draw to all voxels of a part instead, against which no median
helps; "both" adds one draw to the part and one to each voxel, as a network does that is as wrong
about the part as it is unsure within it; "network" is the same, read with the tolerance that the
pipeline uses for predicted codes. Parts are given: clustering is measured apart
(voxels/segment.py). Random screws turn once to twice and travel .004, .01 or .03 a radian; the
first is a bottle cap.

Writes docs/joint_code_noise.png and docs/joint_code_noise.md.
"""

from __future__ import annotations

import argparse
import subprocess
from collections import defaultdict
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from uniart_jax.objects.kinematics import Joint, line_distance
from uniart_jax.objects.states import sample_state
from uniart_jax.procedural import HELD_OUT_SEED, SEEN_FAMILIES, UNSEEN_FAMILIES, generate
from uniart_jax.voxels.joint_code import (
    CODE_CHANNELS,
    JOINT_CODE,
    NETWORK_TOLERANCE,
    OWN_BOX,
    PARENT_BOX,
    decode_part,
    decode_tree,
    encode_joint,
    encode_object,
)
from uniart_jax.voxels.voxelize import voxelize

DOCS = Path(__file__).resolve().parent.parent / "docs"
MEASURED = tuple(f"uniart_jax/{name}" for name in ("objects", "procedural", "voxels"))
SIGMAS = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
TYPES = ("fixed", "revolute", "continuous", "prismatic", "screw")
KINDS = ("independent", "shared", "both", "network")
HEADINGS = {
    "independent": "## Noise of every voxel its own",
    "shared": "## Noise shared by all voxels of a part",
    "both": "## Both, of the same size",
    "network": "## Both, read with the tolerance for predicted codes",
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "--objects", type=int, default=40, help="objects of each source (procedural, random trees)"
    )
    count = parser.parse_args().objects
    rng = np.random.default_rng(0)
    cases = list(procedural_cases(count)) + [random_case(rng) for _ in range(count)]
    results = {
        (kind, sigma): measure(cases, kind, sigma, rng) for kind in KINDS for sigma in SIGMAS
    }
    text = table(results, len(cases), written_at())
    print(text)
    (DOCS / "joint_code_noise.md").write_text(text)
    plot(results, DOCS / "joint_code_noise.png")


def procedural_cases(count: int):
    """(joints, boxes, codes, parents, voxels per part) of held-out procedural objects at random
    states, families in turn."""
    families = SEEN_FAMILIES + UNSEEN_FAMILIES
    seed = HELD_OUT_SEED
    while count:
        family = families[seed % len(families)]
        try:
            obj = sample_state(generate(family, seed), np.random.default_rng(seed))
            boxes, codes, parents = encode_object(obj)
            voxels = (
                np.bincount(voxelize(obj, 16, 2).voxel_part, minlength=len(boxes)) * 4
            )  # as at R = 32
        except ValueError:  # two boxes alike in this state
            seed += 1
            continue
        yield obj.joints, boxes, codes, parents, voxels
        seed, count = seed + 1, count - 1


def random_case(rng: np.random.Generator):
    """A random tree of 2 to 10 parts with all joint types."""
    count = int(rng.integers(2, 11))
    boxes = np.concatenate(
        [rng.uniform(-0.4, 0.4, (count, 3)), rng.uniform(0.05, 0.5, (count, 3))], axis=1
    )
    parents = np.array([0] + [rng.integers(k) for k in range(1, count)])
    joints = [Joint.fixed()]
    for _ in range(1, count):
        origin, direction = rng.uniform(-0.5, 0.5, 3), rng.normal(size=3)
        angle = np.array([-rng.uniform(0, 1.5), rng.uniform(0.5, 2)])
        angle = angle * rng.integers(0, 2, 2) if rng.random() < 0.5 else angle
        angle = angle if np.ptp(angle) > 0.1 else np.array([0, 1.5])
        turns = np.array([0, rng.uniform(1, 4) * np.pi])
        joints.append(
            [
                Joint.fixed(),
                Joint(origin, direction, tuple(angle)),
                Joint(origin, direction, (-np.pi, np.pi)),
                Joint(origin, direction, (0, 0), (0, rng.uniform(0.05, 0.4))),
                Joint(
                    origin,
                    direction,
                    tuple(turns),
                    tuple(turns * rng.choice([-1, 1]) * rng.choice([0.004, 0.01, 0.03])),
                ),
            ][rng.integers(5)]
        )
    codes = np.stack([encode_joint(j, b[:3]) for j, b in zip(joints, boxes, strict=True)])
    return joints, boxes, codes, parents, rng.integers(4, 200, count)


def measure(cases, kind: str, sigma: float, rng: np.random.Generator) -> dict:
    """Per type: share of right types, axis error (degrees), pivot distance, limit error; and the
    share of whole trees."""
    rows, trees = defaultdict(list), []
    tolerance = NETWORK_TOLERANCE if kind == "network" else 0.0
    for joints, boxes, codes, parents, voxels in cases:
        own, parent = [], []
        for k, joint in enumerate(joints):
            count = max(int(voxels[k]), 1)
            said = np.tile(np.concatenate([codes[k], boxes[k], boxes[parents[k]]]), (count, 1))
            if kind != "shared":
                said += rng.normal(0, sigma, said.shape)
            if kind != "independent":
                said += rng.normal(0, sigma, CODE_CHANNELS)
            own.append(np.median(said[:, OWN_BOX], axis=0))
            parent.append(np.median(said[:, PARENT_BOX], axis=0))
            if parents[k] != k:
                rows[joint.type].append(
                    errors(joint, decode_part(said[:, JOINT_CODE], own[-1][:3], tolerance))
                )
        tree = decode_tree(np.stack(own), np.stack(parent))
        trees.append(
            all(
                p == (q if q != k else -1)
                for k, (p, q) in enumerate(zip(tree, parents, strict=True))
            )
        )
    return {"tree": float(np.mean(trees)), **{t: np.array(rows[t]) for t in TYPES if rows[t]}}


def errors(true: Joint, got: Joint) -> tuple[float, float, float, float]:
    """(type right, axis error in degrees, distance of the axes, error of the limits as a share of
    the span); NaN: undefined."""
    if got.type != true.type or true.type == "fixed":
        return float(got.type == true.type), np.nan, np.nan, np.nan
    cosine = float(got.direction @ true.direction)
    limits = np.array(got.limits) if cosine > 0 else -np.array(got.limits)[::-1]
    span = true.limits[1] - true.limits[0]
    pivot = line_distance(true, got) if true.rotates else np.nan
    axis = np.degrees(np.arccos(min(1.0, abs(cosine))))
    return 1.0, axis, pivot, float(np.abs(limits - true.limits).max() / span)


def written_at() -> str:
    """The last commit that touched what the figures follow from, "and changes" where files of it
    differ from what is committed."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(DOCS.parent), *arguments, "--", *MEASURED]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no")
    commit = git("log", "-1", "--format=%h", "--abbrev=7")
    return f"`{commit}`" + (" and changes" if changed else "")


def table(results, count: int, commit: str) -> str:
    lines = [
        "# The joint code under noise",
        "",
        f"{count} objects, half of them held-out procedural ones, half random trees. Written by "
        f"`python benchmarks/joint_code_noise.py` with the code as of commit {commit},",
        "whose header says what is measured. Medians are over the joints whose type is right; a "
        "limit's error is a share of the span.",
        "",
    ]
    for kind in KINDS:
        lines += [
            HEADINGS[kind],
            "",
            "| σ | trees | "
            + " | ".join(f"{t} type" for t in TYPES)
            + " | axis ° | pivot | limits |",
            "|" + "---|" * (len(TYPES) + 5),
        ]
        for sigma in SIGMAS:
            result = results[kind, sigma]
            types = [f"{result[t][:, 0].mean():.2f}" if t in result else "–" for t in TYPES]
            both = np.concatenate([result[t][:, 1:] for t in TYPES if t in result])
            middle = [
                f"{np.median(c[~np.isnan(c)]):.3f}" if (~np.isnan(c)).any() else "–" for c in both.T
            ]
            lines.append(
                f"| {sigma:g} | {result['tree']:.2f} | " + " | ".join(types + middle) + " |"
            )
        lines.append("")
    lines += ["![the same as curves](joint_code_noise.png)", ""]
    return "\n".join(lines)


def plot(results, path: Path) -> None:
    figure, axes = plt.subplots(4, 3, figsize=(13, 13), sharex=True)
    titles = (
        "right type (black: whole tree)",
        "axis error, degrees, median",
        "limit error, share of span, median",
    )
    for row, kind in enumerate(KINDS):
        for column, title in enumerate(titles):
            ax = axes[row, column]
            ax.set_title(f"{kind}: {title}", fontsize=9)
            ax.set_xlabel("σ")
            if column == 0:
                ax.plot(SIGMAS, [results[kind, s]["tree"] for s in SIGMAS], "k", lw=2)
            for color, t in enumerate(TYPES):
                if column and t == "fixed":
                    continue
                values = []
                for sigma in SIGMAS:
                    rows = results[kind, sigma].get(t)
                    cell = np.array([]) if rows is None else rows[:, (0, 1, 3)[column]]
                    cell = cell[~np.isnan(cell)]
                    values.append(
                        np.nan if not len(cell) else cell.mean() if column == 0 else np.median(cell)
                    )
                ax.plot(SIGMAS, values, ".-", color=f"C{color}", label=t)
            ax.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    main()
