"""Every setting of the library as frozen dataclasses. No jax here, so that data workers and command
lines stay light.

    networks, data, training, sampling    the parts of a ``Config``
    json_text                             any of them as JSON, and back

``configs/*.py`` build a ``Config``; the command line overrides any field by its dotted name.
Defaults are the paper's sizes, which are TRELLIS's where TRELLIS has the same network
(docs/networks.md). All names are imported from here.
"""

from __future__ import annotations

import dataclasses
import sys
import types
from pathlib import Path

from uniart_jax.config.data import Background, DataConfig, World
from uniart_jax.config.json_text import from_json, to_json
from uniart_jax.config.networks import (
    IMAGE_ENCODERS,
    LATENT_OF,
    NETWORKS,
    STAGES,
    FlowConfig,
    GaussianConfig,
    GridConfig,
    ImageEncoderConfig,
    ImageEncoderKind,
    Kernel,
    LayoutConfig,
    MaskConfig,
    ModelConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.config.sampling import (
    TOLERANCES,
    LatentSampleConfig,
    SampleConfig,
    StructureSampleConfig,
)
from uniart_jax.config.training import LossConfig, MeshConfig, StageConfig
from uniart_jax.runtime.config_files import CONFIGS, find_file, run_file

__all__ = [
    "IMAGE_ENCODERS",
    "LATENT_OF",
    "NETWORKS",
    "STAGES",
    "TOLERANCES",
    "Background",
    "Config",
    "DataConfig",
    "FlowConfig",
    "GaussianConfig",
    "GridConfig",
    "ImageEncoderConfig",
    "ImageEncoderKind",
    "Kernel",
    "LatentSampleConfig",
    "LayoutConfig",
    "LossConfig",
    "MaskConfig",
    "MeshConfig",
    "ModelConfig",
    "SampleConfig",
    "StageConfig",
    "StructureSampleConfig",
    "StructureVAEConfig",
    "UniArtVAEConfig",
    "World",
    "from_json",
    "load_config",
    "to_json",
]


@dataclasses.dataclass(frozen=True)
class Config:
    """One experiment.

    ``init``: a checkpoint that training goes on from (``--init`` overrides it). ``untrained``:
    parameters of a checkpoint that are still as they were drawn, by dotted name or prefix (what a
    conversion could not fill). ``quick_compile``: ``train.py`` compiles programs in less time,
    which then run slower, for tests of the whole training.
    """

    name: str = "paper"
    init: str = ""
    untrained: tuple[str, ...] = ()
    quick_compile: bool = False
    model: ModelConfig = ModelConfig()
    data: DataConfig = DataConfig()
    loss: LossConfig = LossConfig()
    mesh: MeshConfig = MeshConfig()
    image_encoder: StageConfig = StageConfig()
    layout: StageConfig = StageConfig()
    mask: StageConfig = StageConfig()
    structure_vae: StageConfig = StageConfig()
    uniart_vae: StageConfig = StageConfig()
    structure_flow: StageConfig = StageConfig()
    latent_flow: StageConfig = StageConfig()
    sample_structure: StructureSampleConfig = StructureSampleConfig()
    sample_latent: LatentSampleConfig = LatentSampleConfig()
    seed: int = 0


def load_config(name: str | Path) -> Config:
    """The ``config()`` of a Python file, or of a file of ``configs/`` by its name ("nano").

    Raises:
      FileNotFoundError, ValueError: no such file, or it has no function ``config`` that returns a
        ``Config``.
    """
    path = find_file(name, "config", CONFIGS)
    config = run_file(path)
    if not isinstance(config, Config):
        raise ValueError(
            f"config '{path}': it must define config() returning a uniart_jax.config.Config"
        )
    return config


class _Module(types.ModuleType):
    """This module, which can be called: ``uniart_jax.config("nano")`` is ``load_config``."""

    def __call__(self, name: str | Path) -> Config:
        return load_config(name)


sys.modules[__name__].__class__ = _Module
