"""Chamfer distance of two point sets: ours beside scipy's KD tree, in the same run, and the memory
it takes.

    python benchmarks/chamfer.py [--points 100000] [--repeats 5] [--out out/bench]

Both directions, trees and curves built anew each time, compilation not included; medians of runs in
turn. Wall seconds hold on idle cores alone, CPU seconds of the process on busy ones too. Sets:
procedural objects against other points of themselves at rest, against themselves opened and against
another object of their family; points in a cube; a tenth as many points of a sphere against a small
ball at its centre, where little can be pruned. Memory: growth of the largest resident set of a new
process over the one it has with jax started and the points drawn, compilation included.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from results import machine, report
from scipy.spatial import cKDTree

from uniart_jax.evaluation.geometry import surface_points
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.nearest import mutual_distances
from uniart_jax.procedural import HELD_OUT_SEED, generate

FAMILIES = ("oven", "storage_furniture")


def point_sets(number: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Pairs of [number, 3] float32."""
    sets = {}
    for family in FAMILIES:
        obj, other = (at_rest(generate(family, HELD_OUT_SEED + k)) for k in (0, 1))
        points = surface_points(obj.mesh(), number, seed=0)
        sets[f"{family}, itself"] = points, surface_points(obj.mesh(), number, seed=1)
        sets[f"{family}, open"] = points, surface_points(obj.mesh(obj.open()), number, seed=1)
        sets[f"{family}, another"] = points, surface_points(other.mesh(), number, seed=1)
    rng = np.random.default_rng(0)
    sets["cube"] = rng.random((number, 3)), rng.random((number, 3))
    sphere, ball = rng.normal(size=(2, number // 10, 3))
    sets["sphere, centre"] = sphere / np.linalg.norm(sphere, axis=1, keepdims=True), 1e-2 * ball
    return {name: tuple(p.astype(np.float32) for p in pair) for name, pair in sets.items()}


def by_tree(a: np.ndarray, b: np.ndarray, workers: int) -> tuple[np.ndarray, np.ndarray]:
    return cKDTree(b).query(a, workers=workers)[0], cKDTree(a).query(b, workers=workers)[0]


def in_turn(functions: dict[str, Callable], repeats: int) -> dict[str, tuple]:
    """(median wall seconds, median CPU seconds, result) of each function after one warm-up."""
    results: dict[str, tuple] = {}
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in functions}
    for _ in range(repeats + 1):
        for name, function in functions.items():
            begin = time.perf_counter(), time.process_time()
            results[name] = function()
            times[name].append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
            time.sleep(0.05)  # another library's threads may still be spinning
    return {
        name: (*(statistics.median(run) for run in zip(*runs[1:], strict=True)), results[name])
        for name, runs in times.items()
    }


def memory(number: int) -> float:
    """MB that one comparison adds to a process, its compilation included; measured in this
    process."""
    rng = np.random.default_rng(0)
    a, b = (rng.random((number, 3), np.float32) for _ in "ab")
    jax.block_until_ready(jax.jit(lambda x: x + 1)(a))
    before = largest_resident()
    mutual_distances(a, b)
    return largest_resident() - before


def largest_resident() -> float:
    """MB; of this program alone, where ``getrusage`` has its parent's too (Linux)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    parser.add_argument("--memory", action="store_true", help="print the memory (MB) alone")
    options = parser.parse_args()
    if options.memory:
        print(memory(options.points))
        return
    rows = []
    for name, (a, b) in point_sets(options.points).items():
        measured = in_turn(
            {
                "ours": lambda a=a, b=b: mutual_distances(a, b),
                "tree": lambda a=a, b=b: by_tree(a, b, -1),
                "tree, one thread": lambda a=a, b=b: by_tree(a, b, 1),
            },
            options.repeats,
        )
        found = zip(measured["ours"][2], measured["tree"][2], strict=True)
        row: dict = {"sets": name}
        for way, (wall, cpu, _) in measured.items():
            row |= {f"{way}, s": wall, f"{way}, CPU s": cpu}
        row["ratio"] = measured["ours"][0] / measured["tree"][0]
        row["CPU ratio"] = measured["ours"][1] / measured["tree"][1]
        rows.append(row | {"largest difference": float(max(abs(x - y).max() for x, y in found))})
        print(f"{name}: {row['ratio']:.2f}", file=sys.stderr)
    command = [sys.executable, sys.argv[0], "--memory", "--points", str(options.points)]
    grown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    report(
        "chamfer",
        rows,
        options.out,
        points=options.points,
        memory_mb=float(grown),
        machine=machine(),
    )


if __name__ == "__main__":
    main()
