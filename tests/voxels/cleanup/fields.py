"""Dense fields of analytic solids, made without voxels; places and lengths are in cells."""

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import DenseField, with_sources

N = 64  # sub-cells a side
AT = np.stack(np.meshgrid(*[np.arange(N + 2) + 0.0] * 3, indexing="ij"))


def field_of(*solids):
    """A field whose part k is where the k-th distance [N + 2]^3 (sub-cells) is negative; earlier
    parts win."""
    sdf, owner = np.full((N + 2,) * 3, 3.0, np.float32), np.full((N + 2,) * 3, -1, np.int16)
    for k, distance in enumerate(solids):
        mine = (distance < np.abs(sdf)) & (sdf > 0)
        sdf = np.where(mine, np.clip(distance, -3, 3), sdf).astype(np.float32)
        owner = np.where(mine, k, owner).astype(np.int16)
    source = np.where(np.abs(sdf) < 3, np.arange(sdf.size).reshape(sdf.shape), -1).astype(np.int32)
    sdf[sdf == 0] = -1e-4
    return DenseField(sdf, owner, source)


def block(lower, upper, places=AT):
    """Distance from a block between two corners; corners may be maps of the other places."""
    return np.max(
        [np.maximum(a - x, x - b) for a, x, b in zip(lower, places, upper, strict=True)], 0
    )


def box_of(lower, upper):
    """[6] centre and size of a block, object units."""
    lower, upper = place_of(lower), place_of(upper)
    return np.concatenate([(lower + upper) / 2, upper - lower])


def place_of(cells):
    """Object units."""
    return (np.array(cells) - 0.5) / N - 0.5


def moved(motion, cells=AT):
    """Cells [3, ...] after a motion [4, 4] in object units."""
    flat = place_of(cells).reshape(3, -1)
    there = motion[:3, :3] @ flat + motion[:3, 3:]
    return ((there + 0.5) * N + 0.5).reshape(cells.shape)


def solid_of(field, part):
    """[N + 2]^3 bool."""
    return (field.sdf < 0) & (field.owner == part)


def copy_of(field):
    return DenseField(field.sdf.copy(), field.owner.copy(), field.source.copy())


def assert_same(field, other):
    for name in ("sdf", "owner", "source"):
        np.testing.assert_array_equal(getattr(field, name), getattr(other, name))


def surface_has_sources(field):
    """Whether every solid cell of part 0 that borders on others has a source, once named."""
    solid = solid_of(field, 0)
    surface = solid & ndimage.binary_dilation(~solid, np.ones((3, 3, 3)))
    return bool((with_sources(field, 1).source[surface] >= 0).all())


def noise(seed, share, size=3):
    """[N + 2]^3 bool: lumps of cells."""
    rng = np.random.default_rng(seed)
    seeds = rng.random((N + 2,) * 3) < share
    return ndimage.binary_dilation(seeds, np.ones((size,) * 3))
