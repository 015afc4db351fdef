"""What a benchmark leaves: a table on the screen, the same as JSON, and a picture of cost against
size."""

from __future__ import annotations

import json
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import matplotlib
import numpy as np

from uniart_jax.evaluation.result_store import without_nan

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def in_turn(functions: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Median seconds of each function: one warm-up, then all of them ``repeats`` times in turn, so
    that a noisy machine is noisy for all."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for round_ in range(repeats + 1):
        for name, function in functions.items():
            begin = time.perf_counter()
            jax.block_until_ready(function())
            if round_:
                times[name].append(time.perf_counter() - begin)
            time.sleep(0.05)  # another library's threads may still be spinning
    return {name: statistics.median(values) for name, values in times.items()}


def steady(
    function: Callable[[], Any],
    wait: Callable[[Any], Any] = jax.block_until_ready,
    seconds: float = 0.3,
) -> float:
    """Median seconds a call of calls queued one after another, for an accelerator that the host
    must stay ahead of. The first call compiles."""
    wait(function())
    begin = time.perf_counter()
    wait(function())
    calls = int(min(100, max(1, seconds / 3 / (time.perf_counter() - begin))))
    rounds = []
    for _ in range(3):
        begin = time.perf_counter()
        for _ in range(calls):
            result = function()
        wait(result)
        rounds.append((time.perf_counter() - begin) / calls)
    return statistics.median(rounds)


def matmul_peak(size: int = 2048, repeats: int = 7) -> float:
    """GFLOP/s of a float32 product of two ``size``^2 matrices here: the limit that is measured, not
    the one on the box."""
    a = jax.numpy.ones((size, size))
    product = jax.jit(lambda a: a @ a)
    return 2 * size**3 / in_turn({"": lambda: product(a)}, repeats)[""] / 1e9


def matmul_peaks(size: int) -> dict[str, float]:
    """GFLOP/s of random matrices' products in what networks compute in; float32 as JAX does it
    unless told otherwise (TF32 on NVIDIA), and exactly."""
    peaks = {}
    for name, dtype, precision in (
        ("bfloat16", "bfloat16", None),
        ("float32", "float32", None),
        ("float32 highest", "float32", "highest"),
    ):
        a = jax.random.normal(jax.random.key(0), (size, size), dtype)
        product = jax.jit(lambda a, p=precision: jax.numpy.matmul(a, a, precision=p))
        peaks[name] = 2 * size**3 / steady(lambda f=product, a=a: f(a)) / 1e9
    return peaks


def machine() -> dict[str, Any]:
    """What the figures were made on."""
    names = ("jax", "jaxlib", "flax", "torch")
    return {
        "python": platform.python_version(),
        "processor": platform.processor() or platform.machine(),
        "devices": [d.device_kind for d in jax.devices()],
        "versions": {name: _version(name) for name in names},
    }


def report(name: str, rows: Sequence[dict[str, Any]], out: Path, **more: Any) -> None:
    """Print rows of equal keys as a table and write ``OUT/<name>.json``."""
    columns = list(rows[0])
    text = [[_text(row[c]) for c in columns] for row in rows]
    widths = [max(len(c), *(len(line[i]) for line in text)) for i, c in enumerate(columns)]
    for line in [columns, *text]:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
    for key, value in more.items():
        if key != "machine":
            print(f"{key}: {_text(value)}")
    save(name, rows, out, **more)


def save(name: str, rows: Sequence[dict[str, Any]], out: Path, **more: Any) -> None:
    """``OUT/<name>.json`` alone; ``machine=`` where another process measured."""
    out.mkdir(parents=True, exist_ok=True)
    content = {"machine": more.get("machine") or machine(), "rows": list(rows), **more}
    plain = without_nan(json.loads(json.dumps(content, default=float)))
    (out / f"{name}.json").write_text(json.dumps(plain, indent=2, allow_nan=False) + "\n")


def bars(path: Path, groups: dict[str, dict[str, float]], ylabel: str) -> None:
    """Groups of bars on a logarithmic axis; a name has one colour in all of them."""
    names = list(dict.fromkeys(name for group in groups.values() for name in group))
    figure, axes = plt.subplots(figsize=(max(6, 1.8 * len(groups)), 4.5))
    width = 0.9 / max(map(len, groups.values()), default=1)
    for i, name in enumerate(names):
        here = [
            (x + (list(group).index(name) - (len(group) - 1) / 2) * width, group[name])
            for x, group in enumerate(groups.values())
            if name in group
        ]
        axes.bar(*zip(*here, strict=True), width, label=name, color=plt.cm.tab20(i % 20))
    axes.set_xticks(range(len(groups)), groups, fontsize=7)
    axes.set(yscale="log", ylabel=ylabel)
    axes.grid(alpha=0.3, axis="y", which="both")
    axes.legend(fontsize=7)
    _save_figure(figure, path)


def picture(
    path: Path, x: Sequence[float], curves: dict[str, Sequence[float]], xlabel: str, ylabel: str
) -> None:
    """Curves over size on logarithmic axes; names that begin with 'limit' are dashed."""
    figure, axes = plt.subplots(figsize=(6, 4))
    for name, values in curves.items():
        axes.loglog(x, values, "k--" if name.startswith("limit") else "o-", label=name)
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    _save_figure(figure, path)


def _save_figure(figure: Any, path: Path) -> None:
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    plt.close(figure)
    print(f"picture: {path}")


def slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Exponent of y ~ x^slope, by least squares on logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def _version(name: str) -> str:
    try:
        return version(name)
    except ModuleNotFoundError:
        return "absent"


def _text(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
