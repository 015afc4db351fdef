"""Specks that a network's output leaves in the air: parts of next to no volume that touch nothing."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial import cKDTree

from uniart_jax.objects.object import ArticulatedObject

DISTANCE = 0.02  # of the longest side, to the nearest other part
VOLUME = 0.01  # of the object's


def without_debris(obj: ArticulatedObject) -> ArticulatedObject:
    """The object without parts that carry nothing, hang in the air as shown, and hold less than a hundredth of its volume.

    Args:
      obj: parts are closed, and their vertices lie dense: a cell of the lattice they were found on apart.
    """
    size = float(np.ptp(obj.bounds, axis=0).max())
    volume = np.array([abs(part.mesh.volume) for part in obj.parts])
    kept = list(range(len(obj.parts)))
    for k in reversed(range(1, len(obj.parts))):  # children stand behind their parents
        carries = any(obj.parts[i].parent == k for i in kept)
        if carries or volume[k] > VOLUME * volume.sum():
            continue
        others = np.concatenate([obj.parts[i].mesh.vertices for i in kept if i != k])
        if cKDTree(others).query(obj.parts[k].mesh.vertices)[0].min() > DISTANCE * size:
            kept.remove(k)
    if len(kept) == len(obj.parts):
        return obj
    position = {old: new for new, old in enumerate(kept)} | {-1: -1}
    parts = []
    for k in kept:
        part = obj.parts[k]
        name = f"link_{position[k]}" if part.parent >= 0 else part.name
        parts.append(dataclasses.replace(part, name=name, parent=position[part.parent]))
    return dataclasses.replace(obj, parts=tuple(parts))
