"""Reads the parity fixtures (TRELLIS's own outputs for random weights) and puts their parameters under our names."""

import json
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[3] / "shared" / "parity"


def load(name):
    """(config dict, arrays by key) of one fixture; skips the test where the fixtures are absent."""
    path = FOLDER / f"{name}.npz"
    if not path.exists():
        pytest.skip(f"parity fixture {path.name} is not here (shared/parity beside the repository)")
    arrays = dict(np.load(path, allow_pickle=False))
    return json.loads(str(arrays.pop("config"))), arrays


def parameters(arrays, prefix="sd/"):
    """PyTorch parameters -> nested dict with our names and layouts."""
    tree = {}
    for key, value in arrays.items():
        if not key.startswith(prefix) or key.endswith(("pos_emb", "offset_perturbation")):
            continue
        *path, last = key[len(prefix) :].split(".")
        if last == "weight" and value.ndim == 1:
            last = "scale"
        elif last == "weight":
            last = "kernel"
            if value.ndim == 2:
                value = value.T
            elif (
                path[-1] == "conv" and value.shape[1] == value.shape[2] == 3
            ):  # spconv [O, x, y, z, I]
                value = value.transpose(1, 2, 3, 4, 0).reshape(27, value.shape[4], value.shape[0])
            else:
                value = value.transpose(2, 3, 4, 1, 0)
        node = tree
        for part in path:
            node = node.setdefault(part, {})
        node[last] = np.asarray(value)
    return tree


def pad(coords, feats, width=None):
    """Sparse [T, 4] and [T, C] -> coords [B, V, 3], feats [B, V, C], counts [B], and the rows' (item, position)."""
    items = coords[:, 0]
    counts = np.bincount(items)
    width = width or int(counts.max()) + 5
    position = np.concatenate([np.arange(n) for n in counts])
    dense = np.zeros((len(counts), width, 3), np.int32)
    values = np.zeros((len(counts), width, feats.shape[1]), np.float32)
    dense[items, position] = coords[:, 1:]
    values[items, position] = feats
    return dense, values, counts.astype(np.int32), (items, position)
