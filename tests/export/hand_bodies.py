"""Bodies, surfaces and mesh files of a small object, made by hand: what writers take, without the
code that makes them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from uniart_jax.export.atlas import Surface
from uniart_jax.export.physics import Body, Box, Dynamics, Hull
from uniart_jax.export.wavefront import TEXTURE_FILE, write_material, write_plain, write_textured
from uniart_jax.objects.object import ArticulatedObject


@dataclasses.dataclass(frozen=True)
class Written:
    """A folder with the files that writers name, and all that they are given."""

    folder: Path
    stems: list[str]
    surfaces: list[Surface]
    bodies: list[Body]
    visual_files: list[str]
    hull_files: list[list[str]]
    texture: str = f"meshes/{TEXTURE_FILE}"


def make_surface(mesh: trimesh.Trimesh) -> Surface:
    """Merged geometry, every triangle with texture coordinates of its own."""
    vertices, inverse = np.unique(np.asarray(mesh.vertices), axis=0, return_inverse=True)
    count = len(mesh.faces)
    rng = np.random.default_rng(count)
    uv = rng.uniform(size=(3 * count, 2))
    faces = np.asarray(inverse).reshape(-1)[mesh.faces]
    return Surface(vertices, faces, uv, np.arange(3 * count).reshape(-1, 3))


def make_bodies(obj: ArticulatedObject) -> list[Body]:
    """A turned box and a hull for every part (flat ones: a box), some mass with a slanted tensor,
    dynamics told apart by part."""
    bodies = []
    for k, part in enumerate(obj.parts):
        lo, hi = part.mesh.bounds * obj.scale
        size = np.maximum(hi - lo, 1e-3)
        turn = trimesh.transformations.euler_matrix(0.3, 0.2, 0.1 * k)[:3, :3]
        mass = 1.0 + k
        moments = mass / 12 * (np.sum(size**2) - size**2)
        shapes: tuple = (Box((lo + hi) / 2, size / 3, turn),)
        if (hi - lo).min() > 1e-4:
            hull = part.mesh.convex_hull
            shapes += (Hull(trimesh.Trimesh(hull.vertices * obj.scale, hull.faces)),)
        moving = part.parent >= 0 and part.joint.type != "fixed"
        spring = {"stiffness": 0.3 + k, "reference": 0.2 + k, "unsprung": 0.05 + k}
        dynamics = Dynamics(0.1 + k, 0.01 + k, 20.0 + k, 2.0 + k, **spring) if moving else None
        center = (lo + hi) / 2 + 0.1 * size
        bodies.append(Body(mass, center, turn @ np.diag(moments) @ turn.T, shapes, dynamics))
    return bodies


def write_files(obj: ArticulatedObject, folder: Path) -> Written:
    """Visual meshes, hulls and a texture, where writers expect them."""
    meshes = folder / "meshes"
    meshes.mkdir(parents=True)
    write_material(meshes)
    Image.new("RGB", (8, 8), (200, 90, 40)).save(meshes / TEXTURE_FILE)
    stems = [f"part{k}" for k in range(len(obj.parts))]
    surfaces, bodies = [make_surface(p.mesh) for p in obj.parts], make_bodies(obj)
    hull_files = []
    for stem, surface, body in zip(stems, surfaces, bodies, strict=True):
        write_textured(surface, meshes / f"{stem}.obj", obj.scale)
        files = []
        for shape in body.shapes:
            if isinstance(shape, Hull):
                name = f"{stem}_collision{len(files)}.obj"
                write_plain(shape.mesh, meshes / name)
                files.append(f"meshes/{name}")
        hull_files.append(files)
    visual_files = [f"meshes/{stem}.obj" for stem in stems]
    return Written(folder, stems, surfaces, bodies, visual_files, hull_files)
