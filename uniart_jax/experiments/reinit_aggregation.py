"""First weights for arms whose UniArt VAE has another aggregation, so that all arms begin as alike
as they can.

``reinit_aggregation``: from a checkpoint. The aggregation (``front``) is initialised anew, all else
is kept. As in ``weights.compose`` with TRELLIS's weights, the encoder's input layer keeps the rows
of the visual features, which stand first, and the other rows are zero: the first latents depend on
the visual features only. The same holds for the linear path past that layer, where there is one.
Without visual features these layers are initialised anew too.

``shared_init``: from nothing. Parameters with the same name and shape as in the network with
part-wise attention have its initial values.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

from uniart_jax.config import NETWORKS, Config
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network
from uniart_jax.models.network import build, flat_names

FRONT = "front."
INPUTS = ("encoder.input_layer.kernel", "encoder.path.kernel")


def reinit_aggregation(source: Checkpoint, config: Config, folder: Path) -> Path:
    """The folder of ``source`` or, where its aggregation is not the config's, of a checkpoint in
    ``folder`` that has the config's, initialised anew.

    Raises:
      FileNotFoundError, ValueError: ``source`` is no checkpoint with a UniArt VAE, or differs from
        the config in more than the aggregation.
    """
    found, wanted = source.config, config.model.uniart_vae.aggregation
    model = found.model
    if model.uniart_vae.aggregation == wanted or not source.has("uniart_vae"):
        return source.folder
    other = dataclasses.replace(model.uniart_vae, aggregation=wanted)
    found = dataclasses.replace(found, model=dataclasses.replace(model, uniart_vae=other))
    old = flat_names(source.load("uniart_vae"))
    drawn = build("uniart_vae", found.model).init(jax.random.key(config.seed))
    leaves, visual = [], other.visual_channels
    for name, leaf in flat_names(drawn).items():
        if name.startswith(FRONT) or (name in INPUTS and not visual):
            leaves.append(np.asarray(leaf))
        elif name in INPUTS:
            rows = np.zeros(leaf.shape, np.float32)
            rows[:visual] = old[name][:visual]
            leaves.append(rows)
        else:
            leaves.append(old[name])
    params = jax.tree.unflatten(jax.tree.structure(drawn), leaves)
    write_network(folder, "uniart_vae", params, "stored")
    write_config(folder, found)
    others = [name for name in NETWORKS if name != "uniart_vae" and source.has(name)]
    source.copy_networks(others, folder)
    return folder


def shared_init(config: Config, stages: Sequence[str], folder: Path) -> Path | None:
    """A checkpoint in ``folder`` with the networks of ``stages`` as a training of ``config``
    initialises them, except the UniArt VAE: parameters that one of aggregation 'uniart' has by the
    same name and shape are initialised as there. None where that is its own aggregation, or it is
    not trained.
    """
    model = config.model
    wanted = dataclasses.replace(model.uniart_vae, aggregation="uniart")
    if "uniart_vae" not in stages or model.uniart_vae == wanted:
        return None
    for name in stages:
        # as stages/train_network.py does
        key = jax.random.fold_in(jax.random.key(config.seed), NETWORKS.index(name))
        params = jax.jit(build(name, model).init)(key)
        if name == "uniart_vae":
            other = build(name, dataclasses.replace(model, uniart_vae=wanted))
            shared = flat_names(jax.jit(other.init)(key))
            leaves = [
                found
                if (found := shared.get(n)) is not None and found.shape == leaf.shape
                else leaf
                for n, leaf in flat_names(params).items()
            ]
            params = jax.tree.unflatten(jax.tree.structure(params), leaves)
        write_network(folder, name, params, "float32")
    return folder
