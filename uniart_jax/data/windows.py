"""Training on some windows of an object: runs of its Morton curve, chosen so that small parts are
seen as often as large ones.

The UniArt VAE reads a voxel with its neighbours only, so a few whole windows teach it what the
whole object would, at a fraction of the cost and in one static shape. The windows are those that
'serial' attention cuts (``nn.voxel_plans.serial_ids``), so attention inside them is what it is on
the whole object.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.data.columns import FEATURES
from uniart_jax.data.records import Record
from uniart_jax.nn.voxel_plans import morton


def choose_windows(record: Record, voxels: int, window: int, rng: np.random.Generator) -> Record:
    """The record with at most ``voxels`` of its voxels: whole windows of ``window``, drawn without
    replacement.

    A window's weight is half its share of the voxels and half its share of the parts, each part
    counting the same.
    """
    count = len(record.coords)
    if count <= voxels:
        return record
    order = np.argsort(morton(record.coords.astype(np.int64)), kind="stable")
    number = -(-count // window)
    of = np.empty(count, np.int64)
    of[order] = np.arange(count) // window
    sizes = np.bincount(record.voxel_part, minlength=len(record.boxes))
    share = 1.0 / np.maximum(sizes, 1)[record.voxel_part]
    weight = np.bincount(of, share / share.sum(), minlength=number)
    weight = weight + np.bincount(of, minlength=number) / count
    chosen = rng.choice(number, voxels // window, replace=False, p=weight / weight.sum())
    keep = np.flatnonzero(np.isin(of, chosen))
    fields = ("coords", "sdf", "color", "owner", "voxel_part", *FEATURES)
    kept = {k: values[keep] for k in fields if (values := getattr(record, k)) is not None}
    return dataclasses.replace(record, **kept)
