"""Panels read off meshes: of cases made of boards, which are known, and of others."""

import dataclasses

import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.data.legs import legs_of
from uniart_jax.data.mirror import mirror_corners
from uniart_jax.data.panels import boards_of, panels_of
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.part_table import MOST_BOARDS, MOST_PANELS

# sides, top and bottom between them, back, a shelf
BOARDS = np.array(
    [
        [-0.2, -0.4, -0.3, 0.2, -0.38, 0.3],
        [-0.2, 0.38, -0.3, 0.2, 0.4, 0.3],
        [-0.2, -0.38, 0.28, 0.2, 0.38, 0.3],
        [-0.2, -0.38, -0.3, 0.2, 0.38, -0.28],
        [0.18, -0.38, -0.28, 0.2, 0.38, 0.28],
        [-0.2, -0.38, 0.05, 0.18, 0.38, 0.07],
    ]
)


def box(corners):
    lower, upper = np.array(corners[:3]), np.array(corners[3:])
    return trimesh.creation.box(upper - lower).apply_translation((lower + upper) / 2)


def piece(*meshes, moving=()):
    body = trimesh.boolean.union(meshes, engine="manifold") if len(meshes) > 1 else meshes[0]
    slide = Joint(np.zeros(3), np.array([-1.0, 0, 0]), travel=(0, 0.2))
    parts = [Part("base", body, -1, Joint.fixed())]
    parts += [Part(f"drawer_{k}", mesh, 0, slide) for k, mesh in enumerate(moving)]
    return ArticulatedObject(tuple(parts))


def case(*more, **parts):
    return piece(*map(box, BOARDS), *more, **parts)


def test_the_boards_of_a_case_though_a_shelf_cuts_their_faces():
    found = panels_of(case())
    assert len(found) == len(BOARDS) and found.share == pytest.approx(1, abs=1e-3)
    for board in BOARDS:
        nearest = found.boxes[np.abs(found.boxes - board).max(1).argmin()]
        thin = (board[3:] - board[:3]).argmin()
        np.testing.assert_allclose(nearest[[thin, thin + 3]], board[[thin, thin + 3]])
        whole = np.delete(np.array([-0.2, -0.4, -0.3, 0.2, 0.4, 0.3]), [thin, thin + 3])
        np.testing.assert_allclose(
            np.delete(nearest, [thin, thin + 3]), whole
        )  # through the others
    # together they are the case
    places = np.stack(np.meshgrid(*[(np.arange(80) + 0.5) / 80 - 0.5] * 3, indexing="ij"), -1)
    inside = lambda b: ((places > b[:3]) & (places < b[3:])).all(-1)  # noqa: E731
    true = np.any([inside(b) for b in BOARDS], 0)
    cover = np.any([inside(b) for b in found.boxes], 0)
    np.testing.assert_array_equal(cover, true)


def test_what_moves_is_none_of_it():
    drawer = box([-0.2, -0.37, -0.27, 0.1, 0.37, 0.0])
    np.testing.assert_array_equal(panels_of(case(moving=[drawer])).boxes, panels_of(case()).boxes)


def test_a_wall_with_a_hole_is_the_boards_around_it():
    wall = trimesh.boolean.difference(
        [box([-0.01, -0.4, -0.4, 0.01, 0.4, 0.4]), box([-0.1, -0.3, -0.3, 0.1, 0.3, 0.3])],
        engine="manifold",
    )
    found = panels_of(piece(wall))
    assert len(found) == 4 and found.share == pytest.approx(1, abs=1e-3)
    sides = np.sort(found.boxes[:, 3:] - found.boxes[:, :3], 1)
    np.testing.assert_allclose(sides[:, :2], [[0.02, 0.1]] * 4, atol=1e-3)


def test_what_is_round_or_turned_is_not_explained():
    ball = trimesh.creation.icosphere(3, 0.2)
    assert panels_of(piece(ball)).share == 0 and len(panels_of(piece(ball))) == 0
    turned = box([-0.2, -0.2, -0.01, 0.2, 0.2, 0.01])
    turned.apply_transform(trimesh.transformations.rotation_matrix(0.4, [0, 0, 1]))
    assert not len(panels_of(piece(turned)))
    part = panels_of(case(trimesh.creation.icosphere(3, 0.12).apply_translation([0, 0, 0.42])))
    assert len(part) == len(BOARDS) and 0.8 < part.share < 0.9


def test_boxes_between_far_faces_with_air_between_are_none():
    shelves = [box([-0.2, -0.4, z, 0.2, 0.4, z + 0.02]) for z in (0.0, 0.08, 0.16, 0.24)]
    post = box([0.15, -0.4, 0.0, 0.2, -0.35, 0.26])
    found = panels_of(piece(*shelves, post))
    assert len(found) == 5 and found.share == pytest.approx(1, abs=1e-3)


def test_legs_count_as_explained():
    table = next(
        obj
        for obj in (procedural.generate("table", seed) for seed in range(900_000, 900_100))
        if (legs := legs_of(obj)) and legs.round.all() and panels_of(obj).share < 0.95
    )
    without, together = panels_of(table), panels_of(table, legs_of(table))
    np.testing.assert_array_equal(without.boxes, together.boxes)
    assert without.share < together.share <= 1


def test_most_of_furniture_and_appliances_is_panels_and_none_is_too_many():
    for family, least in (("storage_furniture", 0.9), ("cupboard", 0.9), ("dishwasher", 0.85)):
        for seed in (900_000, 900_002, 900_003):  # the cupboard 900,001 stands in a corner
            obj = procedural.generate(family, seed)
            found = panels_of(obj, legs_of(obj))
            assert 4 <= len(found) <= MOST_PANELS and least < found.share <= 1, (family, seed)
            assert (found.boxes[:, 3:] > found.boxes[:, :3]).all()
            volume = (found.boxes[:, 3:] - found.boxes[:, :3]).prod(1)
            assert volume[0] == volume.max()


@pytest.mark.parametrize("family", ["storage_furniture", "desk", "built_in_appliance", "oven"])
def test_mirrored_objects_have_mirrored_panels(family):
    for seed in range(900_000, 900_003):
        obj = procedural.generate(family, seed)
        parts = []
        for part in obj.parts:
            mesh = part.mesh.copy()
            mesh.apply_transform(np.diag([1.0, -1, 1, 1]))
            parts.append(dataclasses.replace(part, mesh=mesh))
        here, there = panels_of(obj), panels_of(ArticulatedObject(tuple(parts)))
        assert there.share == pytest.approx(here.share, abs=0.02)
        turned = mirror_corners(there.boxes)
        near = np.abs(here.boxes[:, None] - turned).max(2).min(1) < 2e-3
        assert near.mean() > 0.9 and abs(len(here) - len(there)) <= 1, seed


def test_a_mesh_that_is_not_closed_tells_nothing():
    obj = case()
    mesh = obj.parts[0].mesh.copy()
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    assert panels_of(ArticulatedObject((dataclasses.replace(obj.parts[0], mesh=mesh),))) is None


FRONT = [-0.24, -0.3, -0.1, -0.22, 0.3, 0.1]
DRAWER = np.array(
    [
        FRONT,
        [-0.22, -0.28, -0.08, 0.16, -0.27, 0.05],
        [-0.22, 0.27, -0.08, 0.16, 0.28, 0.05],
        [-0.22, -0.28, -0.08, 0.16, 0.28, -0.07],
        [0.15, -0.28, -0.08, 0.16, 0.28, 0.05],
        [-0.27, -0.05, -0.005, -0.24, 0.05, 0.005],  # its handle
    ]
)


def drawer(*more):
    return trimesh.boolean.union([*map(box, DRAWER), *more], engine="manifold")


def test_the_boards_of_a_drawer_and_none_of_its_body():
    body, boards = boards_of(case(moving=[drawer()]))
    assert body is None and len(boards) == len(DRAWER)
    assert boards.share == pytest.approx(1, abs=1e-3)
    for board in DRAWER:
        near = boards.boxes[np.abs(boards.boxes - board).max(1).argmin()]
        thin = (board[3:] - board[:3]).argmin()
        np.testing.assert_allclose(near[[thin, thin + 3]], board[[thin, thin + 3]], atol=1e-4)
        assert (near[:3] < board[:3] + 1e-4).all() and (near[3:] > board[3:] - 1e-4).all()


def test_a_round_knob_is_the_box_around_it_a_round_door_is_none():
    disc = trimesh.creation.cylinder(0.02, 0.03, sections=24)
    disc.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    knob = disc.copy().apply_translation([-0.255, 0, 0.0])
    boards = boards_of(case(moving=[trimesh.boolean.union([box(FRONT), knob], engine="manifold")]))
    boards = boards[1]
    assert len(boards) == 2
    np.testing.assert_allclose(boards.boxes[1][1:3], [-0.02, -0.02], atol=1e-3)
    np.testing.assert_allclose(boards.boxes[1][4:], [0.02, 0.02], atol=1e-3)
    door = boards_of(case(moving=[disc.copy().apply_scale(8)]))[1]
    assert len(door) == 0 and door.share == 0


def test_a_part_that_is_narrow_or_open_to_the_inside_has_no_boards():
    rod = box([-0.3, -0.3, -0.02, -0.26, 0.3, 0.02])
    assert boards_of(case(moving=[rod])) == [None, None]
    torn = box(FRONT)
    torn.update_faces(np.arange(len(torn.faces)) > 0)
    assert boards_of(case(moving=[torn]))[1] is None


def test_boards_of_a_door_that_stands_ajar_are_those_of_the_closed_door():
    plate, handle = [-0.23, -0.4, -0.3, -0.2, 0.4, 0.3], [-0.26, 0.3, -0.2, -0.23, 0.32, 0.1]
    door = trimesh.boolean.union([box(plate), box(handle)], engine="manifold")
    hinge = Joint(np.array([-0.2, -0.4, 0]), np.array([0.0, 0, 1]), angle=(0.0, 1.7))
    body = case().parts[0]
    closed = ArticulatedObject((body, Part("door", door, 0, hinge)))
    boards = boards_of(closed)[1]
    through = [*handle[:3], plate[3], *handle[4:]]  # as wide as the door is solid there
    np.testing.assert_allclose(boards.boxes, [plate, through], atol=1e-4)
    for angle in (0.3, 0.9, np.pi / 2):
        ajar = boards_of(closed.shown_at(np.array([0, angle])))[1]
        np.testing.assert_allclose(ajar.boxes, boards.boxes, atol=3e-4)
        assert ajar.share == pytest.approx(boards.share, abs=1e-2)


def test_boards_of_procedural_drawers_explain_them():
    found = []
    for seed in range(40):
        obj = procedural.draw(seed, ("storage_furniture",)).normalized()
        for part, boards in zip(obj.parts, boards_of(obj), strict=True):
            if part.joint.type == "prismatic" and boards is not None:
                assert len(boards) <= MOST_BOARDS
                found.append(boards.share)
    assert len(found) > 20 and np.mean(np.array(found) > 0.9) > 0.9
