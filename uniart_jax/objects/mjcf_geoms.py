"""The geoms of a compiled MuJoCo model as painted meshes.

Sizes are MuJoCo's half sizes; a mesh is the compiled one, which MuJoCo has moved to its centre of
mass and main axes, so the compiled pose of its geom belongs to it. A texture without texture
coordinates is projected on each face from the side that the face looks to; MuJoCo projects a cube's
sides from the middle of the geom and a flat image along z, which differ on curved or long shapes.
"""

from __future__ import annotations

import numpy as np
import trimesh
from PIL import Image
from trimesh.transformations import quaternion_matrix
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import SimpleMaterial

from uniart_jax.objects.robot import Geometry
from uniart_jax.objects.robot_mesh import primitive

PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(8)  # mjtGeom
TEXTURE_2D, TEXTURE_CUBE = 0, 1  # mjtTexture
ROLE_RGB = 1  # mjtTextureRole
DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)
MAX_REPEATS = 16  # of a texture on one side of a geom


def has_shape(model, geom: int) -> bool:
    """Whether it is a body with an end and a surface: no plane, height field or signed distance
    field."""
    return int(model.geom_type[geom]) in (SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH)


def rgba(model, geom: int) -> np.ndarray:
    """[4] as MuJoCo shows it: the material's colour unless the geom has one of its own."""
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.allclose(own, DEFAULT_RGBA):
        own = model.mat_rgba[material]
    return np.clip(np.asarray(own, dtype=np.float64), 0, 1)


def geometry(model, geom: int, frame: np.ndarray) -> Geometry:
    """A geom's mesh, painted, in its link's frame.

    Args:
      model: ``mujoco.MjModel``.
      geom: one that ``has_shape``.
      frame: [4, 4] the body in its link.
    """
    place = quaternion_matrix(model.geom_quat[geom])
    place[:3, 3] = model.geom_pos[geom]
    image, kind, repeats = _texture(model, geom)
    mesh, uv = _mesh(model, geom, with_uv=image is not None and kind == TEXTURE_2D)
    color = rgba(model, geom)
    if image is None:
        paint = np.tile(np.round(color * 255).astype(np.uint8), (len(mesh.faces), 1))
        mesh.visual = ColorVisuals(mesh, face_colors=paint)
    else:
        if uv is None:
            mesh, uv = _projected(mesh, kind, repeats, sides=len(image) // image.shape[1])
        picture = Image.fromarray(np.round(image * color[:3]).astype(np.uint8))
        mesh.visual = TextureVisuals(uv=uv, material=SimpleMaterial(image=picture))
    return Geometry("mesh", np.ones(3), frame @ place, mesh=mesh)


def _mesh(model, geom: int, with_uv: bool) -> tuple[trimesh.Trimesh, np.ndarray | None]:
    kind, size = int(model.geom_type[geom]), np.asarray(model.geom_size[geom], dtype=np.float64)
    if kind == MESH:
        return _asset(model, int(model.geom_dataid[geom]), with_uv)
    if kind == ELLIPSOID:
        ball = trimesh.creation.icosphere(subdivisions=3)
        return trimesh.Trimesh(ball.vertices * size, ball.faces, process=False), None
    name, sizes = {
        SPHERE: ("sphere", size[:1]),
        CAPSULE: ("capsule", size[:2] * [1, 2]),
        CYLINDER: ("cylinder", size[:2] * [1, 2]),
        BOX: ("box", size * 2),
    }[kind]
    return primitive(Geometry(name, sizes, np.eye(4))), None


def _asset(model, mesh: int, with_uv: bool) -> tuple[trimesh.Trimesh, np.ndarray | None]:
    """A mesh asset; with texture coordinates its vertices are split where these differ."""
    start = model.mesh_vertadr[mesh]
    vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(np.float64)
    rows = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    faces = model.mesh_face[rows].astype(np.int64)
    uv = None
    if with_uv and model.mesh_texcoordadr[mesh] >= 0:
        start = model.mesh_texcoordadr[mesh]
        coords = model.mesh_texcoord[start : start + model.mesh_texcoordnum[mesh]]
        corners = np.column_stack([faces.ravel(), model.mesh_facetexcoord[rows].ravel()])
        pairs, inverse = np.unique(corners, axis=0, return_inverse=True)
        vertices, faces = vertices[pairs[:, 0]], inverse.reshape(-1, 3)
        uv = coords[pairs[:, 1]].astype(np.float64) * [1, -1] + [0, 1]  # MuJoCo's v points down
    return trimesh.Trimesh(vertices, faces, process=False), uv


def _texture(model, geom: int) -> tuple[np.ndarray | None, int, np.ndarray]:
    """(image [h, w, 3] uint8 or None, mjtTexture, [3] repeats along the geom's sides)."""
    material = int(model.geom_matid[geom])
    nothing = None, TEXTURE_2D, np.ones(3)
    if material < 0:
        return nothing
    texture = int(model.mat_texid[material, ROLE_RGB])
    if texture < 0:
        return nothing
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    data = model.tex_data[start : start + height * width * channels]
    kind = int(model.tex_type[texture])
    if kind not in (TEXTURE_2D, TEXTURE_CUBE) or len(data) != height * width * channels:
        return nothing
    image = np.asarray(data, dtype=np.uint8).reshape(height, width, channels)
    image = image[..., :3] if channels >= 3 else np.repeat(image[..., :1], 3, axis=2)
    if kind == TEXTURE_CUBE:
        return image, kind, np.ones(3)
    repeats = np.append(model.mat_texrepeat[material], 1.0)[[0, 1, 1]].astype(np.float64)
    if model.mat_texuniform[material]:  # per length, not per side
        repeats = repeats * 2 * model.geom_aabb[geom, 3:]
    return image, kind, np.clip(repeats, 1e-3, MAX_REPEATS)


def _projected(
    mesh: trimesh.Trimesh, kind: int, repeats: np.ndarray, sides: int
) -> tuple[trimesh.Trimesh, np.ndarray]:
    """(mesh whose faces share no vertex across sides, uv [V, 2]): every face sees the image along
    its main axis.

    A cube's image holds one side or six below each other: +x, -x, +y, -y, +z, -z (MuJoCo's right,
    left, up, down, front, back).
    """
    axis = np.abs(mesh.face_normals).argmax(1)
    negative = np.take_along_axis(mesh.face_normals, axis[:, None], 1)[:, 0] < 0
    side = 2 * axis + negative
    corners = np.column_stack([np.asarray(mesh.faces).ravel(), np.repeat(side, 3)])
    pairs, inverse = np.unique(corners, axis=0, return_inverse=True)
    vertices, side = np.asarray(mesh.vertices)[pairs[:, 0]], pairs[:, 1]
    low, high = mesh.bounds
    unit = (vertices - low) / np.maximum(high - low, 1e-12)
    across = np.array([1, 0, 0])[side // 2]  # z is up on the upright sides, y on the others
    up = np.array([2, 2, 1])[side // 2]
    rows = np.arange(len(unit))
    uv = np.column_stack([unit[rows, across], unit[rows, up]])
    if kind == TEXTURE_CUBE and sides == 6:
        uv[:, 1] = (5 - side + uv[:, 1]) / 6
    else:
        uv *= np.column_stack([repeats[across], repeats[up]])
    return trimesh.Trimesh(vertices, inverse.reshape(-1, 3), process=False), uv
