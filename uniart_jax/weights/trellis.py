"""One network of TRELLIS v1 as parameters of ours: which class is which, and the table of each.

Names are upstream's own (github.com/microsoft/TRELLIS, ``trellis/models``). Two buffers in its
files are not learned: ``pos_emb`` of the structure flow and ``offset_perturbation`` of the Gaussian
decoder. They are compared with what we compute.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from uniart_jax.config import GaussianConfig, ModelConfig
from uniart_jax.models.gaussian_decoder import offset_perturbation
from uniart_jax.models.network import Network, Params, build
from uniart_jax.models.uniart_vae import Trunk
from uniart_jax.nn.embeddings import grid_coords, position_embedding
from uniart_jax.weights.mapping import (
    CONV3D,
    LINEAR,
    SUBMANIFOLD,
    Rule,
    convert,
    norm,
    weight_and_bias,
)
from uniart_jax.weights.trellis_options import (
    OPTIONS,
    Settings,
    class_name,
    merged,
    model_of,
    settings_of,
)

_RESIDUAL = ("blocks.{i}", "middle_block.{i}")
STRUCTURE_VAE = (
    *weight_and_bias("input_layer", CONV3D),
    *(rule for block in _RESIDUAL for i in (1, 2) for rule in norm(f"{block}.norm{i}")),
    *(rule for block in _RESIDUAL for i in (1, 2) for rule in weight_and_bias(f"{block}.conv{i}", CONV3D)),  # noqa: E501
    *weight_and_bias("blocks.{i}.conv", CONV3D),  # down or up
    *norm("out_layer.0"),
    *weight_and_bias("out_layer.2", CONV3D),
)  # fmt: skip
SLAT_TRUNK = (
    *weight_and_bias("input_layer", LINEAR),
    *weight_and_bias("blocks.{i}.attn.to_qkv", LINEAR),
    Rule("blocks.{i}.attn.q_rms_norm.gamma", "blocks.{i}.attn.q_rms_norm.gamma"),
    Rule("blocks.{i}.attn.k_rms_norm.gamma", "blocks.{i}.attn.k_rms_norm.gamma"),
    *weight_and_bias("blocks.{i}.attn.to_out", LINEAR),
    *weight_and_bias("blocks.{i}.mlp.mlp.0", LINEAR),
    *weight_and_bias("blocks.{i}.mlp.mlp.2", LINEAR),
    *weight_and_bias("out_layer", LINEAR),
)
FLOW = (
    *weight_and_bias("t_embedder.mlp.0", LINEAR),
    *weight_and_bias("t_embedder.mlp.2", LINEAR),
    *weight_and_bias("adaLN_modulation.1", LINEAR),  # share_mod
    *weight_and_bias("input_layer", LINEAR),
    *weight_and_bias("blocks.{i}.adaLN_modulation.1", LINEAR),
    *weight_and_bias("blocks.{i}.self_attn.to_qkv", LINEAR),
    *weight_and_bias("blocks.{i}.self_attn.to_out", LINEAR),
    *norm("blocks.{i}.norm2"),
    *weight_and_bias("blocks.{i}.cross_attn.to_q", LINEAR),
    *weight_and_bias("blocks.{i}.cross_attn.to_kv", LINEAR),
    *weight_and_bias("blocks.{i}.cross_attn.to_out", LINEAR),
    *(
        Rule(f"{gamma}.gamma", f"{gamma}.gamma")
        for kind in ("self", "cross")
        for gamma in (f"blocks.{{i}}.{kind}_attn.{qk}_rms_norm" for qk in "qk")
    ),
    *weight_and_bias("blocks.{i}.mlp.mlp.0", LINEAR),
    *weight_and_bias("blocks.{i}.mlp.mlp.2", LINEAR),
    *weight_and_bias("out_layer", LINEAR),
)
STRUCTURE_FLOW = (*FLOW, Rule("pos_emb", "pos_emb"))
_SPARSE = ("input_blocks.{i}", "out_blocks.{i}")
LATENT_FLOW = (
    *FLOW,
    *(rule for block in _SPARSE for rule in norm(f"{block}.norm1")),
    *(rule for block in _SPARSE for i in (1, 2) for rule in weight_and_bias(f"{block}.conv{i}.conv", SUBMANIFOLD)),  # noqa: E501
    *(rule for block in _SPARSE for rule in weight_and_bias(f"{block}.emb_layers.1", LINEAR)),
    *(rule for block in _SPARSE for rule in weight_and_bias(f"{block}.skip_connection", LINEAR)),
)  # fmt: skip


class Place(NamedTuple):
    """Which network of ours a class fills, which half of it, and by which table."""

    network: str
    part: str
    rules: tuple[Rule, ...]


PLACES = {
    "SparseStructureEncoder": Place("structure_vae", "encoder", STRUCTURE_VAE),
    "SparseStructureDecoder": Place("structure_vae", "decoder", STRUCTURE_VAE),
    "SparseStructureFlowModel": Place("structure_flow", "", STRUCTURE_FLOW),
    "SLatEncoder": Place("uniart_vae", "encoder", SLAT_TRUNK),
    "SLatGaussianDecoder": Place("uniart_vae", "decoder", SLAT_TRUNK),
    "SLatFlowModel": Place("latent_flow", "", LATENT_FLOW),
}


@dataclasses.dataclass(frozen=True)
class Converted:
    """One network of TRELLIS.

    Attributes:
      upstream: its class, without ``Elastic``.
      network, part: whose parameters these are: all of a network ('' part), or its encoder or
        decoder.
      settings: what it says of the model (``trellis_options``).
      model: the config that follows from it alone.
      params: nested, our names and layouts, of the stored float width. Of the SLAT classes they are
        TRELLIS's own, narrower trunks with their ``out_layer``; ``compose`` puts them into the
        UniArt VAE.
      notes: what a person should know.
    """

    upstream: str
    network: str
    part: str
    settings: Settings
    model: ModelConfig
    params: Params
    notes: tuple[str, ...] = ()


def convert_trellis(
    name: str, args: Mapping[str, Any], tensors: Mapping[str, np.ndarray]
) -> Converted:
    """A network of TRELLIS under our names.

    Args:
      name: upstream's class.
      args: its constructor's arguments.
      tensors: its state dict.

    Raises:
      ValueError: not a class that has a place here, options that we do not have, or tensors that do
        not fit; one line each.
    """
    name = class_name(name)
    if name not in PLACES:
        raise ValueError(
            f"{name}: not a network of TRELLIS that has a place here; there are "
            f"{', '.join(OPTIONS)}"
        )
    settings = settings_of(name, args)
    tensors = dict(tensors)
    notes: tuple[str, ...] = ()
    if name == "SparseStructureFlowModel" and "pos_emb" in tensors:
        model = model_of(merged([(name, settings)]))
        if _is_computed(tensors["pos_emb"], _positions(model, args["resolution"])):
            del tensors["pos_emb"]
            notes = ("pos_emb: checked, computed here",)
        else:
            settings["structure_flow.position_table"] = True
            notes = ("pos_emb: not the table that is computed here, so it is kept",)
    model = model_of(merged([(name, settings)]))
    if name == "SLatGaussianDecoder":
        _check_offsets(tensors.pop("offset_perturbation", None), model.gaussians)
        notes = ("offset_perturbation: checked, computed here",)
    place = PLACES[name]
    params = convert(place.rules, tensors, _expected(name, model), name)
    return Converted(name, place.network, place.part, settings, model, params, notes)


def slat_encoder(model: ModelConfig) -> Network:
    """TRELLIS's SLAT encoder by itself: a trunk on visual features only. The UniArt VAE has a wider
    one."""
    c = model.uniart_vae
    return Network(
        "slat_encoder",
        model,
        lambda rngs: Trunk(c.visual_channels, 2 * c.latent_channels, model, rngs),
    )


def _expected(name: str, model: ModelConfig) -> Params:
    if name == "SLatEncoder":
        return slat_encoder(model).abstract()
    if name == "SLatGaussianDecoder":
        return build("gaussian_decoder", model).abstract()
    place = PLACES[name]
    params = build(place.network, model).abstract()
    return params[place.part] if place.part else params


def _positions(model: ModelConfig, resolution: int) -> np.ndarray:
    flow = model.structure_flow
    coords = grid_coords(resolution // flow.patch_size)
    return np.asarray(position_embedding(coords, flow.model_channels))


def _is_computed(stored: np.ndarray, computed: np.ndarray) -> bool:
    """Whether a buffer is what we compute, within the rounding of its type (and of another
    library's sine and atanh)."""
    if stored.shape != computed.shape:
        return False
    tolerance = 1e-5 if stored.dtype.itemsize > 2 else 1e-3
    return np.allclose(stored.astype(np.float32), computed, rtol=tolerance, atol=tolerance)


def _check_offsets(stored: np.ndarray | None, config: GaussianConfig) -> None:
    # upstream keeps the buffer even where it is not used
    computed = offset_perturbation(dataclasses.replace(config, perturb_offset=True))
    if stored is None or not _is_computed(stored, computed):
        problem = "missing" if stored is None else "not the Hammersley points of its config"
        raise ValueError(
            f"SLatGaussianDecoder: offset_perturbation is {problem}; such a decoder is not "
            "supported, leave its file out"
        )
