"""How objects were sampled: what ``report.json`` says of it, and how many steps several samples
take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from uniart_jax.config import SampleConfig
from uniart_jax.data.background import run_lengths

if TYPE_CHECKING:
    from uniart_jax.pipeline import Sample

DIFFERENT = 4  # solver steps of several samples, where the checkpoint's own would make them alike


def steps_of_several(options: Sequence[SampleConfig]) -> int | None:
    """Solver steps for several samples of one picture; None: the flows' own (``options``) will do.

    One step is the mean, whatever the seed.
    """
    return DIFFERENT if any(flow.steps == 1 for flow in options) else None


def details(made: Sequence[Sample], index: int) -> dict[str, Any]:
    """What report.json says of sample ``index`` beside the object: how it was sampled and, where
    there are several, how much they agree."""
    from uniart_jax.evaluation.spread import joint_spread

    one = made[index]
    sampling = {}
    for flow, options in one.options.items():
        fixed = {"steps": options.steps}
        adapted = {"tolerance": options.tolerance, "forced": one.forced[flow]}
        sampling[flow] = {
            "solver": options.solver,
            "adaptive": options.adaptive,
            **(adapted if options.adaptive else fixed),
            "guidance": options.guidance,
            "evaluations": one.evaluations[flow],
        }
    kind = one.kind
    told: dict[str, Any] = {
        "kind": {
            "words": str(kind),
            "family": kind.family,
            "probability": round(kind.probability, 4),
        },
        "sampling": sampling,
    }
    if one.layout is not None and one.layout.certainty is not None:
        told["certainty"] = round(one.layout.certainty, 4)
    if one.background:
        told["background"] = list(one.background)  # of each view
    if one.cut:
        told["mask"] = [run_lengths(view) for view in one.cut]
    if len(made) == 1:
        return told
    return told | {"spread": joint_spread([s.obj for s in made], index)}
