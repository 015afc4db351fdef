"""The parity fixtures: upstream's own inputs and outputs for random weights.

Every ``.npz`` of a folder is a case: ``fixtures`` beside this file, or the folder that
``$UNIART_PARITY_DIR`` names. Keys: ``config`` (JSON of constructor arguments), ``in/…``, ``out/…``,
``sd/<upstream's parameter>``; gradients are ``out/grad/<parameter>``.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

SHIPPED = Path(__file__).parent / "fixtures"
FOLDER = Path(os.environ.get("UNIART_PARITY_DIR") or SHIPPED)


class Case(NamedTuple):
    config: dict
    inputs: dict
    outputs: dict
    state: dict  # upstream's parameters
    gradients: dict  # of them

    def sparse(self):
        """(batch of coords [B, V, 3] and counts [B], feats [B, V, C], the rows' (item, position));
        padded by a few voxels."""
        coords, counts, rows = pad(self.inputs["coords"])
        return (
            {"coords": coords, "counts": counts},
            spread(self.inputs["feats"], coords, rows),
            rows,
        )


def cases(folder):
    """Paths of a folder's fixtures.

    Raises:
      FileNotFoundError: there are none; a check of nothing must not pass.
    """
    found = sorted(Path(folder).glob("*.npz"))
    if not found:
        raise FileNotFoundError(f"{folder}: no parity fixtures")
    return found


def load(path):
    arrays = dict(np.load(path, allow_pickle=False))
    config = json.loads(str(arrays.pop("config")))

    def under(prefix):
        return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}

    return Case(config, under("in/"), under("out/"), under("sd/"), under("out/grad/"))


def pad(coords):
    """Sparse [T, 4] -> coords [B, V, 3], counts [B], and the rows' (item, position)."""
    items = coords[:, 0]
    counts = np.bincount(items).astype(np.int32)
    position = np.concatenate([np.arange(n) for n in counts])
    dense = np.zeros((len(counts), int(counts.max()) + 5, 3), np.int32)
    dense[items, position] = coords[:, 1:]
    return dense, counts, (items, position)


def spread(feats, coords, rows):
    """Sparse [T, C] -> [B, V, C], padding zero."""
    values = np.zeros((*coords.shape[:2], feats.shape[1]), np.float32)
    values[rows] = feats
    return values


def last(x):
    """[B, C, ...] -> [B, ..., C]."""
    return np.moveaxis(x, 1, -1)
