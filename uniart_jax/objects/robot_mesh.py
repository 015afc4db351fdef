"""The geometry of a link as one coloured mesh. Mesh files come from ``asset_files``."""

from __future__ import annotations

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import SimpleMaterial

from uniart_jax.objects.appearance import merge_meshes
from uniart_jax.objects.asset_files import AssetFiles, RefusedError
from uniart_jax.objects.object import moved_mesh
from uniart_jax.objects.robot import Geometry, Link


def link_mesh(link: Link, files: AssetFiles, notes: list[str]) -> trimesh.Trimesh | None:
    """All visuals of a link as one mesh in the link's frame, colours kept; None for a link that has
    no geometry at all.

    A mesh file that is missing or broken is left out (noted) if other geometry remains. A link
    whose visuals are all lost, or that has none, is shown by its collision geometry (noted).

    Raises:
      ValueError: nothing remains of a link that should be seen, or a file outside the asset's
        folder; it names both.
    """
    lost: list[str] = []
    for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
        pieces = []
        for shape in shapes:
            try:
                pieces += _pieces(shape, files)
            except RefusedError as error:
                raise ValueError(f"link '{link.name}': {_named(shape, error)}") from None
            except (ValueError, FileNotFoundError) as error:
                lost.append(_named(shape, error))
        if pieces:
            for line in dict.fromkeys(lost):
                notes.append(f"link '{link.name}': {line}; left out")
            if tag == "collision":
                notes.append(
                    f"link '{link.name}': no visual geometry; shown by its collision geometry"
                )
            return merge_meshes(pieces)
    if lost:
        raise ValueError(
            f"link '{link.name}': nothing is left of it: {'; '.join(dict.fromkeys(lost))}"
        )
    return None


def _named(shape: Geometry, error: Exception) -> str:
    text = str(error)
    return f"mesh {text}" if f"'{shape.filename}'" in text else f"mesh '{shape.filename}': {text}"


def _pieces(shape: Geometry, files: AssetFiles) -> list[trimesh.Trimesh]:
    if shape.mesh is not None:
        files.count_faces(len(shape.mesh.faces))
        return [moved_mesh(shape.mesh, shape.origin @ np.diag([*shape.size, 1.0]))]
    if shape.kind == "mesh":
        loaded = files.meshes(files.find(shape.filename))
        matrix = shape.origin @ np.diag([*shape.size, 1.0])
    else:
        loaded, matrix = [primitive(shape)], shape.origin
        files.count_faces(len(loaded[0].faces))
    pieces = []
    for mesh in loaded:
        piece = moved_mesh(mesh, matrix)
        _paint(piece, shape, files)
        pieces.append(piece)
    return pieces


def primitive(shape: Geometry) -> trimesh.Trimesh:
    """A box, sphere, cylinder or capsule (its length without the caps, along z) about its own
    origin."""
    if shape.kind == "box":
        return trimesh.creation.box(extents=shape.size)
    if shape.kind == "sphere":
        return trimesh.creation.icosphere(subdivisions=3, radius=shape.size[0])
    if shape.kind == "cylinder":
        return trimesh.creation.cylinder(radius=shape.size[0], height=shape.size[1], sections=48)
    return trimesh.creation.capsule(radius=shape.size[0], height=shape.size[1], count=(24, 24))


def _paint(mesh: trimesh.Trimesh, shape: Geometry, files: AssetFiles) -> None:
    """A mesh's own texture or vertex colours win, then the description's material, then the mesh's
    plain colour (as in RViz)."""
    visual = mesh.visual
    uv = visual.uv if isinstance(visual, TextureVisuals) else None
    if isinstance(visual, TextureVisuals):
        own = getattr(visual.material, "image", None) or getattr(
            visual.material, "baseColorTexture", None
        )
        if own is not None and uv is not None:
            return
    elif visual.kind in ("vertex", "face"):
        return
    if shape.texture and uv is not None:
        image = files.texture(shape.texture)
        if image is not None:
            mesh.visual = TextureVisuals(uv=uv, material=SimpleMaterial(image=image))
            return
    if shape.color is not None:
        rgba = np.round(shape.color * 255).astype(np.uint8)
        mesh.visual = ColorVisuals(mesh, face_colors=np.tile(rgba, (len(mesh.faces), 1)))
