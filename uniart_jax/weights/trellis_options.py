"""TRELLIS v1's constructor arguments, as its checkpoints' JSON gives them, in terms of our
``ModelConfig``.

Defaults are upstream's constructors' (``trellis/models/*.py``). An option that changes the
mathematics and that we do not have is an error.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from uniart_jax.config import GaussianConfig, ModelConfig

Settings = dict[str, Any]  # fields of ModelConfig by dotted name, and STRUCTURE_SIDE
STRUCTURE_SIDE = "side of the structure latent"  # what a structure flow knows of the grid

OUT_OF_SCOPE = {
    "SLatRadianceFieldDecoder": "radiance fields are not what this library makes",
    "SLatMeshDecoder": "meshes come from this library's own heads",
}
FLOWS = ("SparseStructureFlowModel", "SLatFlowModel")
TEXT_CHANNELS = 768  # of CLIP ViT-L/14, which TRELLIS's text flows are conditioned on
DEFAULT = ModelConfig()
_REQUIRED = object()
_NO_EFFECT = {"use_fp16", "use_checkpoint"}  # on the result


class Option(NamedTuple):
    """An argument: its type, upstream's default, our field and the values that we have (none given:
    all)."""

    kind: type
    default: Any = _REQUIRED
    field: str = ""
    choices: tuple = ()


def _structure_vae(channel: str) -> dict[str, Option]:
    return {
        channel: Option(int, choices=(1,)),
        "latent_channels": Option(int, field="structure_vae.latent_channels"),
        "num_res_blocks": Option(int, field="structure_vae.num_res_blocks"),
        "channels": Option(tuple, field="structure_vae.channels"),
        "num_res_blocks_middle": Option(int, 2, "structure_vae.num_res_blocks_middle"),
        "norm_type": Option(str, "layer", "structure_vae.norm", ("layer", "group")),
    }


def _trunk(width: str, network: str, qk_rms_norm: str) -> dict[str, Option]:
    return {
        "model_channels": Option(int, field=f"{network}.{width}"),
        "num_blocks": Option(int, field=f"{network}.num_blocks"),
        "num_heads": Option(int, None, f"{network}.num_heads"),
        "num_head_channels": Option(int, 64),
        "mlp_ratio": Option(float, 4.0, f"{network}.mlp_ratio"),
        "pe_mode": Option(str, "ape", choices=("ape",)),
        "qk_rms_norm": Option(bool, False, f"{network}.{qk_rms_norm}"),
    }


def _slat_vae() -> dict[str, Option]:
    return {
        "resolution": Option(int, field="grid.resolution"),
        "latent_channels": Option(int, field="uniart_vae.latent_channels"),
        **_trunk("width", "uniart_vae", "qk_rms_norm"),
        "attn_mode": Option(str, "swin", "uniart_vae.attention", ("full", "swin")),
        "window_size": Option(int, 8, "uniart_vae.window"),
    }


def _flow(network: str, resolution: str, latent: str) -> dict[str, Option]:
    return {
        "resolution": Option(int, field=resolution),
        "in_channels": Option(int, field=latent),
        "out_channels": Option(int),
        "cond_channels": Option(int, field=f"{network}.cond_channels"),
        **_trunk("model_channels", network, "qk_rms_norm"),
        "patch_size": Option(int, 2, f"{network}.patch_size"),
        "share_mod": Option(bool, False, f"{network}.share_mod"),
        "qk_rms_norm_cross": Option(bool, False, f"{network}.qk_rms_norm_cross"),
    }


OPTIONS: dict[str, dict[str, Option]] = {
    "SparseStructureEncoder": _structure_vae("in_channels"),
    "SparseStructureDecoder": _structure_vae("out_channels"),
    "SparseStructureFlowModel": _flow(
        "structure_flow", STRUCTURE_SIDE, "structure_vae.latent_channels"
    ),
    "SLatEncoder": {"in_channels": Option(int, field="uniart_vae.visual_channels"), **_slat_vae()},
    "SLatFlowModel": {
        **_flow("latent_flow", "grid.resolution", "uniart_vae.latent_channels"),
        "num_io_res_blocks": Option(int, 2, "latent_flow.num_io_res_blocks"),
        "io_block_channels": Option(tuple, None, "latent_flow.io_channels"),
        "use_skip_connection": Option(bool, True, "latent_flow.use_skip_connection"),
    },
    "SLatGaussianDecoder": {"representation_config": Option(dict), **_slat_vae()},
}
GAUSSIANS = {
    "num_gaussians": Option(int, field="num_gaussians"),
    "voxel_size": Option(float, field="voxel_size"),
    "perturb_offset": Option(bool, field="perturb_offset"),
    "2d_filter_kernel_size": Option(float),  # the renderer's
    "3d_filter_kernel_size": Option(float, field="kernel_size_3d"),
    "scaling_bias": Option(float, field="scaling_bias"),
    "opacity_bias": Option(float, field="opacity_bias"),
    "scaling_activation": Option(str, field="scaling_activation", choices=("exp", "softplus")),
    "lr": Option(dict),
}
RATES = {
    f"_{name}": Option(float, field=f"lr_{name}")
    for name in ("xyz", "features_dc", "scaling", "rotation", "opacity")
}


def class_name(name: str) -> str:
    """Upstream's class without the prefix of its memory-managed training variant, which has the
    same parameters."""
    return name.removeprefix("Elastic")


def out_of_scope(name: str, args: Mapping[str, Any], file: str = "") -> str:
    """Why a network of TRELLIS has no place here; '' if it has one.

    A flow is a text flow if its file is called ``…txt…``, or, where the name says neither ``txt``
    nor ``img``, if its condition has CLIP's width.
    """
    name = class_name(name)
    if name in FLOWS:
        words = file.lower().replace("-", "_").split("_")
        unnamed = "img" not in words and "txt" not in words
        if "txt" in words or (unnamed and args.get("cond_channels") == TEXT_CHANNELS):
            return "conditioned on text"
    return OUT_OF_SCOPE.get(name, "")


def settings_of(name: str, args: Mapping[str, Any]) -> Settings:
    """What one network's arguments say of the model.

    Raises:
      ValueError: arguments are missing, strange or malformed, or ask for what we do not have.
    """
    if args.get("attn_mode") == "full":  # its windows have any size, or None
        args = {key: value for key, value in args.items() if key != "window_size"}
    found = _read(name, OPTIONS[name], args)
    fields = {option.field: found[key] for key, option in OPTIONS[name].items() if option.field}
    if name == "SparseStructureDecoder":
        fields["structure_vae.channels"] = fields["structure_vae.channels"][::-1]
    if name in FLOWS and found["out_channels"] != found["in_channels"]:
        raise ValueError(
            f"{name}: out_channels {found['out_channels']} differs from in_channels "
            f"{found['in_channels']}; such a flow is not supported"
        )
    if "num_heads" in found and found["num_heads"] is None:
        field = OPTIONS[name]["num_heads"].field
        fields[field] = found["model_channels"] // found["num_head_channels"]
    heads = [value for field, value in fields.items() if field.endswith(".num_heads")]
    if heads and (heads[0] < 1 or found["model_channels"] % heads[0]):
        raise ValueError(
            f"{name}: model_channels {found['model_channels']} does not divide into {heads[0]} "
            "heads"
        )
    if name == "SLatFlowModel" and not fields["latent_flow.io_channels"]:
        # without these blocks upstream does not go down, whatever patch_size says
        fields |= {"latent_flow.io_channels": (), "latent_flow.patch_size": 1}
    if fields.get("uniart_vae.attention") == "full":
        fields.pop("uniart_vae.window")
    if name == "SLatGaussianDecoder":
        where = f"{name}: representation_config"
        values = _read(where, GAUSSIANS, found["representation_config"])
        rates = _read(f"{where}: lr", RATES, values["lr"])
        for options, given in ((GAUSSIANS, values), (RATES, rates)):
            fields |= {f"gaussians.{o.field}": given[k] for k, o in options.items() if o.field}
    return fields


def merged(settings: Iterable[tuple[str, Settings]]) -> Settings:
    """The settings of several networks, named for errors, as one.

    Raises:
      ValueError: they contradict each other; all contradictions are listed.
    """
    together: Settings = {}
    source: dict[str, str] = {}
    conflicts = []
    for name, fields in settings:
        for field, value in fields.items():
            if field in together and together[field] != value:
                conflicts.append(
                    f"{field} is {together[field]} in {source[field]} and {value} in {name}"
                )
            together[field] = value
            source[field] = name
    side = together.pop(STRUCTURE_SIDE, None)
    if side is not None:
        levels = len(together.get("structure_vae.channels", DEFAULT.structure_vae.channels))
        resolution = together.setdefault("grid.resolution", side << (levels - 1))
        if resolution != side << (levels - 1):
            conflicts.append(
                f"the structure flow's latent has {side} cells a side, a grid of {resolution} "
                f"halved {levels - 1} times has {resolution >> (levels - 1)}"
            )
    widths = {
        together[f"{flow}.cond_channels"]
        for flow in ("structure_flow", "latent_flow")
        if f"{flow}.cond_channels" in together
    }
    if len(widths) > 1:
        conflicts.append(
            f"the flows are conditioned on images of different widths {sorted(widths)}"
        )
    if conflicts:
        raise ValueError(f"the networks do not belong to one model: {'; '.join(conflicts)}")
    return together


def model_of(settings: Settings, base: ModelConfig = DEFAULT) -> ModelConfig:
    """The config with these fields; all others are ``base``'s, by default the paper's."""
    parts: dict[str, dict[str, Any]] = {}
    for field, value in settings.items():
        part, name = field.split(".")
        parts.setdefault(part, {})[name] = value
    changed = {
        part: dataclasses.replace(getattr(base, part), **fields) for part, fields in parts.items()
    }
    return dataclasses.replace(base, **changed)


def _read(name: str, options: Mapping[str, Option], args: Any) -> dict[str, Any]:
    """Arguments by name, with defaults filled in."""
    if not isinstance(args, Mapping):
        raise ValueError(f"{name}: its arguments are no JSON object but {type(args).__name__}")
    problems = []
    values = {}
    if strange := sorted(args.keys() - options.keys() - _NO_EFFECT):
        problems.append(f"unknown: {', '.join(strange)}")
    missing = [k for k, o in options.items() if o.default is _REQUIRED and k not in args]
    if missing:
        problems.append(f"missing: {', '.join(missing)}")
    for key, option in options.items():
        value = args.get(key, option.default)
        if option.kind is float and type(value) is int:
            value = float(value)
        if option.kind is tuple and isinstance(value, list):
            value = tuple(value)
        values[key] = value
        if key not in args or (value is None and option.default is None):
            continue
        if not _is_a(value, option.kind):
            problems.append(f"{key}={value!r} is malformed")
        elif option.choices and value not in option.choices:
            have = " or ".join(repr(choice) for choice in option.choices)
            problems.append(f"{key}={value!r} is not supported, only {have}")
    if problems:
        raise ValueError(f"{name}: options {'; '.join(problems)}")
    return values


def _is_a(value: Any, kind: type) -> bool:
    """Whether a JSON value is of a kind; numbers that count something are positive."""
    if kind is dict:
        return isinstance(value, Mapping)
    if kind is tuple:
        return isinstance(value, tuple) and all(_is_a(n, int) for n in value)
    return type(value) is kind and (kind is not int or value > 0)


assert {o.field for o in (*GAUSSIANS.values(), *RATES.values()) if o.field} == {
    field.name for field in dataclasses.fields(GaussianConfig)
}
