"""How much a step computes, and how much a device can: together, the share of peak.

XLA's own cost analysis counts the body of a loop once, however often it runs (scanned blocks,
chunked attention, accumulation), so products are counted here on the traced program, with loops
multiplied out. What is counted is what runs: recomputed activations (``remat``) count again.
"""

from __future__ import annotations

import functools
import math
import time
from collections import Counter
from typing import Any

import jax
import jax.numpy as jnp

LARGEST, LONG_ENOUGH = 8192, 0.005  # side of the largest matrix tried; seconds that measure well


def matmul_flops(jaxpr: Any) -> Counter[str]:
    """Floating-point operations of all matrix products and convolutions of a jaxpr, by the dtype of
    their left operand.

    Scans and Pallas grids are multiplied out, of branches the dearest counts, a ``while`` whose
    trips are unknown counts once, and kernels that JAX cannot look into (cuDNN's) count nothing.
    """
    total: Counter[str] = Counter()
    for eqn in getattr(jaxpr, "jaxpr", jaxpr).eqns:
        name, params = eqn.primitive.name, eqn.params
        if name in ("dot_general", "conv_general_dilated"):
            total[str(eqn.invars[0].aval.dtype)] += _product(eqn)
            continue
        inner = [matmul_flops(j) for value in params.values() for j in _jaxprs(value)]
        if name == "cond":
            inner = [max(inner, key=lambda c: c.total())]
        times = 1
        if name == "scan":
            times = params["length"]
        elif name == "pallas_call":
            times = math.prod(params["grid_mapping"].grid)
        elif name == "shard_map":
            times = params["mesh"].size
        for counts in inner:
            for dtype, value in counts.items():
                total[dtype] += times * value
    return total


@functools.cache
def matmul_peak(dtype: str) -> float | None:
    """FLOP/s of products of square matrices on one device of this process, measured: the limit a
    step is judged by. Well under a second.

    None where the device's memory is too full for that (up to two matrices of ``LARGEST``, freed at
    the end); it is not tried again.
    """
    try:
        return _measured(dtype)
    except (jax.errors.JaxRuntimeError, MemoryError):
        return None


def _measured(dtype: str) -> float:
    device = jax.local_devices()[0]
    product = jax.jit(jnp.matmul)
    size, rate = 512, 0.0
    while size <= LARGEST:
        a = jnp.ones((size, size), dtype, device=device)
        jax.block_until_ready(product(a, a)).delete()
        seconds = math.inf
        for _ in range(3):
            begin = time.perf_counter()
            result = jax.block_until_ready(product(a, a))
            seconds = min(seconds, time.perf_counter() - begin)
            result.delete()
        a.delete()
        rate = max(rate, 2 * size**3 / seconds)
        if seconds > LONG_ENOUGH:
            break
        size *= 2
    return rate


def _product(eqn: Any) -> int:
    left, right = (v.aval.shape for v in eqn.invars[:2])
    out = math.prod(eqn.outvars[0].aval.shape)
    if eqn.primitive.name == "dot_general":
        (contracted, _), _ = eqn.params["dimension_numbers"]
        return 2 * out * math.prod(left[axis] for axis in contracted)
    features = right[eqn.params["dimension_numbers"].rhs_spec[0]]
    return 2 * out * math.prod(right) // features


def _jaxprs(value: Any) -> list[Any]:
    if hasattr(value, "eqns") or hasattr(getattr(value, "jaxpr", None), "eqns"):
        return [value]
    return [j for v in value for j in _jaxprs(v)] if isinstance(value, (tuple, list)) else []
