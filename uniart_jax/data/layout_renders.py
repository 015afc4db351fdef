"""A plain picture of a layout, for objects that have no picture: boxes in their colours, or what is
told of boards, legs and outlines. The networks take it for a photograph of a simple object."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import trimesh

from uniart_jax.data.cameras import camera_codes
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.render import FRONT_LEFT, fit, render
from uniart_jax.voxels.closed_pose import closing_of, undone
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.opening_direction import round_about, still_parts
from uniart_jax.voxels.revolution_table import Revolution
from uniart_jax.voxels.tube_table import Tube

SIDE = 512  # pixels
MARGIN = 1.15  # frame over object
FLUSH = 0.02  # object units between faces of a moving part and of the body that count as one face
PROUD = 0.008  # object units by which the moving part's stands out, to be seen
TOP = 0.02  # object units of a body above its legs, at least
SEAM = 0.003  # object units around a moving part that show the edges between neighbours


def render_layout(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """A picture [S, S, 4] uint8 sRGB of a layout from the front left and above, and the code [7] of
    its camera (``voxels.camera_code``)."""
    obj = solids(layout)
    camera = fit(obj, FRONT_LEFT, margin=MARGIN)
    image = np.round(255 * render(obj, camera, SIDE)).astype(np.uint8)
    angles = [camera.azimuth, camera.elevation, camera.fov_degrees, camera.distance]
    return image, camera_codes(np.array([angles]), image[None])[0]


def solids(layout: Layout) -> ArticulatedObject:
    """The object that is drawn: each part is its boards, if the layout has some; the body its
    panels and legs; a round part the solid of its outline; else a part is its box. The front of a
    moving part stands out a little where it lies in the body's front, so that it is seen."""
    still = still_parts(layout.parents, layout.joints)
    root, corners = layout.parents.index(-1), box_corners(np.asarray(layout.boxes, np.float64))
    shown = undone(closing_of(layout.joints, layout.boxes, layout.parents))
    drawn = []
    for k, (box, joint) in enumerate(zip(layout.boxes, layout.joints, strict=True)):
        boards = layout.boards[k] if layout.boards else None
        outline = layout.revolutions[k] if layout.revolutions else None
        if outline is None and (axis := round_about(box[:3], box[3:], joint)) is not None:
            across = [i for i in range(3) if i != axis]  # knobs and turntables
            outline = Revolution(axis, box[:3][across], np.full(2, box[3:][across].min() / 2))
        if layout.tubes and (tube := layout.tubes[k]) is not None:
            meshes = _bars(tube)
        elif k == root:
            meshes = _body(layout, box, corners[k], outline)
        elif boards is not None and k not in still:
            meshes = _boxes(boards.boxes)
            for mesh in meshes:
                there = np.vstack([shown[k], [0, 0, 0, 1]])
                mesh.apply_transform(there if boards.motion is None else boards.motion)
        elif outline is not None:
            meshes = [_turned(outline, box)]
        else:
            meshes = _boxes([_front(corners[k], joint, corners[root])])
        drawn.append(trimesh.util.concatenate(meshes))
    return layout.to_object(drawn)


def _body(
    layout: Layout, box: np.ndarray, corners: np.ndarray, outline: Revolution | None
) -> list[trimesh.Trimesh]:
    """What the root is built of, as far as the layout tells."""
    legs = [] if layout.legs is None else _legs(layout.legs)
    if layout.panels is not None and len(layout.panels):
        return _boxes(layout.panels.boxes) + legs
    if outline is not None:
        return [_turned(outline, box), *legs]
    if layout.legs is not None and legs and layout.legs.alone:  # what they carry is at least a top
        above, corners = float(layout.legs.heights[:, 1].max()), corners.copy()
        corners[2] = np.clip(above, corners[2], corners[5] - min(TOP, box[5]))
    return _boxes([corners]) + legs


def _front(corners: np.ndarray, joint: Joint, body: np.ndarray) -> np.ndarray:
    """Corners [6] of a moving part's box, told from its neighbours: ``SEAM`` smaller around, and
    its front moved out by ``PROUD`` where it lies in a face of the body's box [6]. The front of a
    slider faces along its way, that of a plate across it."""
    if joint.type == "fixed":
        return corners
    size = corners[3:] - corners[:3]
    slides = joint.type == "prismatic"
    axis = int(np.abs(joint.direction).argmax()) if slides else int(size.argmin())
    seam = np.where(np.arange(3) == axis, 0, np.minimum(SEAM, size / 4))
    corners = corners + np.concatenate([seam, -seam])
    for face, out in ((axis, -PROUD), (axis + 3, PROUD)):
        if abs(corners[face] - body[face]) < FLUSH:
            further = min if out < 0 else max
            corners[face] = further(corners[face], body[face] + out)
    return corners


def _boxes(corners: Sequence[np.ndarray] | np.ndarray) -> list[trimesh.Trimesh]:
    """Meshes of boxes [N, 6] lower and upper corner."""
    return [trimesh.creation.box(bounds=np.reshape(one, (2, 3))) for one in corners]


def _legs(legs: Legs) -> list[trimesh.Trimesh]:
    """Prisms between the legs' rectangles at both ends."""
    meshes = []
    for lower, upper, heights in zip(legs.lower, legs.upper, legs.heights, strict=True):
        ends = [(lower, heights[0]), (upper, heights[1])]
        points = [[x, y, z] for r, z in ends for x in (r[0], r[2]) for y in (r[1], r[3])]
        meshes.append(trimesh.convex.convex_hull(np.array(points)))
    return meshes


def _bars(tube: Tube) -> list[trimesh.Trimesh]:
    """Cylinders along the pieces of a tube, as long as its ends reach."""
    meshes = []
    for start, end in itertools.pairwise(tube.points):
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9) * tube.radius
        segment = np.array([start - along, end + along])
        if np.ptp(segment, axis=0).max() > 0:
            meshes.append(trimesh.creation.cylinder(tube.radius, segment=segment, sections=12))
    ball = trimesh.creation.icosphere(radius=tube.radius)
    return meshes or [ball.apply_translation(tube.points[0])]


def _turned(outline: Revolution, box: np.ndarray) -> trimesh.Trimesh:
    """The solid of revolution of an outline, as long as its part's box."""
    axis, count = outline.axis, len(outline.radii)
    heights = np.linspace(-0.5, 0.5, count + 1) * box[3 + axis] + box[axis]
    profile = [(0.0, heights[0])]
    for radius, low, high in zip(outline.radii, heights[:-1], heights[1:], strict=True):
        profile += [(radius, low), (radius, high)]
    mesh = trimesh.creation.revolve(np.array([*profile, (0.0, heights[-1])]), sections=32)
    across = [i for i in range(3) if i != axis]
    points = np.empty_like(mesh.vertices)
    points[:, axis] = mesh.vertices[:, 2]
    points[:, across] = mesh.vertices[:, :2] + outline.center
    faces = mesh.faces if axis != 1 else mesh.faces[:, ::-1]  # x, z in order are a left hand
    return trimesh.Trimesh(points, faces, process=False)
