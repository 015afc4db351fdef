"""Parts as exact solids, and how much of one lies in another."""

from __future__ import annotations

import itertools
from collections.abc import Set

import numpy as np
import trimesh
from manifold3d import Error, Manifold, Mesh64

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import MAX_PARTS

HAIR = 1e-3  # of the smaller part's volume


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


def check_closed(obj: ArticulatedObject, name: str) -> None:
    """Every part is closed, shell by shell, and also where a reader merges equal vertices."""
    assert 1 <= len(obj.parts) <= MAX_PARTS, name
    for part in obj.parts:
        mesh, where = part.mesh, f"{name} {part.name}"
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0, where
        for shell in mesh.split(only_watertight=False):
            assert shell.is_watertight and shell.volume > 0, where
        merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
        assert merged.is_watertight, where


def check_clear(obj: ArticulatedObject, name: str) -> None:
    """No part lies in another at rest, nor, with what it carries, in its parent where it goes: by
    less than ``HAIR`` of the smaller volume."""
    solids = [solid(part.mesh) for part in obj.parts]
    for a, b in itertools.combinations(range(len(solids)), 2):
        shared = overlap(solids[a], solids[b])
        assert shared < HAIR, f"{name} {obj.parts[a].name} in {obj.parts[b].name}: {shared:.2g}"
    for k, part in enumerate(obj.parts):
        if part.parent < 0 or part.joint.type == "fixed":
            continue
        low, high = part.joint.limits
        far = np.pi if part.joint.type == "continuous" else (high if high > -low else low)
        for share in (0.25, 0.5, 1.0):
            q = np.zeros(len(obj.parts))
            q[k] = share * far
            moved = obj.forward_kinematics(q)
            for i in descendants(obj, k):
                shared = overlap(solids[i].transform(moved[i][:3]), solids[part.parent])
                where = f"{name} {obj.parts[i].name} at {share:.0%}: {shared:.2g}"
                assert shared < HAIR, where


def check_clear_of_others(
    obj: ArticulatedObject, name: str, most: float, allowed: Set[tuple[str, str]]
) -> None:
    """While one joint moves and the others rest, what it carries runs into no other part by more
    than ``most`` of the smaller volume; ``allowed`` are pairs of labels that may."""
    solids = [solid(part.mesh) for part in obj.parts]
    for k, part in enumerate(obj.parts):
        if part.parent < 0 or part.joint.type == "fixed":
            continue
        low, high = part.joint.limits
        far = np.pi if part.joint.type == "continuous" else (high if high > -low else low)
        carried = descendants(obj, k)
        for share in (0.25, 0.5, 0.75, 1.0):
            q = np.zeros(len(obj.parts))
            q[k] = share * far
            moved = obj.forward_kinematics(q)
            for i, j in itertools.product(carried, range(len(solids))):
                if j in carried or (obj.parts[i].label, obj.parts[j].label) in allowed:
                    continue
                shared = overlap(solids[i].transform(moved[i][:3]), solids[j])
                where = f"{name} {obj.parts[i].name} in {obj.parts[j].name} at {share:.0%}"
                assert shared <= most, f"{where}: {shared:.2g}"


def descendants(obj: ArticulatedObject, k: int) -> list[int]:
    """Part ``k`` and all that it carries."""
    below = [k]
    for i, parent in enumerate(obj.parents):
        if parent in below:
            below.append(i)
    return below
