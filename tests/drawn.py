"""Parameters of networks at random: drawn by NumPy, where ``Network.init`` would compile a program
a shape, and without zeros, behind which mistakes would hide."""

import sys

import jax
import numpy as np


def parameters(network, seed: int = 0):
    """Kernels that keep the size of what goes through them, scales near one, all else near
    zero."""
    rng = np.random.default_rng(seed)

    def draw(path, leaf):
        values, name = rng.normal(size=leaf.shape), path[-1].key
        if name in ("gamma", "scale"):
            values = 1 + 0.02 * values
        elif len(leaf.shape) > 1:
            values /= np.sqrt(np.prod(leaf.shape[:-1]))
        else:
            values *= 0.02
        return jax.device_put(np.asarray(values, leaf.dtype))

    return jax.tree_util.tree_map_with_path(draw, network.abstract())


def draw_quickly(monkeypatch) -> None:
    """What converted weights do not fill is drawn by NumPy too."""
    from uniart_jax.weights.mapping import flatten

    def draw(network, names, seed):
        drawn = flatten(parameters(network, seed))
        return {name: np.asarray(drawn[name]) for name in names}

    monkeypatch.setattr(sys.modules["uniart_jax.weights.compose"], "_draw", draw)
