"""How long a training would take, and how much memory, on machines that are not here: from the
compiled step and a share of peak.

    python benchmarks/predict_training.py [--config configs/paper.py] [--networks latent_flow ...]
    [--share .35] [--measured out/bench/accelerator_steps.json]

Of every network that a config trains, at its own size and batch, on synthetic objects of 16,384
voxels (``synthetic.py``); nothing is run.

* products: FLOP of the forward pass's matrix products counted in its jaxpr (loops multiplied out,
  ``training.flops``), times three. What remat computes again is not useful work and does not count;
  it lies in the share. Reads of maps (``nn.lifting.sample_map``) count as gathers, with none.
* share of peak: ``--share``, an assumption, unless ``--measured`` gives the file of
  ``accelerator_steps.py`` from a real device: the products a second of the same network (scan and
    remat as in the config) by the peak in that device's data sheet, as the machines' are.
* a flow's step looks at images first: DINOv2's forward pass over the batch, counted the same way,
  is in its products, and its parameters in the memory; what the pass holds for a moment is not.
* step: products / (devices x peak x share), or the gradients' all-reduce in float32 at the links'
  rate, whichever is longer. Reading data, evaluating and saving come on top.
* memory of a device: state (16 bytes a parameter, gradients 4 more, / fsdp) and what the step's
  program needs beside it, from XLA's memory analysis of the compiled step at one and two items. XLA
  for CPUs keeps bfloat16 products' operands in float32, so this errs on the large side.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import jax
import numpy as np
from results import report
from synthetic import make_loss, training_batch

from uniart_jax.cli.train import load_config
from uniart_jax.config import LATENT_OF, Config, MeshConfig
from uniart_jax.models.network import build
from uniart_jax.training.flops import matmul_flops
from uniart_jax.training.sharding import make_mesh
from uniart_jax.training.state import abstract_state, make_optimizer
from uniart_jax.training.step import make_train_step

TRAINED = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
VOXELS = 16_384  # of an item
STATE, GRADIENT = 16, 4  # bytes a parameter: itself, two moments, the average; its gradient


@dataclasses.dataclass(frozen=True)
class Machine:
    """Devices that train together. ``peak``: dense bfloat16 FLOP/s of one, ``memory`` its GiB,
    ``link``: bytes/s in one direction. From the vendors' data sheets."""

    name: str
    devices: int
    peak: float
    memory: float
    link: float


PEAKS = {
    "A100": 312e12,
    "H100": 989e12,
    "H200": 989e12,
    "TPU v5": 459e12,
}  # of a device's name; SXM boards

MACHINES = (
    Machine("8 x A100 80 GB", 8, 312e12, 74.5, 300e9),
    Machine("8 x H100 80 GB", 8, 989e12, 74.5, 450e9),
    Machine("v5p-64 (32 chips)", 32, 459e12, 88.5, 300e9),
)


def network_and_loss(name: str, config: Config) -> tuple[Any, Any]:
    network = build(name, config.model)
    return network, make_loss(name, network, config)


def useful_flops(name: str, config: Config) -> float:
    """FLOP of a training step's matrix products for one item."""
    plain = dataclasses.replace(config.model, kernel="xla", remat=False)  # kernels hide products
    config = dataclasses.replace(config, model=plain)
    network, loss = network_and_loss(name, config)
    items = 4  # of different sizes
    batch = training_batch(name, config.model, items, VOXELS)
    traced = jax.make_jaxpr(loss)(network.abstract(), batch, jax.random.key(0))
    return 3.0 * matmul_flops(traced).total() / items


def looking(config: Config) -> tuple[float, int]:
    """Of the frozen image encoder, which a flow's step begins with: FLOP of its matrix products for
    one image, forward alone, and bytes of its parameters."""
    model = dataclasses.replace(config.model, kernel="xla", remat=False)
    network, size = build("image_encoder", model), model.image_encoder.image_size
    image = jax.ShapeDtypeStruct((1, size, size, 3), "float32")
    flops = matmul_flops(jax.make_jaxpr(network.apply)(network.abstract(), image)).total()
    return float(flops), 4 * sum(math.prod(p.shape) for p in jax.tree.leaves(network.abstract()))


def program(name: str, config: Config, items: int) -> tuple[int, int]:
    """(parameters, bytes beside the state) of the compiled step."""
    network, loss = network_and_loss(name, config)
    stage = getattr(config, name)
    optimizer = make_optimizer(stage)
    update = make_train_step(loss, optimizer, stage.ema_decay).update
    key = jax.random.key(0)
    state = abstract_state(network.init, optimizer, make_mesh(MeshConfig()))
    batch = training_batch(name, config.model, items, VOXELS)
    compiled = jax.jit(update, donate_argnums=0).lower(state, batch, key).compile()
    parameters = sum(math.prod(p.shape) for p in jax.tree.leaves(state.params))
    return parameters, compiled.memory_analysis().temp_size_in_bytes


def predict(
    name: str, config: Config, machine: Machine, cost: dict[str, float], share: float
) -> dict[str, Any]:
    """One row."""
    stage = getattr(config, name)
    items = stage.batch_size
    compute = cost["flops"] * items / (machine.devices * machine.peak * share)
    moved = 2 * GRADIENT * cost["parameters"] * (machine.devices - 1) / machine.devices
    exchange = moved / machine.link
    step = max(compute, exchange)
    local = math.ceil(items / machine.devices)
    beside = cost["first"] + (local - 1) * cost["more"]
    memory = {
        fsdp: (STATE * cost["parameters"] / fsdp + beside) / 2**30 for fsdp in (1, machine.devices)
    }
    return {
        "machine": machine.name,
        "network": name,
        "items a device": local,
        "TFLOP a step": cost["flops"] * items / 1e12,
        "share of peak": share,
        "step s": step,
        "all-reduce s": exchange,
        "GiB": memory[1],
        "GiB, fsdp": memory[machine.devices],
        "fits": "yes" if memory[1] <= machine.memory else "with fsdp" if memory[machine.devices] <= machine.memory else "accumulate",  # noqa: E501
        "steps": stage.steps,
        "days": step * stage.steps / 86_400,
    }  # fmt: skip


def measured_shares(path: Path, config: Config) -> dict[str, float]:
    """{network: share of the data sheet's peak} of ``accelerator_steps.py``'s rows with the
    config's scan and remat.

    Raises:
      ValueError: measured on a device whose peak is not known here.
    """
    model, content = config.model, json.loads(path.read_text())
    device = str(content["machine"]["devices"][0])
    peaks = [peak for name, peak in PEAKS.items() if name in device]
    if not peaks:
        raise ValueError(f"{path}: measured on '{device}', whose peak is not in PEAKS; add it")
    return {
        row["network"]: 1e12 * float(row["TFLOP/s"]) / peaks[0]
        for row in content["rows"]
        if (row["scan"], row["remat"]) == (model.scan_blocks, model.remat) and row["TFLOP/s"] > 0
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--config", type=Path, default=Path("configs/paper.py"))
    parser.add_argument("--networks", nargs="+", choices=TRAINED, default=list(TRAINED))
    parser.add_argument("--share", type=float, default=0.35)
    parser.add_argument("--measured", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments = parser.parse_args()
    config = load_config(arguments.config)
    shares = measured_shares(arguments.measured, config) if arguments.measured else {}
    rows = []
    for name in arguments.networks:
        parameters, first = program(name, config, 1)
        _, second = program(name, config, 2)
        seeing, held = looking(config) if name in LATENT_OF else (0.0, 0)
        cost = {
            "flops": useful_flops(name, config) + seeing,
            "parameters": parameters,
            "first": first + held,
            "more": max(second - first, 0),
        }
        print(
            f"{name}: {parameters / 1e6:.0f} M parameters, {cost['flops'] / 1e12:.3g} TFLOP an "
            f"item, {first / 2**30:.2f} GiB for one item, {cost['more'] / 2**30:.2f} for each more",
            flush=True,
        )
        rows += [
            predict(name, config, m, cost, shares.get(name, arguments.share)) for m in MACHINES
        ]
    rows.sort(key=lambda row: [m.name for m in MACHINES].index(row["machine"]))
    report("predict_training", rows, arguments.out)
    for machine in MACHINES:
        days = np.array([row["days"] for row in rows if row["machine"] == machine.name])
        print(f"{machine.name}: {days.sum():.1f} days in all")


if __name__ == "__main__":
    main()
