"""Random voxels, and what a plan says of them."""

import jax
import numpy as np


def voxels(seed, items, width, side):
    """Random sorted unique coords, padded."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, min(width, side**3) + 1, items).astype(np.int32)
    coords = np.zeros((items, width, 3), np.int32)
    for b, n in enumerate(counts):
        chosen = np.sort(rng.choice(side**3, n, replace=False))
        coords[b, :n] = np.stack(np.unravel_index(chosen, (side,) * 3), -1)
    return coords, counts


def members(plan, total):
    """Every segment of a plan of one share as a list of flat tokens; checks the plan's own
    consistency on the way."""
    plan = jax.tree.map(lambda a: a[0], plan)
    flat = np.concatenate([bucket.index.reshape(-1) for bucket in plan.buckets])
    tokens = np.flatnonzero(plan.inverse < len(flat))
    np.testing.assert_array_equal(flat[plan.inverse[tokens]], tokens)
    assert (flat < total).sum() == len(tokens)
    out = []
    for bucket in plan.buckets:
        for row, length in zip(bucket.index, bucket.length, strict=True):
            assert (row[:length] < total).all() and (row[length:] == total).all()
        for row, length, ids in zip(bucket.index, bucket.length, row_ids(bucket), strict=True):
            assert (ids[length:] == -1).all() and (ids[:length] >= 0).all()
            out += [row[:length][ids[:length] == i] for i in np.unique(ids[:length])]
    return out


def row_ids(bucket):
    if bucket.segment is not None:
        return bucket.segment
    valid = np.arange(bucket.index.shape[1]) < bucket.length[:, None]
    return np.where(valid, 0, -1)
