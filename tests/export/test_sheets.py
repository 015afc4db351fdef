"""Open surfaces as plates: where their walls are, no thicker than asked for, and few."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from uniart_jax.export.collision import OVERLAP, collision_shapes
from uniart_jax.export.separation import as_solid, overlaps
from uniart_jax.export.sheets import REGIONS, plates

THICK = 0.004


def open_box(extents=(1.0, 1.0, 1.0), without=2) -> trimesh.Trimesh:
    """A box of no thickness without its upper side along an axis."""
    box = trimesh.creation.box(extents).subdivide()
    return box.submesh(
        [np.flatnonzero(box.triangles_center[:, without] < 0.49 * extents[without])], append=True
    )


def made(mesh: trimesh.Trimesh, tolerance=0.002) -> list[Manifold]:
    mesh.merge_vertices()
    return plates(np.asarray(mesh.vertices), np.asarray(mesh.faces), tolerance, THICK)


def farthest(mesh: trimesh.Trimesh, solids: list[Manifold]) -> float:
    """How far any place of a surface is from the nearest solid."""
    points, _ = trimesh.sample.sample_surface(mesh, 400, seed=0)
    around = [trimesh.Trimesh(*_mesh(s)) for s in solids]
    away = [-trimesh.proximity.signed_distance(m, points) for m in around]
    return float(np.min(away, axis=0).max())


def _mesh(solid: Manifold) -> tuple[np.ndarray, np.ndarray]:
    mesh = solid.to_mesh()
    return np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_tray_is_a_plate_a_wall(angle):
    tray = open_box((1, 2, 0.5))
    tray.apply_transform(trimesh.transformations.rotation_matrix(angle, [1, 2, 3]))
    found = made(tray)
    assert len(found) == 5
    assert sum(p.volume() for p in found) == pytest.approx(tray.area * THICK, rel=1e-3)
    assert farthest(tray, found) < 1e-6


def test_a_hole_in_a_wall_stays_open():
    wall = trimesh.creation.annulus(0.2, 0.5, 1e-9, sections=4)
    ring = wall.submesh([np.flatnonzero(wall.face_normals[:, 2] > 0.9)], append=True)
    (plate,) = made(ring)
    assert plate.volume() == pytest.approx(ring.area * THICK, rel=1e-3)
    assert plate.genus() == 1


@pytest.mark.parametrize("seed", range(4))
def test_a_wall_that_shelves_meet_is_one_plate(seed):
    heights = np.linspace(0, 1, 7)
    at = np.array([[x, y, z] for z in heights for x in (0, 1) for y in (0, 1)])
    wall = [[0, 1, 5], [0, 5, 4]] + 4 * np.arange(6)[:, None, None]
    shelves = [[0, 1, 3], [0, 3, 2]] + 4 * np.arange(1, 6)[:, None, None]
    faces = np.concatenate([wall.reshape(-1, 3), shelves.reshape(-1, 3)])
    found = made(trimesh.Trimesh(at, np.random.default_rng(seed).permutation(faces)))
    assert len(found) == 6


def test_a_round_wall_is_few_plates_that_follow_it():
    tube = trimesh.creation.cylinder(0.5, 1.0, sections=128)
    tube = tube.submesh([np.flatnonzero(np.abs(tube.face_normals[:, 2]) < 0.1)], append=True)
    found = made(tube)
    assert 10 < len(found) < 64
    assert farthest(tube, found) < 0.002


def test_a_crumpled_surface_is_no_more_plates_than_allowed():
    side = np.linspace(0, 1, 30)
    heights = np.random.default_rng(0).uniform(0, 0.2, (30, 30))
    vertices = np.stack([*np.meshgrid(side, side), heights], -1).reshape(-1, 3)
    cell = np.arange(870)[np.arange(870) % 30 != 29]
    faces = np.concatenate(
        [np.stack([cell, cell + 1, cell + 30], 1), np.stack([cell + 1, cell + 31, cell + 30], 1)]
    )
    surface = trimesh.Trimesh(vertices, faces)
    found = made(surface)
    assert 0 < len(found) <= REGIONS
    assert farthest(surface, found) < 0.08


def test_a_surface_without_area_has_no_plates():
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float)
    assert plates(line, np.array([[0, 1, 2]]), 0.01, THICK) == []


def test_a_large_case_of_sheets_leaves_room_for_its_door():
    """A fixed share of the case's size would reach into what stands a hundredth before it."""
    case = open_box((1, 1, 2), without=0)
    door = open_box((0.05, 1, 2), without=0)
    door.apply_translation([0.535, 0, 0])
    shapes = collision_shapes([case, door])
    assert not overlaps(shapes, OVERLAP * 2)
    inner = [as_solid(s) for s in shapes[0]]
    assert max(s.volume() for s in inner) < 0.05


@pytest.mark.parametrize("turned", [False, True])
def test_faces_that_exist_twice_are_walls_all_the_same(turned):
    """Each was a shell of its own, of which only the 256 largest are kept."""
    case = open_box().subdivide().subdivide()
    case.merge_vertices()
    twice = np.concatenate([case.faces, case.faces[:, ::-1] if turned else case.faces])
    (shapes,) = collision_shapes([trimesh.Trimesh(case.vertices, twice, process=False)])
    assert len(shapes) == 5
    assert farthest(case, [as_solid(s) for s in shapes]) < 1e-6
