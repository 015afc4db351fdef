"""Every attention kernel on the accelerator that is found: is it right, how fast is it at the
paper's sizes, and which should ``auto`` take?

    python benchmarks/accelerator_kernels.py [--minutes 9] [--only correctness speed] [--tiny]
    [--out out/bench]

* correctness: forward and gradient against float64 numpy on what the kernel was given (rounded to
  its dtype): odd lengths, rows of one key and of none, NaN in all padding, cross-attention, packed
    rows, one segment a row. The largest error over the largest value must be within ``ALLOWED``,
    and
  padding and its gradients exactly zero. A kernel that raises is a row that says so.
* speed: seconds forward and forward + backward (queued calls, median of three rounds) of the
  structure flow's rows, of shifted windows and parts by both kinds of plan, of ragged rows and of
  cross-attention, beside every way of PyTorch where it has the device (``accelerator_peers.py``).
  TFLOP/s count the products that are asked for, padding left out, and 7/2 of them for both
  directions; ``of peak``: of the matrix product measured here.
* rule: the fastest kernel for each dtype and kind of rows, and what ``auto`` takes today.

float32 is as JAX computes it unless told otherwise (TF32 on NVIDIA). With --tiny sizes are tiny; so
on a CPU, where Pallas interprets, compilation is quick and seconds mean nothing.
Every result is written when it is there; what the limit of minutes does not reach is left out,
least important first.
"""

from __future__ import annotations

import argparse
import functools
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jobs import Clock, accelerator, describe, run_jobs, work
from results import bars, report, save, steady
from synthetic import row_lengths, segment_ids, segment_plan

from uniart_jax.nn.attention import attend, attend_segments, choose
from uniart_jax.nn.segments import pack_segments, plan_segments, whole_rows

# largest error over largest value, forward and gradient; float32 on an accelerator multiplies in
# TF32 or bfloat16 passes
ALLOWED = {"float32 highest": (2e-5, 1e-4), "float32": (5e-3, 1e-2), "bfloat16": (1e-2, 2e-2)}
KERNELS = {
    "gpu": ("cudnn", "xla", "triton"),
    "tpu": ("splash", "xla"),
    "cpu": ("xla", "triton", "splash"),
}
# (queries, keys, lengths given, queries have them too)
ROWS = {
    "rows": (256, 256, False, False),
    "odd rows": (201, 201, False, False),
    "lengths": (201, 201, True, True),
    "lengths, 192": (192, 192, True, True),
    "cross": (130, 77, False, False),
    "cross, lengths": (70, 201, True, False),
}
PLANS = ("one a row", "packed", "whole rows", "empty rows")
FULL = dict(kind="rows", items=8, queries=4096, keys=4096, ragged=False, heads=16, size=64)
SEGMENTS = dict(items=8, width=16384, resolution=64, size=64)
SPEED: dict[str, dict[str, Any]] = {
    "full": FULL,
    "windows, training plan": dict(SEGMENTS, kind="windows", fitted=False, heads=12),
    "windows, fitted plan": dict(SEGMENTS, kind="windows", fitted=True, heads=12),
    "ragged rows": dict(FULL, queries=3072, keys=3072, ragged=True),
    "cross": dict(FULL, keys=1374),
    "parts, training plan": dict(SEGMENTS, kind="parts", fitted=False, heads=2),
    "parts, fitted plan": dict(SEGMENTS, kind="parts", fitted=True, heads=2),
}


def reference(q, k, v, g, seen) -> list[np.ndarray]:
    """Attention in float64 and its gradient: out, dq, dk, dv; seen [S, Lq, Lk]."""
    q, k, v, g = (np.where(np.isnan(x), 0, x).astype(np.float64) for x in (q, k, v, g))
    scale = q.shape[-1] ** -0.5
    logits = np.where(seen[:, None], np.einsum("slnh,smnh->snlm", q, k) * scale, -np.inf)
    peak = logits.max(-1, keepdims=True)
    weights = np.exp(logits - np.where(np.isfinite(peak), peak, 0))
    weights /= np.maximum(weights.sum(-1, keepdims=True), 1e-300)
    out = np.einsum("snlm,smnh->slnh", weights, v)
    d_weights = np.einsum("slnh,smnh->snlm", g, v)
    inner = (weights * d_weights).sum(-1, keepdims=True)
    d_logits = weights * (d_weights - inner) * scale
    d_q, d_k = np.einsum("snlm,smnh->slnh", d_logits, k), np.einsum("snlm,slnh->smnh", d_logits, q)
    return [out, d_q, d_k, np.einsum("snlm,slnh->smnh", weights, g)]


def plans(width: int = 150, kinds: int = 5):
    """Every kind of plan of the same ids [2, width], and who sees whom."""
    ids = np.random.default_rng(0).integers(0, kinds, (2, width))
    counts = np.array([width, width - 31])
    every = (
        plan_segments(ids, counts, ((2 * kinds + 3, 40), (2 * kinds, 70))),
        pack_segments(ids, counts, (40, 130)),
        whole_rows(ids, counts),
        pack_segments(ids, counts, (130,), rows=(7,)),
    )
    valid = np.arange(width) < counts[:, None]
    seen = (ids[:, :, None] == ids[:, None]) & valid[:, :, None] & valid[:, None]
    return dict(zip(PLANS, every, strict=True)), seen


def correctness(job: dict[str, Any]) -> dict[str, Any]:
    """One kernel, dtype and case: the errors, or what is wrong."""
    kernel, size = job["kernel"], job["size"]
    dtype = jnp.dtype(job["dtype"].split()[0])
    precision = "highest" if "highest" in job["dtype"] else None
    rng = np.random.default_rng(0)

    def draw(*shape):
        return jnp.asarray(rng.normal(size=shape), dtype)

    if job["case"] in PLANS:
        every, seen = plans()
        plan = jax.tree.map(jnp.asarray, every[job["case"]])
        items, width = seen.shape[:2]
        inputs, g = [draw(items, width, 2, size) for _ in range(3)], draw(items, width, 2, size)
        q_valid = k_valid = seen.any(-1)

        def run(q, k, v):
            flat = jnp.stack([q, k, v], 2).reshape(items * width, 3, 2, size)
            return attend_segments(flat, plan, kernel=kernel).reshape(q.shape)

    else:
        queries, keys, some, both = ROWS[job["case"]]
        lengths = np.array([keys, 1 + keys // 3, 1, 0] if some else [keys] * 4)
        k_valid = np.arange(keys) < lengths[:, None]
        q_valid = k_valid if both else np.ones((4, queries), bool)
        seen = q_valid[:, :, None] & k_valid[:, None]
        inputs = [draw(4, n, 2, size) for n in (queries, keys, keys)]
        g = draw(4, queries, 2, size)
        n = jnp.asarray(lengths) if some else None

        def run(q, k, v):
            return attend(q, k, v, n, query_lengths=n if both else None, kernel=kernel)

    valid = [x[..., None, None] for x in (q_valid, k_valid, k_valid)]
    dirty = [jnp.where(m, x, jnp.nan) for m, x in zip(valid, inputs, strict=True)]

    @jax.jit
    def both_ways(inputs, g):
        out, back = jax.vjp(run, *inputs)
        return [out, *back(g)]

    with jax.default_matmul_precision(precision or "default"):
        found = [np.asarray(x, np.float64) for x in both_ways(dirty, g)]
    expected = reference(*(np.asarray(x, np.float64) for x in (*inputs, g)), seen)
    for name, x, m in zip(
        ("output", "d query", "d key", "d value"), found, [valid[0], *valid], strict=True
    ):
        if not np.isfinite(x).all():
            return {"forward": np.nan, "gradient": np.nan, "result": f"FAILED: {name} not finite"}
        if np.where(m, 0, x).any():
            return {"forward": np.nan, "gradient": np.nan, "result": f"FAILED: {name} of padding"}
    errors = [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(found, expected, strict=True)]
    forward, gradient = errors[0], max(errors[1:])
    allowed = ALLOWED[job["dtype"]]
    result = "passed" if forward <= allowed[0] and gradient <= allowed[1] else "FAILED"
    return {"forward": forward, "gradient": gradient, "result": result}


def products(case: dict[str, Any]) -> float:
    """FLOP of the forward products that are asked for."""
    if case["kind"] == "rows":
        lengths = row_lengths(case["items"], case["keys"]).astype(float)
        pairs = (
            (lengths**2).sum() if case["ragged"] else case["items"] * case["queries"] * case["keys"]
        )
    else:
        ids, counts = _ids(case["kind"], case["items"], case["width"], case["resolution"])
        pairs = sum(
            (np.unique(i[:n], return_counts=True)[1] ** 2.0).sum()
            for i, n in zip(ids, counts, strict=True)
        )
    return 4.0 * float(pairs) * case["heads"] * case["size"]


def speed(job: dict[str, Any]) -> dict[str, Any]:
    """Seconds of one kernel, dtype and case."""
    kernel, dtype, heads, size = (job[k] for k in ("kernel", "dtype", "heads", "size"))
    keys = jax.random.split(jax.random.key(0), 4)
    if job["kind"] == "rows":
        items, queries, length = job["items"], job["queries"], job["keys"]
        shapes = [(items, n, heads, size) for n in (queries, length, length)]
        extra = jnp.asarray(row_lengths(items, length)) if job["ragged"] else None
        function = lambda n, *qkv: attend(*qkv, n, query_lengths=n, kernel=kernel)  # noqa: E731
    else:
        ids, counts = _ids(job["kind"], job["items"], job["width"], job["resolution"])
        shapes = [(ids.size, 3, heads, size)]
        extra = jax.tree.map(jnp.asarray, segment_plan(job["kind"], job["fitted"], ids, counts))
        function = lambda plan, x: attend_segments(x, plan, kernel=kernel)  # noqa: E731
    x = [jax.random.normal(k, s, dtype) for k, s in zip(keys, shapes, strict=False)]
    forward = jax.jit(function)
    g = jax.random.normal(keys[3], jax.eval_shape(forward, extra, *x).shape, dtype)
    back = jax.jit(lambda e, g, *x: jax.vjp(functools.partial(function, e), *x)[1](g))
    compiled = back.lower(extra, g, *x).compile()
    return {
        "forward s": steady(lambda: forward(extra, *x)),
        "f+b s": steady(lambda: compiled(extra, g, *x)),
        "temporaries MiB": compiled.memory_analysis().temp_size_in_bytes / 2**20,
    }


@functools.cache
def _ids(*arguments):
    return segment_ids(*arguments)


def measure(job: dict[str, Any]) -> dict[str, Any]:
    if job["do"] == "about":
        return describe(job)
    if job["do"] == "torch":
        from accelerator_peers import measure as peer

        return peer(job)
    return {"correctness": correctness, "speed": speed}[job["do"]](job)


def tiny_case(case: dict[str, Any]) -> dict[str, Any]:
    if case["kind"] == "rows":
        return dict(
            case, items=2, queries=case["queries"] // 32, keys=case["keys"] // 32, heads=2, size=16
        )
    return dict(case, items=2, width=400, resolution=24, heads=2, size=16)


def check(backend: str, tiny: bool, seconds: float, out: Path, about: dict) -> None:
    clock, rows, kernels = Clock(seconds / 60), [], KERNELS[backend]
    for i, kernel in enumerate(kernels):
        if kernel == "cudnn":
            dtypes = ["bfloat16"]
        elif backend == "cpu":  # interpreting Pallas is slow
            dtypes = ["float32 highest", *(["bfloat16"] if kernel == "xla" else [])]
        else:
            dtypes = list(ALLOWED)[::-1]
        cases = [*PLANS, *(c for c in ROWS if kernel != "triton" or "cross" not in c)]
        if backend == "cpu" and kernel != "xla":
            cases = cases[1::2]
        jobs = [
            dict(do="correctness", kernel=kernel, dtype=d, case=c, size=16 if tiny else 64)
            for d in dtypes
            for c in cases
        ]
        for job, result in run_jobs(jobs, clock.left() / (len(kernels) - i)):
            if "raised" in result:
                result = {
                    "forward": np.nan,
                    "gradient": np.nan,
                    "result": f"raised: {result['raised']}",
                }
            kept = {k: job[k] for k in ("kernel", "dtype", "case")}
            rows.append({**kept, **result, "allowed": ALLOWED[job["dtype"]]})
            save("accelerator_kernels_correct", rows, out, **about)
    if rows:
        report("accelerator_kernels_correct", rows, out, **about)
        bad = sum(row["result"] != "passed" for row in rows)
        print(f"correctness: {len(rows) - bad} of {len(rows)} passed\n", flush=True)


def time_all(backend: str, tiny: bool, seconds: float, out: Path, about: dict) -> list[dict]:
    clock, rows = Clock(seconds / 60), []
    cases = {name: tiny_case(c) if tiny else c for name, c in SPEED.items()}
    work_of = {name: products(case) for name, case in cases.items()}
    dtypes = ("float32",) if backend == "cpu" else ("bfloat16", "float32")
    every = [(name, case, d) for d in dtypes for name, case in cases.items()]
    batches: list[list[dict]] = []
    for kernel in KERNELS[backend] if backend != "cpu" else ("xla",):  # interpreted: no speed
        jobs = [
            dict(case, do="speed", who=kernel, kernel=kernel, dtype=d, case=name)
            for name, case, d in every
            if (kernel != "cudnn" or d == "bfloat16") and (kernel != "triton" or name != "cross")
        ]
        batches.append(jobs)
    if backend != "tpu":
        batches.insert(1, _torch_jobs(every))
    for i, jobs in enumerate(batches):
        for job, result in run_jobs(jobs, clock.left() / (len(batches) - i)):
            raised = result.get("raised")
            both = np.nan if raised else 3.5 * work_of[job["case"]] / result["f+b s"] / 1e12
            row = {"case": job["case"], "dtype": job["dtype"], "who": job["who"]}
            row |= {k: result.get(k, np.nan) for k in ("forward s", "f+b s", "temporaries MiB")}
            row |= {"f+b TFLOP/s": both, "of peak": 1e3 * both / about["peaks"][job["dtype"]]}
            rows.append({**row, "note": f"raised: {raised}"[:100] if raised else ""})
            save("accelerator_kernels_speed", rows, out, **about)
    if missing := sum(map(len, batches)) - len(rows):
        print(f"speed: {missing} measurements left out, the time is up", flush=True)
    order = [(name, d) for name, _, d in every]
    rows.sort(key=lambda row: (order.index((row["case"], row["dtype"])), row["f+b s"]))
    if rows:
        report("accelerator_kernels_speed", rows, out, **about)
        groups: dict[str, dict[str, float]] = {}
        for row in rows:
            if row["dtype"] == dtypes[0] and not row["note"]:
                label = row["case"].replace(", ", "\n")
                groups.setdefault(label, {})[row["who"]] = 1e3 * row["f+b s"]
        bars(out / "accelerator_kernels.png", groups, f"ms forward + backward, {dtypes[0]}")
    return rows


def _torch_jobs(every) -> list[dict]:
    try:
        import torch  # noqa: F401
        from accelerator_peers import ways
    except ImportError:
        print("torch is absent: no peers")
        return []
    # windows and parts are the same for PyTorch whatever the plan
    return [
        dict(case, do="torch", who=f"torch {way}", way=way, dtype=d, case=name)
        for name, case, d in every
        if not case.get("fitted")
        for way in ways(case)
    ]


def rule(rows: list[dict], backend: str) -> list[dict[str, Any]]:
    """The fastest kernel of each dtype and kind of rows, forward + backward, beside what ``auto``
    takes."""
    kept = []
    for name, case in SPEED.items():
        for dtype in ("bfloat16", "float32"):
            ours, torchs = (
                sorted((r["f+b s"], r["who"]) for r in rows
                       if (r["case"].split(",")[0] == name.split(",")[0] if peer else r["case"] == name)  # noqa: E501
                       and r["dtype"] == dtype and r["who"].startswith("torch") == peer and not r["note"])  # noqa: E501
                for peer in (False, True)
            )  # fmt: skip
            if ours:
                keys = case.get("keys", 512 if case["kind"] == "windows" else case.get("width"))
                kept.append({
                    "dtype": dtype,
                    "rows": name,
                    "fastest": ours[0][1],
                    "next": f"{ours[1][1]} x {ours[1][0] / ours[0][0]:.2f}" if len(ours) > 1 else "",  # noqa: E501
                    "auto takes": choose("auto", jnp.dtype(dtype), keys, backend),
                    "best torch": f"{torchs[0][1]} x {torchs[0][0] / ours[0][0]:.2f}" if torchs else "",  # noqa: E501
                })  # fmt: skip
    return kept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=9)
    parser.add_argument(
        "--only", nargs="+", choices=["correctness", "speed"], default=["correctness", "speed"]
    )
    parser.add_argument("--tiny", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments = parser.parse_args()
    clock = Clock(arguments.minutes)
    about, backend, tiny = accelerator(clock, arguments.tiny, dict(do="about"))
    if "correctness" in arguments.only:
        share = 0.4 if "speed" in arguments.only else 1.0
        check(backend, tiny, share * clock.left(), arguments.out, about)
    if "speed" in arguments.only:
        rows = time_all(backend, tiny, clock.left(), arguments.out, about)
        verdict = rule(rows, backend)
        if verdict:
            print("\nThe rule for 'auto' (fastest forward + backward):")
            report("accelerator_kernels_rule", verdict, arguments.out, **about)


if __name__ == "__main__":
    work(measure) if "--worker" in sys.argv else main()
