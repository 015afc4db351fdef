"""Does the spread that report.json gives tell which joints are wrong? Several samples of held-out
images, each joint against the truth.

    python benchmarks/spread.py [--count 28] [--samples 4] [--unseen] [--checkpoint nano] [--out
    out/bench]

For every moving joint of every sample: the share of the samples that have a part there with a joint
of the same type (``matched`` x ``type_share`` / ``samples`` of ``evaluation.spread``), and whether
the joint is right (``evaluation.parts``). One row for each number of samples that agree:

- ``joints``: how many there are. ``right``: the share of them that is right; ``least``, ``most``:
  its 95 % bootstrap over objects, since the joints of an object stand or fall together.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from results import report

from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.evaluation.procedural import held_out_for
from uniart_jax.evaluation.spread import joint_spread
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import load
from uniart_jax.runtime.compilation_cache import enable_compilation_cache
from uniart_jax.runtime.progress import track

RESAMPLES = 2000


def agreement(samples: list[ArticulatedObject], truth: ArticulatedObject) -> np.ndarray:
    """[J, 2] of all moving joints of the samples: how many samples have it, and whether it is
    right."""
    rows = []
    for index, sample in enumerate(samples):
        spread, scores = joint_spread(samples, index), compare_parts(sample, truth)
        right = set(scores.match[scores.right].tolist())
        for k, part in enumerate(sample.parts):
            if part.parent >= 0 and part.joint.type != "fixed":
                found = spread["joints"][part.name]
                rows.append((round(found["matched"] * found["type_share"]), k in right))
    return np.array(rows, float).reshape(-1, 2)


def by_agreement(objects: list[np.ndarray], samples: int) -> list[dict[str, Any]]:
    """A row for each number of samples that agree, from 1 to all of them; ``objects``: of
    ``agreement``."""
    rng = np.random.default_rng(0)
    draws = rng.integers(len(objects), size=(RESAMPLES, len(objects)))
    rows = []
    for number in range(1, samples + 1):
        right = np.array([o[o[:, 0] == number, 1].sum() for o in objects])
        joints = np.array([(o[:, 0] == number).sum() for o in objects])
        share = least = most = np.nan
        if joints.sum():
            totals = joints[draws].sum(1)
            shares = right[draws].sum(1)[totals > 0] / totals[totals > 0]
            share = right.sum() / joints.sum()
            least, most = np.percentile(shares, [2.5, 97.5])
        row = {"samples that agree": number, "joints": int(joints.sum())}
        rows.append(row | {"right": share, "least": least, "most": most})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=28)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--unseen", action="store_true")
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    args = parser.parse_args()
    enable_compilation_cache()
    pipeline = load(args.checkpoint)
    if pipeline.config.untrained:
        raise SystemExit(f"checkpoint '{args.checkpoint}': it is not trained yet")
    model = pipeline.config.model
    objects, missing = [], 0
    for index in track(range(args.count), "held-out objects", args.count):
        test = held_out_for(model, index, args.unseen)
        made = []
        for seed in range(args.samples):
            try:
                made.append(pipeline.sample(test.image, seed=args.samples * index + seed).obj)
            except ValueError:  # nothing was found in the image: no joint to judge
                missing += 1
        objects.append(agreement(made, test.obj) if made else np.zeros((0, 2)))
    rows = by_agreement(objects, args.samples)
    name = "spread-unseen" if args.unseen else "spread"
    report(
        name,
        rows,
        args.out,
        checkpoint=args.checkpoint,
        objects=args.count,
        samples=args.samples,
        samples_without_object=missing,
    )


if __name__ == "__main__":
    main()
