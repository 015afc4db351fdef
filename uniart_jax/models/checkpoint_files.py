"""The files of a checkpoint folder: ``config.json``, one ``<network>.safetensors`` a network, and
``latent_stats.safetensors`` with mean and standard deviation of each latent.

Averaged weights, flat dotted names, float16 on disk (converted ones as wide as they were, large
kernels as int8 where asked) and float32 in memory. A file is complete or absent (written beside,
then renamed); nothing is unpickled. ``models.checkpoint`` says which of them a folder has, and
reads them.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jax.experimental import multihost_utils
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from uniart_jax.config import Config, to_json
from uniart_jax.models.network import differences, flat_names

STATISTICS = "latent_stats.safetensors"
SCALE = "scale_of_int8"  # end of the name of what a kernel in int8 is multiplied with


def write_network(
    folder: str | Path,
    name: str,
    params: Any,
    dtype: Literal["float16", "float32", "stored"] = "float16",
    int8: Sequence[str] = (),
) -> Path:
    """Write a network's (averaged) parameters to ``folder/<name>.safetensors``.

    Parameters that are split over several processes are gathered first, so call it on all of them;
    the first one writes.

    Args:
      dtype: on disk; 'stored' keeps float16 where a parameter has it and writes float32 otherwise
        (converted weights are mixed).
      int8: names of kernels that are rounded to 8 bits, each with a scale an output channel (its
        last axis): half the bytes, an error of at most .4 % of the channel's largest weight.

    Raises:
      ValueError: values are not finite, or too large for float16; all such names are listed. Or
        there is no kernel of a name in ``int8``.
    """
    tensors = {}
    for key, leaf in flat_names(params).items():
        if isinstance(leaf, jax.Array) and not (
            leaf.is_fully_addressable or leaf.is_fully_replicated
        ):
            leaf = multihost_utils.process_allgather(leaf, tiled=True)
        width = dtype
        if width == "stored":
            width = "float16" if leaf.dtype == np.float16 else "float32"
        with np.errstate(over="ignore"):
            tensors[key] = np.ascontiguousarray(np.asarray(leaf).astype(width))
    path = Path(folder) / f"{name}.safetensors"
    if unknown := sorted({*int8} - {*tensors}):
        raise ValueError(f"{path}: not written, no parameter is named {', '.join(unknown)}")
    if bad := _not_finite(tensors):
        raise ValueError(f"{path}: not written, values are not finite as {dtype}: {', '.join(bad)}")
    for key in int8:
        tensors |= _to_int8(key, tensors[key])
    if jax.process_index() == 0:
        write_file(path, save(tensors))  # save_file would make it unreadable for others
    return path


def read_network(path: Path, abstract: Any) -> Any:
    """Parameters of a network as nested dict of float32 numpy arrays.

    Args:
      path: a ``.safetensors`` file.
      abstract: the expected structure, arrays or ShapeDtypeStructs (``Network.abstract()``).

    Raises:
      FileNotFoundError: no such file.
      ValueError: truncated, of another config, not finite or not floating-point numbers; every
        difference is listed.
    """
    tensors = _from_int8(_read(path))
    expected = flat_names(abstract)
    problems = differences(
        {name: list(leaf.shape) for name, leaf in expected.items()},
        {name: list(leaf.shape) for name, leaf in tensors.items()},
    )
    if bad := _not_floating(tensors):
        problems.append(f"not floating-point numbers: {', '.join(bad)}")
    if bad := _not_finite(tensors):
        problems.append(f"not finite: {', '.join(bad)}")
    if problems:
        raise ValueError(
            f"{path} does not fit this config; {'; '.join(problems)}; use the config.json it was "
            "made with"
        )
    leaves = [tensors[n].astype(np.float32) for n in expected]
    return jax.tree.unflatten(jax.tree.structure(abstract), leaves)


def _to_int8(name: str, kernel: np.ndarray) -> dict[str, np.ndarray]:
    """A kernel as int8, and what its output channels are multiplied with, float32."""
    kernel = kernel.astype(np.float32)
    scale = np.abs(kernel).max(tuple(range(kernel.ndim - 1))) / 127
    rounded = np.round(kernel / np.where(scale > 0, scale, 1)).astype(np.int8)
    return {name: rounded, f"{name}.{SCALE}": scale}


def _from_int8(tensors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A file's tensors, those in int8 with a scale as float32."""
    found = {name: value for name, value in tensors.items() if not name.endswith(f".{SCALE}")}
    for name, value in found.items():
        scale = tensors.get(f"{name}.{SCALE}")
        if scale is not None and value.dtype == np.int8 and scale.shape == value.shape[-1:]:
            found[name] = value.astype(np.float32) * scale
    return found


def write_config(folder: str | Path, config: Config) -> Path:
    """Write ``folder/config.json``."""
    path = Path(folder) / "config.json"
    write_file(path, (to_json(config) + "\n").encode())
    return path


def write_statistics(folder: str | Path, latent: str, mean: Any, std: Any) -> Path:
    """Add a latent's mean and standard deviation ([C] float32 each) to
    ``folder/latent_stats.safetensors``."""
    path = Path(folder) / STATISTICS
    tensors = _read(path) if path.exists() else {}
    for key, value in (("mean", mean), ("std", std)):
        tensors[f"{latent}.{key}"] = np.array(value, dtype=np.float32)
    if bad := _not_finite(tensors):
        raise ValueError(f"{path}: not written, values are not finite: {', '.join(bad)}")
    write_file(path, save(tensors))
    return path


def read_statistics(path: Path, latent: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation [C] of a latent, as ``write_statistics`` stored them.

    Raises:
      FileNotFoundError: no such file.
      ValueError: truncated, without this latent, or of values that no latent has: not finite, not
        floating-point numbers, a standard deviation that is not above 0.
    """
    tensors = _read(path)
    keys = (f"{latent}.mean", f"{latent}.std")
    if missing := [key for key in keys if key not in tensors]:
        raise ValueError(f"{path}: missing: {', '.join(missing)}; train the stage that makes them")
    found = {key: tensors[key] for key in keys}
    if bad := _not_floating(found):
        raise ValueError(f"{path}: not floating-point numbers: {', '.join(bad)}")
    if bad := _not_finite(found):
        raise ValueError(f"{path}: not finite: {', '.join(bad)}")
    mean, std = found.values()
    if mean.ndim != 1 or mean.shape != std.shape:
        raise ValueError(
            f"{path}: {latent} has shapes {mean.shape} and {std.shape}, expected [C] both"
        )
    if not (std > 0).all():
        raise ValueError(
            f"{path}: {keys[1]} is not above 0 in {np.sum(std <= 0)} of {std.size} channels; train "
            "the stage that makes it again"
        )
    return mean, std


def write_file(path: Path, content: bytes) -> None:
    """Write a file that is complete or absent, whenever the program ends."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(temporary, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        return load_file(path)
    except SafetensorError as error:
        raise ValueError(
            f"{path}: truncated or not a safetensors file ({error}); copy or export it again"
        ) from None


def _not_finite(tensors: dict[str, np.ndarray]) -> list[str]:
    return [name for name, value in sorted(tensors.items()) if not np.isfinite(value).all()]


def _not_floating(tensors: dict[str, np.ndarray]) -> list[str]:
    """Names of what holds no floating-point numbers, with their type (bfloat16 is none of numpy's
    kinds)."""
    return [f"{name} ({v.dtype})" for name, v in sorted(tensors.items()) if v.dtype.kind in "biuc"]
