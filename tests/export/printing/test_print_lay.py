"""How pieces lie on the plate: any solid does, also one of many small faces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold, Mesh64

from uniart_jax.export.printing import lay
from uniart_jax.export.printing.solids import box_of, turned


def solid(mesh: trimesh.Trimesh) -> Manifold:
    points = np.ascontiguousarray(mesh.vertices, np.float64)
    return Manifold(Mesh64(points, np.ascontiguousarray(mesh.faces, np.uint64)))


def egg() -> trimesh.Trimesh:
    """A ball whose upper half is stretched: it does not stand on its largest faces."""
    mesh = trimesh.creation.icosphere(4, radius=20.0)
    points = np.array(mesh.vertices)
    points[:, 2] *= np.where(points[:, 2] > 0, 1.8, 1.0)
    return trimesh.Trimesh(points, mesh.faces, process=False)


def leaning() -> trimesh.Trimesh:
    """An oblique cone of 300 facets, its tip far beside its foot."""
    mesh = trimesh.creation.cone(10.0, 40.0, sections=300)
    points = np.array(mesh.vertices)
    points[:, 0] += 1.5 * points[:, 2]
    return trimesh.Trimesh(points, mesh.faces, process=False)


@pytest.mark.parametrize("made", [egg, leaning])
def test_a_solid_of_many_small_faces_lies_on_one_that_it_stands_on(made):
    body = solid(made())
    way = lay.laid(body)
    assert way.contact > 0
    np.testing.assert_allclose(box_of(turned(body, way.matrix))[0], 0, atol=1e-6)
    vertices, faces = lay.triangles(body)
    down = -way.matrix[2, :3]
    heights = vertices @ -down
    feet = vertices[heights < heights.min() + lay.FLAT]
    assert lay._stands(feet, down, lay._centre(vertices, faces))


def test_what_stands_nowhere_lies_with_its_centre_of_mass_lowest(monkeypatch):
    monkeypatch.setattr(lay, "_stands", lambda *_: False)
    way = lay.laid(Manifold.cube((30.0, 20.0, 4.0)))
    assert abs(way.matrix[2, 2]) == 1.0 and way.contact == pytest.approx(600)
