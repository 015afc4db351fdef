"""Padded segments: which tokens attend to which, planned on the host so that every shape on the
device is static.

A batch is [B, V, ...] with ``counts[B]`` valid tokens first and zero padding after them. A
*segment* is a set of tokens that attend to one another: a part, a window, a run of the Morton
curve. ``plan_segments`` sorts segments into buckets of fixed capacity [S, L] with exact lengths,
one segment a row; ``pack_segments`` puts several into a row, told apart by their ids, so that
little of it is padding. ``nn.attention`` gathers by them. numpy only: data workers call this
without jax.

A plan is of one or more *shares*: consecutive equal parts of the batch's items, each with positions
of its own, so that a device that holds a share's items needs no other's. What is planned here is
one share; ``nn.voxel_plans`` plans several and joins them.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

LONG = (1024, 2048, 4096, 8192, 16384)
_LADDERS = (
    (128, 256, 512, *LONG),
    (96, 128, 192, 256, 384, 512, *LONG),
    (64, 128, 192, 256, 384, 512, *LONG),
    (192, 384, 512, *LONG),
    (256, 512, *LONG),
    (384, 512, *LONG),
    (512, *LONG),
)
_TOKEN_WORK = 128  # of a token in a row, in keys that it looks at: measured on a CPU


class Bucket(NamedTuple):
    """Rows of at most L tokens, S in each of E shares.

    Attributes:
      index: [E, S, L] int32 positions in the share's T = B * V / E flattened tokens; padding is T.
      length: [E, S] int32 tokens in each row, first in it.
      segment: [E, S, L] int32 which of the row's segments a token is in, padding -1; None: one
        segment a row.
    """

    index: np.ndarray
    length: np.ndarray
    segment: np.ndarray | None = None


class Segments(NamedTuple):
    """A partition of a batch's tokens into segments.

    Attributes:
      buckets: their rows, concatenated, hold every valid token exactly once.
      inverse: [E, T] int32 position of each token in the concatenation of all buckets' S * L rows
        of its share; padding tokens: the total.
    """

    buckets: tuple[Bucket, ...]
    inverse: np.ndarray


def plan_segments(
    ids: np.ndarray, counts: np.ndarray, capacities: tuple[tuple[int, int], ...]
) -> Segments:
    """Gather plan of the segments that equal ids make.

    Args:
      ids: [B, V] int; tokens of one item with equal ids are one segment, never across items. Ids of
        padding are ignored.
      counts: [B] valid tokens of each item.
      capacities: (S, L) of each bucket. A segment longer than the largest L is cut into pieces of
        at most that.

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
            f"segments: {len(waiting)} of {len(lengths)} segments do not fit the capacities "
            f"{capacities}; raise the capacities (capacities_for gives some that always suffice)"
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
        length_of = np.pad(used, (0, size - len(chosen))).astype(np.int32)
        buckets.append(Bucket(index[None], length_of[None]))
        offset += size * length
    return Segments(tuple(buckets), inverse[None])


def pack_segments(
    ids: np.ndarray, counts: np.ndarray, sizes: Sequence[int], *, rows: Sequence[int] = ()
) -> Segments:
    """Gather plan of the segments that equal ids make, several of them in a row.

    A segment goes to the smallest size that holds it; what room its row leaves is filled with
    smaller ones, the largest first. Rows are rounded up by at most an eighth (``round_rows``), or
    to one of ``rows``, so that few shapes are compiled.

    Args:
      ids, counts: as for ``plan_segments``.
      sizes: L of each bucket, ascending. A segment longer than the last is cut into pieces of at
        most that.
      rows: of a single size, the numbers of rows that there may be, ascending, the last always
        enough; the first that suffices is taken.
    """
    items, width = ids.shape
    tokens, starts, lengths = _pieces(ids, counts, sizes[-1])
    missing = items * width
    inverse = np.full(missing, -1, np.int32)
    buckets, offset = [], 0
    packed = _pack(lengths, sizes)
    numbers = [next(n for n in rows if n >= len(packed[0]))] if rows else _rounded(packed)
    for size, number, own in zip(sizes, numbers, packed, strict=True):
        if not number:
            continue
        index = np.full((number, size), missing, np.int32)
        segment = np.full((number, size), -1, np.int32)
        used = np.zeros(number, np.int32)
        for r, pieces in enumerate(own):
            for i, piece in enumerate(pieces):
                here = slice(used[r], used[r] + lengths[piece])
                index[r, here] = tokens[starts[piece] : starts[piece] + lengths[piece]]
                segment[r, here] = i
                used[r] = here.stop
        place = np.flatnonzero(index < missing)
        inverse[index.reshape(-1)[place]] = offset + place
        buckets.append(Bucket(index[None], used[None], segment[None]))
        offset += number * size
    inverse = np.where(inverse < 0, offset, inverse).astype(np.int32)
    return Segments(tuple(buckets), inverse[None])


def fitted_sizes(ids: np.ndarray, counts: np.ndarray, longest: int) -> tuple[int, ...]:
    """Row lengths that hold these segments with the least work, and at most 15 % of padding where
    any do; for ``pack_segments``."""
    lengths = _pieces(ids, counts, longest)[2]
    best: tuple[tuple[bool, int], tuple[int, ...]] | None = None
    for below in _LADDERS:
        sizes = (*[size for size in below if size < longest], longest)
        rows = _rounded(_pack(lengths, sizes))
        padded = sum(n * size for n, size in zip(rows, sizes, strict=True))
        work = sum(n * size * (size + _TOKEN_WORK) for n, size in zip(rows, sizes, strict=True))
        cost = (padded > 1.15 * lengths.sum(), work)
        if best is None or cost < best[0]:
            best = (cost, sizes)
    assert best is not None
    return best[1]


def whole_rows(ids: np.ndarray, counts: np.ndarray) -> Segments:
    """The plan in which every item is a row of its own and its ids are the segments: one shape
    whatever the segments are."""
    items, width = ids.shape
    place = np.arange(items * width, dtype=np.int32).reshape(items, width)
    valid = np.arange(width) < np.asarray(counts)[:, None]
    index = np.where(valid, place, items * width).astype(np.int32)
    segment = np.where(valid, ids, -1).astype(np.int32)
    bucket = Bucket(index[None], np.asarray(counts, np.int32)[None], segment[None])
    return Segments((bucket,), index.reshape(1, -1))


def round_rows(rows: int) -> int:
    """The next number of at most four binary digits: 1 to 16, 18, 20, ... 32, 36, ..."""
    step = 1 << max(0, (rows - 1).bit_length() - 4)
    return -(-rows // step) * step


def row_choices(items: int, width: int, size: int) -> tuple[int, int, int]:
    """Rows of ``size`` that segments of a share of so many items of this width may be packed into
    while training: few numbers, each a program to compile.

    The first holds every token if no row has room left, and nearly always suffices, since padding
    makes up for what rows leave (not of a single item that fills its width); the second is an
    eighth more. The third is always enough: two rows one after the other hold more than ``size``
    tokens, or they would be one.
    """
    full = -(-items * width // size)
    return round_rows(full), round_rows(full + -(-full // 8)), round_rows(2 * full + 1)


def join_shares(plans: Sequence[Segments]) -> Segments:
    """One plan of the shares of several; rows are added where a share has fewer than another.

    Raises:
      ValueError: their buckets are not of the same lengths.
    """
    if len(plans) == 1:
        return plans[0]
    if len({tuple(b.index.shape[2] for b in plan.buckets) for plan in plans}) > 1:
        raise ValueError("plans: shares whose buckets are of other lengths; pack them in one size")
    rows = np.max([[b.index.shape[1] for b in plan.buckets] for plan in plans], 0)
    padded = [pad_rows(plan, rows.tolist()) for plan in plans]
    buckets = []
    for own in zip(*(plan.buckets for plan in padded), strict=True):
        segments = [b.segment for b in own if b.segment is not None]
        buckets.append(
            Bucket(
                np.concatenate([b.index for b in own]),
                np.concatenate([b.length for b in own]),
                np.concatenate(segments) if segments else None,
            )
        )
    return Segments(tuple(buckets), np.concatenate([plan.inverse for plan in padded]))


def pad_rows(plan: Segments, rows: Sequence[int]) -> Segments:
    """The plan with so many rows in each bucket, at least as many as it has; what is added is
    empty."""
    tokens = plan.inverse.shape[1]
    inverse = np.full_like(plan.inverse, -1)
    buckets = []
    here = there = 0  # where the bucket begins in a share's rows, before and after
    for bucket, number in zip(plan.buckets, rows, strict=True):
        _, size, length = bucket.index.shape
        more = ((0, 0), (0, number - size), (0, 0))
        segment = bucket.segment
        buckets.append(
            Bucket(
                np.pad(bucket.index, more, constant_values=tokens),
                np.pad(bucket.length, more[:2]),
                None if segment is None else np.pad(segment, more, constant_values=-1),
            )
        )
        mine = (plan.inverse >= here) & (plan.inverse < here + size * length)
        inverse[mine] = plan.inverse[mine] - here + there
        here, there = here + size * length, there + number * length
    return Segments(tuple(buckets), np.where(inverse < 0, there, inverse))


def _rounded(packed: list[list[list[int]]]) -> list[int]:
    """Rows of each size, rounded; at least one in all."""
    rows = [round_rows(len(own)) for own in packed]
    return rows if any(rows) else [1, *rows[1:]]


def _pack(lengths: np.ndarray, sizes: Sequence[int]) -> list[list[list[int]]]:
    """Rows of pieces for each size, ascending: the largest piece that still fits joins a row until
    none does."""
    order = np.argsort(lengths, kind="stable")
    pieces, keys = order.tolist(), lengths[order].tolist()
    packed = []
    for size, below in zip(reversed(sizes), (*reversed(sizes[:-1]), 0), strict=True):
        rows: list[list[int]] = []
        while keys and keys[-1] > below:
            row, room = [], size
            while (i := bisect.bisect_right(keys, room) - 1) >= 0:
                row.append(pieces.pop(i))
                room -= keys.pop(i)
            rows.append(row)
        packed.append(rows)
    return packed[::-1]


def _pieces(
    ids: np.ndarray, counts: np.ndarray, longest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat token positions ordered by segment, and the start and length of every piece in that
    order."""
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
