"""The folder that a finished stage leaves and that sampling loads: ``config.json`` and one
``<network>.safetensors`` a network.

Averaged weights, flat dotted names, float16 on disk (converted ones as wide as they were) and
float32 in memory. ``latent_stats.safetensors`` holds mean and standard deviation of each latent. A
file is complete or absent (written beside, then renamed); nothing is unpickled.
"""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jax.experimental import multihost_utils
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from uniart_jax.config import Config, from_json, to_json
from uniart_jax.training.hub import PREFIX, hub_folder

PRETRAINED = Path(__file__).parent.parent / "pretrained"  # the shipped models
STATISTICS = "latent_stats.safetensors"


def checkpoint_folder(checkpoint: str | Path) -> Path:
    """Where a checkpoint lies: a shipped model by its name, one of the Hugging Face hub
    (``hf:ORG/NAME``, ``training.hub``), else the folder itself.

    Raises:
      FileNotFoundError: none of these; the shipped ones are listed.
      ValueError: what the hub needs is not installed.
    """
    if str(checkpoint).startswith(PREFIX):
        return hub_folder(str(checkpoint))
    shipped = PRETRAINED / str(checkpoint)
    folder = shipped if not os.path.isdir(checkpoint) and shipped.is_dir() else Path(checkpoint)
    if not folder.is_dir():
        known = (
            ", ".join(sorted(p.name for p in PRETRAINED.iterdir() if p.is_dir()))
            if PRETRAINED.is_dir()
            else ""
        )
        raise FileNotFoundError(
            f"checkpoint '{checkpoint}': neither a folder nor a shipped model (shipped: "
            f"{known or 'none'}; of the hub: hf:ORG/NAME)"
        )
    return folder


def checkpoint_digest(checkpoint: str | Path) -> str:
    """Of all networks of a checkpoint (``checkpoint_folder``), and of the options that it is
    sampled with."""
    total = hashlib.sha256()
    folder = checkpoint_folder(checkpoint)
    folder = folder if list(folder.glob("*.safetensors")) else folder / "export"
    for path in sorted([*folder.glob("*.safetensors"), *folder.glob("config.json")]):
        found = path.stat()
        total.update(path.name.encode() + _file_digest(path, found.st_size, found.st_mtime_ns))
    return total.hexdigest()[:16]


@functools.cache  # gigabytes, asked for by every arm
def _file_digest(path: Path, size: int, changed: int) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def export_network(
    folder: str | Path,
    name: str,
    params: Any,
    dtype: Literal["float16", "float32", "stored"] = "float16",
) -> Path:
    """Write a network's (averaged) parameters to ``folder/<name>.safetensors``.

    Parameters that are split over several processes are gathered first, so call it on all of them;
    the first one writes.

    Args:
      dtype: on disk; 'stored' keeps float16 where a parameter has it and writes float32 otherwise
        (converted weights are mixed).

    Raises:
      ValueError: values are not finite, or too large for float16; all such names are listed.
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
    if bad := _not_finite(tensors):
        raise ValueError(f"{path}: not written, values are not finite as {dtype}: {', '.join(bad)}")
    if jax.process_index() == 0:
        _write(path, save(tensors))  # save_file would make it unreadable for others
    return path


def load_network(folder: str | Path, name: str, abstract: Any) -> Any:
    """Parameters of a network as nested dict of float32 numpy arrays.

    Args:
      folder: an export folder or a training WORKDIR.
      abstract: the expected structure, arrays or ShapeDtypeStructs (``Network.abstract()``).

    Raises:
      FileNotFoundError: no such file.
      ValueError: truncated, of another config, not finite or not floating-point numbers; every
        difference is listed.
    """
    path = find_export(folder, f"{name}.safetensors")
    tensors = _read(path)
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


def copy_export(source: str | Path, folder: str | Path, filename: str) -> None:
    """Copy a file of an export folder (or WORKDIR) as it is; the first process writes.

    Raises:
      FileNotFoundError: ``source`` has no such file.
    """
    path = find_export(source, filename)
    if jax.process_index() == 0:
        _write(Path(folder) / filename, path.read_bytes())
    if jax.process_count() > 1:
        multihost_utils.sync_global_devices(f"copied {filename}")


def write_config(folder: str | Path, config: Config) -> Path:
    """Write ``folder/config.json``."""
    path = Path(folder) / "config.json"
    _write(path, (to_json(config) + "\n").encode())
    return path


def read_config(folder: str | Path) -> Config:
    """The config of an export folder or WORKDIR.

    Raises:
      FileNotFoundError: no config.json.
      ValueError: it is malformed; all unknown fields are listed.
    """
    path = find_export(folder, "config.json")
    try:
        return from_json(Config, path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_statistics(folder: str | Path, name: str, mean: Any, std: Any) -> Path:
    """Add a latent's mean and standard deviation ([C] float32 each) to
    ``folder/latent_stats.safetensors``."""
    path = Path(folder) / STATISTICS
    tensors = _read(path) if path.exists() else {}
    for key, value in (("mean", mean), ("std", std)):
        tensors[f"{name}.{key}"] = np.array(value, dtype=np.float32)
    if bad := _not_finite(tensors):
        raise ValueError(f"{path}: not written, values are not finite: {', '.join(bad)}")
    _write(path, save(tensors))
    return path


def read_statistics(folder: str | Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of a latent, as ``write_statistics`` stored them.

    Raises:
      FileNotFoundError: no such file.
      ValueError: truncated, without this latent, or of values that no latent has: not finite, not
        floating-point numbers, a standard deviation that is not above 0.
    """
    path = find_export(folder, STATISTICS)
    tensors = _read(path)
    keys = (f"{name}.mean", f"{name}.std")
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
            f"{path}: {name} has shapes {mean.shape} and {std.shape}, expected [C] both"
        )
    if not (std > 0).all():
        raise ValueError(
            f"{path}: {keys[1]} is not above 0 in {np.sum(std <= 0)} of {std.size} channels; train "
            "the stage that makes it again"
        )
    return mean, std


def find_export(folder: str | Path, filename: str) -> Path:
    """Path of an exported file: in ``folder`` itself or, where that is a WORKDIR, in
    ``folder/export``.

    Raises:
      FileNotFoundError: in neither.
    """
    folder = Path(folder)
    for place in (folder, folder / "export"):
        if (place / filename).is_file():
            return place / filename
    if not folder.is_dir():
        raise FileNotFoundError(
            f"checkpoint {folder}: no such folder; give an export folder or a WORKDIR"
        )
    raise FileNotFoundError(
        f"checkpoint {folder}: no {filename} in it or in its export/; finish the training stage "
        "that writes it"
    )


def has_export(folder: str | Path, filename: str) -> bool:
    """Whether an export folder or WORKDIR holds this file."""
    try:
        find_export(folder, filename)
    except FileNotFoundError:
        return False
    return True


def flat_names(tree: Any) -> dict[str, Any]:
    """Leaves of a pytree by dotted name, in the tree's own order."""
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {jax.tree_util.keystr(path, simple=True, separator="."): leaf for path, leaf in leaves}


def differences(expected: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """How the named values that were found differ from those expected: missing, extra and
    mismatched names; empty if equal."""
    common = sorted(expected.keys() & found.keys())
    lists = {
        "missing": sorted(expected.keys() - found.keys()),
        "extra": sorted(found.keys() - expected.keys()),
        "mismatched": [f"{n} is {found[n]}, expected {expected[n]}" for n in common if found[n] != expected[n]],  # noqa: E501
    }  # fmt: skip
    return [f"{kind}: {', '.join(names)}" for kind, names in lists.items() if names]


def _not_finite(tensors: dict[str, np.ndarray]) -> list[str]:
    return [name for name, value in sorted(tensors.items()) if not np.isfinite(value).all()]


def _not_floating(tensors: dict[str, np.ndarray]) -> list[str]:
    """Names of what holds no floating-point numbers, with their type (bfloat16 is none of numpy's
    kinds)."""
    return [f"{name} ({v.dtype})" for name, v in sorted(tensors.items()) if v.dtype.kind in "biuc"]


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        return load_file(path)
    except SafetensorError as error:
        raise ValueError(
            f"{path}: truncated or not a safetensors file ({error}); copy or export it again"
        ) from None


def _write(path: Path, content: bytes) -> None:
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
