import igl
import numpy as np
import pytest
import trimesh

from uniart_jax.voxels.grid import subcell_centers
from uniart_jax.voxels.solid import Solid, basins


def solid(mesh):
    return Solid(np.array(mesh.vertices), np.array(mesh.faces))


def boxes(*bounds):
    return trimesh.util.concatenate([trimesh.creation.box(bounds=b) for b in bounds])


def overlapping():
    # flush bottoms, a shared side, one box within another: every coincidence that breaks ray counting
    return boxes(
        [[-0.4, -0.4, -0.5], [0.1, 0.4, 0.2]],
        [[-0.1, -0.4, -0.5], [0.4, 0.4, 0.4]],
        [[-0.3, -0.2, -0.3], [-0.2, 0.2, 0.0]],
        [[-0.4, -0.4, 0.2], [-0.2, 0.4, 0.5]],
    )


def hollow():
    outer, inner = trimesh.creation.box((0.9, 0.9, 0.9)), trimesh.creation.box((0.6, 0.6, 0.6))
    inner.invert()
    return trimesh.util.concatenate([outer, inner])


def open_box():
    box = trimesh.creation.box((0.8, 0.8, 0.8))
    return trimesh.Trimesh(box.vertices, box.faces[box.face_normals[:, 2] < 0.5])


def inverted():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    mesh.invert()
    return mesh


@pytest.mark.parametrize(
    ("make", "closed", "outward"),
    [
        (overlapping, True, True),
        (hollow, True, True),
        (open_box, False, False),
        (inverted, True, False),
        (lambda: trimesh.creation.torus(0.3, 0.12, 24, 12), True, True),
    ],
)
def test_inside_is_where_the_winding_number_says(make, closed, outward):
    part = solid(make())
    assert (part.closed, part.outward) == (closed, outward)
    coords = np.stack(np.unravel_index(np.arange(0, 512, 3), (8, 8, 8)), -1)
    points = subcell_centers(coords, 8, 4).reshape(-1, 3) + np.array([1e-7, 2e-7, 3e-7])
    winding = np.abs(igl.winding_number(part.vertices, part.faces, points))
    low, high = part.bounds
    in_box = ((points >= low) & (points <= high)).all(1)
    expected = (winding > 0.5) & in_box  # by definition nothing outside the box is inside
    inside = np.zeros((len(coords), 64), bool)
    squared, _, _ = igl.point_mesh_squared_distance(points, part.vertices, part.faces)
    distance = np.sqrt(squared).reshape(len(coords), -1) * 32
    clear = np.abs(winding - 0.5) > 1e-3
    alone = np.broadcast_to(np.arange(64), distance.shape)
    for basin in (alone, basins(distance, 4)):
        voxels, found = part.contains_subcells(coords, 8, 4, basin)
        inside[voxels] = found
        np.testing.assert_array_equal(inside.ravel()[clear], expected[clear])
    np.testing.assert_array_equal(part.contains(points)[clear], expected[clear])


def test_no_surface_parts_the_cells_of_a_basin():
    """Around a ball's surface: no basin reaches across, and its root is farther from the surface than any other cell of it."""
    coords = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), -1)
    points = subcell_centers(coords, 8, 4).reshape(-1, 3)
    signed = (np.linalg.norm(points, axis=1) - 0.35).reshape(512, 64) * 32
    basin = basins(np.abs(signed), 4)
    root = np.take_along_axis(signed, basin, 1)
    assert (np.sign(root) == np.sign(signed)).all()
    assert (np.abs(root) >= np.abs(signed)).all()
    own = basin == np.arange(64)
    assert own.mean() < 0.15 and (np.take_along_axis(basin, basin, 1) == basin).all()
    # two sheets less than a sub-cell apart: every cell between them stands alone
    assert (basins(np.full((1, 64), 0.3), 4) == np.arange(64)).all()


def test_the_rough_hierarchy_is_refined_where_it_matters():
    """A ball of many faces with a hole: winding numbers pass 1/2 in free space."""
    mesh = trimesh.creation.icosphere(4, 0.4)
    mesh.update_faces(mesh.triangles_center[:, 2] < 0.25)
    part = solid(mesh)
    points = np.random.default_rng(0).uniform(part.bounds[0], part.bounds[1], (4000, 3))
    exact = np.abs(igl.winding_number(part.vertices, part.faces, points))
    clear = np.abs(exact - 0.5) > 0.02
    assert 0.9 < clear.mean() < 1
    np.testing.assert_array_equal(part.contains(points)[clear], exact[clear] > 0.5)


@pytest.mark.parametrize("size", [0.04, 0.1, 0.3])
def test_thickness_of_a_plate(size):
    plate = solid(trimesh.creation.box((0.8, 0.8, size)))
    points = plate.vertices[plate.faces].mean(1)
    faces = np.arange(len(points))
    flat = np.abs(points[:, 2]) > size / 2 - 1e-9
    assert (plate.thicker(faces[flat], points[flat], 0.08) == (size > 0.08)).all()
    assert plate.thicker(faces[~flat], points[~flat], 0.08).all()  # its rim goes far in


@pytest.mark.parametrize("doubled", [False, True])
def test_a_sheet_has_no_thickness(doubled):
    corners = [[-0.4, -0.4, 0.1], [0.4, -0.4, 0.1], [0.4, 0.4, 0.1], [-0.4, 0.4, 0.1]]
    faces = [[0, 1, 2], [0, 2, 3]]
    mesh = trimesh.Trimesh(corners, faces + [f[::-1] for f in faces] * doubled, process=False)
    both = trimesh.util.concatenate(
        [mesh, trimesh.creation.box(bounds=[[-0.4, -0.4, -0.4], [0.4, 0.4, -0.2]])]
    )
    part = solid(both)
    count = len(mesh.faces)
    points = mesh.triangles.mean(1)
    assert not part.thicker(np.arange(count), points, 0.05).any()


def test_inner_faces_of_overlapping_pieces_do_not_make_a_part_thin():
    # a plate of .02 glued to a block: the face between them is inside
    part = solid(
        boxes([[-0.4, -0.4, -0.02], [0.4, 0.4, 0.0]], [[-0.4, -0.4, -0.4], [0.4, 0.4, -0.01]])
    )
    top = np.flatnonzero(np.abs(part.vertices[part.faces][:, :, 2]).max(1) < 1e-9)
    points = part.vertices[part.faces[top]].mean(1)
    assert len(top) == 2 and part.thicker(top, points, 0.05).all()
