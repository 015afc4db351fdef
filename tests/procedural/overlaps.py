"""Parts as exact solids, and how much of one lies in another."""

from __future__ import annotations

import numpy as np
import trimesh
from manifold3d import Error, Manifold, Mesh64

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import MAX_PARTS


def solid(mesh: trimesh.Trimesh) -> Manifold:
    """A part as a manifold3d solid; fails if it is not closed and edge-manifold."""
    body = Manifold(
        Mesh64(
            vert_properties=np.asarray(mesh.vertices, dtype=np.float64),
            tri_verts=np.asarray(mesh.faces, dtype=np.uint64),
        )
    )
    assert body.status() == Error.NoError
    return body


def overlap(a: Manifold, b: Manifold) -> float:
    """Volume of the intersection relative to the smaller solid."""
    one, two = np.array(a.bounding_box()), np.array(b.bounding_box())
    if np.any(one[:3] >= two[3:]) or np.any(two[:3] >= one[3:]):
        return 0.0
    return (a ^ b).volume() / min(a.volume(), b.volume())


def loose(mesh: trimesh.Trimesh, air: float) -> int:
    """How many groups of a part's shells more than ``air`` from all others there are, but one."""
    rest = [solid(shell) for shell in mesh.split(only_watertight=False)]
    groups = 0
    while rest:
        group, groups = [rest.pop()], groups + 1
        for one in group:  # grows as it goes
            near = [other for other in rest if one.min_gap(other, 2 * air) < air]
            rest = [other for other in rest if other not in near]
            group += near
    return groups - 1


def check_parts(obj: ArticulatedObject, name: str, most: float, on_root: bool = False) -> None:
    """Every part is closed, also shell by shell, and shares at most ``most`` of the smaller volume
    with its parent, or the root, from rest to the far end of its way."""
    solids = [solid(part.mesh) for part in obj.parts]
    assert len(obj.parts) <= MAX_PARTS
    for k, part in enumerate(obj.parts):
        assert part.mesh.is_watertight and part.mesh.volume > 0, f"{name} {part.name}"
        assert all(s.volume > 0 for s in part.mesh.split(only_watertight=False))
        if part.parent < 0:
            continue
        carrier = solids[0 if on_root else part.parent]
        far = part.joint.limits[np.abs(part.joint.limits).argmax()]
        for share in (0.0, 0.25, 0.5, 1.0):
            there = solids[k].transform(part.joint.motion(share * far)[:3])
            shared = overlap(there, carrier)
            assert shared < most, f"{name} {part.name} at {share:.0%}: {shared:.2g}"
