"""State dicts in ``torch.save``'s format of before PyTorch 1.6, read without unpickling.

Five pickles (magic number, version, system, the dict, the storages' keys), then of each storage in
the keys' order its number of elements as int64 and the elements, little-endian. The pickles run in
``torch_file.interpret``, which calls nothing.
"""

from __future__ import annotations

import pickletools
from pathlib import Path

import numpy as np

from uniart_jax.weights.torch_file import (
    _STORAGES,
    MAX_PICKLE,
    Storage,
    interpret,
    state_dict,
    view,
    widened,
)

MAGIC = 0x1950A86A20F9469CFC6C
VERSION = 1001
PICKLES = 5


def is_legacy(path: Path) -> bool:
    """Whether a file begins with the old format's magic number."""
    with open(path, "rb") as file:
        start = file.read(64)
    try:
        return _pickles(start, 1)[0][0] == MAGIC
    except ValueError:
        return False


def read_legacy(path: Path) -> dict[str, np.ndarray]:
    """Tensors by name; bfloat16 as float32.

    Raises:
      ValueError: truncated, or more than a dict of tensors.
    """
    data = path.read_bytes()
    (magic, version, _, held, keys), place = _pickles(data, PICKLES)
    if (magic, version) != (MAGIC, VERSION) or not isinstance(keys, list):
        raise ValueError("it is of an unknown version of PyTorch's old format")
    found = state_dict(held)
    storages: dict[str, Storage] = {t.storage.key: t.storage for t in found.values()}
    loaded: dict[str, np.ndarray] = {}
    for key in keys:
        if key not in storages:
            raise ValueError(f"its storage {key} belongs to no tensor")
        storage, dtype = storages[key], np.dtype(_STORAGES[storages[key].kind]).newbyteorder("<")
        size = int.from_bytes(data[place : place + 8], "little")
        place += 8
        end = place + size * dtype.itemsize
        if size != storage.size or end > len(data):
            raise ValueError("it is truncated or damaged")
        values = np.frombuffer(data, dtype, size, place)
        loaded[key] = widened(values) if storage.kind == "torch BFloat16Storage" else values
        place = end
    if missing := storages.keys() - loaded.keys():
        raise ValueError(f"it is truncated: {len(missing)} storages are missing")
    return {name: view(loaded[tensor.storage.key], tensor) for name, tensor in found.items()}


def _pickles(data: bytes, count: int) -> tuple[list, int]:
    """The values of the first ``count`` pickles of ``data`` and where they end; ValueError if there
    are none."""
    values, place = [], 0
    for _ in range(count):
        part = data[place : place + MAX_PICKLE]
        end = next((at for code, _, at in pickletools.genops(part) if code.name == "STOP"), None)
        if end is None:
            raise ValueError("its pickle is malformed")
        values.append(interpret(part[: end + 1]))
        place += end + 1
    return values, place
