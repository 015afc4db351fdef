"""One training step of ``configs/small.py``'s latent flow on a CPU, beside the same network in
PyTorch, in one run.

    python benchmarks/training_step.py [--items 2] [--repeats 3] [--out out/bench]

Forward, backward, clipping, AdamW and the moving average of the weights, float32; procedural
objects of about 13,000 to 15,000 voxels at 64^3. The peer works object by object on exact lengths;
ours is padded to the config's voxel bucket. The share of the peak counts only the useful
operations, as PyTorch's own counter sees them in the peer (no padding, only pairs of voxels that
exist), over our time and the measured rate of a large product. Gates: ratio <= 1, share >= 50 %.
With ``--profile`` the trace of one step is written for ``xprof`` or Perfetto.

XLA gives a step's memory back and takes it anew; where fresh pages are dear (virtual machines),
MALLOC_MMAP_MAX_=0 MALLOC_TRIM_THRESHOLD_=100000000000 MALLOC_ARENA_MAX=1 in the environment keeps
it.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import torch
import torch_peers as peers
from results import in_turn, matmul_peak, report
from surfaces import surface
from torch.nn.utils import clip_grad_norm_
from torch.utils.flop_counter import FlopCounterMode

from uniart_jax.config import Config, load_config
from uniart_jax.models.flow_trunk import T_MIN
from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan
from uniart_jax.training.sharding import make_mesh, put_batch
from uniart_jax.training.state import create_state, make_optimizer
from uniart_jax.training.step import make_train_step
from uniart_jax.weights.mapping import LINEAR, convert, weight_and_bias
from uniart_jax.weights.trellis import LATENT_FLOW

OBJECTS = (("table", 1), ("laptop", 0), ("refrigerator", 5), ("laptop", 5))
TOKENS = 256  # of the image


def small() -> Config:
    config = load_config("small")
    model = dataclasses.replace(
        config.model, compute_dtype="float32", scan_blocks=False, remat=False
    )
    return dataclasses.replace(config, model=model)


class Peer(peers.LatentFlow):
    """With the aligned volume, and predicting the clean sample."""

    def __init__(self, c, latent: int):
        super().__init__(
            latent, c.model_channels, c.cond_channels, c.num_blocks, c.num_heads, c.io_channels[0]
        )
        self.volume_layer = torch.nn.Linear(c.volume_channels, c.model_channels)

    def forward(self, x, t, context, volume, fine, coarse, cells, cell_coords, side):
        time = self.t_embedder(t)
        seen = x * ((1 - t) / ((1 - t) ** 2 + t**2))
        first = self.input_blocks[0](self.input_layer(seen), time, fine, cells)
        h = second = self.input_blocks[1](first, time, coarse, cells)
        h = h + peers.positions(cell_coords, h.shape[-1])
        added = self.volume_layer(torch.nn.functional.layer_norm(volume, volume.shape[-1:]))
        at = (cell_coords.long() * volume.shape[0]).div(side, rounding_mode="floor")
        h = h + added[at[:, 0], at[:, 1], at[:, 2]]
        for block in self.blocks:
            h = block(h, time, context)
        h = self.out_blocks[0](torch.cat([h, second], -1), time, fine, cells)
        h = self.out_blocks[1](torch.cat([h, first], -1), time, fine, cells)
        out = self.out_layer(torch.nn.functional.layer_norm(h, h.shape[-1:]))
        return (x - out) / max(t, T_MIN)


def batch_of(config: Config, items: int) -> dict[str, Any]:
    """Objects padded to the smallest bucket that holds them, with random latents, conditions and
    times."""
    found = [surface(*name) for name in itertools.islice(itertools.cycle(OBJECTS), items)]
    longest = max(map(len, found))
    width = min(b for b in config.data.voxel_buckets if b >= longest)
    rng, model = np.random.default_rng(0), config.model
    normal = lambda *s: rng.normal(size=s).astype(np.float32)  # noqa: E731
    coords, counts = (
        np.zeros((items, width, 3), np.int32),
        np.array([len(c) for c in found], np.int32),
    )
    for row, voxels in zip(coords, found, strict=True):
        row[: len(voxels)] = voxels
    flow, side = model.latent_flow, model.latent_flow.volume_resolution
    return {
        "coords": coords,
        "counts": counts,
        "plan": flow_plan(coords, counts, flow, model.grid),
        "x0": normal(items, width, model.uniart_vae.latent_channels),
        "noise": normal(items, width, model.uniart_vae.latent_channels),
        "t": np.linspace(0.3, 0.9, items, dtype=np.float32),
        "tokens": normal(items, TOKENS, flow.cond_channels),
        "volume": normal(items, side, side, side, flow.volume_channels),
    }


def our_loss(network):
    def loss(params, batch, key):
        x0, noise, t = batch["x0"], batch["noise"], batch["t"][:, None, None]
        x = (1 - t) * x0 + t * noise
        v = network.apply(
            params,
            x,
            batch["t"],
            batch["tokens"],
            batch["volume"],
            **{k: batch[k] for k in ("coords", "counts", "plan")},
        )
        mask = (jnp.arange(x.shape[1]) < batch["counts"][:, None]).astype(jnp.float32)
        error = jnp.square(v - (noise - x0)).mean(-1) * mask
        return (error.sum(1) / batch["counts"]).mean(), {}

    return loss


def peer_step(peer: Peer, batch: dict[str, Any], config: Config):
    """A function that makes one update and returns the loss, and the tensors it reads."""
    stage = config.latent_flow
    optimizer = torch.optim.AdamW(
        peer.parameters(),
        stage.learning_rate,
        stage.betas,
        weight_decay=stage.weight_decay,
        foreach=True,
    )
    parameters = list(peer.parameters())
    average = [p.detach().clone() for p in parameters]
    items = []
    (pool,) = batch["plan"].pools
    width = batch["coords"].shape[1]
    for b, n in enumerate(batch["counts"]):
        levels = [(width, n), (pool.coords.shape[1], pool.counts[b])]
        pairs = []
        for plan, (wide, count) in zip(batch["plan"].neighbors, levels, strict=True):
            local = plan[b, :count].astype(np.int64) - b * wide
            pairs.append(peers.conv_pairs(np.where((local >= 0) & (local < count), local, count)))
        cells = torch.as_tensor(pool.parent[b, :n].astype(np.int64) // 8 - b * pool.coords.shape[1])
        tensors = [torch.as_tensor(batch[k][b]) for k in ("tokens", "volume")]
        x0, noise = (torch.as_tensor(batch[k][b, :n]) for k in ("x0", "noise"))
        cell_coords = torch.as_tensor(pool.coords[b, : pool.counts[b]])
        items.append((float(batch["t"][b]), x0, noise, tensors, pairs, cells, cell_coords))
    side = config.model.grid.resolution // config.model.latent_flow.patch_size

    def loss_of(t, x0, noise, tensors, pairs, cells, cell_coords):
        v = peer((1 - t) * x0 + t * noise, t, *tensors, *pairs, cells, cell_coords, side)
        return (v - (noise - x0)).square().mean() / len(items)

    def step():
        optimizer.zero_grad()
        total = 0.0
        for item in items:
            loss = loss_of(*item)
            loss.backward()
            total += float(loss.detach())
        clip_grad_norm_(parameters, stage.gradient_clip, foreach=True)
        optimizer.step()
        torch._foreach_lerp_(average, [p.detach() for p in parameters], 1 - stage.ema_decay)
        return total

    return step


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--items", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    parser.add_argument("--profile", type=Path)
    arguments = parser.parse_args()
    config = small()
    batch = batch_of(config, arguments.items)
    network, stage = build("latent_flow", config.model), config.latent_flow
    torch.manual_seed(0)
    peer = Peer(config.model.latent_flow, config.model.uniart_vae.latent_channels)
    state_dict = {name: p.detach().numpy().copy() for name, p in peer.state_dict().items()}
    table = (*LATENT_FLOW, *weight_and_bias("volume_layer", LINEAR))
    params = convert(table, state_dict, network.abstract(), "small")
    optimizer = make_optimizer(stage)
    place = make_mesh(config.mesh)
    state = create_state(
        lambda key: jax.tree.map(jnp.asarray, params), optimizer, jax.random.key(0), place
    )
    update = make_train_step(our_loss(network), optimizer, stage.ema_decay)
    device_batch, key = put_batch(batch, place), jax.random.key(0)
    found: dict[str, Any] = {}

    def ours():
        nonlocal state
        state, metrics = update(state, device_batch, key)
        found.setdefault("ours", float(metrics["loss"]))
        return state

    theirs = peer_step(peer, batch, config)
    with FlopCounterMode(display=False) as counter:
        found["torch"] = theirs()
    times = in_turn({"ours": ours, "torch": theirs}, arguments.repeats)
    if arguments.profile:
        with jax.profiler.trace(str(arguments.profile)):
            jax.block_until_ready(ours())
    peak, useful = matmul_peak(), counter.get_total_flops() / 1e9
    row = {
        "objects": arguments.items,
        "voxels": int(batch["counts"].sum()),
        "padded to": batch["coords"].shape[0] * batch["coords"].shape[1],
        "ours s": times["ours"],
        "torch s": times["torch"],
        "ratio": times["ours"] / times["torch"],
        "useful GFLOP": useful,
        "share of peak": useful / times["ours"] / peak,
        "torch's share": useful / times["torch"] / peak,
        "losses differ": abs(found["ours"] - found["torch"]) / found["torch"],
    }
    report("training_step", [row], arguments.out, peak_gflops=peak)


if __name__ == "__main__":
    main()
