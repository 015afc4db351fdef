"""Tensors of a weight file by name, as numpy: safetensors, and what ``torch.save`` writes
(``weights.torch_file``).

No code of a file is run and PyTorch is not needed.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open

from uniart_jax.weights.torch_file import read_torch, widened
from uniart_jax.weights.torch_legacy import is_legacy, read_legacy

TORCH_SUFFIXES = (".pt", ".pth", ".bin")
_TYPES = {
    "F64": "<f8",
    "F32": "<f4",
    "F16": "<f2",
    "BF16": "<u2",  # widened to float32 below
    "I64": "<i8",
    "I32": "<i4",
    "I16": "<i2",
    "I8": "i1",
    "U8": "u1",
    "BOOL": "?",
}


def read_tensors(path: str | Path) -> dict[str, np.ndarray]:
    """Every tensor of a file by its name.

    Args:
      path: ``.safetensors``, or a PyTorch state dict ``.pt``, ``.pth``, ``.bin`` (alone, or under
        the key state_dict, model or teacher).

    Returns:
      Read-only arrays of the stored type, mapped from the file where that can be; bfloat16, which
      numpy lacks, as float32 (exact).

    Raises:
      FileNotFoundError: no such file.
      ValueError: another kind of file, a damaged one, or a pickle that holds more than tensors.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"weights '{path}': no such file")
    if path.suffix == ".safetensors":
        return _read_safetensors(path)
    if path.suffix in TORCH_SUFFIXES and is_legacy(path):
        try:
            return read_legacy(path)
        except ValueError as error:
            raise ValueError(
                f"weights '{path}': PyTorch's format of before 1.6, but "
                f"{' '.join(str(error).split())}; download it again, or save the state dict alone "
                "as safetensors"
            ) from None
    if path.suffix in TORCH_SUFFIXES:
        return read_torch(path)
    raise ValueError(
        f"weights '{path}': unknown kind of file; give .safetensors or a PyTorch state dict "
        f"{', '.join(TORCH_SUFFIXES)}"
    )


def _read_safetensors(path: Path) -> dict[str, np.ndarray]:
    try:
        with safe_open(path, framework="np"):  # checks the header: names, types, offsets, length
            pass
    except (SafetensorError, OSError) as error:
        raise ValueError(
            f"weights '{path}': truncated or not a safetensors file ({error}); download it again"
        ) from None
    with open(path, "rb") as file:
        length = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(length))
    header.pop("__metadata__", None)
    strange = {entry["dtype"] for entry in header.values()} - _TYPES.keys()
    if strange:
        raise ValueError(
            f"weights '{path}': it holds tensors of type {', '.join(sorted(strange))}; convert "
            "them to float16 or float32"
        )
    content = np.memmap(path, np.uint8, mode="r", offset=8 + length) if any(
        np.prod(entry["shape"]) for entry in header.values()
    ) else np.zeros(0, np.uint8)  # fmt: skip
    tensors = {}
    for name, entry in header.items():
        start, end = entry["data_offsets"]
        value = np.asarray(content[start:end]).view(_TYPES[entry["dtype"]]).reshape(entry["shape"])
        tensors[name] = widened(value) if entry["dtype"] == "BF16" else value
    return tensors
