"""Colours for predictions that have none: each part gets the plain colour of the truth's part that
it was matched to.

The paper gives methods without appearance the truth's materials before it compares pictures. A part
here gets one colour, the mean of its reference part, not the colour of the nearest point of the
truth: that would paint doors and drawers onto a box that has neither, and a picture figure would
reward what is missing.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals

from uniart_jax.evaluation.parts import match_parts
from uniart_jax.objects.appearance import corner_weights, linear_to_srgb, sample_color
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.joint_code import box_corners

POINTS = 1000  # a part
NEUTRAL = 2.5 / 255  # sRGB: what counts as one colour, and as gray


def surface_colors(mesh: trimesh.Trimesh, number: int = POINTS) -> np.ndarray:
    """[number, 3] linear RGB at points uniform on the surface; always the same points."""
    points, faces = trimesh.sample.sample_surface(mesh, number, seed=0)
    return sample_color(mesh, faces, corner_weights(mesh.triangles[faces], points))


def uncolored(obj: ArticulatedObject) -> bool:
    """Whether an object has no appearance: all of it is one and the same gray (white and black are
    grays too).

    That is what formats, loaders and exporters leave where no material was given, each with a gray
    of its own, as a missing visual, a default material or a blank texture. Whoever paints a whole
    object in one gray is taken for one without colours.
    """
    lowest, highest = np.ones(3), np.zeros(3)
    for part in obj.parts:
        colors = linear_to_srgb(surface_colors(part.mesh))
        lowest, highest = np.minimum(lowest, colors.min(0)), np.maximum(highest, colors.max(0))
        if float(highest.max() - lowest.min()) > NEUTRAL:  # not one colour, or not a gray
            return False
    return True


def with_materials(obj: ArticulatedObject, ref: ArticulatedObject) -> ArticulatedObject:
    """The object with every part in the mean colour of the reference's part that it was matched to.

    Parts are matched one to one by their boxes (``parts.match_parts``); a surplus part takes the
    reference part whose box is nearest. Means are over the surface, in linear RGB, and kept in 8
    bits of sRGB as colours of meshes are.
    """
    match, _ = match_parts(obj.boxes, ref.boxes)
    between = box_corners(obj.boxes)[:, None] - box_corners(ref.boxes)[None]
    source = np.linalg.norm(between, axis=-1).argmin(1)
    source[match[match >= 0]] = np.flatnonzero(match >= 0)
    means = [surface_colors(p.mesh).mean(0, dtype=np.float64) for p in ref.parts]
    plain = np.rint(linear_to_srgb(np.array(means)) * 255).astype(np.uint8)
    return painted(obj, plain[source])


def painted(obj: ArticulatedObject, colors: np.ndarray) -> ArticulatedObject:
    """The object with every part in one plain colour: [K, 3] uint8 sRGB."""
    parts = []
    for part, color in zip(obj.parts, colors, strict=True):
        mesh = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
        rgba = np.append(color, 255).astype(np.uint8)
        mesh.visual = ColorVisuals(mesh, face_colors=np.tile(rgba, (len(mesh.faces), 1)))
        parts.append(dataclasses.replace(part, mesh=mesh))
    return dataclasses.replace(obj, parts=tuple(parts))
