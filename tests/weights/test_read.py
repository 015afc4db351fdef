"""Reading weight files: what is stored comes back; what could run, or is broken, is refused with
one line."""

import builtins
import os
import pickle
import struct
import zipfile

import numpy as np
import pytest
from official import (
    EMPTY_ORDERED,
    dictionary,
    number,
    symbol,
    tensor,
    text,
    torch_file,
    torch_state,
    tuple_of,
)
from safetensors.numpy import save_file

from uniart_jax.weights.read import read_tensors
from uniart_jax.weights.torch_legacy import MAGIC, VERSION

VALUES = np.arange(12, dtype=np.float32)


def refused(path, pattern):
    with pytest.raises(ValueError, match=pattern) as error:
        read_tensors(path)
    assert "\n" not in str(error.value) and str(path) in str(error.value)


def test_safetensors_of_mixed_widths(tmp_path):
    state = {
        "half": np.float16([[1.5, -2]]),
        "full": VALUES.reshape(3, 4),
        "count": np.int64(7),
        "none": np.zeros((0, 3), np.float32),
    }
    save_file({k: np.asarray(v) for k, v in state.items()}, tmp_path / "a.safetensors")
    found = read_tensors(tmp_path / "a.safetensors")
    assert found.keys() == state.keys()
    for name, value in state.items():
        assert found[name].dtype == np.asarray(value).dtype
        np.testing.assert_array_equal(found[name], value)


def test_safetensors_of_bfloat16(tmp_path):
    header = b'{"w":{"dtype":"BF16","shape":[2],"data_offsets":[0,4]}}'
    values = np.array([1.0, -3.140625], np.float32)
    bits = (values.view(np.uint32) >> 16).astype("<u2").tobytes()
    path = tmp_path / "a.safetensors"
    path.write_bytes(struct.pack("<Q", len(header)) + header + bits)
    np.testing.assert_array_equal(read_tensors(path)["w"], values)
    path.write_bytes(path.read_bytes().replace(b'"BF16"', b'"F8_X"'))
    refused(path, "safetensors")


def test_damaged_and_unknown_files(tmp_path):
    path = tmp_path / "a.safetensors"
    save_file({"w": VALUES}, path)
    path.write_bytes(path.read_bytes()[:-3])
    refused(path, "truncated or not a safetensors file")
    path.write_bytes(b"")
    refused(path, "truncated or not a safetensors file")
    (tmp_path / "a.onnx").touch()
    refused(tmp_path / "a.onnx", "unknown kind of file")
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_tensors(tmp_path / "b.pth")


@pytest.mark.parametrize("wrap", [None, "state_dict", "model", "teacher"])
def test_a_state_dict_comes_back(tmp_path, wrap):
    state = {"w": VALUES.reshape(4, 3), "h": np.float16([1, 2]), "n": np.array(5)}
    found = read_tensors(torch_state(tmp_path / "a.pth", state, wrap))
    assert found.keys() == state.keys()
    for name, value in state.items():
        assert found[name].dtype == value.dtype
        np.testing.assert_array_equal(found[name], value)


def test_views_parameters_versions_and_bfloat16(tmp_path):
    bits = (VALUES.view(np.uint32) >> 16).astype("<u2").tobytes()
    whole = tensor("FloatStorage", "0", 12, 0, (3, 4), (4, 1))
    parameter = (
        symbol("torch._utils", "_rebuild_parameter")
        + tuple_of(whole, b"\x88", EMPTY_ORDERED)
        + b"R"
    )
    items = {
        "whole": parameter,
        "turned": tensor("FloatStorage", "0", 12, 0, (4, 3), (1, 4)),
        "part": tensor("FloatStorage", "0", 12, 6, (2, 2), (4, 1)),
        "none": tensor("FloatStorage", "0", 12, 0, (0, 2), (2, 1)),
        "brain": tensor("BFloat16Storage", "1", 12, 2, (), ()),
    }
    ordered = EMPTY_ORDERED + dictionary(items)[1:]
    versions = dictionary({"_metadata": EMPTY_ORDERED}) + b"b"
    path = torch_file(tmp_path / "a.pt", ordered + versions, {"0": VALUES.tobytes(), "1": bits})
    found = read_tensors(path)
    square = VALUES.reshape(3, 4)
    np.testing.assert_array_equal(found["whole"], square)
    np.testing.assert_array_equal(found["turned"], square.T)
    np.testing.assert_array_equal(found["part"], square[1:, 2:])
    assert np.shares_memory(found["whole"], found["part"]) and not found["part"].flags.writeable
    assert found["none"].shape == (0, 2) and found["brain"] == 2
    swapped = {
        "0": VALUES.astype(">f4").tobytes(),
        "1": np.frombuffer(bits, "<u2").astype(">u2").tobytes(),
    }
    path = torch_file(tmp_path / "big.pt", ordered, swapped, order="big")
    for name, value in read_tensors(path).items():
        np.testing.assert_array_equal(value, found[name])


GOOD = tensor("FloatStorage", "0", 12, 0, (3, 4), (4, 1))
HOSTILE = {
    "system": (symbol("os", "system") + tuple_of(text("touch PROOF")) + b"R", r"names os\.system"),
    "builtin": (symbol("builtins", "eval") + tuple_of(text("touch PROOF")) + b"R", r"names builtins\.eval"),  # noqa: E501
    "hidden": (text("os") + text("system") + b"\x93" + tuple_of(text("touch PROOF")) + b"R", "instruction STACK_GLOBAL"),  # noqa: E501
    "instance": (b"(" + text("touch PROOF") + b"ios\nsystem\n", "instruction INST"),
    "object": (symbol("torch", "FloatStorage") + b")\x81", "instruction NEWOBJ"),
    "extension": (b"\x82\x01", "instruction EXT1"),
    "called storage": (symbol("torch", "FloatStorage") + tuple_of(number(9)) + b"R", r"calls torch\.FloatStorage"),  # noqa: E501
    "called dict": (symbol("collections", "OrderedDict") + tuple_of(b"]") + b"R", r"calls collections\.OrderedDict"),  # noqa: E501
    "attributes": (EMPTY_ORDERED + dictionary({"__class__": number(1)}) + b"b", "sets attributes"),
    "module": (symbol("torch.nn.modules.linear", "Linear") + b")R", r"names torch\.nn\.modules\.linear\.Linear"),  # noqa: E501
    "strange reference": (tuple_of(text("module")) + b"Q", "refers to something"),
    "list": (b"]", "holds a list"),
    "mixed": (dictionary({"w": GOOD, "lr": number(1)}), "beside tensors it holds lr"),
    "empty": (b"}", "no dict of tensors"),
    "underflow": (b"R", "malformed"),
    "loose items": (b"(" + text("w") + b"u", "malformed"),
    "no memo": (b"h\x07", "malformed"),
    "cut": (b"X\xff\x00\x00\x00abc", "expected 255 bytes"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_pickle_runs_nothing(tmp_path, name, monkeypatch):
    program, message = HOSTILE[name]
    calls = []
    monkeypatch.setattr(os, "system", calls.append)
    monkeypatch.setattr(builtins, "eval", calls.append)
    path = torch_file(tmp_path / "a.pth", program, {"0": VALUES.tobytes()})
    refused(path, message)
    assert not calls
    if name in ("system", "builtin", "hidden", "instance"):  # it would have
        pickle.loads(b"\x80\x02" + program + b".")
        assert calls == ["touch PROOF"]


@pytest.mark.parametrize(
    "view",
    [(1, (3, 4), (4, 1)), (0, (3, 4), (-4, 1)), (0, (2**40, 2**40), (0, 0)), (-1, (2,), (1,)), (0, (3, 4), (1,))],  # noqa: E501
)  # fmt: skip
def test_views_stay_within_their_storage(tmp_path, view):
    if max(view[1]) > 2**31:  # larger than the writer's numbers
        big = b"\x8a\x06" + (2**40).to_bytes(6, "little")
        program = tensor("FloatStorage", "0", 12, 0, (1, 1), (0, 0)).replace(number(1), big)
    else:
        program = tensor("FloatStorage", "0", 12, *view)
    refused(
        torch_file(tmp_path / "a.pth", dictionary({"w": program}), {"0": VALUES.tobytes()}), "w: "
    )


def legacy_file(path, program, *storages):
    """A file of ``torch.save`` before 1.6: five pickles, then each storage's length and numbers."""
    system = {"protocol_version": 1001, "little_endian": True, "type_sizes": {"int": 4}}
    heads = [pickle.dumps(v, 2) for v in (MAGIC, VERSION, system)]
    keys = pickle.dumps([key for key, _ in storages], 2)
    numbers = b"".join(struct.pack("<q", len(v)) + v.tobytes() for _, v in storages)
    frame = b"" if program.startswith(b"\x80") else b"\x80\x02"
    body = program if frame == b"" else frame + program + b"."
    path.write_bytes(b"".join([*heads, body, keys]) + numbers)
    return path


def test_the_format_of_before_1_6(tmp_path):
    program = dictionary({"w": GOOD})
    path = legacy_file(tmp_path / "a.pth", program, ("0", VALUES))
    found = read_tensors(path)
    whole = read_tensors(torch_file(tmp_path / "b.pth", program, {"0": VALUES.tobytes()}))
    np.testing.assert_array_equal(found["w"], whole["w"])
    path.write_bytes(path.read_bytes()[:-4])
    refused(path, r"before 1\.6.*truncated")
    legacy_file(path, program)
    refused(path, r"before 1\.6.*missing")
    legacy_file(path, pickle.dumps(os.getcwd, 2), ("0", VALUES))
    refused(path, r"before 1\.6.*no part of a state dict")


def test_damaged_zips(tmp_path):
    program = dictionary({"w": GOOD})
    path = torch_file(tmp_path / "a.pth", program, {"0": VALUES.tobytes()})
    whole = path.read_bytes()
    path.write_bytes(whole[:-30])
    refused(path, "truncated or damaged")
    at = whole.index(VALUES.tobytes())
    path.write_bytes(whole[: at + 4] + b"\x09" + whole[at + 5 :])
    refused(path, "truncated or damaged.*CRC")
    path.write_bytes(b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.")  # the start of the old format
    refused(path, r"before 1\.6.*safetensors")
    refused(torch_file(tmp_path / "a.pth", program, {"0": VALUES[:-1].tobytes()}), "another length")
    refused(torch_file(tmp_path / "a.pth", program, {}), "missing")
    zeros = np.zeros(1 << 20, np.float32)
    bomb = dictionary({"w": tensor("FloatStorage", "0", zeros.size, 0, (zeros.size,), (1,))})
    refused(
        torch_file(tmp_path / "a.pth", bomb, {"0": zeros.tobytes()}, compression=zipfile.ZIP_DEFLATED),  # noqa: E501
        "compressed",
    )  # fmt: skip
    with zipfile.ZipFile(tmp_path / "b.pth", "w") as archive:
        archive.writestr("readme", "nothing")
    refused(tmp_path / "b.pth", r"without PyTorch's data\.pkl")
