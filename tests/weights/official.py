"""A checkpoint folder as TRELLIS publishes one, at toy size, with random weights; and PyTorch files
written without PyTorch."""

import io
import json
import struct
import zipfile

import numpy as np
from safetensors.numpy import save_file

from uniart_jax.weights.mapping import CONV3D, LINEAR, SUBMANIFOLD, _compiled, _filled, flatten
from uniart_jax.weights.trellis import PLACES, _expected, model_of
from uniart_jax.weights.trellis_options import merged, settings_of

TRUNK = {"model_channels": 32, "num_blocks": 2, "num_heads": 2, "use_fp16": True}
SLAT = {"resolution": 16, "latent_channels": 8, "attn_mode": "swin", "window_size": 8, **TRUNK}
FLOW = {"in_channels": 8, "out_channels": 8, "cond_channels": 24, "qk_rms_norm": True, **TRUNK}
STRUCTURE = {"latent_channels": 8, "num_res_blocks": 1, "num_res_blocks_middle": 1}
GAUSSIANS = {
    "lr": {"_xyz": 1.0, "_features_dc": 1.0, "_opacity": 1.0, "_scaling": 1.0, "_rotation": 0.1},
    "perturb_offset": True,
    "voxel_size": 1.5,
    "num_gaussians": 4,
    "2d_filter_kernel_size": 0.1,
    "3d_filter_kernel_size": 9e-4,
    "scaling_bias": 4e-3,
    "opacity_bias": 0.1,
    "scaling_activation": "softplus",
}
NETWORKS = {
    "ss_enc": ("SparseStructureEncoder", {"in_channels": 1, "channels": [4, 8, 8], **STRUCTURE}),
    "ss_dec": ("SparseStructureDecoder", {"out_channels": 1, "channels": [8, 8, 4], **STRUCTURE}),
    "ss_flow_img": ("SparseStructureFlowModel", {"resolution": 4, "patch_size": 1, **FLOW}),
    "slat_enc": ("ElasticSLatEncoder", {"in_channels": 24, **SLAT}),
    "slat_dec_gs": ("ElasticSLatGaussianDecoder", {"representation_config": GAUSSIANS, **SLAT}),
    "slat_flow_img": (
        "ElasticSLatFlowModel",
        {"resolution": 16, "patch_size": 2, "io_block_channels": [16], **FLOW},
    ),
}


def abstract(name, args):
    """Our parameters of an upstream class, by name."""
    name = name.removeprefix("Elastic")
    return flatten(_expected(name, model_of(merged([(name, settings_of(name, args))]))))


UNDO = {LINEAR: (1, 0), CONV3D: (4, 3, 0, 1, 2), SUBMANIFOLD: (4, 0, 1, 2, 3)}


def upstream(name, args, seed=0):
    """A random state dict under upstream's names, half precision within the blocks as its
    checkpoints are; no buffers."""
    rng = np.random.default_rng(seed)
    rules = PLACES[name.removeprefix("Elastic")].rules
    state = {}
    for path, leaf in abstract(name, args).items():
        rule, match = next((r, m) for r in rules if (m := _compiled(r.path).fullmatch(path)))
        value = rng.normal(0, 0.2, leaf.shape).astype(np.float32)
        if rule.layout is SUBMANIFOLD:
            value = value.reshape(3, 3, 3, *value.shape[1:])
        value = value.transpose(UNDO.get(rule.layout, range(value.ndim)))
        half = path.split(".")[0] in ("blocks", "input_blocks", "out_blocks", "middle_block")
        dtype = np.float16 if half else np.float32
        state[_filled(rule.pattern, match)] = np.ascontiguousarray(value.astype(dtype))
    return state


def write_folder(folder, names=tuple(NETWORKS), buffers=None, pipeline=None):
    """Writes ``ckpts/<name>.json`` and ``.safetensors``; ``buffers`` {name: {buffer: array}}."""
    (folder / "ckpts").mkdir(parents=True, exist_ok=True)
    for seed, name in enumerate(names):
        kind, args = NETWORKS[name]
        state = upstream(kind, args, seed) | (buffers or {}).get(name, {})
        write_network(folder / "ckpts" / name, kind, args, state)
    if pipeline is not None:
        (folder / "pipeline.json").write_text(json.dumps(pipeline))


def write_network(path, kind, args, state):
    path.with_name(path.name + ".json").write_text(json.dumps({"name": kind, "args": args}))
    save_file(state, path.with_name(path.name + ".safetensors"))


# --- files as torch.save writes them: a zip of a pickle and of the numbers ---

STORAGES = {"<f4": "FloatStorage", "<f2": "HalfStorage", "<i8": "LongStorage"}


def text(value):
    encoded = value.encode()
    return b"X" + struct.pack("<I", len(encoded)) + encoded


def number(value):
    return b"J" + struct.pack("<i", value)


def tuple_of(*items):
    return b"(" + b"".join(items) + b"t"


def symbol(module, name):
    return f"c{module}\n{name}\n".encode()


EMPTY_ORDERED = symbol("collections", "OrderedDict") + b")R"


def tensor(storage, key, size, offset, shape, strides):
    """The instructions that rebuild one tensor."""
    reference = (
        tuple_of(text("storage"), symbol("torch", storage), text(key), text("cpu"), number(size))
        + b"Q"
    )
    arguments = tuple_of(
        reference,
        number(offset),
        tuple_of(*map(number, shape)),
        tuple_of(*map(number, strides)),
        b"\x89",
        EMPTY_ORDERED,
    )
    return symbol("torch._utils", "_rebuild_tensor_v2") + arguments + b"R"


def dictionary(items):
    return b"}(" + b"".join(text(k) + v for k, v in items.items()) + b"u"


def torch_file(path, program, storages, *, order="little", compression=zipfile.ZIP_STORED):
    """Write a zip of ``program`` (without its frame) and storages {key: bytes}."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr("archive/data.pkl", b"\x80\x02" + program + b".")
        archive.writestr("archive/byteorder", order)
        for key, content in storages.items():
            archive.writestr(f"archive/data/{key}", content)
    path.write_bytes(buffer.getvalue())
    return path


def torch_state(path, state, wrap=None):
    """A state dict of float32, float16 or int64 arrays."""
    items, storages = {}, {}
    for key, (name, value) in enumerate(state.items()):
        value = np.ascontiguousarray(value)
        strides = [s // value.itemsize for s in value.strides]
        kind = STORAGES[value.dtype.str]
        items[name] = tensor(kind, str(key), value.size, 0, value.shape, strides)
        storages[str(key)] = value.tobytes()
    program = dictionary(items)
    return torch_file(
        path, dictionary({wrap: program, "epoch": number(3)}) if wrap else program, storages
    )
