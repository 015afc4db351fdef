"""What a benchmark leaves: a table on the screen, the same as JSON, and a picture of cost against size."""

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

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def in_turn(functions: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Median seconds of each function: one warm-up, then all of them ``repeats`` times in turn, so that a noisy machine is noisy for all."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for round_ in range(repeats + 1):
        for name, function in functions.items():
            begin = time.perf_counter()
            jax.block_until_ready(function())
            if round_:
                times[name].append(time.perf_counter() - begin)
            time.sleep(0.05)  # another library's threads may still be spinning
    return {name: statistics.median(values) for name, values in times.items()}


def matmul_peak(size: int = 2048, repeats: int = 7) -> float:
    """GFLOP/s of a float32 product of two ``size``^2 matrices here: the limit that is measured, not the one on the box."""
    a = jax.numpy.ones((size, size))
    product = jax.jit(lambda a: a @ a)
    return 2 * size**3 / in_turn({"": lambda: product(a)}, repeats)[""] / 1e9


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
        print(f"{key}: {_text(value)}")
    out.mkdir(parents=True, exist_ok=True)
    content = {"machine": machine(), "rows": list(rows), **more}
    (out / f"{name}.json").write_text(json.dumps(content, indent=2, default=float) + "\n")


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
