"""One training step of every paper-size network on the accelerator that is found: compile time,
step time, memory, the largest batch.

    python benchmarks/accelerator_steps.py [structure_flow ...] [--minutes 9] [--kernel auto]
    [--only steps batches] [--tiny] [--out out/bench]

The library's losses, AdamW, averaged parameters and donated state (``training``), bfloat16 compute,
on synthetic objects (``synthetic.py``): 4,096 tokens for the structure flow, up to 16,384 voxels an
item for the UniArt VAE and the latent flow. Of DINOv2-L (image_encoder) the forward pass alone;
flows are given its tokens here, while in a training it is the beginning of their step.

* steps: each with ``scan_blocks`` and ``remat`` on and off. ``of peak``: the matrix products of the
  forward pass, counted in its jaxpr (loops multiplied out, attention over its rows' padding
  included), times three, a second and of the product rate measured here in bfloat16. What remat
  computes again does not count. XLA's own flop count stands beside it; it sees a loop's body once
  and no custom kernel. Peak GiB: the device's own statistics where it keeps some, which include the
    making of the state; program GiB: the compiled step's arguments and temporaries.
* batches: the largest power of two that fits, with scan and remat on, each trial in a process of
  its own, from the size that a step's memory predicts.

With --tiny networks are tiny; so on a CPU, where compilation is quick and seconds mean nothing.
Every result is written when it is there; what the limit of minutes does not reach is left out.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import os
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jobs import Clock, accelerator, describe, run_jobs, work
from results import bars, report, save
from synthetic import make_loss, training_batch

from uniart_jax.config import (
    Config,
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    ModelConfig,
    StageConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.models.network import build
from uniart_jax.training.flops import matmul_flops
from uniart_jax.training.state import create_state, make_optimizer
from uniart_jax.training.step import make_train_step

# items of a step, and voxels of an item; most important first
STEPS = {
    "structure_flow": (8, 0),
    "uniart_vae": (4, 16384),
    "latent_flow": (8, 16384),
    "structure_vae": (8, 16384),
    "image_encoder": (32, 0),
}
MODES = ((True, True), (False, True), (True, False), (False, False))  # scan_blocks, remat
UNSTACKED = ("structure_vae",)  # has no stack of equal blocks: neither changes it
FULL = "RESOURCE_EXHAUSTED", "out of memory", "OUT_OF_MEMORY"


def model_of(tiny: bool, **how: Any) -> ModelConfig:
    """The paper's networks; or small ones of the same form."""
    if not tiny:
        dinov2 = ImageEncoderConfig(
            architecture="dinov2", image_size=518, width=1024, num_blocks=24, num_heads=16
        )
        return ModelConfig(image_encoder=dinov2, compute_dtype="bfloat16", **how)
    flow = FlowConfig(model_channels=32, num_blocks=2, num_heads=2, cond_channels=16)
    return ModelConfig(
        grid=GridConfig(resolution=8, subdivisions=2, max_parts=16),
        image_encoder=ImageEncoderConfig(architecture="dinov2", image_size=28, width=32, num_blocks=2, num_heads=2),  # noqa: E501
        structure_vae=StructureVAEConfig(channels=(8, 16), num_res_blocks=1, num_res_blocks_middle=1),  # noqa: E501
        uniart_vae=UniArtVAEConfig(width=32, num_blocks=4, num_heads=2, visual_channels=16, geometry_channels=16, articulation_channels=16),  # noqa: E501
        structure_flow=flow,
        latent_flow=dataclasses.replace(flow, patch_size=2, io_channels=(16,)),
        compute_dtype="bfloat16",
        **how,
    )  # fmt: skip


def loss_of(name: str, model: ModelConfig):
    """The network and its loss."""
    network = build(name, model)
    return network, make_loss(name, network, Config(model=model))


def forward_products(job: dict[str, Any], batch: Any) -> float:
    """FLOP of the forward pass's matrix products, attention in plain XLA so that it is seen."""
    model = model_of(job["tiny"], kernel="xla")
    if job["network"] == "image_encoder":
        network = build("image_encoder", model)
        return matmul_flops(jax.make_jaxpr(network.apply)(network.abstract(), batch.image)).total()
    network, loss = loss_of(job["network"], model)
    return matmul_flops(jax.make_jaxpr(loss)(network.abstract(), batch, jax.random.key(0))).total()


def step(job: dict[str, Any]) -> dict[str, Any]:
    """Compile and run one step; a ``trial`` runs it twice and counts nothing."""
    how = {k: job[k] for k in ("scan_blocks", "remat", "kernel")}
    model = model_of(job["tiny"], **how)
    batch = training_batch(job["network"], model, job["items"], job["width"])
    forward = None if job["trial"] else forward_products(job, batch)
    batch, key = jax.device_put(batch), jax.random.key(0)
    if job["network"] == "image_encoder":
        network = build("image_encoder", model)
        state = jax.jit(network.init)(key)
        size = state
        lowered = jax.jit(lambda s, b, k: (s, network.apply(s, b.image)), donate_argnums=0)
    else:
        network, loss = loss_of(job["network"], model)
        stage = StageConfig()
        optimizer = make_optimizer(stage)
        state = create_state(network.init, optimizer, key)
        size = state.params
        train_step = make_train_step(loss, optimizer, stage.ema_decay)
        # the function that the step compiles, to see its compilation alone
        lowered = jax.jit(train_step.update, donate_argnums=0)
    parameters = sum(x.size for x in jax.tree.leaves(size))
    begin = time.perf_counter()
    compiled = lowered.lower(state, batch, key).compile()
    compile_seconds = time.perf_counter() - begin
    times, metrics = [], None
    for _ in range(2 if job["trial"] else 8):
        begin = time.perf_counter()
        state, metrics = jax.block_until_ready(compiled(state, batch, key))
        times.append(time.perf_counter() - begin)
    seconds = statistics.median(times[1:])
    loss = metrics["loss"] if "loss" in metrics else metrics["tokens"].mean()
    program = compiled.memory_analysis()
    used = (
        program.temp_size_in_bytes
        + program.argument_size_in_bytes
        + program.output_size_in_bytes
        - program.alias_size_in_bytes
    )
    statistics_ = jax.devices()[0].memory_stats() or {}
    passes = 1 if job["network"] == "image_encoder" else 3
    return {
        "M parameters": parameters / 1e6,
        "compile s": compile_seconds,
        "step s": seconds,
        "items/s": job["items"] / seconds,
        "TFLOP/s": passes * forward / seconds / 1e12 if forward else np.nan,
        "XLA TFLOP": (compiled.cost_analysis() or {}).get("flops", np.nan) / 1e12,
        "program GiB": used / 2**30,
        "peak GiB": statistics_.get("peak_bytes_in_use", np.nan) / 2**30,
        "limit GiB": statistics_.get("bytes_limit", np.nan) / 2**30,
        "finite": bool(jnp.isfinite(loss)),
    }


def measure(job: dict[str, Any]) -> dict[str, Any]:
    return describe(job) if job.get("about") else step(job)


def time_steps(
    networks: list[str], base: dict, tiny: bool, clock: Clock, out: Path, about: dict
) -> list[dict]:
    rows: list[dict[str, Any]] = []
    for scan, remat in MODES[:1] if tiny else MODES:
        for name in networks:
            if name in UNSTACKED and (scan, remat) != MODES[0]:
                continue
            if name == "image_encoder" and remat and not scan:
                continue  # nothing to compute again in a forward pass
            items, width = (2, min(STEPS[name][1], 200)) if tiny else STEPS[name]
            job = dict(
                base,
                network=name,
                items=items,
                width=width,
                scan_blocks=scan,
                remat=remat,
                trial=False,
            )
            for _, result in run_jobs([job], min(clock.left(), 300), each=300):
                raised = result.pop("raised", "")
                row = {"network": name, "scan": scan, "remat": remat, "items": items}
                row |= {k: result.get(k, np.nan) for k in COLUMNS}
                row["of peak"] = 1e3 * row["TFLOP/s"] / about["peaks"]["bfloat16"]
                rows.append({**row, "note": f"raised: {raised}"[:100] if raised else ""})
                print(
                    f"{name}, scan {scan}, remat {remat}: {row['step s']:.3g} s {rows[-1]['note']}",
                    flush=True,
                )
                save("accelerator_steps", rows, out, **about)
    if rows:
        rows.sort(key=lambda row: networks.index(row["network"]))
        report("accelerator_steps", rows, out, **about)
        groups = {
            name: {_mode(r): r["step s"] for r in rows if r["network"] == name and not r["note"]}
            for name in networks
        }
        groups = {name: group for name, group in groups.items() if group}
        if groups:
            bars(out / "accelerator_steps.png", groups, "seconds a step, bfloat16")
    return rows


COLUMNS = (
    "M parameters",
    "compile s",
    "step s",
    "items/s",
    "TFLOP/s",
    "XLA TFLOP",
    "program GiB",
    "peak GiB",
    "limit GiB",
    "finite",
)


def _mode(row: dict[str, Any]) -> str:
    return " + ".join(k for k in ("scan", "remat") if row[k]) or "neither"


def largest_batch(name: str, base: dict, start: int, most: int, clock: Clock, width: int):
    """Trials until one fits and twice as many items do not: (most items that fit, what stopped it,
    the trials)."""
    fits, tried, items, why = 0, {}, start, "the time was up"
    while items not in tried and 1 <= items <= most:
        job = dict(
            base, network=name, items=items, width=width, scan_blocks=True, remat=True, trial=True
        )
        result = next((r for _, r in run_jobs([job], min(clock.left(), 300), each=300)), None)
        if result is None:
            return fits, why, tried
        raised = result.get("raised", "")
        tried[items] = result.get("step s", np.nan)
        if raised and not any(word in raised for word in FULL):
            return fits, f"raised: {raised}"[:100], tried
        fits = fits if raised else max(fits, items)
        items = items // 2 if raised else items * 2
    return (
        fits,
        "out of memory" if items in tried or items < 1 else f"not tried above {most}",
        tried,
    )


def find_batches(
    networks: list[str],
    base: dict,
    tiny: bool,
    clock: Clock,
    out: Path,
    about: dict,
    steps: list[dict],
) -> None:
    rows = []
    for name in networks:
        if clock.left() < 10:
            break
        items, width = (2, min(STEPS[name][1], 200)) if tiny else STEPS[name]
        for row in steps:
            # the state does not grow with the batch: 16 bytes a parameter, and as much again for
            # gradients and updates
            if (
                row["network"] == name
                and row["scan"]
                and row["remat"]
                and row["limit GiB"] > 0
                and not row["note"]
            ):
                state = row["M parameters"] * 1e6 * 20 / 2**30
                each = max(row["program GiB"] - state, 0.1) / row["items"]
                items = 1 << int(math.log2(max(1, (row["limit GiB"] - state) / each)))
        fits, why, tried = largest_batch(name, base, items, 2 if tiny else 4096, clock, width)
        best = max((n / s for n, s in tried.items() if s > 0), default=np.nan)
        rows.append(
            {
                "network": name,
                "largest batch": fits,
                "because": why,
                "items/s at best": best,
                "trials": str({k: round(float(v), 3) for k, v in tried.items()}),
            }
        )
        print(f"{name}: batch {fits}, {why}", flush=True)
        save("accelerator_batches", rows, out, **about)
    if rows:
        report("accelerator_batches", rows, out, **about)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("networks", nargs="*", default=list(STEPS))
    parser.add_argument("--minutes", type=float, default=9)
    parser.add_argument("--kernel", default="auto")
    parser.add_argument(
        "--only", nargs="+", choices=["steps", "batches"], default=["steps", "batches"]
    )
    parser.add_argument("--tiny", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments = parser.parse_args()
    clock = Clock(arguments.minutes)
    about, _, tiny = accelerator(clock, arguments.tiny, dict(about=True))
    base = dict(tiny=tiny, kernel=arguments.kernel)
    networks, rows = arguments.networks or list(STEPS), []
    if "steps" in arguments.only:
        share = 0.65 if "batches" in arguments.only else 1.0
        rows = time_steps(
            networks, base, tiny, Clock(share * clock.left() / 60), arguments.out, about
        )
    if "batches" in arguments.only:
        trained = [name for name in networks if name != "image_encoder"][: 1 if tiny else None]
        find_batches(trained, base, tiny, clock, arguments.out, about, rows)


if __name__ == "__main__":
    # all of the device for the one trial that runs
    os.environ.setdefault("XLA_PYTHON_CLIENT_MEM_FRACTION", "0.95")
    work(measure) if "--worker" in sys.argv else main()
