"""How TRELLIS samples: its ``pipeline.json``, or, without one, its published defaults."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from uniart_jax.config import LatentSampleConfig, SampleConfig, StructureSampleConfig

# configs/generation/slat_flow_img_dit_L_64l8p2_fp16.json
LATENT_MEAN = (
    -2.1687545776367188, -0.004347046371549368, -0.13352349400520325, -0.08418072760105133,
    -0.5271206498146057, 0.7238689064979553, -1.1414450407028198, 1.2039363384246826,
)  # fmt: skip
LATENT_STD = (
    2.377650737762451, 2.386378288269043, 2.124418020248413, 2.1748552322387695,
    2.663944721221924, 2.371192216873169, 2.6217446327209473, 2.684523105621338,
)  # fmt: skip
DEFAULT = SampleConfig(steps=25, guidance=5.0, guidance_interval=(0.5, 1.0), rescale_t=3.0)


@dataclasses.dataclass(frozen=True)
class Sampling:
    """Attributes: both samplers' settings; mean and standard deviation of the latents, [C]."""

    structure: StructureSampleConfig
    latent: LatentSampleConfig
    mean: np.ndarray
    std: np.ndarray


def read_sampling(pipeline: Any = None) -> Sampling:
    """What a ``pipeline.json`` (as JSON gives it) says; what it does not say, and all without one,
    by default.

    Raises:
      ValueError: it is malformed.
    """
    args = _object(_object({} if pipeline is None else pipeline, "").get("args", {}), "args")
    normalization = _object(args.get("slat_normalization", {}), "args.slat_normalization")
    mean, std = (
        _numbers(normalization.get(key, default), f"args.slat_normalization.{key}")
        for key, default in (("mean", LATENT_MEAN), ("std", LATENT_STD))
    )
    if len(mean) != len(std) or not (np.array(std) > 0).all():
        raise ValueError(
            "pipeline.json: args.slat_normalization needs as many standard deviations above 0 as "
            "means"
        )
    return Sampling(
        StructureSampleConfig(**_settings(args, "sparse_structure_sampler")),
        LatentSampleConfig(**_settings(args, "slat_sampler")),
        np.array(mean, np.float32),
        np.array(std, np.float32),
    )


def _settings(args: Mapping[str, Any], sampler: str) -> dict[str, Any]:
    where = f"args.{sampler}"
    params = _object(_object(args.get(sampler, {}), where).get("params", {}), f"{where}.params")
    steps = params.get("steps", DEFAULT.steps)
    guidance = params.get("cfg_strength", DEFAULT.guidance)
    rescale = params.get("rescale_t", DEFAULT.rescale_t)
    interval = _numbers(
        params.get("cfg_interval", DEFAULT.guidance_interval), f"{where}.params.cfg_interval"
    )
    _numbers([steps, guidance, rescale], f"{where}.params")
    if type(steps) is not int or steps < 1 or rescale <= 0 or len(interval) != 2:
        raise ValueError(f"pipeline.json: {where}.params is malformed")
    return {
        "steps": steps,
        "guidance": float(guidance),
        "guidance_interval": interval,
        "rescale_t": float(rescale),
    }


def _object(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ValueError(f"pipeline.json: {where or 'it'} is not an object")
    return value


def _numbers(values: Any, where: str) -> tuple[float, ...]:
    if not isinstance(values, list | tuple) or not all(
        type(v) in (int, float) and np.isfinite(v) for v in values
    ):
        raise ValueError(f"pipeline.json: {where} is not a list of numbers")
    return tuple(float(v) for v in values)
