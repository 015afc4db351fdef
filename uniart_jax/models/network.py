"""A network as a pure function: ``apply(params, ...)`` over a plain nested dict of arrays.

The modules are Flax NNX; here they are split into structure and parameters once, so that everything
above works on plain pytrees under plain ``jax.jit``. Names in the dict mirror TRELLIS's modules:
``params["blocks"]["0"]["self_attn"]["to_qkv"]["kernel"]``.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from typing import Any

import jax
from flax import nnx

from uniart_jax.config import STAGES, ModelConfig
from uniart_jax.models.aggregation import AGGREGATIONS
from uniart_jax.runtime.program_cache import kept_program

Params = dict[str, Any]
TOLD = 6  # names of a kind, missing ones for instance, that a message holds

# Each network's file in this folder and its class, imported when it is built; or a class of one's
# own, of (ModelConfig, nnx.Rngs), or where it is: "package.module:Class".
Entry = str | type[nnx.Module]
MODULES: dict[str, Entry] = {
    "layout": "layout:LayoutNetwork",
    "mask": "mask:MaskNetwork",
    "structure_vae": "structure_vae:StructureVAE",
    "uniart_vae": "uniart_vae:UniArtVAE",
    "structure_flow": "flow_transformer:StructureFlow",
    "latent_flow": "flow_transformer:LatentFlow",
    "gaussian_decoder": "gaussian_decoder:GaussianDecoder",
}
# By ``ImageEncoderConfig.architecture``, entries as in ``MODULES``. An image encoder maps images
# [B, H, W, 3], sRGB in [0, 1] on black, to a dict. ``inference.samplers.make_conditioner`` takes of
# it
#   tokens [B, L, D]              always: any number of them, D = cond_channels of the flows
#   volume [B, Rv, Rv, Rv, C]     where a flow has volume_channels, of which it reads the first:
#                                 features in the object's grid, Rv = volume_resolution
#   pixels [B, S, S, pixel_width] where a flow has pixel_channels or refine_channels: maps of S =
#                                 image_size / stem_stride a side, of which the first
#                                 3 stem_stride^2 channels are the picture
#                                 (``image_encoder.pixel_width``, ``image_encoder.silhouette``)
#   camera [B, 7]                 with these: the camera code that they are read through
#                                 (``voxels.camera_code``)
# A kind that is ``spatial`` (``config.IMAGE_ENCODERS``) gives all four, another the tokens alone.
# One that is ``trained`` is also called with true cameras (image, camera, use_true_camera), and
# gives occupancy [B, R, R, R] logits and codes [B, Rt, Rt, Rt, 21] to ``training.encoder_loss``.
# Further keys are its own affair. The layout network has a backbone of its own.
IMAGE_ENCODERS: dict[str, Entry] = {
    "volume": "image_encoder:ImageEncoder",
    "dinov2": "dinov2:DINOv2",
}


class _OneKey:
    """``nnx.Rngs`` where only shapes matter: to count what each layer draws, and fold it in, is
    most of the time of tracing them."""

    def __init__(self) -> None:
        self.key = jax.random.key(0)

    def params(self) -> jax.Array:
        return self.key


class Network:
    """One network of a model: how to make its parameters and how to run it.

    Attributes:
      name: one of ``config.STAGES``.
      config: the model that it belongs to.
    """

    def __init__(self, name: str, config: ModelConfig, make: Callable[[Any], nnx.Module]):
        self.name, self.config, self._make = name, config, make

    def __repr__(self) -> str:
        count = sum(leaf.size for leaf in jax.tree.leaves(self._split[1]))
        return f"Network({self.name}: {count:,} parameters)"

    def init(self, key: jax.Array) -> Params:
        """Fresh parameters; pure, so it may run under ``jax.jit`` with output shardings."""
        state = nnx.state(self._make(nnx.Rngs(params=key)))
        return _plain(nnx.to_pure_dict(state))

    def apply(self, params: Params, *args, method: str = "__call__", **kwargs):
        """Run a method of the network with these parameters.

        Raises:
          ValueError: the parameters' names or shapes are not the network's; all differences are
            listed.
        """
        graph, state = self._split
        leaves, values = nnx.to_flat_state(state), flat_names(params)
        expected = {".".join(map(str, path)): list(leaf.shape) for path, leaf in leaves}
        found = {name: list(value.shape) for name, value in values.items()}
        if problems := differences(expected, found):
            raise ValueError(f"{self.name}: parameters do not match; {'; '.join(problems)}")
        filled = nnx.from_flat_state(
            [
                (path, leaf.replace(values[name]))
                for name, (path, leaf) in zip(expected, leaves, strict=True)
            ]
        )
        return getattr(nnx.merge(graph, filled), method)(*args, **kwargs)

    def abstract(self) -> Params:
        """The parameters as ``jax.ShapeDtypeStruct``."""
        return _plain(nnx.to_pure_dict(self._split[1]))

    @functools.cached_property
    def _split(self):
        return nnx.split(nnx.eval_shape(lambda: self._make(_OneKey())))


def build(name: str, config: ModelConfig) -> Network:
    """A network by name: one of ``config.STAGES``, or 'gaussian_decoder', TRELLIS's optional
    head. Equal configs give one network, whose structure is traced once.

    Raises:
      ValueError: the name is none of these.
    """
    modules = {**MODULES, "image_encoder": encoder_entry(config)}
    if name not in modules:
        known = ", ".join(dict.fromkeys((*STAGES, *modules)))
        raise ValueError(f"network {name!r} is unknown; choose one of {known}")
    try:
        return _built(name, config, modules[name])
    except TypeError:  # a list in the config
        return _built.__wrapped__(name, config, modules[name])


def encoder_entry(config: ModelConfig) -> Entry:
    """That of the config's image encoder.

    Raises:
      ValueError: ``IMAGE_ENCODERS`` has no such architecture.
    """
    architecture = config.image_encoder.architecture
    if architecture not in IMAGE_ENCODERS:
        raise ValueError(
            f"image encoder {architecture!r} has no network; choose one of "
            f"{', '.join(IMAGE_ENCODERS)}, or add it to models.network.IMAGE_ENCODERS"
        )
    return IMAGE_ENCODERS[architecture]


@functools.lru_cache(maxsize=32)
def _built(name: str, config: ModelConfig, entry: Entry) -> Network:
    module = network_class(entry)
    return Network(name, config, lambda rngs: module(config, rngs))


def network_class(entry: Entry) -> Callable[..., nnx.Module]:
    """The class that an entry of ``MODULES`` or ``IMAGE_ENCODERS`` means.

    Raises:
      ValueError: it names none.
    """
    if not isinstance(entry, str):
        return entry
    file, _, kind = entry.partition(":")
    name = file if "." in file else f"uniart_jax.models.{file}"
    try:
        return getattr(importlib.import_module(name), kind)
    except (ImportError, AttributeError) as error:
        raise ValueError(
            f"network '{entry}': {error}; give a class, or package.module:Class"
        ) from error


def is_of_this_package(config: ModelConfig) -> bool:
    """Whether all networks of a model are of this package, whose sources tell a kept program from
    one that has changed (``runtime.program_cache``)."""
    front = AGGREGATIONS.get(config.uniart_vae.aggregation)
    entries = (*MODULES.values(), encoder_entry(config), *filter(None, [front]))
    places = (entry if isinstance(entry, str) else f"{entry.__module__}." for entry in entries)
    return all("." not in place or place.startswith("uniart_jax.") for place in places)


def kept_of_model(
    jitted: Callable[..., Any], what: str, config: ModelConfig, *settings: Any
) -> Callable[..., Any]:
    """``program_cache.kept_program`` of a model's networks; ``jitted`` as it is where not all of
    them are of this package."""
    if not is_of_this_package(config):
        return jitted
    return kept_program(jitted, what, config, *settings)


def flat_names(tree: Any) -> dict[str, Any]:
    """Leaves of a pytree by dotted name, in the tree's own order."""
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {jax.tree_util.keystr(path, simple=True, separator="."): leaf for path, leaf in leaves}


def differences(expected: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """How the named values that were found differ from those expected: missing, extra and
    mismatched names, the first ``TOLD`` of each; empty if equal."""
    common = sorted(expected.keys() & found.keys())
    lists = {
        "missing": sorted(expected.keys() - found.keys()),
        "extra": sorted(found.keys() - expected.keys()),
        "mismatched": [
            f"{n} is {found[n]}, expected {expected[n]}" for n in common if found[n] != expected[n]
        ],
    }
    return [f"{kind}: {_first(names)}" for kind, names in lists.items() if names]


def _first(names: list[str]) -> str:
    more = len(names) - TOLD
    return ", ".join(names[:TOLD]) + (f" and {more} more" if more > 0 else "")


def _plain(state: dict) -> Params:
    return {str(k): _plain(v) if isinstance(v, dict) else v for k, v in state.items()}
