"""Legs made whole: what carries an object is about the same at every height.

At the resolution of the voxels legs are a few cells thick, and a network draws them torn. Where few
of the body's cells are, from its lowest layer on, each layer is filled where the median of those
above and below it is solid. Nothing is taken away, so legs that lean and boards between them stay.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import ZERO, DenseField

SPARSE = 0.4  # share of its bounding rectangle that a layer of legs fills at most
LEAST = 8  # layers of legs
WINDOW = 21  # layers whose median is taken


def with_whole_legs(field: DenseField, body: Sequence[int]) -> DenseField:
    """A field whose body's legs have no gaps.

    Args:
      body: owners that do not move.
    """
    mine = np.isin(field.owner, body)
    solid = (field.sdf < 0) & mine
    if not solid.any():
        return field
    window = ndimage.find_objects(solid.astype(np.int8))[0]
    count = solid[window].sum((0, 1))
    area = solid[window].shape[0] * solid[window].shape[1]
    sparse = count <= SPARSE * area
    height = len(sparse) if sparse.all() else int((~sparse).argmax())
    if height < LEAST or height == len(sparse):
        return field
    legs = (window[0], window[1], slice(window[2].start, window[2].start + height))
    sdf, owner = field.sdf.copy(), field.owner.copy()
    drawn = np.where(mine[legs], sdf[legs], np.maximum(np.abs(sdf[legs]), 0.5))
    straight = ndimage.median_filter(drawn, (1, 1, min(WINDOW, height)), mode="reflect")
    others = np.asarray(ndimage.binary_dilation((sdf < 0) & ~mine), bool)[legs]
    part = np.bincount(owner[legs][solid[legs]]).argmax()
    fill = ~others & (straight < 0) & (sdf[legs] > 0)
    sdf[legs] = np.where(fill, np.minimum(straight, -ZERO), sdf[legs])
    owner[legs] = np.where(fill & ~mine[legs], part, owner[legs])
    return dataclasses.replace(field, sdf=sdf, owner=owner)
