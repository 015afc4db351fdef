"""State dicts that ``torch.save`` wrote, read without PyTorch and without unpickling.

Such a file is a zip: ``<name>/data.pkl`` says which tensors there are, ``<name>/data/<key>`` hold
the numbers. A pickle is a program that may call anything. This is an interpreter for the few
instructions that a dict of tensors needs; names of functions and classes are symbols to it and
never looked up, and whatever it does not know ends the reading.

``torch.load(weights_only=True)`` reads the same files. These lines are kept since without them
EfficientNet-Lite0 of ImageNet (the extra ``lite0``) and ``uniart convert dinov2`` would
need an install of PyTorch, hundreds of megabytes, for one read.
"""

from __future__ import annotations

import pickletools
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

WRAPPERS = ("state_dict", "model", "teacher")  # keys that training scripts put a state dict under
MAX_PICKLE = 8 << 20  # bytes; names and shapes of a few thousand tensors take less than one
_ADVICE = "load it where you trust it and save the state dict alone as safetensors"

_STORAGES = {
    "torch DoubleStorage": "f8",
    "torch FloatStorage": "f4",
    "torch HalfStorage": "f2",
    "torch BFloat16Storage": "u2",  # widened to float32 at the end
    "torch LongStorage": "i8",
    "torch IntStorage": "i4",
    "torch ShortStorage": "i2",
    "torch CharStorage": "i1",
    "torch ByteStorage": "u1",
    "torch BoolStorage": "?",
}
_DICT, _TENSOR, _PARAMETER = (
    "collections OrderedDict",
    "torch._utils _rebuild_tensor_v2",
    "torch._utils _rebuild_parameter",
)
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_VALUES = {
    "BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE", "SHORT_BINSTRING",
}  # fmt: skip
_IGNORED = {"PROTO", "FRAME"}


class Symbol(NamedTuple):
    """A class or function by its name only."""

    name: str


class Storage(NamedTuple):
    """A reference to ``data/<key>``: ``size`` elements of ``kind``."""

    kind: str
    key: str
    size: int


class Tensor(NamedTuple):
    """A view of a storage; offset and strides in elements."""

    storage: Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]


class _Mark:
    """A place on the stack."""


def read_torch(path: Path) -> dict[str, np.ndarray]:
    """Tensors by name, read-only; views of one storage share its memory. bfloat16 as float32.

    Raises:
      ValueError: not such a file, damaged, or it holds more than tensors.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(archive, path)
    except zipfile.BadZipFile as error:
        with open(path, "rb") as file:
            start = file.read(4)
        if start[:2] != b"PK":
            problem = (
                f"it is in PyTorch's format of before 1.6 or no PyTorch file at all; {_ADVICE}"
            )
        else:
            problem = f"truncated or damaged ({error}); download it again"
        raise ValueError(f"weights '{path}': {problem}") from None
    # zipfile says NotImplementedError of what it cannot unpack, RuntimeError of what is encrypted
    except (EOFError, OSError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"weights '{path}': damaged ({error}); download it again") from None


def _read(archive: zipfile.ZipFile, path: Path) -> dict[str, np.ndarray]:
    entries = {entry.filename: entry for entry in archive.infolist()}
    pickles = [name for name in entries if name.count("/") == 1 and name.endswith("/data.pkl")]
    if len(pickles) != 1:
        raise ValueError(
            f"weights '{path}': a zip, but without PyTorch's data.pkl; give a state dict"
        )
    # torch.save never compresses, so nothing can grow: entries are together no larger than the file
    total = sum(entry.file_size for entry in entries.values())
    packed = any(entry.compress_type != zipfile.ZIP_STORED for entry in entries.values())
    if packed or total > path.stat().st_size or entries[pickles[0]].file_size > MAX_PICKLE:
        raise ValueError(
            f"weights '{path}': its parts are compressed or overlap, as torch.save never writes "
            f"them; {_ADVICE}"
        )
    root = pickles[0].removesuffix("data.pkl")
    order = root + "byteorder"
    big = order in entries and archive.read(order).strip() == b"big"
    try:
        found = state_dict(interpret(archive.read(pickles[0])))
    except ValueError as error:
        raise ValueError(f"weights '{path}': {' '.join(str(error).split())}; {_ADVICE}") from None
    loaded: dict[Storage, np.ndarray] = {}
    tensors = {}
    for name, tensor in found.items():
        storage = tensor.storage
        if storage not in loaded:
            place = f"{root}data/{storage.key}"
            dtype = np.dtype(_STORAGES[storage.kind]).newbyteorder(">" if big else "<")
            if place not in entries or entries[place].file_size != storage.size * dtype.itemsize:
                raise ValueError(
                    f"weights '{path}': the numbers of {name} are missing or of another length; "
                    "download it again"
                )
            values = np.frombuffer(archive.read(place), dtype)
            values = values.astype(dtype.newbyteorder("=")) if big else values
            if (
                storage.kind == "torch BFloat16Storage"
            ):  # once a storage, however many tensors view it
                values = widened(values)
            loaded[storage] = values
        try:
            value = view(loaded[storage], tensor)
        except ValueError as error:
            raise ValueError(f"weights '{path}': {name}: {error}; download it again") from None
        tensors[name] = value
    return tensors


def view(values: np.ndarray, tensor: Tensor) -> np.ndarray:
    """The tensor's elements of its storage, not copied.

    Raises:
      ValueError: it reaches outside the storage, or is larger than it.
    """
    _, offset, shape, strides = tensor
    numbers = (offset, *shape, *strides)
    if len(shape) != len(strides) or len(shape) > 16 or min(numbers) < 0 or max(numbers) >= 2**62:
        raise ValueError(f"impossible shape {shape}, strides {strides}, offset {offset}")
    if 0 in shape:
        return np.zeros(shape, values.dtype)
    last = offset + sum((n - 1) * s for n, s in zip(shape, strides, strict=True))
    elements = 1
    for n in shape:
        elements *= n
    if last >= len(values) or elements > len(values):
        raise ValueError(
            f"shape {shape}, strides {strides}, offset {offset} reach outside its {len(values)} "
            "numbers"
        )
    steps = [s * values.itemsize for s in strides]
    return np.lib.stride_tricks.as_strided(values[offset:], shape, steps, writeable=False)


def state_dict(value: Any) -> dict[str, Tensor]:
    """The tensors by name of what a file holds, be they under one of ``WRAPPERS``.

    Raises:
      ValueError: it is no dict of tensors.
    """
    for key in WRAPPERS:
        if isinstance(value, dict) and isinstance(value.get(key), dict):
            value = value[key]
            break
    if not isinstance(value, dict) or not value:
        raise ValueError(f"it holds a {type(value).__name__}, no dict of tensors")
    strange = [
        str(k) for k, v in value.items() if not (isinstance(k, str) and isinstance(v, Tensor))
    ]
    if strange:
        raise ValueError(f"beside tensors it holds {', '.join(strange[:5])}")
    return value


def interpret(program: bytes) -> Any:
    """Run a pickle of dicts and tensors; tensors come out as ``Tensor``.

    Raises:
      ValueError: malformed, or an instruction, name or call that a state dict has no need of.
    """
    stack: list[Any] = []
    memo: dict[int, Any] = {}

    def pop(kind: type = object) -> Any:
        if not stack or not isinstance(stack[-1], kind) or isinstance(stack[-1], _Mark):
            raise ValueError("its pickle is malformed")
        return stack.pop()

    def pop_to_mark() -> list[Any]:
        items = []
        while stack and not isinstance(stack[-1], _Mark):
            items.append(stack.pop())
        if not stack:
            raise ValueError("its pickle is malformed")
        stack.pop()
        return items[::-1]

    for code, argument, _ in pickletools.genops(program):
        name = code.name
        if name in _IGNORED:
            continue
        if name == "STOP":
            return pop()
        if name in _CONSTANTS:
            stack.append(_CONSTANTS[name])
        elif name in _VALUES:
            stack.append(argument)
        elif name == "GLOBAL":
            if argument not in (_DICT, _TENSOR, _PARAMETER) and argument not in _STORAGES:
                raise ValueError(
                    f"its pickle names {str(argument).replace(' ', '.')}, which is no part of a "
                    "state dict"
                )
            stack.append(Symbol(str(argument)))
        elif name == "MARK":
            stack.append(_Mark())
        elif name == "EMPTY_TUPLE":
            stack.append(())
        elif name in ("TUPLE1", "TUPLE2", "TUPLE3"):
            items = [pop() for _ in range(int(name[-1]))]
            stack.append(tuple(items[::-1]))
        elif name == "TUPLE":
            stack.append(tuple(pop_to_mark()))
        elif name == "EMPTY_DICT":
            stack.append({})
        elif name == "EMPTY_LIST":
            stack.append([])
        elif name == "APPEND":
            item = pop()
            _top(stack, list).append(item)
        elif name == "APPENDS":
            items = pop_to_mark()
            _top(stack, list).extend(items)
        elif name == "SETITEM":
            value, key = pop(), pop()
            _set(_top(stack, dict), [key, value])
        elif name == "SETITEMS":
            items = pop_to_mark()
            _set(_top(stack, dict), items)
        elif name in ("BINPUT", "LONG_BINPUT"):
            memo[int(argument or 0)] = _top(stack, object)
        elif name in ("BINGET", "LONG_BINGET"):
            if argument not in memo:
                raise ValueError("its pickle is malformed")
            stack.append(memo[argument])
        elif name == "BINPERSID":
            stack.append(_storage(pop(tuple)))
        elif name == "REDUCE":
            arguments = pop(tuple)
            stack.append(_call(pop(Symbol), arguments))
        elif name == "BUILD":
            # an OrderedDict's attributes: a module's version numbers, which nobody needs
            state = pop()
            if not (isinstance(state, dict) and state.keys() <= {"_metadata"}):
                raise ValueError("its pickle sets attributes of an object")
            _top(stack, dict)
        else:
            raise ValueError(
                f"its pickle has an instruction {name}, which a state dict has no need of"
            )
    raise ValueError("its pickle is malformed")


def _top(stack: list[Any], kind: type) -> Any:
    if not stack or not isinstance(stack[-1], kind) or isinstance(stack[-1], _Mark):
        raise ValueError("its pickle is malformed")
    return stack[-1]


def _set(target: dict, items: list[Any]) -> None:
    keys, values = items[::2], items[1::2]
    if len(keys) != len(values) or not all(isinstance(key, str | int) for key in keys):
        raise ValueError("its pickle has a dict with keys that are not names")
    target.update(zip(keys, values, strict=True))


def _storage(reference: tuple) -> Storage:
    match reference:
        case ("storage", Symbol(kind), str(key), _, int(size), *rest) if (
            kind in _STORAGES and size >= 0 and rest in ([], [None])  # of before 1.6: no view
        ):
            return Storage(kind, key, size)
    raise ValueError("its pickle refers to something that is no tensor's storage")


def _call(function: Symbol, arguments: tuple) -> Any:
    """The three calls that a state dict makes, as data."""
    match function.name, arguments:
        case "collections OrderedDict", ():
            return {}
        case "torch._utils _rebuild_parameter", (Tensor() as tensor, *_):
            return tensor
        case (
            "torch._utils _rebuild_tensor_v2",
            (Storage() as storage, int(offset), tuple(shape), tuple(strides), *_),
        ) if all(type(n) is int for n in (offset, *shape, *strides)):
            return Tensor(storage, offset, shape, strides)
    raise ValueError(
        f"its pickle calls {function.name.replace(' ', '.')} in a way that no state dict does"
    )


def widened(bits: np.ndarray) -> np.ndarray:
    """bfloat16 as uint16 bits -> float32."""
    return (bits.astype(np.uint32) << 16).view(np.float32)
