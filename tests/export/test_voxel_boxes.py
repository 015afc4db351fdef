"""Rough parts as boxes of lattice cells: cavities stay, parts do not cross, smooth objects are not
taken for rough."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from skimage import measure

from uniart_jax import procedural
from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.physics import Box, Hull
from uniart_jax.export.voxel_boxes import (
    CELLS,
    ENOUGH,
    as_cells,
    cover,
    is_rough,
)
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.carving import carve

LATTICE = 96


def rough(solid: np.ndarray, seed: int = 0) -> trimesh.Trimesh:
    """Marching cubes of a solid [n, n, n] in the cube [-1/2, 1/2]^3, bumpy as a network's."""
    field = np.where(solid, -1.0, 1.0) * np.random.default_rng(seed).uniform(0.1, 1, solid.shape)
    vertices, faces, _, _ = measure.marching_cubes(np.pad(field, 1, constant_values=1.0), 0.0)
    return trimesh.Trimesh((vertices - 0.5) / len(solid) - 0.5, faces, process=False)


def block(*ranges: tuple[float, float]) -> np.ndarray:
    """The cells between lower and upper ends on each axis, in the cube [-1/2, 1/2]^3."""
    centers = (np.indices((LATTICE,) * 3) + 0.5) / LATTICE - 0.5
    inside = [(c > lo) & (c < hi) for c, (lo, hi) in zip(centers, ranges, strict=True)]
    return np.logical_and.reduce(inside)


def tray() -> np.ndarray:
    return block((-0.4, 0.1), (-0.3, 0.3), (-0.2, 0.1)) & ~block(
        (-0.37, 0.07), (-0.27, 0.27), (-0.16, 0.2)
    )


def chest(drawn: float = 0.0) -> ArticulatedObject:
    """A rough case around a rough tray that slides out by .4; ``drawn``: where it is shown."""
    case = block((-0.4, 0.3), (-0.4, 0.4), (-0.3, 0.25)) & ~block(
        (-0.5, 0.2), (-0.33, 0.33), (-0.23, 0.2)
    )
    slide = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.4))
    parts = Part("case", rough(case)), Part("tray", rough(tray(), 1), 0, slide)
    obj = ArticulatedObject(parts, scale=2.0)
    return obj.shown_at({"tray": drawn}) if drawn else obj


def inside(shapes: tuple[Box, ...], points: np.ndarray) -> np.ndarray:
    found = np.zeros(len(points), bool)
    for shape in shapes:
        local = (points - shape.center) @ shape.rotation
        found |= (np.abs(local) <= shape.size / 2).all(1)
    return found


def test_what_is_rough():
    assert is_rough(chest())
    assert not any(is_rough(procedural.generate(f, 3)) for f in procedural.SEEN_FAMILIES)
    ball = trimesh.creation.icosphere(subdivisions=5)  # 20,000 faces, all smooth
    assert not is_rough(ArticulatedObject((Part("ball", ball),)))
    assert is_rough(ArticulatedObject((Part("ball", ball),), from_voxels=True))


@pytest.mark.parametrize("drawn", [0.0, 0.25])
def test_cavities_stay_and_parts_do_not_cross(drawn):
    obj = chest(drawn)
    bodies = make_bodies(obj, [p.mesh for p in obj.parts])
    assert all(isinstance(s, Box) for b in bodies for s in b.shapes)
    at = np.random.default_rng(0).uniform(-0.5, 0.5, (20_000, 3)) * obj.scale
    moved = obj.forward_kinematics(obj.rest())
    held = []
    for body, pose in zip(bodies, np.linalg.inv(moved), strict=True):
        shown = at @ pose[:3, :3].T + pose[:3, 3] * obj.scale  # the points' places at rest
        held.append(inside(body.shapes, shown))
    assert not (held[0] & held[1]).any()
    # nothing where a thing would lie in the tray, a cell and a half from its walls
    assert not (held[1] & room(at / obj.scale, 1.5 / CELLS)).any()
    # what is solid is held, but for the edges
    core = ndimage.binary_erosion(tray(), iterations=1)
    where = (np.argwhere(core) + 0.5) / LATTICE - 0.5
    pose = np.linalg.inv(moved[1])
    assert inside(bodies[1].shapes, (where @ pose[:3, :3].T + pose[:3, 3]) * obj.scale).mean() > 0.9


def room(points: np.ndarray, margin: float) -> np.ndarray:
    lo = np.array([-0.37, -0.27, -0.16]) + margin
    hi = np.array([0.07, 0.27, 0.1]) - margin
    return ((points > lo) & (points < hi)).all(1)


def test_a_cell_is_one_part_s_and_swallowed_parts_keep_one():
    obj = chest()
    small = trimesh.creation.box([0.001] * 3).apply_translation([0.25, 0, 0])
    specks = [Part(f"speck{i}", small.copy().apply_scale(1 - 0.1 * i), 0) for i in range(3)]
    parts = (*obj.parts, *specks)
    cells = as_cells(dataclasses.replace(obj, parts=parts), [p.mesh for p in parts])
    assert cells.full.sum(0).max() == 1 and not (cells.full & cells.spare).any()
    assert cells.full.any((1, 2, 3)).all()
    assert not (cells.spare.any(0) & cells.full.any(0)).any() and cells.spare.sum(0).max() == 1


def test_open_surfaces_count_by_their_corners():
    plate = trimesh.creation.box([0.8, 0.8, 0.02])
    plate = trimesh.Trimesh(plate.vertices, plate.faces[2:], process=False)
    for _ in range(6):
        plate = plate.subdivide()
    cells = as_cells(ArticulatedObject((Part("plate", plate),)), [plate])
    assert cells.full[0].sum() > 0.8 * CELLS**2


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), share=st.floats(0.05, 0.9))
def test_boxes_hold_the_cells_and_nothing_that_is_not_allowed(seed, share):
    rng = np.random.default_rng(seed)
    full = ndimage.gaussian_filter(rng.random((14, 12, 10)), 1.2)
    full = full > np.quantile(full, 1 - share)
    spare = ndimage.binary_dilation(full) & ~full & (rng.random(full.shape) < 0.5)
    held = np.zeros_like(full)
    boxes = cover(full, spare)
    for low, high in boxes:
        cells = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        assert (full | spare)[cells].all()
        held[cells] = True
    assert any(
        len(boxes) <= most and (full & ~held).sum() <= left * full.sum() for most, left in ENOUGH
    )
    assert all(np.array_equal(a, b) for a, b in zip(cover(full, spare), boxes, strict=True))


def test_a_block_is_one_box_and_layers_of_bumps_are_not_followed():
    full = np.zeros((20, 20, 20), bool)
    full[4:12, 5:15, 6:9] = True
    ((low, high),) = cover(full, np.zeros_like(full))
    assert low.tolist() == [4, 5, 6] and high.tolist() == [12, 15, 9]
    spare = ndimage.binary_dilation(full) & ~full
    assert len(cover(full, spare)) == 1  # spare layers hold nothing of the part
    full[4:12:3, 5:15:3, 9] = True
    spare = ndimage.binary_dilation(full, np.ones((3, 3, 3))) & ~full
    assert len(cover(full, spare)) < 16  # a box a bump at the most
    assert not cover(np.zeros_like(full), spare)


def test_surfaces_that_are_inside_out_count_as_well():
    obj = chest()
    turned = [
        trimesh.Trimesh(p.mesh.vertices, p.mesh.faces[:, ::-1], process=False) for p in obj.parts
    ]
    same, other = as_cells(obj, [p.mesh for p in obj.parts]), as_cells(obj, turned)
    assert np.array_equal(same.full, other.full) and obj.parts[1].mesh.volume > 0


def test_a_bowl_has_no_holes():
    """Slanted thin walls take the most boxes."""
    centers = (np.indices((LATTICE,) * 3) + 0.5) / LATTICE - 0.5
    away = np.linalg.norm(centers, axis=0)
    bowl = rough((away < 0.45) & (away > 0.4) & (centers[2] < 0.1))
    cells = as_cells(ArticulatedObject((Part("bowl", bowl),)), [bowl])
    held = np.zeros_like(cells.full[0])
    for low, high in cover(cells.full[0], cells.spare[0]):
        held[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
    holes = cells.full[0] & ~held
    assert holes.sum() < 0.1 * cells.full[0].sum()
    sizes = np.bincount(np.asarray(ndimage.label(holes)[0]).ravel())[1:]
    assert sizes.max() < 0.01 * cells.full[0].sum()  # and none that a thing falls through


def knobbed(angle: float = 0.0) -> ArticulatedObject:
    """A rough block with a disc that turns on its front, which it is set into by a little."""
    body = Part("body", rough(block((-0.2, 0.4), (-0.4, 0.4), (-0.4, 0.4))))
    disc = trimesh.creation.cylinder(0.05, 0.08, sections=24)
    disc.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
    disc.apply_translation([-0.23, 0.1, 0.2])
    turns = Joint([-0.23, 0.1, 0.2], [1, 0, 0], angle=(-np.pi, np.pi))
    return ArticulatedObject((body, Part("disc", disc, 0, turns)), scale=2.0)


def test_a_knob_is_a_hull_and_nothing_is_in_its_way():
    obj = knobbed()
    body, knob = make_bodies(obj, [part.mesh for part in obj.parts])
    (hull,) = knob.shapes
    assert isinstance(hull, Hull) and all(isinstance(shape, Box) for shape in body.shapes)
    np.testing.assert_allclose(hull.mesh.bounds, 2 * obj.parts[1].mesh.bounds, atol=1e-9)
    spread = np.concatenate([obj.parts[1].mesh.vertices, [[-0.19, 0.1, 0.2]]])
    for q in np.linspace(-np.pi, np.pi, 7):
        at = trimesh.transform_points(spread, obj.joints[1].motion(q))
        assert not inside(body.shapes, 2 * at).any()
    away = np.array([[0.1, 0.1, 0.2], [0.0, -0.2, -0.2]])
    assert inside(body.shapes, 2 * away).all()
    cells, _ = carve(obj, as_cells(obj, [part.mesh for part in obj.parts]))
    assert cells.full[1].sum() == as_cells(obj, [p.mesh for p in obj.parts]).full[1].sum()


def test_with_boxes_alone_a_knob_is_boxes_too():
    obj = knobbed()
    _, knob = make_bodies(obj, [part.mesh for part in obj.parts], collision="boxes")
    assert knob.shapes and all(isinstance(shape, Box) for shape in knob.shapes)
