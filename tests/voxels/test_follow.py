"""Objects that follow a layout: the table's joints and tree, closed meshes, rows without voxels
left out."""

import dataclasses

import numpy as np
import pytest
import trimesh
from solids import box_of, box_sdf, grid_of

from uniart_jax import procedural
from uniart_jax.data.legs import legs_of
from uniart_jax.data.panels import boards_of, panels_of
from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.simulation.pieces import at_rest, spread
from uniart_jax.simulation.plausibility import _distances, _inside, plausibility
from uniart_jax.voxels.cleanup import passes
from uniart_jax.voxels.follow import assemble_layout, row_of_subcells
from uniart_jax.voxels.grid import subcell_centers
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.revolution_table import Revolution
from uniart_jax.voxels.tube_table import Tube
from uniart_jax.voxels.voxelize import voxelize


@pytest.fixture(scope="module")
def oven():
    obj = procedural.generate("oven", 11)
    return obj, voxelize(obj, 16, 4)


def test_true_voxels_and_true_layout_give_the_object(oven):
    obj, grid = oven
    made = assemble_layout(grid.gather(), Layout.of_object(obj))
    scores = compare_parts(made, obj)
    assert scores.right.all() and scores.tree_right
    assert all(part.mesh.is_watertight for part in made.parts)


def test_noise_in_what_voxels_say_of_their_parts_is_borne(oven):
    obj, grid = oven
    told = grid.gather()
    noise = np.random.default_rng(0).normal(0, 0.1, told.own_box.shape).astype(np.float32)
    vague = dataclasses.replace(
        told,
        own_box=told.own_box + noise,
        joint_code=np.zeros_like(told.joint_code),
        parent_box=np.zeros_like(told.parent_box),
    )
    made = assemble_layout(vague, Layout.of_object(obj))
    scores = compare_parts(made, obj)
    assert scores.right.all() and scores.tree_right
    # the layout's joints, whatever the voxels say
    assert sorted(j.type for j in made.joints) == sorted(j.type for j in obj.joints)


def test_the_body_stands_on_the_layouts_legs():
    obj = procedural.generate("table", 3)
    legs = legs_of(obj)
    assert len(legs) == 2 and legs.alone
    grid = voxelize(obj, 16, 4).gather()
    height = subcell_centers(grid.coords, 16, 4)[..., 2]
    torn = dataclasses.replace(
        grid, sdf=np.where(height < legs.heights[0, 1] - 0.05, np.float32(0.5), grid.sdf)
    )
    speck = np.concatenate([obj.boxes[0][:3], [0.01, 0.014, 0.01]])  # is left out, legs are not
    layout = dataclasses.replace(with_row(Layout.of_object(obj), speck), legs=legs)
    made = assemble_layout(torn, layout).parts[0].mesh
    assert made.is_watertight
    for share in (0.1, 0.5, 0.9):
        middle = [0, 0, legs.heights[0] @ [1 - share, share]]
        found, true = (
            sum(p.area for p in mesh.section([0, 0, 1], middle).to_2D()[0].polygons_full)
            for mesh in (made, obj.parts[0].mesh)
        )
        assert found == pytest.approx(true, rel=0.15)
    without = assemble_layout(torn, dataclasses.replace(layout, legs=None)).parts[0].mesh
    assert without.bounds[0, 2] > legs.heights[0, 0] + 0.1


def test_shelves_are_the_layouts():
    """Where voxels show an edge of one; a row that is left out as too small changes nothing."""
    obj = procedural.generate("refrigerator", 900_005)
    panels, true = panels_of(obj), obj.parts[0].mesh
    middle = panels.boxes[:, [2, 5]].mean(1)
    (k,) = np.flatnonzero((np.ptp(panels.boxes[:, [2, 5]], 1) < 0.03) & (np.abs(middle) < 0.2))[:1]
    low, high = panels.boxes[k, :3], panels.boxes[k, 3:]
    grid = voxelize(obj, 24, 4).gather()
    places = subcell_centers(grid.coords, 24, 4)
    inside = ((places > low + [0.05, 0.05, -0.02]) & (places < high + [-0.05, -0.05, 0.02])).all(-1)
    torn = dataclasses.replace(grid, sdf=np.where(inside, np.float32(0.5), grid.sdf))
    speck = np.concatenate([obj.boxes[0][:3], [0.01, 0.014, 0.01]])  # is left out, panels are not
    layout = with_row(Layout.of_object(obj), speck)
    shelf = trimesh.creation.box(bounds=[low + [0.05, 0.05, -0.02], high + [-0.05, -0.05, 0.02]])
    around = lambda mesh: trimesh.boolean.intersection([mesh, shelf]).volume  # noqa: E731
    made = [
        assemble_layout(torn, told) for told in (layout, dataclasses.replace(layout, panels=panels))
    ]
    assert all(obj.parts[0].mesh.is_watertight for obj in made)
    assert around(made[0].parts[0].mesh) < 0.7 * around(true)
    assert around(made[1].parts[0].mesh) == pytest.approx(around(true), rel=0.3)
    other = Panels(panels.boxes[:2], 1.0)
    refused = assemble_layout(torn, dataclasses.replace(layout, panels=other))
    assert any("voxels show another body" in note for note in refused.provenance)
    assert not any("panels" in note for note in made[1].provenance)


def reordered(layout, order):
    place = {k: new for new, k in enumerate(order)} | {-1: -1}
    return Layout(
        layout.boxes[order],
        tuple(layout.joints[k] for k in order),
        tuple(place[layout.parents[k]] for k in order),
        layout.colors[order],
        layout.confidence[order],
        boards=tuple(layout.boards[k] for k in order) if layout.boards else (),
    )


def test_round_parts_have_the_layouts_outlines():
    """Of a square body and a lid, whose row comes after one that is left out as too small; the body
    is said to be round about another place, so that voxels show another shape."""
    low, high = (-0.2, -0.2, -0.3), (0.2, 0.2, 0.1)
    top = ((-0.2, -0.2, 0.1), (0.2, 0.2, 0.2))
    ends = (low, high), top
    grid = grid_of(
        [lambda p, e=e: box_sdf(p, *e) for e in ends], [box_of(*e) for e in ends], resolution=16
    ).gather()
    boxes = np.array([box_of(*ends[0]), [0, 0, 0.3, 0.01, 0.01, 0.01], box_of(*ends[1])])
    slide = Joint(np.zeros(3), (0.0, 0, 1), travel=(0.0, 0.1))
    outlines = Revolution(2, np.array([0.3, 0.3]), np.array([0.1]), estimate=True), None
    outlines += (Revolution(2, np.zeros(2), np.array([0.2, 0.15])),)
    plain = Layout(
        boxes, (Joint.fixed(), slide, slide), (-1, 0, 0), np.full((3, 3), 0.5), np.ones(3)
    )
    made = assemble_layout(grid, dataclasses.replace(plain, revolutions=outlines))
    before = assemble_layout(grid, plain)
    assert [part.mesh.is_watertight for part in made.parts] == [True, True]
    cone = np.pi * 0.1 * np.interp((np.arange(200) + 0.5) / 200, [0.25, 0.75], [0.2, 0.15]) ** 2
    assert made.parts[1].mesh.volume == pytest.approx(cone.mean(), rel=0.06)
    assert made.parts[0].mesh.volume == pytest.approx(before.parts[0].mesh.volume, rel=0.02)
    notes = set(made.provenance) - set(before.provenance)
    assert notes == {"revolution of part 0 of the layout left out: voxels show another shape"}


def test_drawers_are_the_layouts_boards():
    """Where voxels show their fronts alone; a row that is left out as too small changes nothing."""
    obj = procedural.generate("storage_furniture", 900_005)
    boards, true = tuple(boards_of(obj)), obj.parts[1].mesh
    grid = voxelize(obj, 16, 4).gather()
    places = subcell_centers(grid.coords, 16, 4)
    low, high = true.bounds
    inside = ((places > low + [0.03, -0.02, -0.02]) & (places < high + [0.02, 0.02, 0.0])).all(-1)
    torn = dataclasses.replace(grid, sdf=np.where(inside, np.float32(0.5), grid.sdf))
    speck = np.concatenate([obj.boxes[0][:3], [0.01, 0.014, 0.01]])  # is left out, boards are not
    layout = with_row(Layout.of_object(obj), speck)
    told = dataclasses.replace(layout, boards=(*boards, None))
    order = [len(layout) - 1, *range(len(layout) - 1)]  # the speck before the others
    layout, told = (reordered(each, order) for each in (layout, told))
    whole, plain, built = (
        assemble_layout(*each) for each in ((grid, layout), (torn, layout), (torn, told))
    )
    drawers = [made.parts[1].mesh for made in (whole, plain, built)]
    ends = [mesh.bounds[1, 0] for mesh in drawers]
    assert ends[1] < ends[0] - 0.3 and ends[2] == pytest.approx(ends[0], abs=0.02)
    assert drawers[2].volume > 0.7 * drawers[0].volume
    assert built.parts[1].mesh.is_watertight
    assert not any("boards" in note for note in built.provenance)
    front = dataclasses.replace(boards[1], boxes=boards[1].boxes[1:2])
    other = dataclasses.replace(layout, boards=(None, front, None, front, None))
    notes = [n for n in assemble_layout(torn, other).provenance if "boards" in n]
    assert [n.split(" of the layout left out: ") for n in notes] == [
        ["boards of part 1", "it does not move"],
        ["boards of part 3", "voxels show another shape"],
    ]


def test_racks_behind_a_door_are_trays():
    obj = procedural.generate("dishwasher", 900_010)
    racks = [k for k, part in enumerate(obj.parts) if part.joint.type == "prismatic"]
    layout = Layout.of_object(obj)
    made = assemble_layout(voxelize(obj, 24, 4).gather(), layout)
    assert [n for n in made.provenance if "tray" in n] == [
        f"part {k} of the layout made a tray" for k in racks
    ]
    for k in racks:
        np.testing.assert_allclose(made.parts[k].mesh.extents, layout.boxes[k, 3:], atol=0.03)
        assert made.parts[k].mesh.is_watertight
        assert made.parts[k].mesh.volume > 1.5 * obj.parts[k].mesh.volume


def test_rows_that_no_voxel_shows_or_a_mere_speck_are_left_out_and_said(oven):
    obj, grid = oven
    true = Layout.of_object(obj)
    far = np.array([0.9, 0.9, 0.9, 0.02, 0.02, 0.02])
    child = next(k for k in range(len(true)) if true.parents[k] >= 0)
    count = len(true)
    more = Layout(
        np.concatenate([true.boxes, far[None]]),
        (*true.joints, true.joints[child]),
        tuple(count if k == child else p for k, p in enumerate((*true.parents, 0))),
        np.concatenate([true.colors, true.colors[:1]]),
        np.append(true.confidence, 0.6),
    )
    speck = np.concatenate([true.boxes[0, :3], [0.01, 0.014, 0.01]])
    turns = Joint(speck[:3], (1, 0, 0), angle=(-np.pi, np.pi))
    made = assemble_layout(grid.gather(), with_row(more, speck, joint=turns))
    assert len(made.parts) == count
    assert any(f"part {count} of the layout (confidence 0.60)" in line for line in made.provenance)
    assert any("it is too small" in line for line in made.provenance)
    assert compare_parts(made, obj).tree_right  # its child hangs on its parent


@pytest.mark.slow
def test_a_knob_that_is_found_twice_is_made_once():
    obj = procedural.generate("oven", 1)
    grid = voxelize(obj, 32, 4)
    true = Layout.of_object(obj)
    knob = next(k for k, part in enumerate(obj.parts) if part.name.startswith("knob"))
    box = true.boxes[knob] + np.array([0, 0.003, 0.003, 0, 0, 0])
    twice = Layout(
        np.concatenate([true.boxes, box[None]]),
        (*true.joints, dataclasses.replace(true.joints[knob], origin=box[:3])),
        (*true.parents, true.parents[knob]),
        np.concatenate([true.colors, true.colors[knob][None]]),
        np.append(true.confidence, 0.6),
    )
    made = assemble_layout(grid.gather(), twice)
    assert len(made.parts) == len(obj.parts)
    assert any("a surer part is in its place" in line for line in made.provenance)


def with_row(true, box, parent=0, joint=None):
    """A layout with one more row, fixed to another."""
    return Layout(
        np.concatenate([true.boxes, np.asarray(box)[None]]),
        (*true.joints, joint or Joint.fixed()),
        (*true.parents, parent),
        np.concatenate([true.colors, true.colors[:1]]),
        np.append(true.confidence, 0.6),
    )


@pytest.mark.slow
def test_a_fixed_part_of_which_voxels_show_a_fragment_is_left_out_and_said(oven):
    obj, grid = oven
    told, true = grid.gather(), Layout.of_object(obj)
    inside = np.argmin(np.asarray(told.sdf).min(1))  # a voxel deep in the oven's wall
    place = (told.coords[inside] + 0.5) / grid.resolution - 0.5
    handle = np.concatenate([place, [0.02, 0.02, 0.02]])
    own_box = np.array(told.own_box)
    own_box[inside] = handle
    found = dataclasses.replace(told, own_box=own_box.astype(np.float32))
    made = assemble_layout(found, with_row(true, handle))
    assert len(made.parts) == len(obj.parts) + 1  # as long as its box
    long = handle.copy()
    long[3:] = 0.02, 0.02, 0.3
    own_box[inside] = long
    found = dataclasses.replace(told, own_box=own_box.astype(np.float32))
    made = assemble_layout(found, with_row(true, long))
    assert len(made.parts) == len(obj.parts)
    assert any("a fragment of it" in line for line in made.provenance)
    assert compare_parts(made, obj).tree_right


def test_rows_are_the_owners_on_true_voxels(oven):
    obj, grid = oven
    rows = row_of_subcells(grid.gather(), Layout.of_object(obj).boxes)
    solid = grid.sdf < 0
    assert (rows == grid.owner)[solid].mean() > 0.99


def test_no_voxels_is_one_line(oven):
    obj, grid = oven
    told = grid.gather()
    fields = ("coords", "sdf", "color", "own_box", "joint_code", "parent_box")
    empty = dataclasses.replace(told, **{name: getattr(told, name)[:0] for name in fields})
    with pytest.raises(ValueError, match="empty"):
        assemble_layout(empty, Layout.of_object(obj))


CASE, HOLLOW = ((0, -0.35, -0.35), (0.45, 0.35, 0.35)), ((-0.1, -0.28, -0.28), (0.38, 0.28, 0.28))
DOOR = (-0.06, -0.3, -0.3), (-0.004, 0.3, 0.3)
LIP = (-0.1, -0.1, -0.35), (0, 0.35, 0.35)  # of the case, ahead of the door's free edge
SWINGS = Joint((-0.06, -0.3, 0), (0, 0, 1), angle=(0, 1.5))


def solid(*blocks, but=()):
    """Signed distance of some blocks without others, a function of points."""

    def distance(points):
        inside = np.min([box_sdf(points, *b) for b in blocks], 0)
        return np.max([inside, *(-box_sdf(points, *b) for b in but)], 0)

    return distance


def cabinet(door, box, joint, lip, steep=1.0):
    """Voxels and the layout of a case and its door; with ``lip``, its frame reaches into the
    way."""
    gap = np.array(DOOR) + [[-0.006] * 3, [0.006] * 3]
    body = solid(CASE, LIP, but=(HOLLOW, gap)) if lip else solid(CASE, but=(HOLLOW,))
    boxes = np.array([box_of(LIP[0] if lip else CASE[0], CASE[1]), box_of(*box)])
    boxes[0, [1, 4]] = 0, 0.7
    grid = grid_of([body, door], boxes, resolution=16, steep=steep)
    layout = Layout(boxes, (Joint.fixed(), joint), (-1, 0), np.full((2, 3), 0.5), np.ones(2))
    return grid.gather(), layout


def buried(made):
    """Share of the door's surface that lies deep in the case, most anywhere on its way."""
    rest = at_rest(made)
    case, door = rest.mesh([0]), rest.mesh([1])
    joint = rest.obj.parts[1].joint
    points = spread(door, 800)
    ways = [
        trimesh.transform_points(points, joint.motion(q)) for q in np.linspace(*joint.limits, 25)
    ]
    at = np.concatenate(ways)
    deep = (_inside(case, at) > 0.5) & (_distances(case, at) > 0.003)
    return deep.reshape(len(ways), -1).mean(1).max()


def assembled_without(grid, layout, *names):
    with pytest.MonkeyPatch.context() as patch:
        for name in names:
            patch.setattr(passes, name, lambda field, *_: field)  # does nothing
        return assemble_layout(grid, layout)


@pytest.mark.slow
@pytest.mark.parametrize("left_out", [(), ("with_flat_faces",)])
def test_a_door_whose_way_the_frame_bars_is_given_room(left_out):
    grid, layout = cabinet(solid(DOOR), DOOR, SWINGS, lip=True)
    barred = assembled_without(grid, layout, "with_room_to_move", *left_out)
    made = assembled_without(grid, layout, *left_out)
    assert buried(barred) > 0.01 > 0.002 > buried(made)
    assert all(check["passed"] for check in plausibility(made).values())
    assert not made.provenance and not barred.provenance  # nothing had to be moved
    assert all(part.mesh.is_watertight for part in made.parts)
    (body, door), (barred_body, barred_door) = ([p.mesh for p in o.parts] for o in (made, barred))
    assert door.volume == pytest.approx(barred_door.volume, rel=0.06)
    assert 0.9 * barred_body.volume < body.volume < barred_body.volume
    # the case's other outer faces are where they were
    np.testing.assert_allclose(body.bounds[1], barred_body.bounds[1], atol=0.005)


@pytest.mark.slow
def test_an_open_door_is_made_flat_and_has_room():
    """Its plate is rough where it is shown, 40 degrees open."""
    angle = np.deg2rad(40)
    motion = SWINGS.motion(angle)

    def rough(points):
        at = trimesh.transform_points(points.reshape(-1, 3), np.linalg.inv(motion))
        waves = 0.014 * np.sin(60 * at[:, 2]) * np.sin(50 * at[:, 1])
        return (box_sdf(at, *DOOR) + waves).reshape(points.shape[:-1])

    corners = trimesh.transform_points(trimesh.bounds.corners(DOOR), motion)
    box = corners.min(0), corners.max(0)
    shown = dataclasses.replace(SWINGS, angle=(-angle, 1.5 - angle))
    grid, layout = cabinet(rough, box, shown, lip=False, steep=3.0)
    plain, made = (assembled_without(grid, layout, *n) for n in (["with_flat_faces"], []))
    rough_by = []
    for obj in (plain, made):
        mesh = obj.shown_at(obj.rest()).parts[1].mesh
        points, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)
        x = points[(np.abs(points[:, 1:]) < 0.2).all(1), 0]
        faces = x[x < -0.035], x[x >= -0.035]
        rough_by.append(max(np.ptp(np.quantile(face, [0.02, 0.98])) for face in faces))
    assert rough_by[1] < 0.006 < 0.015 < rough_by[0]
    np.testing.assert_allclose(np.ptp(mesh.bounds[:, 1:], axis=0), 0.6, atol=0.03)
    assert buried(made) < 0.02 and made.parts[1].mesh.is_watertight
    again = assemble_layout(grid, layout).parts[1].mesh
    np.testing.assert_array_equal(again.vertices, made.parts[1].mesh.vertices)


def test_a_disc_has_the_cells_that_it_fills_but_not_all_of_a_part():
    """A pin lies all within a knob, a lump of the case within another; a crumb hangs in the air."""
    knob = (-0.08, -0.05, -0.05), (0, 0.05, 0.05)
    drawn = (-0.07, -0.03, -0.03), (0, 0.03, 0.03)
    pin = (-0.06, -0.02, -0.02), (-0.02, 0.02, 0.02)
    second = [[x, y - 0.2, z] for x, y, z in knob]
    lump = [[x, y - 0.2, z] for x, y, z in drawn]
    crumb = (-0.3, 0.2, 0.2), (-0.24, 0.26, 0.26)
    boxes = np.array(
        [box_of((-0.3, -0.35, -0.35), CASE[1]), box_of(*knob), box_of(*pin), box_of(*second)]
    )
    parts = [solid(CASE, crumb, lump), solid(drawn, but=(pin,)), solid(pin)]
    grid = grid_of(parts, boxes[:3], resolution=16)
    turns = [Joint((0, y, 0), (1, 0, 0), angle=(-1, 1)) for y in (0, -0.2)]
    joints = Joint.fixed(), turns[0], Joint.fixed(), turns[1]
    layout = Layout(boxes, joints, (-1, 0, 1, 0), np.full((4, 3), 0.5), np.ones(4))
    made = assemble_layout(grid.gather(), layout)
    assert len(made.parts) == 4 and all(part.mesh.is_watertight for part in made.parts)
    case, *others = (part.mesh.bounds for part in made.parts)
    np.testing.assert_allclose(case, CASE, atol=0.01)
    for disc in (knob, second):
        assert min(np.abs(bounds - disc).max() for bounds in others) < 0.001


def test_a_row_that_is_fixed_and_told_is_a_piece_of_what_carries_it():
    """A body with a handle of which no voxel is found, whose knob, told as a tube, moves."""
    low, high = (-0.2, -0.2, -0.3), (0.2, 0.2, 0.3)
    grid = grid_of([lambda p: box_sdf(p, low, high)], [box_of(low, high)], resolution=16).gather()
    handle = Tube(np.array([[0.2, 0, -0.1], [0.35, 0, -0.1], [0.35, 0, 0.1], [0.2, 0, 0.1]]), 0.03)
    lever = Tube(np.array([[0.35, 0, 0.0], [0.35, 0.2, 0.0]]), 0.03)
    boxes = np.array([box_of(low, high), handle.box, lever.box])
    turn = Joint(np.array([0.35, 0, 0]), (0.0, 0, -1), angle=(0.0, 1.0))
    layout = Layout(
        boxes, (Joint.fixed(), Joint.fixed(), turn), (-1, 0, 1), np.full((3, 3), 0.5), np.ones(3),
        tubes=(None, handle, lever), names=("case", "handle", "lever"),
    )  # fmt: skip
    made = assemble_layout(grid, layout)
    assert [part.name for part in made.parts] == ["case", "lever"]
    assert made.parts[1].parent == 0 and made.parts[0].mesh.is_watertight
    np.testing.assert_allclose(made.parts[0].mesh.bounds[1, 0], 0.38, atol=0.02)
    np.testing.assert_allclose(made.parts[1].mesh.bounds[1, 1], 0.23, atol=0.02)
