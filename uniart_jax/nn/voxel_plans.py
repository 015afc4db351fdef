"""Which voxels attend to which: the segments of a voxel batch (parts, windows, runs of the Morton
curve) and their plans. numpy only.

Window ids follow TRELLIS ``modules/sparse/attention/windowed_attn.py``: (coords + shift) // window,
without roll or wrap.
"""

from __future__ import annotations

import numpy as np

from uniart_jax.config import GridConfig, UniArtVAEConfig
from uniart_jax.nn.segments import (
    Segments,
    fitted_sizes,
    join_shares,
    pack_segments,
    plan_segments,
    row_choices,
    whole_rows,
)


def capacities_for(
    config: UniArtVAEConfig, grid: GridConfig, items: int, width: int
) -> dict[str, tuple[tuple[int, int], ...] | None]:
    """Capacities of every plan of ``voxel_plans`` that always suffice; None: segments are packed
    (parts that are never cut, cubic windows)."""
    cut = config.part_segment
    capacities: dict[str, tuple[tuple[int, int], ...] | None] = {
        "parts": part_capacities(items, width, min(grid.max_parts, width), cut) if cut else None
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
    coords: np.ndarray,
    counts: np.ndarray,
    config: UniArtVAEConfig,
    grid: GridConfig,
    *,
    voxel_part: np.ndarray | None = None,
    fitted: bool = False,
    shares: int = 1,
) -> dict[str, Segments]:
    """The plans that the UniArt VAE reads: "parts" (encoder only), "window_0" and "window_1".

    Args:
      coords: [B, V, 3]. counts: [B].
      voxel_part: [B, V] part ids, for the encoder; None leaves out "parts", which decoding alone
        does not need.
      fitted: where segments are packed, in rows of several lengths, as many as these segments need:
        least work for one batch, another shape for the next. Otherwise (training) in rows of one
        length, as many as ``row_choices`` has.
      shares: consecutive equal parts of the items that are planned apart, one for each device that
        will hold one (not with ``fitted``).

    Raises:
      ValueError: an item has more than ``grid.max_parts`` parts, or the items do not divide into
        the shares.
    """
    coords, counts = np.asarray(coords), np.asarray(counts)
    ids = {} if voxel_part is None else {"parts": np.asarray(voxel_part)}
    items = len(counts)
    if items % shares or (fitted and shares > 1):
        raise ValueError(f"plans: {items} items in {shares} shares; give a divisor, or 1 if fitted")
    size = items // shares
    made = [
        _plans_of_share(
            coords[i : i + size],
            counts[i : i + size],
            {name: values[i : i + size] for name, values in ids.items()},
            config,
            grid,
            fitted,
        )
        for i in range(0, items, size)
    ]
    return {name: join_shares([plans[name] for plans in made]) for name in made[0]}


def serial_capacities(
    items: int, width: int, length: int, shift: int
) -> tuple[tuple[int, int], ...]:
    """Capacities that always suffice for ``serial_ids`` of the same length and shift."""
    return ((items * -(-(width + shift) // length), length),)


def part_capacities(items: int, width: int, parts: int, length: int) -> tuple[tuple[int, int], ...]:
    """Capacities that always suffice for at most ``parts`` parts an item cut to pieces of
    ``length``.

    A part leaves at most one piece shorter than ``length``; those of at most a quarter of it go to
    a bucket of their own.
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
    """[B, V] run of each voxel when the voxels of an item, in Morton order, are cut into runs of
    ``length`` tokens.

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


def _plans_of_share(
    coords: np.ndarray,
    counts: np.ndarray,
    ids: dict[str, np.ndarray],
    config: UniArtVAEConfig,
    grid: GridConfig,
    fitted: bool,
) -> dict[str, Segments]:
    """``voxel_plans`` of one share; ids: perhaps those of "parts"."""
    items, width = coords.shape[:2]
    capacities = capacities_for(config, grid, items, width)
    ids = dict(ids)
    for i in range(0 if config.attention == "full" else 2):
        shift = i * (config.window // 2)
        ids[f"window_{i}"] = (
            serial_ids(coords, counts, config.window, shift)
            if config.attention == "serial"
            else window_ids(coords, config.window, shift)
        )
    plans = {}
    for name, values in ids.items():
        chosen = capacities[name]
        if chosen is not None:
            plans[name] = plan_segments(values, counts, chosen)
        elif fitted:
            longest = width if name == "parts" else config.window**3
            sizes = fitted_sizes(values, counts, longest)
            plans[name] = pack_segments(values, counts, sizes)
        elif name == "parts":
            plans[name] = whole_rows(values, counts)
        else:
            size = min(width, config.window**3)
            plans[name] = pack_segments(
                values, counts, (size,), rows=row_choices(items, width, size)
            )
    return plans
