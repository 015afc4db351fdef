"""uniart_jax: one RGB image in, a complete articulated 3D object out. JAX implementation of the
paper UniArt.

Public names are imported on first use, so that ``import uniart_jax`` is instant and sub-packages
stay independent.
"""

from __future__ import annotations

import importlib

__version__ = "0.1.0"

_PUBLIC = {
    "ArticulatedObject": "uniart_jax.objects.object",
    "Part": "uniart_jax.objects.object",
    "Joint": "uniart_jax.objects.kinematics",
    "VoxelGrid": "uniart_jax.voxels.grid",
    "Layout": "uniart_jax.voxels.layout",
    "load_object": "uniart_jax.objects.load",
    "Pipeline": "uniart_jax.pipeline",
    "load": "uniart_jax.pipeline",
    "ask_command": "uniart_jax.inference.ask_layout",
    "Trainer": "uniart_jax.stages",
    "keep_programs": "uniart_jax.runtime.compilation_cache",
}
__all__ = ["__version__", "config", *_PUBLIC]


def __getattr__(name: str):
    if name == "config":  # the module; called, it loads a config: ``config("nano")``
        return importlib.import_module("uniart_jax.config")
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'uniart_jax' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
