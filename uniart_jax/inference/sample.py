"""What a pipeline takes and gives: options of sampling; an object and how it was made."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, TypedDict

import numpy as np

from uniart_jax.config import SampleConfig
from uniart_jax.export.picture_colors import Picture
from uniart_jax.export.words import moving_words
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.kind import Kind, kind_of
from uniart_jax.voxels.layout import Layout


class SamplingOptions(TypedDict, total=False):
    """Fields of ``config.SampleConfig`` to sample with; None, or absent: as the checkpoint has
    them. ``structure``, ``latent``: of one flow alone, by name, before those of both."""

    steps: int | None
    guidance: float | None
    guidance_interval: tuple[float, float] | None
    rescale_t: float | None
    solver: Literal["euler", "heun"] | None
    adaptive: bool | None
    tolerance: float | None
    mirrored: bool | None
    structure: Mapping[str, Any] | None
    latent: Mapping[str, Any] | None


@dataclasses.dataclass(frozen=True)
class Sample:
    """A sampled object and how. ``picture``: the (first) image with the camera that was estimated
    for it. Of both flows ("structure", "latent") the options, the velocities that were asked for
    (with guidance each is one call of the network on twice the batch) and the adaptive steps whose
    error was above the tolerance (``flow.solvers.Solution``). ``background``: how the object was
    cut out of each image (``data.background``); ``cut``: each image so cut out, [H, W, 4] uint8.
    ``layout``: what it follows, if anything."""

    obj: ArticulatedObject
    options: dict[str, SampleConfig]
    evaluations: dict[str, int]
    forced: dict[str, int]
    picture: Picture | None = None
    background: tuple[str, ...] = ()
    cut: tuple[np.ndarray, ...] = ()
    layout: Layout | None = None

    def __repr__(self) -> str:
        asked = ", ".join(f"{flow} {number}" for flow, number in self.evaluations.items())
        lines = [f"Sample({self.kind}: {moving_words(self.obj)}", repr(self.obj)]
        lines += [f"network evaluations: {asked}"] if asked else []
        lines += [f"cut out by: {', '.join(self.background)}"] if self.background else []
        lines += ["follows no layout" if self.layout is None else f"follows {self.layout!r}"]
        return "\n  ".join(lines) + ")"

    @property
    def kind(self) -> Kind:
        """The kind of thing that its parts are likest to."""
        return kind_of(self.layout or Layout.of_object(self.obj))
