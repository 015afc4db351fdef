"""Specks in the air are left out; parts that touch, carry something or are large are not."""

from __future__ import annotations

import trimesh

from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.debris import without_debris


def cube(side: float, at: tuple[float, float, float]) -> trimesh.Trimesh:
    mesh = trimesh.creation.box([side] * 3)
    while len(mesh.vertices) < 3000:
        mesh = mesh.subdivide()
    return mesh.apply_translation(at)


def make(*parts: tuple[str, trimesh.Trimesh, int]) -> ArticulatedObject:
    return ArticulatedObject(tuple(Part(*part) for part in parts))


BASE = ("base", cube(0.6, (0, 0, 0)), -1)


def test_a_speck_in_the_air_is_left_out_and_the_others_are_counted_anew():
    obj = make(BASE, ("link_1", cube(0.05, (-0.45, 0, 0)), 0), ("link_2", cube(0.05, (0.325, 0, 0)), 0))  # fmt: skip
    left = without_debris(obj)
    assert [p.name for p in left.parts] == ["base", "link_1"]
    assert left.parts[1].mesh is obj.parts[2].mesh and left.parts[1].parent == 0


def test_a_speck_that_carries_only_specks_goes_with_them():
    obj = make(BASE, ("link_1", cube(0.05, (-0.45, 0, 0)), 0), ("link_2", cube(0.05, (-0.45, 0.2, 0)), 1))  # fmt: skip
    assert len(without_debris(obj).parts) == 1


def test_what_touches_or_carries_or_is_large_stays():
    for part in (
        ("link_1", cube(0.05, (-0.325, 0, 0)), 0),  # touches
        ("link_1", cube(0.3, (-0.8, 0, 0)), 0),  # large
    ):
        obj = make(BASE, part)
        assert without_debris(obj) is obj
    carrier = make(BASE, ("link_1", cube(0.05, (-0.45, 0, 0)), 0), ("link_2", cube(0.5, (1, 0, 0)), 1))  # fmt: skip
    assert without_debris(carrier) is carrier
    alone = make(BASE)
    assert without_debris(alone) is alone
