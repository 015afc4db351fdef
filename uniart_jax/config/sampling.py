"""How flows are sampled, and what is done with the samples."""

from __future__ import annotations

import dataclasses
from typing import Literal

TOLERANCES = (1e-4, 1.0)  # of adaptive solvers


@dataclasses.dataclass(frozen=True)
class SampleConfig:
    """Sampling defaults that belong to a checkpoint.

    ``guidance``: classifier-free, v_c + w (v_c - v_u); 0 is none. It is the ``guidance_scale`` of
    diffusers less 1. ``guidance_interval``: of t, outside which there is none.
    ``adaptive``: each item in steps of its own, of an error of about ``tolerance``
    (``flow.solvers``); ``steps`` and ``rescale_t`` then give the first step's length alone.
    ``mirrored``: where a flow takes one step, the mean with what it makes of the mirrored picture
    (``inference.mirror_average``).
    """

    solver: Literal["euler", "heun"] = "euler"
    adaptive: bool = False
    tolerance: float = 0.1
    steps: int = 25
    guidance: float = 1.0
    guidance_interval: tuple[float, float] = (0.0, 1.0)
    rescale_t: float = 3.0
    mirrored: bool = False

    def __post_init__(self) -> None:
        least, most = TOLERANCES
        if self.solver not in ("euler", "heun"):
            raise ValueError(f"sampling: solver must be euler or heun, got '{self.solver}'")
        if self.steps < 1:
            raise ValueError(f"sampling needs at least 1 step, not {self.steps}")
        if not least <= self.tolerance <= most:
            raise ValueError(f"tolerance must be in {least:g}..{most:g}, got {self.tolerance:g}")
        if not 0 <= self.guidance < float("inf"):
            raise ValueError(f"sampling: guidance must be 0 or more, got {self.guidance:g}")


@dataclasses.dataclass(frozen=True)
class StructureSampleConfig(SampleConfig):
    """A voxel is active above ``threshold``, a logit. What is sampled in few steps is close to a
    mean, from which thin things fade."""

    threshold: float = 0.0


@dataclasses.dataclass(frozen=True)
class LatentSampleConfig(SampleConfig):
    """Sampled distances are thickened by ``sdf_offset`` and smoothed by ``sdf_blur``, along panels
    by ``sdf_blur_along`` and, where that is not 0, along legs by ``voxels.grid.ROD``, in sub-cells
    (``voxels.grid.smoothed``), for the same reason."""

    sdf_offset: float = 0.0
    sdf_blur: float = 0.0
    sdf_blur_along: float = 0.0
