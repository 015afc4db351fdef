"""What devices send one another in a training step, beside the least that data parallelism needs:
the exchange of gradients.

    python benchmarks/collectives.py [--config configs/paper.py] [--networks uniart_vae latent_flow]
    [--devices 8] [--fsdp 1 8] [--blocks 2] [--voxels 4096]

The step of a config's network, an item a device, with fewer blocks (transformers; structure VAE and
image encoder as they are), compiled for fake CPU devices and not run; what each device receives is
read off the program (``received``), loops multiplied out. The least: an all-reduce of the gradients
in float32, 8 (n - 1) / n bytes a parameter, and where parameters are split over ``fsdp`` an
all-gather of them beside. What is counted is XLA's program for CPUs; for accelerators it may choose
other collectives, such as a reduce-scatter where here an all-reduce is cut.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any

import jax
from results import report
from synthetic import make_loss, training_batch

from uniart_jax.cli.train import load_config
from uniart_jax.config import Config, MeshConfig
from uniart_jax.models.network import build
from uniart_jax.training.sharding import make_mesh, put_batch
from uniart_jax.training.state import abstract_state, make_optimizer
from uniart_jax.training.step import make_train_step

NETWORKS = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
ALL = (*NETWORKS, "image_encoder")  # the last is not trained in configs/paper.py
BYTES = {
    "pred": 1,
    "s8": 1,
    "u8": 1,
    "bf16": 2,
    "f16": 2,
    "s32": 4,
    "u32": 4,
    "f32": 4,
    "s64": 8,
    "u64": 8,
    "f64": 8,
}
KINDS = ("all-gather", "all-reduce", "reduce-scatter", "all-to-all", "collective-permute")
_COMPUTATION = re.compile(r"^(?:ENTRY )?%?([\w.\-]+) \(.*\{$")
_CALLED = re.compile(
    r"(?:body|condition|to_apply|calls|true_computation|false_computation)=%?([\w.\-]+)"
)
_SHAPE = re.compile(r"(\w+)\[([\d,]*)\]")
_INSTRUCTION = re.compile(r"^(?:ROOT )?%?[\w.\-]+ = (.*?) ([\w\-]+)\(")


def received(text: str, devices: int) -> Counter[str]:
    """Bytes that a device receives in the collectives of a compiled program's text, by kind; a loop
    whose trips XLA does not know counts once, a branch as if all were taken.

    Of n devices in a group: an all-gather's result x (n - 1) / n, twice that for an all-reduce, a
    reduce-scatter's result x (n - 1), all of a permute.
    """
    own: dict[str, Counter[str]] = {}
    calls: dict[str, list[tuple[str, int]]] = {}
    entry = here = ""
    for line in text.splitlines():
        if found := _COMPUTATION.match(line.strip()):
            here = found[1]
            own[here], calls[here] = Counter(), []
            entry = here if line.startswith("ENTRY") else entry
            continue
        if not (found := _INSTRUCTION.match(line.strip())):
            continue
        shape, operation = found[1], found[2]
        if operation.endswith("-start") and operation.removesuffix("-start") in KINDS:
            raise ValueError(f"collectives: an asynchronous '{operation}' is not understood")
        if operation in KINDS:
            own[here][operation] += _moved(operation, shape, line, devices)
        trips = re.search(r'"known_trip_count":\{"n":"(\d+)"', line)
        times = int(trips[1]) if operation == "while" and trips else 1
        calls[here] += [(name, times) for name in _CALLED.findall(line)]
        for branches in re.findall(r"branch_computations=\{(.*?)\}", line):
            calls[here] += [(name.strip(" %"), 1) for name in branches.split(",")]

    def total(name: str) -> Counter[str]:
        result = Counter(own.get(name, {}))
        for inner, times in calls.get(name, ()):
            for kind, size in total(inner).items():
                result[kind] += times * size
        return result

    return total(entry)


def _moved(operation: str, shape: str, line: str, devices: int) -> int:
    size = sum(
        BYTES.get(dtype, 4) * math.prod(int(n) for n in sides.split(",") if n)
        for dtype, sides in _SHAPE.findall(shape)
    )
    group = _group(line, devices)
    if operation == "collective-permute":
        return size
    if operation == "reduce-scatter":
        return size * (group - 1)
    return (2 if operation == "all-reduce" else 1) * size * (group - 1) // group


def _group(line: str, devices: int) -> int:
    """Devices that exchange with one another, in any of the three forms that XLA writes; all of
    them where it names no groups."""
    if found := re.search(r"replica_groups=\[(\d+),(\d+)\]", line):
        return int(found[2])
    if found := re.search(r"replica_groups=\{\{([\d,]*)\}", line):
        return len(found[1].split(","))
    if found := re.search(r"replica_groups=mesh\[(.*?)\].*?\{(.*?)\}", line):
        sizes = dict(re.findall(r"'(\w+)'=(\d+)", found[1]))
        named = re.findall(r"'(\w+)'(?::\(\d+\)(\d+))?", found[2])
        return math.prod(int(part or sizes[name]) for name, part in named)
    if "replica_groups=" in line and "replica_groups={}" not in line:
        raise ValueError(f"collectives: groups that are not understood: {line.strip()[:200]}")
    return devices


def least(parameters: int, devices: int, fsdp: int = 1) -> float:
    """Bytes that a device has to receive in a step: gradients summed, and, split over ``fsdp``,
    parameters gathered."""
    return 8 * (devices - 1) / devices * parameters + 4 * (fsdp - 1) / fsdp * parameters


def step_program(name: str, config: Config, voxels: int) -> tuple[str, int]:
    """(compiled text, parameters) of a network's step, an item a device."""
    mesh = make_mesh(config.mesh)
    network = build(name, config.model)
    loss = make_loss(name, network, config)
    optimizer = make_optimizer(getattr(config, name))
    state = abstract_state(network.init, optimizer, mesh)
    batch = put_batch(training_batch(name, config.model, mesh.size, voxels, mesh.size), mesh)
    program = make_train_step(loss, optimizer, 0.999).compile(state, batch, jax.random.key(0))
    count = sum(math.prod(p.shape) for p in jax.tree.leaves(state.params))
    return program.call.as_text(), count


def shallow(config: Config, blocks: int) -> Config:
    """With so many blocks in every stack, unrolled."""
    model = config.model
    parts = {
        name: dataclasses.replace(getattr(model, name), num_blocks=blocks)
        for name in ("uniart_vae", "structure_flow", "latent_flow")
    }
    model = dataclasses.replace(model, **parts, scan_blocks=False, kernel="xla")
    return dataclasses.replace(config, model=model)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--config", type=Path, default=Path("configs/paper.py"))
    parser.add_argument("--networks", nargs="+", choices=ALL, default=list(NETWORKS))
    parser.add_argument("--devices", type=int, default=8)
    parser.add_argument("--fsdp", type=int, nargs="+", default=[1, 8])
    parser.add_argument("--blocks", type=int, default=2)
    parser.add_argument("--voxels", type=int, default=4096)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments = parser.parse_args()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_num_cpu_devices", arguments.devices)
    config = shallow(load_config(arguments.config), arguments.blocks)
    if (
        "image_encoder" in arguments.networks
        and config.model.image_encoder.architecture != "volume"
    ):
        parser.error(
            f"image_encoder: {arguments.config} does not train it; give --config configs/nano.py"
        )
    rows: list[dict[str, Any]] = []
    for name in arguments.networks:
        for fsdp in arguments.fsdp:
            split = dataclasses.replace(config, mesh=MeshConfig(fsdp=fsdp))
            text, parameters = step_program(name, split, arguments.voxels)
            moved = received(text, arguments.devices)
            needed = least(parameters, arguments.devices, fsdp)
            rows.append(
                {
                    "network": name,
                    "data x fsdp": f"{arguments.devices // fsdp} x {fsdp}",
                    "M parameters": parameters / 1e6,
                    **{f"{kind} MB": moved[kind] / 1e6 for kind in KINDS},
                    "all MB": sum(moved.values()) / 1e6,
                    "least MB": needed / 1e6,
                    "ratio": sum(moved.values()) / needed,
                }
            )
            print(f"{name} {rows[-1]['data x fsdp']}: {rows[-1]['ratio']:.2f}", flush=True)
    report("collectives", rows, arguments.out, blocks=arguments.blocks, voxels=arguments.voxels)


if __name__ == "__main__":
    main()
