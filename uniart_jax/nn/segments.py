"""Padded segments: which tokens attend to which, planned on the host so that every shape on the device is static.

A batch is [B, V, ...] with ``counts[B]`` valid tokens first and zero padding after them. A *segment* is a set of tokens that attend
to one another: a part, a window, a run of the Morton curve. ``plan_segments`` sorts segments into buckets of fixed capacity
[S, L] with exact lengths; ``nn.attention`` gathers by them. numpy only: data workers call this without jax.

Window ids follow TRELLIS ``modules/sparse/attention/windowed_attn.py``: (coords + shift) // window, without roll or wrap.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from uniart_jax.config import GridConfig, UniArtVAEConfig


class Bucket(NamedTuple):
    """Segments of at most L tokens.

    Attributes:
      index: [S, L] int32 positions in the flattened [B * V] tokens; padding is B * V.
      length: [S] int32 tokens in each segment, first in their row.
    """

    index: np.ndarray
    length: np.ndarray


class Segments(NamedTuple):
    """A partition of a batch's tokens into segments.

    Attributes:
      buckets: their rows, concatenated, hold every valid token exactly once.
      inverse: [B * V] int32 position of each token in the concatenation of all buckets' S * L rows; padding tokens: the total.
    """

    buckets: tuple[Bucket, ...]
    inverse: np.ndarray


def plan_segments(
    ids: np.ndarray, counts: np.ndarray, capacities: tuple[tuple[int, int], ...]
) -> Segments:
    """Gather plan of the segments that equal ids make.

    Args:
      ids: [B, V] int; tokens of one item with equal ids are one segment, never across items. Ids of padding are ignored.
      counts: [B] valid tokens of each item.
      capacities: (S, L) of each bucket. A segment longer than the largest L is cut into pieces of at most that.

    Raises:
      ValueError: the segments do not fit into the capacities.
    """
    items, width = ids.shape
    tokens, starts, lengths = _pieces(ids, counts, max(length for _, length in capacities))
    order = sorted(range(len(capacities)), key=lambda i: capacities[i][1])
    rows: list[np.ndarray] = [np.zeros(0, np.int64)] * len(capacities)
    waiting = np.argsort(lengths, kind="stable")
    for i in order:
        size, length = capacities[i]
        fitting = int(np.searchsorted(lengths[waiting], length, side="right"))
        rows[i] = waiting[: min(fitting, size)]
        waiting = waiting[min(fitting, size) :]
    if len(waiting):
        raise ValueError(
            f"segments: {len(waiting)} of {len(lengths)} segments do not fit the capacities {capacities}; "
            "raise the capacities (capacities_for gives some that always suffice)"
        )
    inverse = np.full(items * width, sum(s * n for s, n in capacities), np.int32)
    buckets, offset = [], 0
    for (size, length), chosen in zip(capacities, rows, strict=True):
        chosen = np.sort(chosen)  # rows in the order of their tokens: neighbouring reads
        index = np.full((size, length), items * width, np.int32)
        used = lengths[chosen]
        row = np.repeat(np.arange(len(chosen)), used)
        column = np.arange(len(row)) - np.repeat(np.cumsum(used) - used, used)
        token = tokens[np.repeat(starts[chosen], used) + column]
        index[row, column] = token
        inverse[token] = offset + row * length + column
        buckets.append(Bucket(index, np.pad(used, (0, size - len(chosen))).astype(np.int32)))
        offset += size * length
    return Segments(tuple(buckets), inverse)


def segment_lengths(ids: np.ndarray, counts: np.ndarray, longest: int) -> np.ndarray:
    """[number of segments] lengths after cutting at ``longest``: what capacities must hold."""
    return _pieces(ids, counts, longest)[2]


def fit_capacities(lengths: np.ndarray, sizes: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Capacities that hold these segments in buckets of the given sizes, rounded up to 1 or 1.5 times a power of two.

    For segments whose worst case is far above the usual one (shifted windows): a few distinct shapes are compiled instead.
    """
    edges = np.asarray((0, *sorted(sizes)))
    found = np.histogram(np.asarray(lengths) - 0.5, edges)[0]
    capacities = []
    for n, size in zip(found, edges[1:], strict=True):
        rounded = 1
        while rounded < n:
            rounded = (
                rounded * 3 // 2
                if rounded & (rounded - 1) == 0 and rounded > 1
                else 1 << rounded.bit_length()
            )
        capacities.append((rounded, int(size)))
    return tuple(capacities)


def serial_capacities(
    items: int, width: int, length: int, shift: int
) -> tuple[tuple[int, int], ...]:
    """Capacities that always suffice for ``serial_ids`` of the same length and shift."""
    return ((items * -(-(width + shift) // length), length),)


def part_capacities(items: int, width: int, parts: int, length: int) -> tuple[tuple[int, int], ...]:
    """Capacities that always suffice for at most ``parts`` parts an item cut to pieces of ``length``.

    A part leaves at most one piece shorter than ``length``; those of at most a quarter of it go to a bucket of their own.
    """
    if length >= width:
        return ((items * parts, width),)
    short = max(length // 4, 1)
    # n parts can leave remainders above `short` only if they own n * short tokens
    long = max(
        n + (width - n * (short + 1)) // length for n in range(min(parts, width // (short + 1)) + 1)
    )
    return ((items * parts, short), (items * long, length))


def serial_ids(coords: np.ndarray, counts: np.ndarray, length: int, shift: int = 0) -> np.ndarray:
    """[B, V] run of each voxel when the voxels of an item, in Morton order, are cut into runs of ``length`` tokens.

    With ``shift`` the first run is shorter by it, so that shifted runs straddle the unshifted ones.
    """
    ids = np.zeros(coords.shape[:2], np.int64)
    for b, count in enumerate(counts):
        order = np.argsort(morton(coords[b, :count]), kind="stable")
        ids[b, order] = (np.arange(count) + shift) // length
    return ids


def morton(coords: np.ndarray) -> np.ndarray:
    """[...] Morton code of voxel indices [..., 3] below 2^20: bits interleaved, x highest."""
    code = np.asarray(coords, np.int64)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        code = (code | (code << shift)) & mask
    return (code[..., 0] << 2) | (code[..., 1] << 1) | code[..., 2]


def window_ids(coords: np.ndarray, window: int, shift: int = 0) -> np.ndarray:
    """[B, V] id of the cubic window of each voxel; border windows are smaller."""
    cell = (np.asarray(coords, np.int64) + shift) // window
    span = int(cell.max(initial=0)) + 1
    return (cell[..., 0] * span + cell[..., 1]) * span + cell[..., 2]


def capacities_for(
    config: UniArtVAEConfig, grid: GridConfig, items: int, width: int
) -> dict[str, tuple[tuple[int, int], ...] | None]:
    """Capacities of every plan of ``voxel_plans`` that always suffice; None: fitted to each batch.

    Shifted cubic windows are fitted, because their worst case is the whole dense grid.
    """
    length = config.part_segment or width
    capacities: dict[str, tuple[tuple[int, int], ...] | None] = {
        "parts": part_capacities(items, width, min(grid.max_parts, width), length)
    }
    for i in range(2):
        shift = i * (config.window // 2)
        capacities[f"window_{i}"] = (
            serial_capacities(items, width, config.window, shift)
            if config.attention == "serial"
            else None
        )
    return capacities


def voxel_plans(
    batch: Mapping[str, np.ndarray],
    config: UniArtVAEConfig,
    grid: GridConfig,
    *,
    parts: bool = True,
) -> dict[str, Segments]:
    """The plans that the UniArt VAE reads: "parts" (encoder only), "window_0" and "window_1".

    Args:
      batch: coords [B, V, 3], counts [B] and, for the encoder, voxel_part [B, V].
      parts: False leaves out "parts", as decoding alone needs no part ids.

    Raises:
      ValueError: an item has more than ``grid.max_parts`` parts.
    """
    coords, counts = np.asarray(batch["coords"]), np.asarray(batch["counts"])
    capacities = capacities_for(config, grid, *coords.shape[:2])
    ids = {}
    if parts:
        ids["parts"] = np.asarray(batch["voxel_part"])
    for i in range(2):
        shift = i * (config.window // 2)
        ids[f"window_{i}"] = (
            serial_ids(coords, counts, config.window, shift)
            if config.attention == "serial"
            else window_ids(coords, config.window, shift)
        )
    plans = {}
    for name, values in ids.items():
        chosen = capacities[name]
        if chosen is None:
            longest = config.window**3
            sizes = (*tuple(s for s in (32, 64, 128, 256) if s < longest), longest)
            chosen = fit_capacities(segment_lengths(values, counts, longest), sizes)
        plans[name] = plan_segments(values, counts, chosen)
    return plans


def _pieces(
    ids: np.ndarray, counts: np.ndarray, longest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat token positions ordered by segment, and the start and length of every piece in that order."""
    _items, width = ids.shape
    valid = np.arange(width) < np.asarray(counts)[:, None]
    tokens = np.flatnonzero(valid)
    keys = np.asarray(ids, np.int64).reshape(-1)[tokens]
    item = tokens // width
    order = np.lexsort((keys, item))
    tokens, keys, item = tokens[order], keys[order], item[order]
    first = np.ones(len(tokens), bool)
    first[1:] = (keys[1:] != keys[:-1]) | (item[1:] != item[:-1])
    start = np.flatnonzero(first)
    within = np.arange(len(tokens)) - np.repeat(start, np.diff(np.append(start, len(tokens))))
    starts = np.flatnonzero(within % longest == 0)
    return tokens, starts, np.diff(np.append(starts, len(tokens)))
