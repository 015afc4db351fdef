"""One forward pass of TRELLIS's networks at their real size, beside PyTorch with the same weights,
in one run.

    python benchmarks/full_size.py [structure_flow latent_flow slat_encoder dinov2] [--repeats 3]
    [--out out/bench]

Random weights, one object of about 11,600 voxels, float32. Our parameters are the peer's, through
the converter, so the largest difference of the two outputs shows that both computed the same thing.
Seconds are medians of the repeats, taken in turn. Gate: ratio <= 1.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import torch
import torch_peers as peers
from results import in_turn, report
from surfaces import surface_of

from uniart_jax.config import ModelConfig
from uniart_jax.models.network import build
from uniart_jax.nn.grids import CELL_STEP, flow_plan
from uniart_jax.nn.voxel_plans import voxel_plans, window_ids
from uniart_jax.weights.dinov2 import convert_dinov2
from uniart_jax.weights.trellis import convert_trellis, slat_encoder

VOXELS, TIME = 11_600, 0.7
FLOW = dict(model_channels=1024, cond_channels=1024, num_blocks=24, num_heads=16, qk_rms_norm=True)
Case = tuple[Any, Callable[..., Any], tuple, Callable[[], Any], int]


def randomise(module: torch.nn.Module) -> dict[str, np.ndarray]:
    """Every parameter drawn (zero-initialised layers would hide what flows through them); the state
    dict."""
    generator = torch.Generator().manual_seed(0)
    for parameter in module.parameters():
        fan = parameter[0].numel() if parameter.ndim > 1 else 0
        scale = min(0.02, fan**-0.5) if fan else 0.02
        with torch.no_grad():
            parameter.normal_(0, scale, generator=generator)
            if not fan:
                parameter.add_(0.5 if parameter.numel() > 1 else 0.0)
    return {name: value.numpy() for name, value in module.state_dict().items()}


def normal(*shape: int) -> np.ndarray:
    return np.random.default_rng(len(shape)).normal(size=shape).astype(np.float32)


def structure_flow() -> Case:
    peer = peers.StructureFlow(16, 8, 1024, 1024, 24, 16)
    args = dict(resolution=16, in_channels=8, out_channels=8, patch_size=1, **FLOW)
    converted = convert_trellis("SparseStructureFlowModel", args, randomise(peer))
    network = build("structure_flow", converted.model)
    x, context = normal(4096, 8), normal(1374, 1024)
    inputs = (x.reshape(1, 16, 16, 16, 8), np.float32([TIME]), context[None])
    ours = lambda p, *a: network.apply(p, *a).reshape(4096, 8)  # noqa: E731
    return (
        converted.params,
        ours,
        inputs,
        lambda: peer(torch.tensor(x), TIME, torch.tensor(context)),
        4096,
    )


def latent_flow() -> Case:
    coords = surface_of(VOXELS)
    peer = peers.LatentFlow(8, 1024, 1024, 24, 16, 128)
    args = dict(
        resolution=64, in_channels=8, out_channels=8, patch_size=2, io_block_channels=[128], **FLOW
    )
    converted = convert_trellis("SLatFlowModel", args, randomise(peer))
    model = converted.model
    network, count = build("latent_flow", model), np.array([len(coords)], np.int32)
    plan = flow_plan(coords[None], count, model.latent_flow, model.grid, round_to=CELL_STEP)
    (pool,) = plan.pools
    x, context = normal(len(coords), 8), normal(1374, 1024)
    cells = torch.as_tensor(pool.parent[0].astype(np.int64) // 8)
    fine, coarse = (
        peers.conv_pairs(n[0, :c])
        for n, c in zip(plan.neighbors, (len(coords), pool.counts[0]), strict=True)
    )
    cell_coords = torch.as_tensor(pool.coords[0, : pool.counts[0]])
    inputs = (x[None], np.float32([TIME]), context[None], coords[None], count, plan)

    def ours(p, x, t, tokens, coords, counts, plan):
        return network.apply(p, x, t, tokens, coords=coords, counts=counts, plan=plan)[0]

    def theirs():
        return peer(torch.tensor(x), TIME, torch.tensor(context), fine, coarse, cells, cell_coords)

    return converted.params, ours, inputs, theirs, len(coords)


def slat() -> Case:
    coords = surface_of(VOXELS)
    peer = peers.SlatEncoder(1024, 768, 8, 12, 12)
    args = dict(
        resolution=64,
        in_channels=1024,
        model_channels=768,
        latent_channels=8,
        num_blocks=12,
        num_heads=12,
    )
    converted = convert_trellis("SLatEncoder", args, randomise(peer))
    model, network = converted.model, slat_encoder(converted.model)
    x = normal(len(coords), 1024)
    counts = np.array([len(coords)], np.int32)
    plans = voxel_plans(coords[None], counts, model.uniart_vae, model.grid, fitted=True)
    windows = [peers.Windows(window_ids(coords[None], 8, shift)[0]) for shift in (0, 4)]
    ours = lambda p, x, c, plans: network.apply(p, x, c, plans)[0]  # noqa: E731
    theirs = lambda: peer(torch.tensor(x), torch.as_tensor(coords), windows)  # noqa: E731
    return converted.params, ours, (x[None], coords[None], plans), theirs, len(coords)


def dinov2() -> Case:
    peer = peers.DINOv2()
    config, params = convert_dinov2(randomise(peer))
    network = build("image_encoder", ModelConfig(image_encoder=config))
    image = normal(1, 518, 518, 3)
    ours = lambda p, x: network.apply(p, x, method="features")[0]  # noqa: E731
    theirs = lambda: peer(torch.tensor(image.transpose(0, 3, 1, 2)))[0]  # noqa: E731
    return params, ours, (image,), theirs, 1374


CASES = {
    "structure_flow": structure_flow,
    "latent_flow": latent_flow,
    "slat_encoder": slat,
    "dinov2": dinov2,
}


def measure(name: str, repeats: int) -> dict[str, Any]:
    params, ours, inputs, theirs, tokens = CASES[name]()
    params, inputs = jax.tree.map(jnp.asarray, (params, inputs))
    begin = time.perf_counter()
    compiled = jax.jit(ours).lower(params, *inputs).compile()
    compile_seconds = time.perf_counter() - begin
    memory = compiled.memory_analysis().temp_size_in_bytes / 2**20
    with torch.no_grad():
        expected = theirs().numpy()
        found = np.asarray(compiled(params, *inputs))[: len(expected)]
        times = in_turn({"ours": lambda: compiled(params, *inputs), "torch": theirs}, repeats)
    return {
        "network": name,
        "tokens": tokens,
        "ours s": times["ours"],
        "torch s": times["torch"],
        "ratio": times["ours"] / times["torch"],
        "compile s": compile_seconds,
        "temporaries MiB": memory,
        "differ": float(np.abs(found - expected).max() / np.abs(expected).max()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("networks", nargs="*", default=list(CASES))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments = parser.parse_args()
    rows = []
    for name in arguments.networks or CASES:
        rows.append(measure(name, arguments.repeats))
        print(
            f"{name}: {rows[-1]['ours s']:.1f} s, PyTorch {rows[-1]['torch s']:.1f} s", flush=True
        )
        gc.collect()
    report("full_size", rows, arguments.out)


if __name__ == "__main__":
    main()
