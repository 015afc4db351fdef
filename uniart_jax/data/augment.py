"""Augmentation of whole records on stored types, so that it is cheap. No picture follows a record
here: for batches that show none.

What needs the object itself (sizes of parts, another shown state) is ``data.live``; mirroring is
``data.mirror``.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.data.records import Record
from uniart_jax.objects.appearance import gain_tables
from uniart_jax.objects.perturb import draw_joint
from uniart_jax.voxels.joint_code import encode_joint


def recolor_record(record: Record, gains: np.ndarray) -> Record:
    """The record in other colours, without pictures of it: the linear RGB of each sub-cell times
    its part's ``gains`` [K, 3], clipped."""
    tables = gain_tables(gains)
    color = tables[record.owner[..., None], np.arange(3), record.color]
    return dataclasses.replace(record, color=color)


def redraw_joints(record: Record, share: float, rng: np.random.Generator) -> Record:
    """The record with other joints on each of its parts but the root with probability ``share``:
    any joint (``objects.perturb.draw_joint``) to any part before it, whatever its mesh says.
    Voxels, boxes and ``meta`` stay. Of a record as ``records.from_object`` makes it: parents first,
    one root."""
    codes, parents = record.codes.copy(), record.parents.copy()
    for k in range(len(codes)):
        if parents[k] != k and rng.random() < share:
            joint = draw_joint(record.boxes[k], rng)
            codes[k] = encode_joint(joint, record.boxes[k, :3])
            parents[k] = rng.integers(k)
    return dataclasses.replace(record, codes=codes, parents=parents)
