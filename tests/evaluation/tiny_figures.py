"""A family of figures that costs nothing, for tests of the frame; the names of parts make it go
wrong."""

import os
import time

from uniart_jax.evaluation.metric import Metric

MISSING = "missing"
METRICS = {
    "pose_error": Metric("pose error", "lower", 1.0, "Distance of the numbers of parts."),
    "overlap": Metric("overlap", "higher", 0.0, "Share of the height."),
    "hinges": Metric(
        "hinges", "lower", 9.0, "Nothing to compare without a joint in the reference."
    ),
}


def measure(pred, ref, offset=0.0):
    names = {part.name for part in pred.parts}
    if "crash" in names:
        raise RuntimeError("the figure fell over")
    if "greedy" in names:
        raise MemoryError
    if "slow" in names:
        time.sleep(20)
    if "die" in names:
        os._exit(7)
    span = [float(o.bounds[1, 2] - o.bounds[0, 2]) for o in (pred, ref)]
    turning = [sum(p.joint.type == "revolute" for p in o.parts) for o in (pred, ref)]
    return {
        "pose_error": 0.1 * abs(len(pred.parts) - len(ref.parts)) + offset,
        "overlap": float("inf") if "endless" in names else min(span) / max(span),
        "hinges": float(abs(turning[0] - turning[1])) if turning[1] else float("nan"),
    }


def confusion(pred, ref):
    return {("revolute", "fixed"): len(pred.parts)}


def uncolored(pred):
    return pred.parts[0].name == "gray"
