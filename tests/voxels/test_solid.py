import igl
import numpy as np
import pytest
import trimesh

from uniart_jax.voxels.grid import subcell_centers
from uniart_jax.voxels.solid import Solid


def solid(mesh):
    return Solid(np.array(mesh.vertices), np.array(mesh.faces))


def boxes(*bounds):
    return trimesh.util.concatenate([trimesh.creation.box(bounds=b) for b in bounds])


def overlapping():
    # flush bottoms, a shared side, one box within another: every coincidence that breaks ray
    # counting
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
    clear = np.abs(winding - 0.5) > 1e-3
    voxels, found = part.contains_subcells(coords, 8, 4)
    inside[voxels] = found
    np.testing.assert_array_equal(inside.ravel()[clear], expected[clear])
    np.testing.assert_array_equal(part.contains(points, 0.1)[clear], expected[clear])


@pytest.mark.parametrize("block", [1e-3, 0.02, 0.3])
def test_what_is_asked_of_cubes_holds_at_their_points(block):
    """Through and around the openings of a tube: winding numbers of all sizes, borders near and
    far."""
    tube = trimesh.creation.icosphere(3, 0.45)
    tube.update_faces(np.abs(tube.triangles_center[:, 2]) < 0.3)
    part = solid(tube)
    points = np.random.default_rng(1).uniform(part.bounds[0], part.bounds[1], (6000, 3))
    winding = np.abs(igl.winding_number(part.vertices, part.faces, points))
    clear = np.abs(winding - 0.5) > 1e-6
    assert 0.2 < (winding > 0.5).mean() < 0.8
    np.testing.assert_array_equal(part.contains(points, block)[clear], winding[clear] > 0.5)


@pytest.mark.parametrize("copies", [1, 3])
def test_winding_numbers_that_pass_a_half_far_from_any_border(copies):
    """Between two sheets that look away from each other; three of each within a box turned inside
    out: 3/2 - 1."""
    ends = []
    for z, turned in ((0.25, 1), (-0.25, -1)):
        corners = [[-0.4, -0.4, z], [0.4, -0.4, z], [0.4, 0.4, z], [-0.4, 0.4, z]]
        ends.append(trimesh.Trimesh(corners[::turned], [[0, 1, 2], [0, 2, 3]], process=False))
    box = trimesh.creation.box((0.9, 0.9, 0.9))
    box.invert()
    part = solid(trimesh.util.concatenate(ends * copies + [box] * (copies == 3)))
    points = np.random.default_rng(2).uniform(-0.2, 0.2, (4000, 3))
    winding = np.abs(igl.winding_number(part.vertices, part.faces, points))
    clear = np.abs(winding - 0.5) > 1e-6
    assert 0.1 < (winding > 0.5).mean() < 0.9
    for block in (0.05, 0.1):
        np.testing.assert_array_equal(part.contains(points, block)[clear], winding[clear] > 0.5)


def test_a_lid_of_many_faces_is_asked_by_hierarchy():
    """A ball with a hole of many edges: winding numbers pass 1/2 in free space."""
    mesh = trimesh.creation.icosphere(5, 0.4)
    mesh.update_faces(mesh.triangles_center[:, 2] < 0.25)
    part = solid(mesh)
    points = np.random.default_rng(0).uniform(part.bounds[0], part.bounds[1], (4000, 3))
    exact = np.abs(igl.winding_number(part.vertices, part.faces, points))
    clear = np.abs(exact - 0.5) > 0.02
    assert 0.9 < clear.mean() < 1
    np.testing.assert_array_equal(part.contains(points, 0.03)[clear], exact[clear] > 0.5)


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
