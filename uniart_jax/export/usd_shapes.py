"""What a body of a USD file is made of: mass, a textured mesh, collision shapes. Needs usd-core,
which is imported only when called.

Metres, kilograms; a body's own frame, whose origin is given in the object frame and whose axes are
the object frame's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trimesh.transformations import quaternion_from_matrix

from uniart_jax.export.atlas import Surface
from uniart_jax.export.physics import Box, Shape


def vector(values: np.ndarray, double: bool = False):
    """[3] as USD's; single precision, which UsdPhysics asks for, unless ``double``."""
    from pxr import Gf

    return (Gf.Vec3d if double else Gf.Vec3f)(*(float(v) + 0.0 for v in values))


def quaternion(values: np.ndarray):
    """[4] (w, x, y, z) as USD's in single precision."""
    from pxr import Gf

    w, x, y, z = (float(v) + 0.0 for v in values)
    return Gf.Quatf(w, x, y, z)


def set_mass(prim, mass: float, center: np.ndarray, inertia: np.ndarray) -> None:
    """MassAPI from kg, [3] m in the body's frame, and the tensor [3, 3] kg m^2 about it: UsdPhysics
    takes its main axes and moments."""
    from pxr import UsdPhysics

    tensor = np.asarray(inertia, dtype=np.float64)
    moments, axes = np.linalg.eigh((tensor + tensor.T) / 2)
    if np.linalg.det(axes) < 0:
        axes = -axes
    turn = np.eye(4)
    turn[:3, :3] = axes
    api = UsdPhysics.MassAPI.Apply(prim)
    api.CreateMassAttr(float(mass))
    api.CreateCenterOfMassAttr(vector(center))
    api.CreateDiagonalInertiaAttr(vector(moments))
    api.CreatePrincipalAxesAttr(quaternion(quaternion_from_matrix(turn)))


def define_material(stage, place, texture: str):
    """UsdPreviewSurface that shows ``texture`` (an sRGB image, relative to the file) by the primvar
    ``st``."""
    from pxr import Sdf, UsdShade

    types = Sdf.ValueTypeNames
    material = UsdShade.Material.Define(stage, place)
    surface = UsdShade.Shader.Define(stage, place.AppendChild("surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", types.Float).Set(0.8)
    surface.CreateInput("metallic", types.Float).Set(0.0)
    reader = UsdShade.Shader.Define(stage, place.AppendChild("coordinates"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", types.String).Set("st")
    image = UsdShade.Shader.Define(stage, place.AppendChild("texture"))
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", types.Asset).Set(Sdf.AssetPath(texture))
    image.CreateInput("sourceColorSpace", types.Token).Set("sRGB")
    for side in ("wrapS", "wrapT"):
        image.CreateInput(side, types.Token).Set("clamp")
    image.CreateInput("st", types.Float2).ConnectToSource(
        reader.CreateOutput("result", types.Float2)
    )
    surface.CreateInput("diffuseColor", types.Color3f).ConnectToSource(
        image.CreateOutput("rgb", types.Float3)
    )
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    return material


def define_visual(prim, surface: Surface, scale: float, frame: np.ndarray, material) -> None:
    """The mesh that is seen. Texture coordinates have indices of their own, so that the mesh stays
    closed along its seams."""
    from pxr import Sdf, UsdGeom, UsdShade

    stage, place = prim.GetStage(), prim.GetPath().AppendChild("visual")
    mesh = _define_mesh(stage, place, surface.vertices * scale - frame, surface.faces)
    mesh.CreateDoubleSidedAttr(not surface.mesh.is_watertight)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    st.Set(_array("Vec2fArray", surface.uv, np.float32))
    st.SetIndices(_array("IntArray", surface.uv_faces.ravel(), np.int32))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def define_collision(prim, shapes: Sequence[Shape], frame: np.ndarray) -> None:
    """What the body collides with: cubes and convex hulls, hidden as guides."""
    from pxr import Gf, UsdGeom, UsdPhysics

    stage, place = prim.GetStage(), prim.GetPath().AppendChild("collision")
    UsdGeom.Scope.Define(stage, place).CreatePurposeAttr(UsdGeom.Tokens.guide)
    for i, shape in enumerate(shapes):
        piece = place.AppendChild(f"piece{i}")
        if isinstance(shape, Box):
            cube = UsdGeom.Cube.Define(stage, piece)
            cube.CreateSizeAttr(1.0)
            cube.CreateExtentAttr([(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)])
            turn = np.eye(4)
            turn[:3, :3] = shape.rotation
            w, x, y, z = (float(v) + 0.0 for v in quaternion_from_matrix(turn))
            cube.AddTranslateOp().Set(vector(shape.center - frame, double=True))
            cube.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(w, x, y, z))
            cube.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(vector(shape.size, double=True))
            geometry = cube.GetPrim()
        else:
            hull = shape.mesh
            mesh = _define_mesh(stage, piece, np.asarray(hull.vertices) - frame, hull.faces)
            geometry = mesh.GetPrim()
            api = UsdPhysics.MeshCollisionAPI.Apply(geometry)
            api.CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
        UsdPhysics.CollisionAPI.Apply(geometry)


def _define_mesh(stage, place, points: np.ndarray, faces: np.ndarray):
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, place)
    rounded = _array("Vec3fArray", points, np.float32)
    mesh.CreatePointsAttr(rounded)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(faces), 3))
    mesh.CreateFaceVertexIndicesAttr(_array("IntArray", np.asarray(faces).ravel(), np.int32))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(rounded))
    return mesh


def _array(kind: str, values: np.ndarray, dtype):
    from pxr import Vt

    return getattr(Vt, kind).FromNumpy(np.ascontiguousarray(values, dtype=dtype))
