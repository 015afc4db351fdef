"""Converted networks of TRELLIS put together to the networks of a UniArt checkpoint; what they do
not fill is drawn anew.

The UniArt VAE is wider than TRELLIS's: of the encoder's input layer the rows of ``visual``, which
stand first, are TRELLIS's and the rest starts at zero, so that at first it gives TRELLIS's latents;
the decoder's trunk is TRELLIS's. Front and heads are new.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from uniart_jax.config import LATENT_OF, ImageEncoderConfig, ModelConfig
from uniart_jax.models.network import Network, Params, build
from uniart_jax.weights.mapping import flatten, nest
from uniart_jax.weights.trellis import PLACES, Converted
from uniart_jax.weights.trellis_options import DEFAULT, merged, model_of

# width -> (blocks, heads) of the DINOv2 that TRELLIS's flows may be conditioned on
DINOV2 = {384: (12, 6), 768: (12, 12), 1024: (24, 16)}


@dataclasses.dataclass(frozen=True)
class Filled:
    """A network of the checkpoint.

    Attributes:
      params: complete, nested; float widths as stored, new ones float32.
      sources: the upstream classes that it comes from.
      filled: tensors that came from them.
      new: dotted names or prefixes of the parameters that were drawn.
      notes: what a person should know.
    """

    params: Params
    sources: tuple[str, ...]
    filled: int
    new: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def compose(
    pieces: Sequence[Converted], seed: int = 0, base: ModelConfig = DEFAULT
) -> tuple[ModelConfig, dict[str, Filled]]:
    """The config of a checkpoint and its networks by name.

    Args:
      pieces: one or more, of different classes.
      seed: of what is drawn.
      base: what TRELLIS does not decide.

    Raises:
      ValueError: two are of the same class, or they contradict each other.
    """
    classes = [piece.upstream for piece in pieces]
    if twice := sorted({name for name in classes if classes.count(name) > 1}):
        raise ValueError(
            f"there are several networks of class {', '.join(twice)}; keep one of each"
        )
    model = model_of(merged([(piece.upstream, piece.settings) for piece in pieces]), base)
    model = _with_image_encoder(model, pieces)
    networks = {}
    for name in dict.fromkeys(place.network for place in PLACES.values()):
        own = [piece for piece in pieces if piece.network == name]
        if not own:
            continue
        values: dict[str, Any] = {}
        notes = [note for piece in own for note in piece.notes]
        for piece in own:
            prefix = f"{piece.part}." if piece.part else ""
            part = flatten(piece.params)
            if piece.upstream == "SLatGaussianDecoder":  # the rest of it is a network of its own
                part = {k: v for k, v in part.items() if not k.startswith("out_layer.")}
                notes = [note for note in notes if note not in piece.notes]
            values |= {prefix + key: value for key, value in part.items()}
        if any(piece.upstream == "SLatEncoder" for piece in own):
            values, note = _widened(values, model)
            notes.append(note)
        networks[name] = _completed(
            name, model, values, tuple(p.upstream for p in own), notes, seed
        )
    for piece in pieces:
        if piece.upstream == "SLatGaussianDecoder":
            count = len(jax.tree.leaves(piece.params))
            networks["gaussian_decoder"] = Filled(
                piece.params, (piece.upstream,), count, (), piece.notes
            )
    return model, networks


def _widened(values: Mapping[str, Any], model: ModelConfig) -> tuple[dict[str, Any], str]:
    """The encoder's input layer with rows for what TRELLIS does not have, zero; and a note that
    says so."""
    kernel = values["encoder.input_layer.kernel"]
    shape = flatten(build("uniart_vae", model).abstract())["encoder.input_layer.kernel"].shape
    wide = np.zeros(shape, kernel.dtype)
    wide[: len(kernel)] = kernel
    note = (
        f"encoder.input_layer: {len(kernel)} rows of visual features, {len(wide) - len(kernel)} "
        "new ones zero"
    )
    return {**values, "encoder.input_layer.kernel": wide}, note


def _completed(
    name: str,
    model: ModelConfig,
    values: Mapping[str, Any],
    sources: tuple[str, ...],
    notes: Sequence[str],
    seed: int,
) -> Filled:
    """A network with everything that is not among ``values`` drawn."""
    network = build(name, model)
    expected = flatten(network.abstract())
    wrong = [
        f"{k} {list(v.shape)}"
        for k, v in values.items()
        if k not in expected or expected[k].shape != v.shape
    ]
    if wrong:
        raise ValueError(f"{name}: its files do not fit each other: {', '.join(wrong)}")
    new = [key for key in expected if key not in values]

    drawn = _draw(network, new, seed) if new else {}
    together = {key: drawn[key] if key in drawn else values[key] for key in expected}
    return Filled(nest(together), sources, len(values), prefixes(expected, new), tuple(notes))


def _draw(network: Network, names: Sequence[str], seed: int) -> dict[str, np.ndarray]:
    """Some of a network's initial parameters; what is not asked for is not computed."""

    def draw(key: jax.Array) -> dict[str, jax.Array]:
        drawn = flatten(network.init(key))
        return {name: drawn[name] for name in names}

    # run once, so compiling is what takes time: without optimisation it is ten times faster; on the
    # CPU, so that all machines draw the same
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        key = jax.random.key(seed)
        options = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}
        values = jax.jit(draw).lower(key).compile(compiler_options=options)(key)
    return {name: np.asarray(value) for name, value in values.items()}


def prefixes(names: Mapping[str, Any] | Sequence[str], chosen: Sequence[str]) -> tuple[str, ...]:
    """The chosen dotted names, those that are all of a prefix's together as that prefix."""
    others = [name for name in names if name not in set(chosen)]
    found = []
    for name in chosen:
        parts = name.split(".")
        candidates = [".".join(parts[: n + 1]) for n in range(len(parts))]
        found.append(
            next(c for c in candidates if not any(f"{o}.".startswith(f"{c}.") for o in others))
        )
    return tuple(dict.fromkeys(found))


def _with_image_encoder(model: ModelConfig, pieces: Sequence[Converted]) -> ModelConfig:
    """DINOv2 with registers, of the width that the flows are conditioned on; without flows the
    model stays as it is."""
    widths = {
        getattr(model, piece.network).cond_channels
        for piece in pieces
        if piece.network in LATENT_OF
    }
    if not widths:
        return model
    (width,) = widths
    blocks, heads = DINOV2.get(width, (12, max(1, width // 64)))
    encoder = ImageEncoderConfig(
        architecture="dinov2",
        crop_margin=1.2,  # TRELLIS's
        image_size=518,
        width=width,
        num_blocks=blocks,
        num_heads=heads,
    )
    return dataclasses.replace(model, image_encoder=encoder)
