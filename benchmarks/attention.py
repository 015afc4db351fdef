"""Attention on a CPU beside PyTorch's, in one run: shifted windows of a 64^3 surface, and full
attention of the latent flow.

    python benchmarks/attention.py [--repeats 7] [--out out/bench]

* windows: 12 heads of 64, windows of 8^3 shifted by 4, forward and forward + backward, against the
  better of two ways in PyTorch: an exact loop over the windows, or all padded to the longest under
    one mask. ``limit`` is the time that the exact windows' products alone take at the measured
  matrix rate. Both gather and put back the tokens. Gates: ratio <= 1, padding <= 15 % of tokens,
  cost linear in voxels (log-log slope <= 1.1).
* full: 3,072 tokens, 16 heads of 64, against ``scaled_dot_product_attention``. Gate: ratio <= 1.2.
* kinds: the same windows in other tilings (``attention_xla.CPU_LOGITS``), which is how the default
  was chosen.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import torch
import torch.nn.functional as F
from results import in_turn, matmul_peak, picture, report, slope
from surfaces import surface
from torch_peers import Windows

from uniart_jax.nn import attention_xla
from uniart_jax.nn.attention import attend, attend_segments
from uniart_jax.nn.segments import fitted_sizes, pack_segments
from uniart_jax.nn.voxel_plans import window_ids

OBJECTS = (
    ("scissors", 0),
    ("bottle", 0),
    ("faucet", 4),
    ("laptop", 2),
    ("table", 1),
    ("table", 0),
    ("refrigerator", 1),
    ("storage_furniture", 1),
    ("refrigerator", 0),
)
HEADS, SIZE, WINDOW = 12, 64, 8
TILINGS = (18, 19, 20, 21)  # log2 of the logits at a time


def windows_case(coords: np.ndarray, peak: float, repeats: int) -> dict[str, Any]:
    """One object: seconds of ours and the peer's, and how much of ours is padding."""
    ids, counts = window_ids(coords[None], WINDOW, WINDOW // 2), np.array([len(coords)])
    plan = pack_segments(ids, counts, fitted_sizes(ids, counts, WINDOW**3))
    padded = sum(bucket.index.size for bucket in plan.buckets)
    lengths = np.unique(ids, return_counts=True)[1]
    device_plan = jax.tree.map(jnp.asarray, plan)
    rng = np.random.default_rng(0)
    x, g = (rng.normal(size=(len(coords), n, HEADS, SIZE)).astype(np.float32) for n in (3, 1))
    ours_x, ours_g = jnp.asarray(x), jnp.asarray(g[:, 0])
    peer_x, peer_g, peer = torch.tensor(x), torch.tensor(g[:, 0]), Windows(ids[0])
    forward = jax.jit(attend_segments)
    both = jax.jit(lambda x, p, g: jax.vjp(lambda x: attend_segments(x, p), x)[1](g)[0])

    def torch_both(function):
        leaf = peer_x.clone().requires_grad_()
        function(leaf).backward(peer_g)
        return leaf.grad

    with torch.no_grad():
        difference = float(np.abs(forward(ours_x, device_plan) - peer.loop(peer_x).numpy()).max())
        times = in_turn(
            {
                "ours": lambda: forward(ours_x, device_plan),
                "loop": lambda: peer.loop(peer_x),
                "padded": lambda: peer.padded(peer_x),
            },
            repeats,
        )
    difference_back = float(
        np.abs(both(ours_x, device_plan, ours_g) - torch_both(peer.loop).numpy()).max()
    )
    back = in_turn(
        {
            "ours": lambda: both(ours_x, device_plan, ours_g),
            "loop": lambda: torch_both(peer.loop),
            "padded": lambda: torch_both(peer.padded),
        },
        max(3, repeats // 2),
    )
    products = 4 * float((lengths**2).sum()) * HEADS * SIZE / 1e9
    return {
        "voxels": len(coords),
        "windows": len(lengths),
        "padding": padded / len(coords) - 1,
        "ours s": times["ours"],
        "loop s": times["loop"],
        "padded s": times["padded"],
        "ratio": times["ours"] / min(times["loop"], times["padded"]),
        "f+b ours s": back["ours"],
        "f+b loop s": back["loop"],
        "f+b padded s": back["padded"],
        "f+b ratio": back["ours"] / min(back["loop"], back["padded"]),
        "limit s": products / peak,
        "differ": max(difference, difference_back),
    }


def full_case(tokens: int, heads: int, repeats: int) -> dict[str, Any]:
    """Full attention of one object's tokens."""
    x = np.random.default_rng(0).normal(size=(3, 1, tokens, heads, SIZE)).astype(np.float32)
    q, k, v = (jnp.asarray(a) for a in x)
    peer = [torch.tensor(a).transpose(1, 2) for a in x]
    forward = jax.jit(attend)
    both = jax.jit(jax.grad(lambda q, k, v: attend(q, k, v).sum(), (0, 1, 2)))

    def torch_both():
        leaves = [a.clone().requires_grad_() for a in peer]
        F.scaled_dot_product_attention(*leaves).sum().backward()

    with torch.no_grad():
        times = in_turn(
            {
                "ours": lambda: forward(q, k, v),
                "torch": lambda: F.scaled_dot_product_attention(*peer),
            },
            repeats,
        )
    back = in_turn({"ours": lambda: both(q, k, v), "torch": torch_both}, max(3, repeats // 2))
    return {
        "tokens": tokens,
        "ours s": times["ours"],
        "torch s": times["torch"],
        "ratio": times["ours"] / times["torch"],
        "f+b ours s": back["ours"],
        "f+b torch s": back["torch"],
        "f+b ratio": back["ours"] / back["torch"],
    }


def tiling_case(coords: np.ndarray, repeats: int) -> list[dict[str, Any]]:
    """The same windows with more or fewer logits at a time."""
    ids, counts = window_ids(coords[None], WINDOW, WINDOW // 2), np.array([len(coords)])
    plan = pack_segments(ids, counts, fitted_sizes(ids, counts, WINDOW**3))
    plan = jax.tree.map(jnp.asarray, plan)
    x = jax.random.normal(jax.random.key(0), (len(coords), 3, HEADS, SIZE))
    default, functions = attention_xla.CPU_LOGITS, {}
    for power in TILINGS:
        attention_xla.CPU_LOGITS = 1 << power
        for name, function in (
            ("forward", lambda x, p: attend_segments(x, p)),
            ("f+b", lambda x, p: jax.grad(lambda x: attend_segments(x, p).sum())(x)),
        ):
            functions[power, name] = jax.jit(function).lower(x, plan).compile()
    attention_xla.CPU_LOGITS = default
    times = in_turn({k: (lambda f=f: f(x, plan)) for k, f in functions.items()}, repeats)
    return [
        {"logits at a time": f"2^{p}", "forward s": times[p, "forward"], "f+b s": times[p, "f+b"]}
        for p in TILINGS
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments = parser.parse_args()
    peak = matmul_peak()
    surfaces = sorted((surface(*name) for name in OBJECTS), key=len)
    rows = [windows_case(coords, peak, arguments.repeats) for coords in surfaces]
    sizes, ours = [row["voxels"] for row in rows], [row["ours s"] for row in rows]
    linear = {
        "slope": slope(sizes, ours),
        "slope f+b": slope(sizes, [row["f+b ours s"] for row in rows]),
    }
    report("attention_windows", rows, arguments.out, peak_gflops=peak, **linear)
    best = [min(row["loop s"], row["padded s"]) for row in rows]
    picture(
        arguments.out / "attention_windows.png",
        sizes,
        {"uniart_jax": ours, "PyTorch, the better of two": best, "limit: products alone": [row["limit s"] for row in rows]},  # noqa: E501
        "voxels of a 64³ surface",
        "seconds, forward, 8³ shifted windows",
    )  # fmt: skip
    report(
        "attention_full",
        [full_case(n, 16, arguments.repeats) for n in (1024, 2048, 3072, 4096)],
        arguments.out,
    )
    report("attention_tilings", tiling_case(surfaces[-4], arguments.repeats), arguments.out)


if __name__ == "__main__":
    main()
