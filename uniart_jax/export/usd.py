"""Writing USD: a UsdPhysics articulation that Isaac Sim and others load as it is, and the same as
one USDZ file. Needs usd-core.

    /PhysicsScene            gravity, for who opens the file by itself; not part of the default prim, so a reference does not bring it
    /<object>                default prim, ArticulationRootAPI
      <part>                 RigidBodyAPI, MassAPI; its frame stands at its joint's origin with the object frame's axes, as in the URDF
        visual  collision    what is seen; convex shapes of purpose 'guide'
      <part>_turn            the body without a shape that a screw turns and its part slides on
      materials  joints

Metres, kilograms, z up; angles of joints in degrees, as UsdPhysics has them. Names that are no USD
identifiers are kept as display names. (openusd.org/release/api/usd_physics_page_front.html;
PhysxJointAPI and PhysxJointAxisAPI: Omniverse Physics' "Physx Joint Schema".)
"""  # noqa: E501

from __future__ import annotations

import struct
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from uniart_jax.export.atlas import Surface
from uniart_jax.export.formats import Parts
from uniart_jax.export.frames import (
    ChainJoint,
    body_frames,
    check_bodies,
    check_lengths,
    joint_chain,
    joint_name,
    linked_pairs,
    metric_travel,
    moves,
    rigid_groups,
    travel_name,
)
from uniart_jax.export.physics import GRAVITY, Body
from uniart_jax.export.texture_file import smaller
from uniart_jax.export.usd_joints import place_joint, set_dynamics, set_limits
from uniart_jax.export.usd_shapes import (
    define_collision,
    define_material,
    define_visual,
    set_mass,
    vector,
)
from uniart_jax.objects.names import Numbered, printable
from uniart_jax.objects.object import ArticulatedObject, Part

CARRIER_MASS = 0.01  # kg; of a body without a shape
CARRIER_GYRATION = 0.01  # m
SCENE = "PhysicsScene"
ZIP_EPOCH = b"\x00\x00\x21\x00"  # 1980-01-01 00:00, a zip's first


def write_asset(parts: Parts) -> tuple[str, ...]:
    """``object.usda`` and ``object.usdz`` of an asset (``formats.SIMULATORS``)."""
    path = parts.folder / "object.usda"
    return write_usd(parts.obj, path, parts.surfaces, parts.bodies, parts.texture)


def write_usd(
    obj: ArticulatedObject,
    path: Path,
    surfaces: Sequence[Surface],
    bodies: Sequence[Body],
    texture: str,
) -> tuple[str, ...]:
    """Write ``obj`` as ``path`` (.usda) and, packed with its texture, as .usdz beside it.

    Args:
      obj: any object; ``scale`` turns it into metres.
      path: the .usda file.
      surfaces: [K] of the parts, object frame and units, shown state.
      bodies: [K] mass, collision shapes and dynamics.
      texture: image of all surfaces, written already, relative to the folder of ``path``.

    Returns:
      What UsdPhysics cannot say, a line each.

    Raises:
      ValueError: usd-core is not installed, lists that do not fit the parts, or no such texture.
    """
    try:
        from pxr import Sdf, Usd
    except ImportError:
        raise ValueError("writing USD needs usd-core: pip install 'uniart_jax[usd]'") from None
    check_bodies("write_usd", obj, bodies)
    check_lengths("write_usd", obj, surfaces=surfaces)
    if path.suffix.lower() != ".usda":
        raise ValueError(f"write_usd: {path} does not end in .usda")
    if not (path.parent / texture).is_file():
        raise ValueError(f"write_usd: the texture {path.parent / texture} is missing")
    layer = Sdf.Layer.CreateAnonymous(".usda")
    writer = _Writer(obj, bodies, Usd.Stage.Open(layer))
    writer.fill(surfaces, texture)
    layer.Export(str(path))
    _write_package(layer, path, texture)
    return tuple(writer.notes)


def _write_package(layer, path: Path, texture: str) -> None:
    """The .usdz beside a .usda: the same in USD's binary form, and the texture as small as may be
    (``texture_file``)."""
    from pxr import Sdf, UsdUtils

    package = path.with_suffix(".usdz")
    png = (path.parent / texture).read_bytes()
    packed = smaller(png)
    with tempfile.TemporaryDirectory(prefix="uniart-usdz-") as folder:
        name = texture if packed is None else str(Path(texture).with_suffix(".jpg"))
        picture = Path(folder) / name
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.write_bytes(png if packed is None else packed)
        binary = Path(folder) / path.with_suffix(".usdc").name
        copy = Sdf.Layer.CreateAnonymous(".usdc")
        copy.TransferContent(layer)
        UsdUtils.ModifyAssetPaths(copy, lambda at: f"./{name}" if at == f"./{texture}" else at)
        copy.Export(str(binary))
        if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(binary)), str(package)):
            raise ValueError(f"write_usd: {package} cannot be written")
    _forget_dates(package)


def _forget_dates(package: Path) -> None:
    """Set the dates of all files in a zip to 1980, in place (USDZ's contents are aligned), so that
    equal contents are equal files."""
    data = bytearray(package.read_bytes())
    with zipfile.ZipFile(package) as archive:
        at, files = archive.start_dir, archive.infolist()
    for info in files:  # .ZIP File Format Specification, 4.3.7 and 4.3.12
        for field in (info.header_offset + 10, at + 12):
            data[field : field + 4] = ZIP_EPOCH
        at += 46 + sum(struct.unpack_from("<3H", data, at + 28))
    package.write_bytes(data)


class _Writer:
    """Fills a stage. Prims of parts, carriers and joints are named once, told apart where two names
    become one identifier."""

    def __init__(self, obj: ArticulatedObject, bodies: Sequence[Body], stage):
        from pxr import UsdGeom

        self.obj, self.bodies, self.stage = obj, bodies, stage
        self.frames = body_frames(obj)
        self.notes: list[str] = []
        name = Numbered([SCENE])(identifier(obj.name or "object"))
        self.root = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
        self.taken = Numbered(["materials", "joints"])
        self.taken_joints = Numbered()
        self.parts = [self._define(p.name, self.frames[k]) for k, p in enumerate(obj.parts)]

    def fill(self, surfaces: Sequence[Surface], texture: str) -> None:
        from pxr import UsdGeom, UsdPhysics

        self._stage_metadata()
        UsdGeom.Scope.Define(self.stage, self.root.GetPath().AppendChild("materials"))
        place = self.root.GetPath().AppendPath("materials/material")
        material = define_material(self.stage, place, f"./{texture}")
        for k, (body, surface) in enumerate(zip(self.bodies, surfaces, strict=True)):
            prim, frame = self.parts[k], self.frames[k]
            set_mass(prim, body.mass, body.center - frame, body.inertia)
            define_visual(prim, surface, self.obj.scale, frame, material)
            define_collision(prim, body.shapes, frame)
        UsdGeom.Scope.Define(self.stage, self.root.GetPath().AppendChild("joints"))
        for k, part in enumerate(self.obj.parts):
            if part.parent >= 0:
                self._connect(k, part)
        base = self._joint(UsdPhysics.FixedJoint, "root_joint", self.root, self.parts[0])
        place_joint(base, self.frames[0], None)
        self._filter_pairs()

    def _stage_metadata(self) -> None:
        from pxr import Kind, Usd, UsdGeom, UsdPhysics

        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        UsdPhysics.SetStageKilogramsPerUnit(self.stage, 1.0)
        self.stage.SetDefaultPrim(self.root)
        Usd.ModelAPI(self.root).SetKind(Kind.Tokens.component)
        UsdPhysics.ArticulationRootAPI.Apply(self.root)
        set_display_name(self.root, self.obj.name)
        scene = UsdPhysics.Scene.Define(self.stage, f"/{SCENE}")
        scene.CreateGravityDirectionAttr((0.0, 0.0, -1.0))
        scene.CreateGravityMagnitudeAttr(GRAVITY)

    def _define(self, name: str, frame: np.ndarray):
        """A body's prim at its frame."""
        from pxr import UsdGeom, UsdPhysics

        place = self.root.GetPath().AppendChild(self.taken(identifier(name)))
        body = UsdGeom.Xform.Define(self.stage, place)
        body.AddTranslateOp().Set(vector(frame, double=True))
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        set_display_name(body.GetPrim(), name)
        return body.GetPrim()

    def _joint(self, kind, name: str, above, below):
        """A joint between two prims; ``above`` may be the root, which is no body: the world,
        wherever the object is put."""
        place = self.root.GetPath().AppendChild("joints")
        joint = kind.Define(self.stage, place.AppendChild(self.taken_joints(identifier(name))))
        joint.CreateBody0Rel().SetTargets([above.GetPath()])
        joint.CreateBody1Rel().SetTargets([below.GetPath()])
        set_display_name(joint.GetPrim(), name)
        return joint

    def _connect(self, k: int, part: Part) -> None:
        """The joints between a part and its parent, bodies without a shape between them."""
        from pxr import UsdPhysics

        above, frame = self.parts[part.parent], self.frames[part.parent]
        if not moves(part):
            fixed = self._joint(UsdPhysics.FixedJoint, joint_name(part), above, self.parts[k])
            place_joint(fixed, self.frames[k] - frame, None)
            return
        links = joint_chain(part, self.bodies[k])
        for number, link in enumerate(links, start=1):
            here = link.part.joint.origin * self.obj.scale
            last = number == len(links)
            below = self.parts[k] if last else self._carrier(f"{part.name}_carrier", here)
            self._move(link, above, below, here - frame, here)
            above, frame = below, here

    def _carrier(self, name: str, frame: np.ndarray):
        """A body without a shape."""
        carrier = self._define(name, frame)
        set_mass(carrier, CARRIER_MASS, np.zeros(3), CARRIER_MASS * CARRIER_GYRATION**2 * np.eye(3))
        return carrier

    def _move(self, link: ChainJoint, above, below, at: np.ndarray, frame: np.ndarray) -> None:
        """One joint between two prims: ``at`` [3] in the first, at the second's ``frame`` [3]."""
        from pxr import UsdPhysics

        joint, travel = link.part.joint, metric_travel(link.part, self.obj.scale)
        if not joint.rotates:
            slide = self._joint(UsdPhysics.PrismaticJoint, link.name, above, below)
            place_joint(slide, at, joint.direction)
            set_limits(slide, travel)
            set_dynamics(slide, link.dynamics, "linear")
            return
        carrier = None
        if joint.type == "screw":
            carrier = self._carrier(f"{link.part.name}_turn", frame)
        turn = self._joint(UsdPhysics.RevoluteJoint, link.name, above, carrier or below)
        place_joint(turn, at, joint.direction)
        if joint.type != "continuous":
            set_limits(turn, np.rad2deg(joint.angle))
        set_dynamics(turn, link.dynamics, "angular")
        if carrier:
            name = travel_name(link.part) if link.first else f"{link.name}_travel"
            slide = self._joint(UsdPhysics.PrismaticJoint, name, carrier, below)
            place_joint(slide, np.zeros(3), joint.direction)
            set_limits(slide, travel)
            self._couple(joint.pitch, (link.name, turn), (name, slide))

    def _couple(self, pitch: float, turned: tuple, slid: tuple) -> None:
        """Say how a screw's slide follows its turn (name, joint each); UsdPhysics has no schema
        for it."""
        from pxr import Sdf

        (hinge, turn), (travel, slide) = turned, slid
        pitch = float(pitch * self.obj.scale)
        prim = slide.GetPrim()
        prim.CreateRelationship("uniart:screw:joint", custom=True).SetTargets([turn.GetPath()])
        ratio = prim.CreateAttribute(
            "uniart:screw:metersPerRadian", Sdf.ValueTypeNames.Double, custom=True
        )
        ratio.Set(pitch)
        self.notes.append(
            f"USD: UsdPhysics has no screws: '{travel}' does not follow '{hinge}' by itself; drive "
            f"it by {pitch:.6g} m / rad (uniart:screw:metersPerRadian)"
        )

    def _filter_pairs(self) -> None:
        """No contacts between groups that a joint links, nor within one (bodies fixed to one
        another are bodies nevertheless)."""
        from pxr import UsdPhysics

        leaders = rigid_groups(self.obj)
        pairs = linked_pairs(self.obj)
        groups: dict[int, list[int]] = {}
        for k, leader in enumerate(leaders):
            pairs += [(other, k) for other in groups.setdefault(leader, [])]
            groups[leader].append(k)
        targets: dict[int, list] = {}
        for above, below in pairs:
            targets.setdefault(below, []).append(self.parts[above].GetPath())
        for k, paths in sorted(targets.items()):
            filtered = UsdPhysics.FilteredPairsAPI.Apply(self.parts[k])
            filtered.CreateFilteredPairsRel().SetTargets(paths)


def identifier(name: str) -> str:
    """``name`` with an underscore for whatever a USD identifier cannot hold."""
    from pxr import Tf

    return Tf.MakeValidIdentifier(printable(name))


def set_display_name(prim, name: str) -> None:
    """Keep a name that is no identifier."""
    if name and name != prim.GetName():
        prim.SetDisplayName(printable(name))
