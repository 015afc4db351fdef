"""PyTorch's ways to compute the attention of ``accelerator_kernels.py``, on the same machine: its
workers call ``measure``, one way a job.

    rows      scaled_dot_product_attention by each backend, padded under a mask where rows have lengths; varlen_attn; flex_attention; nested tensors
    segments  tokens sorted by segment and put back: varlen_attn, flex_attention over all tokens, nested tensors, all padded to the longest, a loop

float32 is TF32 where JAX's is (NVIDIA). A way that this PyTorch lacks raises, and its row says so.
"""  # noqa: E501

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from results import steady
from synthetic import row_lengths, segment_ids

BACKENDS = {
    "sdpa flash": "FLASH_ATTENTION",
    "sdpa efficient": "EFFICIENT_ATTENTION",
    "sdpa cudnn": "CUDNN_ATTENTION",
    "sdpa math": "MATH",
}
SORTED = ("varlen", "flex", "nested")
Attend = Callable[..., torch.Tensor]


def ways(case: dict[str, Any]) -> list[str]:
    """The ways worth trying, most promising first."""
    if case["kind"] != "rows":
        return ["varlen", "flex", "nested", "padded", "loop"]
    if not case["ragged"]:
        return ["sdpa cudnn", "sdpa flash", "sdpa efficient", "flex", "sdpa math"]
    return [*SORTED, "sdpa efficient", "sdpa cudnn"]


def measure(job: dict[str, Any]) -> dict[str, Any]:
    """Seconds of one way, forward and forward + backward."""
    torch.set_float32_matmul_precision("high")
    device = "cuda" if torch.cuda.is_available() else "cpu"
    dtype = getattr(torch, job["dtype"])
    wait = (lambda _: torch.cuda.synchronize()) if device == "cuda" else (lambda _: None)
    build = rows if job["kind"] == "rows" else segments
    shapes, attend = build(job, device)
    torch.manual_seed(0)
    inputs = [torch.randn(s, dtype=dtype, device=device) for s in shapes]
    with torch.no_grad():
        out = attend(*inputs)
        forward = steady(lambda: attend(*inputs), wait)
    gradient = torch.randn_like(out)
    leaves = [x.requires_grad_() for x in inputs]
    both = steady(lambda: torch.autograd.grad(attend(*leaves), leaves, gradient), wait)
    return {"forward s": forward, "f+b s": both}


def rows(job: dict[str, Any], device: str) -> tuple[list[tuple[int, ...]], Attend]:
    """Shapes of q, k, v and a function of them."""
    items, queries, keys, heads, size = (
        job[k] for k in ("items", "queries", "keys", "heads", "size")
    )
    lengths = row_lengths(items, keys) if job["ragged"] else np.full(items, keys, np.int32)
    if job["way"] in SORTED and job["ragged"]:
        # as a library that keeps tokens without padding would hold them
        tokens = int(lengths.sum())
        return [(tokens, heads, size)] * 3, sorted_attend(job["way"], lengths, device)
    shapes = [(items, heads, queries, size), *[(items, heads, keys, size)] * 2]
    if job["way"] == "flex":
        return shapes, _flex(device)
    mask = None
    if job["ragged"]:
        valid = np.arange(keys) < lengths[:, None]
        mask = torch.as_tensor(valid, device=device)[:, None, None]
    from torch.nn.attention import SDPBackend, sdpa_kernel

    backend = getattr(SDPBackend, BACKENDS[job["way"]])

    def attend(q, k, v):
        with sdpa_kernel(backend):
            return F.scaled_dot_product_attention(q, k, v, attn_mask=mask)

    return shapes, attend


def segments(job: dict[str, Any], device: str) -> tuple[list[tuple[int, ...]], Attend]:
    """Shape of all items' tokens [T, 3, N, H] and a function of them."""
    ids, counts = segment_ids(job["kind"], job["items"], job["width"], job["resolution"])
    valid = np.arange(ids.shape[1]) < counts[:, None]
    keys = (np.arange(len(ids))[:, None] * (ids.max() + 1) + ids)[valid]
    order = np.argsort(keys, kind="stable")
    lengths = np.unique(keys, return_counts=True)[1]
    there = torch.as_tensor(order, device=device)
    back = torch.as_tensor(np.argsort(order), device=device)
    if job["way"] in SORTED:
        inner = sorted_attend(job["way"], lengths, device)
        attend = lambda x: inner(*x[there].unbind(1))[back]  # noqa: E731
    elif job["way"] == "loop":
        pieces = lengths.tolist()

        def attend(x):
            done = [
                F.scaled_dot_product_attention(*part.permute(1, 2, 0, 3).unsqueeze(1))[0].transpose(0, 1)  # noqa: E501
                for part in torch.split(x[there], pieces)
            ]  # fmt: skip
            return torch.cat(done)[back]

    else:
        longest = int(lengths.max())
        row = np.repeat(np.arange(len(lengths)), lengths)
        column = np.arange(len(keys)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        place = torch.as_tensor((row * longest + column)[np.argsort(order)], device=device)
        table = np.full((len(lengths), longest), len(keys))
        table[row, column] = order
        index = torch.as_tensor(table, device=device)
        mask = torch.as_tensor(np.arange(longest) < lengths[:, None], device=device)[:, None, None]

        def attend(x):
            q, k, v = F.pad(x, (0, 0, 0, 0, 0, 0, 0, 1))[index].permute(2, 0, 3, 1, 4)
            out = F.scaled_dot_product_attention(q, k, v, attn_mask=mask)
            return out.permute(0, 2, 1, 3).reshape(-1, *x.shape[2:])[place]

    return [(len(keys), 3, job["heads"], job["size"])], attend


def sorted_attend(way: str, lengths: np.ndarray, device: str) -> Attend:
    """Of tokens [T, N, H] that stand segment after segment."""
    edges = torch.as_tensor(np.r_[0, np.cumsum(lengths)].astype(np.int32), device=device)
    longest = int(lengths.max())
    if way == "varlen":
        from torch.nn.attention.varlen import varlen_attn

        return lambda q, k, v: varlen_attn(q, k, v, edges, edges, longest, longest)
    if way == "nested":
        offsets = edges.long()

        def attend(*qkv):
            made = [
                torch.nested.nested_tensor_from_jagged(x, offsets, max_seqlen=longest).transpose(1, 2)  # noqa: E501
                for x in qkv
            ]  # fmt: skip
            return F.scaled_dot_product_attention(*made).transpose(1, 2).values()

        return attend
    ids = torch.as_tensor(np.repeat(np.arange(len(lengths)), lengths), device=device)
    inner = _flex(device, ids)

    def flexible(q, k, v):
        q, k, v = (x.transpose(0, 1)[None] for x in (q, k, v))
        return inner(q, k, v)[0].transpose(0, 1)

    return flexible


def _flex(device: str, ids: torch.Tensor | None = None) -> Attend:
    from torch.nn.attention.flex_attention import create_block_mask, flex_attention

    compiled = torch.compile(flex_attention, dynamic=False) if device == "cuda" else flex_attention
    mask = None
    if ids is not None:
        make = torch.compile(create_block_mask) if device == "cuda" else create_block_mask
        with contextlib.suppress(AttributeError):
            torch._dynamo.config.cache_size_limit = 64
        mask = make(
            lambda b, h, q, k: ids[q] == ids[k], None, None, len(ids), len(ids), device=device
        )
    return lambda q, k, v: compiled(q, k, v, block_mask=mask)
