"""Small hand-made objects with every joint type and every kind of appearance."""

from __future__ import annotations

import importlib.util

import numpy as np
import trimesh
from PIL import Image
from skimage import measure

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

# what is in an asset's folder
FILES = {
    *("object.urdf", "object.xml", "object.glb", "view.html", "meshes"),
    *("preview.png", "motion.gif", "report.json"),
}
if importlib.util.find_spec("pxr"):
    FILES |= {"object.usda", "object.usdz"}


def painted_box(lo, hi, subdivisions: int = 2) -> trimesh.Trimesh:
    """A box whose vertex colours vary smoothly over it."""
    box = trimesh.creation.box(bounds=[lo, hi])
    for _ in range(subdivisions):
        box = box.subdivide()
    box.merge_vertices()
    color = 128 + 90 * np.sin(box.vertices * [5, 7, 9] + [0, 1, 2])
    rgba = np.concatenate([color, np.full((len(color), 1), 255)], 1).astype(np.uint8)
    box.visual = trimesh.visual.ColorVisuals(box, vertex_colors=rgba)
    return box


def hollow_box(lo, hi, wall: float) -> trimesh.Trimesh:
    """A box open towards -x, in one flat colour."""
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    inner = trimesh.creation.box(bounds=[lo + np.array([-wall, wall, wall]), hi - wall])
    mesh = trimesh.boolean.difference(
        [trimesh.creation.box(bounds=[lo, hi]), inner], engine="manifold"
    )
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=[150, 100, 60, 255])
    return mesh


def textured_plate(lo, hi) -> trimesh.Trimesh:
    """A box with a striped texture, unwrapped: vertices doubled along the seams."""
    mesh = trimesh.creation.box(bounds=[lo, hi]).unwrap()
    x = np.arange(64)
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[..., 0] = np.where(x // 8 % 2, 200, 40)
    stripes[..., 1] = 90
    stripes[..., 2] = np.where(x // 16 % 2, 60, 180)[:, None]
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(stripes))
    mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.visual.uv, material=material)
    return mesh


def marching_cubes_block(cells: int) -> trimesh.Trimesh:
    """A block of (0.6, 0.8, 0.3) as a network gives it: some 10^4 faces, a colour per vertex."""
    grid = (np.arange(cells + 2) + 0.5) / (cells + 2) - 0.5
    at = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), -1)
    field = (np.abs(at) - [0.3, 0.4, 0.15]).max(-1) * cells
    vertices, faces, _, _ = measure.marching_cubes(np.clip(field, -3, 3), 0)
    vertices = (vertices + 0.5) / (cells + 2) - 0.5
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if mesh.volume < 0:
        mesh.invert()
    color = 128 + 90 * np.sin(mesh.vertices * [9, 7, 11])
    rgba = np.concatenate([color, np.full((len(color), 1), 255)], 1).astype(np.uint8)
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=rgba)
    return mesh


def make_cabinet() -> ArticulatedObject:
    """Body, hinged door, drawer, screw on the door, fixed foot, wheel: three deep, all joint types,
    half a metre large."""
    body = hollow_box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5], 0.04)
    door = painted_box([-0.34, -0.38, 0.02], [-0.301, 0.38, 0.48])
    drawer = textured_plate([-0.34, -0.35, -0.45], [0.2, 0.35, -0.02])
    knob = painted_box([-0.4, 0.28, 0.2], [-0.341, 0.34, 0.26], 1)
    foot = painted_box([0.2, -0.4, -0.55], [0.25, -0.35, -0.501], 1)
    wheel = trimesh.creation.icosphere(2, 0.05)
    wheel.apply_translation([0.0, 0.455, 0.0])
    knob_axis = [-0.4, 0.31, 0.23]
    return ArticulatedObject(
        (
            Part("body", body),
            Part("door", door, 0, Joint([-0.3, -0.38, 0.2], [0, 0, 1], (-0.4, 1.6))),
            Part("drawer", drawer, 0, Joint([0, 0, -0.2], [-1, 0, 0], (0, 0), (0, 0.4))),
            Part("knob", knob, 1, Joint(knob_axis, [-1, 0.2, 0.1], (0, 5.0), (0, 0.04))),
            Part("foot", foot, 0),
            Part("wheel 1/2", wheel, 0, Joint([0, 0.455, 0], [0, 1, 0], (-4, 4))),
        ),
        scale=0.5,
        name="cabinet",
    )


def make_block() -> ArticulatedObject:
    """A box with a lid."""
    lid = Part(
        "lid", painted_box([0, 0, 1], [1, 1, 1.1], 0), 0, Joint([0, 0, 1], [0, 1, 0], (-2, 0))
    )
    return ArticulatedObject((Part("base", painted_box([0, 0, 0], [1, 1, 1], 0)), lid))
