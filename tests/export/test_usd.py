"""The USD: usd-core's own validators find nothing, its physics parser finds our articulation, and
its joints move as ours."""

from __future__ import annotations

import dataclasses
import sys
import zipfile

import numpy as np
import pytest
import trimesh
from asset_objects import make_cabinet
from hand_bodies import write_files
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.export.usd import write_usd
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

pxr = pytest.importorskip("pxr", reason="pip install 'uniart_jax[usd]'")
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation  # noqa: E402

STATES = 20


def written(obj: ArticulatedObject, folder):
    """(what was given, the notes, the stage)."""
    given = write_files(obj, folder)
    path = folder / "object.usda"
    notes = write_usd(obj, path, given.surfaces, given.bodies, given.texture)
    return given, notes, Usd.Stage.Open(str(path))


@pytest.fixture(scope="module")
def cabinet():
    return make_cabinet()


@pytest.fixture(scope="module")
def files(cabinet, tmp_path_factory):
    return written(cabinet, tmp_path_factory.mktemp("usd") / "cabinet")


@pytest.fixture(scope="module")
def stage(files):
    return files[2]


def faults(path) -> list[str]:
    """All that usd-core's validators say of a file."""
    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    return [f"{e.GetName()}: {e.GetMessage()}" for e in errors]


def pose(position, orientation) -> np.ndarray:
    matrix = np.array(Gf.Matrix4d(Gf.Rotation(Gf.Quatd(orientation)), Gf.Vec3d(position)))
    return matrix.T  # USD multiplies rows


def joints_of(stage) -> dict[str, UsdPhysics.Joint]:
    """Display name -> joint."""
    found = [p for p in stage.Traverse() if p.IsA(UsdPhysics.Joint)]
    return {p.GetDisplayName() or p.GetName(): UsdPhysics.Joint(p) for p in found}


def named(stage) -> dict[str, Usd.Prim]:
    """Display name -> body."""
    found = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.RigidBodyAPI)]
    return {p.GetDisplayName() or p.GetName(): p for p in found}


def world(prim) -> np.ndarray:
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0)).T


def local_poses(joint) -> list[np.ndarray]:
    attributes = (
        (joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
        (joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
    )
    return [pose(position.Get(), turn.Get()) for position, turn in attributes]


def moved_bodies(stage, state: dict[str, float]) -> dict[str, np.ndarray]:
    """Path -> [4, 4] of every body at joint coordinates in degrees and metres, by the joints
    alone."""
    placed: dict[str, np.ndarray] = {}
    waiting = list(joints_of(stage).items())
    while waiting:
        name, joint = waiting.pop(0)
        above, below = (
            str(rel.GetTargets()[0]) for rel in (joint.GetBody0Rel(), joint.GetBody1Rel())
        )
        prim = joint.GetPrim()
        if not stage.GetPrimAtPath(above).HasAPI(UsdPhysics.RigidBodyAPI):
            base = world(stage.GetPrimAtPath(above))  # the world
        elif above in placed:
            base = placed[above]
        else:
            waiting.append((name, joint))
            continue
        first, second = local_poses(joint)
        motion, q = np.eye(4), state.get(name, 0.0)
        if prim.IsA(UsdPhysics.RevoluteJoint):
            assert UsdPhysics.RevoluteJoint(prim).GetAxisAttr().Get() == "X"
            motion = trimesh.transformations.rotation_matrix(np.deg2rad(q), [1, 0, 0])
        elif prim.IsA(UsdPhysics.PrismaticJoint):
            assert UsdPhysics.PrismaticJoint(prim).GetAxisAttr().Get() == "X"
            motion[0, 3] = q
        placed[below] = base @ first @ motion @ np.linalg.inv(second)
    return placed


def largest_error(obj: ArticulatedObject, stage, seed: int) -> float:
    """Largest distance of a part's box corners from where the object has them, in sizes of the
    object, over random states."""
    rng, worst, bodies = np.random.default_rng(seed), 0.0, named(stage)
    assert set(bodies) >= {p.name for p in obj.parts}
    for _ in range(STATES):
        q = np.array([rng.uniform(*p.joint.limits) if p.parent >= 0 else 0 for p in obj.parts])
        state = {}
        for part, value in zip(obj.parts, q, strict=True):
            joint = part.joint
            state[f"{part.name}_joint"] = np.rad2deg(value) if joint.rotates else value * obj.scale
            if joint.type == "screw":
                state[f"{part.name}_travel"] = value * joint.pitch * obj.scale
        placed = moved_bodies(stage, state)
        for part, matrix in zip(obj.parts, obj.forward_kinematics(q), strict=True):
            prim = bodies[part.name]
            corners = trimesh.bounds.corners(part.mesh.bounds)
            meant = trimesh.transform_points(corners, matrix) * obj.scale
            there = placed[str(prim.GetPath())] @ np.linalg.inv(world(prim))
            seen = trimesh.transform_points(corners * obj.scale, there)
            worst = max(worst, float(np.abs(seen - meant).max()))
    return worst / float(np.ptp(obj.bounds, axis=0).max() * obj.scale)


@pytest.mark.parametrize("suffix", ["usda", "usdz"])
def test_usd_core_finds_no_fault(files, suffix):
    assert faults(files[0].folder / f"object.{suffix}") == []


def test_stage_metadata(cabinet, stage):
    root = stage.GetDefaultPrim()
    assert root.GetName() == "cabinet" and root.HasAPI(UsdPhysics.ArticulationRootAPI)
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1


def test_joint_frames_agree_at_the_shown_state(stage):
    for joint in joints_of(stage).values():
        prims = [
            stage.GetPrimAtPath(rel.GetTargets()[0])
            for rel in (joint.GetBody0Rel(), joint.GetBody1Rel())
        ]
        first, second = (
            world(p) @ local for p, local in zip(prims, local_poses(joint), strict=True)
        )
        np.testing.assert_allclose(first, second, atol=1e-6)


def test_joints_move_as_the_objects(cabinet, stage):
    assert largest_error(cabinet, stage, seed=0) <= 1e-6


def test_usd_cores_physics_parser_sees_one_fixed_articulation(cabinet, stage):
    parser = getattr(UsdPhysics, "UsdPhysicsLoadStageFromPrimRange", None)
    if parser is None:
        pytest.skip("this usd-core has no such parser")
    found = {}
    for kind, (_, descriptions) in parser(stage, ["/"]).items():
        found[str(kind).split(".")[-1]] = descriptions
    assert all(d.isValid for descriptions in found.values() for d in descriptions)
    (articulation,) = found["Articulation"]
    assert [str(p) for p in articulation.rootPrims] == ["/cabinet/joints/root_joint"]
    count = len(cabinet.parts) + 1  # the screw's carrier
    assert len(found["RigidBody"]) == count
    assert len([b for b in articulation.articulatedBodies if not b.isEmpty]) == count
    fixed = {str(d.primPath): d for d in found["FixedJoint"]}
    base = fixed["/cabinet/joints/root_joint"]
    assert base.body0.isEmpty and str(base.body1) == "/cabinet/body"
    assert len(found["CubeShape"]) == len(found["MeshShape"]) == len(cabinet.parts)


def test_limits_and_resistance(cabinet, files, stage):
    """Degrees for angles, metres for travel; what PhysX reads beside it has PhysX's units."""
    joints = joints_of(stage)
    for part, body in zip(cabinet.parts, files[0].bodies, strict=True):
        if body.dynamics is None:
            continue
        prim = joints[f"{part.name}_joint"].GetPrim()
        turning, dynamics = part.joint.rotates, body.dynamics
        kind, degrees = ("angular", 180 / np.pi) if turning else ("linear", 1.0)
        typed = (UsdPhysics.RevoluteJoint if turning else UsdPhysics.PrismaticJoint)(prim)
        limits = [typed.GetLowerLimitAttr().Get(), typed.GetUpperLimitAttr().Get()]
        expected = np.array(part.joint.limits) * (degrees if turning else cabinet.scale)
        if part.joint.type == "continuous":
            expected = [-np.inf, np.inf]
        np.testing.assert_allclose(limits, expected, rtol=1e-6)
        drive = UsdPhysics.DriveAPI(prim, kind)
        assert drive.GetStiffnessAttr().Get() == pytest.approx(dynamics.stiffness / degrees)
        target = drive.GetTargetPositionAttr().Get()
        assert target == pytest.approx(dynamics.reference * degrees)
        assert drive.GetDampingAttr().Get() == pytest.approx(dynamics.damping / degrees)
        assert drive.GetMaxForceAttr().Get() == pytest.approx(dynamics.effort)
        schemas = prim.GetMetadata("apiSchemas").GetAppliedItems()
        assert "PhysxJointAPI" in schemas and f"PhysxJointAxisAPI:{kind}" in schemas
        velocity = prim.GetAttribute("physxJoint:maxJointVelocity").Get()
        assert velocity == pytest.approx(dynamics.velocity * degrees)
        friction = prim.GetAttribute(f"physxJointAxis:{kind}:staticFrictionEffort").Get()
        assert friction == pytest.approx(dynamics.friction)


def test_masses_and_inertia(cabinet, files, stage):
    bodies = named(stage)
    for part, body in zip(cabinet.parts, files[0].bodies, strict=True):
        prim = bodies[part.name]
        api = UsdPhysics.MassAPI(prim)
        assert api.GetMassAttr().Get() == pytest.approx(body.mass)
        origin = world(prim)[:3, 3]
        np.testing.assert_allclose(origin + api.GetCenterOfMassAttr().Get(), body.center, atol=1e-6)
        axes = pose((0, 0, 0), api.GetPrincipalAxesAttr().Get())[:3, :3]
        tensor = axes @ np.diag(api.GetDiagonalInertiaAttr().Get()) @ axes.T
        np.testing.assert_allclose(tensor, body.inertia, atol=1e-6 * np.trace(body.inertia))


def test_collision_shapes_are_those_given(cabinet, files, stage):
    bodies = named(stage)
    for part, body in zip(cabinet.parts, files[0].bodies, strict=True):
        place = bodies[part.name].GetPath().AppendChild("collision")
        cube = stage.GetPrimAtPath(place.AppendChild("piece0"))
        corners = trimesh.bounds.corners([[-0.5] * 3, [0.5] * 3])
        shape = body.shapes[0]
        meant = corners * shape.size @ shape.rotation.T + shape.center
        np.testing.assert_allclose(trimesh.transform_points(corners, world(cube)), meant, atol=1e-9)
        hull = stage.GetPrimAtPath(place.AppendChild("piece1"))
        points = np.array(UsdGeom.Mesh(hull).GetPointsAttr().Get(), dtype=np.float64)
        seen = trimesh.transform_points(points, world(hull))
        np.testing.assert_allclose(seen, body.shapes[1].mesh.vertices, atol=1e-6)
        api = UsdPhysics.MeshCollisionAPI(hull)
        assert api.GetApproximationAttr().Get() == "convexHull"
        for prim in (cube, hull):
            assert prim.HasAPI(UsdPhysics.CollisionAPI)
            assert UsdGeom.Imageable(prim).ComputePurpose() == "guide"


def test_visual_meshes_are_closed_and_textured(cabinet, files, stage):
    """Every corner has the place and the texture coordinates of the surface; no vertex is doubled
    along a seam."""
    bodies = named(stage)
    for part, surface in zip(cabinet.parts, files[0].surfaces, strict=True):
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(bodies[part.name].GetPath().AppendChild("visual")))
        points = np.array(mesh.GetPointsAttr().Get(), dtype=np.float64)
        faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        seen = trimesh.Trimesh(points, faces, process=False)
        assert seen.is_watertight
        placed = trimesh.transform_points(points, world(mesh.GetPrim()))[faces]
        np.testing.assert_allclose(
            placed, surface.vertices[surface.faces] * cabinet.scale, atol=1e-6
        )
        st_ = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
        assert st_.GetInterpolation() == "faceVarying"
        flat = np.array(st_.ComputeFlattened()).reshape(-1, 3, 2)
        np.testing.assert_allclose(flat, surface.uv[surface.uv_faces], atol=1e-6)
        material = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0]
        image = stage.GetPrimAtPath(material.GetPath().AppendChild("texture"))
        file = UsdShade.Shader(image).GetInput("file").Get()
        assert file.path == "./meshes/texture.png" and file.resolvedPath
        assert UsdShade.Shader(image).GetInput("sourceColorSpace").Get() == "sRGB"
        assert material.ComputeSurfaceSource()[0].GetIdAttr().Get() == "UsdPreviewSurface"


def test_groups_that_a_joint_links_and_bodies_within_one_never_touch(stage):
    pairs = set()
    for name, prim in named(stage).items():
        if prim.HasAPI(UsdPhysics.FilteredPairsAPI):
            for path in UsdPhysics.FilteredPairsAPI(prim).GetFilteredPairsRel().GetTargets():
                other = stage.GetPrimAtPath(path)
                pairs.add(frozenset((name, other.GetDisplayName() or other.GetName())))
    assert pairs == {
        frozenset(pair)
        for pair in [
            ("body", "door"),
            ("body", "drawer"),
            ("body", "wheel 1/2"),
            ("body", "foot"),
            ("foot", "door"),
            ("foot", "drawer"),
            ("foot", "wheel 1/2"),
            ("door", "knob"),
        ]
    }


def test_a_screw_is_lowered_and_said(cabinet, files, stage):
    knob = cabinet.parts[cabinet.index("knob")]
    pitch = knob.joint.pitch * cabinet.scale
    (note,) = files[1]
    assert "'knob_travel' does not follow 'knob_joint'" in note and f"{pitch:.6g} m / rad" in note
    prim = joints_of(stage)["knob_travel"].GetPrim()
    assert prim.GetAttribute("uniart:screw:metersPerRadian").Get() == pytest.approx(pitch)
    (driver,) = prim.GetRelationship("uniart:screw:joint").GetTargets()
    assert driver == joints_of(stage)["knob_joint"].GetPath()


def test_equal_objects_make_equal_files_and_a_package_of_its_own(cabinet, files, tmp_path):
    """Also where the file is written over while somebody reads it."""
    given, _, first = written(cabinet, tmp_path / "again")
    for name in ("object.usda", "object.usdz"):
        assert (tmp_path / "again" / name).read_bytes() == (given.folder / name).read_bytes()
        assert (tmp_path / "again" / name).read_bytes() == (files[0].folder / name).read_bytes(), (
            name
        )
    with zipfile.ZipFile(tmp_path / "again" / "object.usdz") as package:
        assert package.testzip() is None
        assert package.namelist() == ["object.usdc", "meshes/texture.png"]
        for info in package.infolist():
            assert info.compress_type == zipfile.ZIP_STORED
            assert info.date_time == (1980, 1, 1, 0, 0, 0)
    assert first.GetDefaultPrim()
    renamed = dataclasses.replace(cabinet, name="other")
    path = tmp_path / "again" / "object.usda"
    write_usd(renamed, path, given.surfaces, given.bodies, given.texture)
    moved = (tmp_path / "moved.usdz").write_bytes(path.with_suffix(".usdz").read_bytes())
    assert moved
    package = Usd.Stage.Open(str(tmp_path / "moved.usdz"))
    assert package.GetDefaultPrim().GetName() == "other"


def box(lo, hi) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[lo, hi])


NAMES = st.lists(
    st.text(st.characters(exclude_categories=["Cs"]), max_size=6)
    | st.sampled_from(["", "joints", "materials", "a b", "a_b", "1", "門", "b_turn", "root"]),
    min_size=3,
    max_size=3,
    unique=True,
)


@settings(max_examples=25)
@given(names=NAMES, own=st.sampled_from(["", "PhysicsScene", "9 lives", "x"]))
def test_any_names(tmp_path_factory, names, own):
    """Prims for all of them; a name that can be shown is kept as the display name."""
    parts = (
        Part(names[0], box([0, 0, 0], [1, 2, 3])),
        Part(names[1], box([1, 0, 0], [2, 1, 1]), 0, Joint([1, 1, 0], [1, 1, 1], (-1, 2))),
        Part(names[2], box([2, 0, 0], [3, 1, 1]), 1, Joint([1, 0, 0], [0, -1, 0], (0, 3), (0, -2))),
    )
    obj = ArticulatedObject(parts, name=own)
    _, _, stage = written(obj, tmp_path_factory.mktemp("names") / "x")
    bodies = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.RigidBodyAPI)]
    assert len(bodies) == 4 and stage.GetDefaultPrim().IsA(UsdGeom.Xform)
    assert len([p for p in stage.Traverse() if p.IsA(UsdPhysics.Joint)]) == 4
    for prim in stage.Traverse():
        assert prim.GetName().isascii() and prim.GetName().isidentifier()
    shown = {p.GetDisplayName() or p.GetName() for p in bodies}
    assert {n for n in names if n and n.isprintable()} <= shown


@settings(max_examples=25)
@given(
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
    | st.sampled_from([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]),
    kind=st.sampled_from(["revolute", "prismatic", "screw", "left", "continuous"]),
    scale=st.sampled_from([0.01, 1.0, 30.0]),
)
def test_any_axis(tmp_path_factory, direction, kind, scale):
    angle, travel = {
        "revolute": ((-2, 1), (0, 0)),
        "prismatic": ((0, 0), (-0.5, 1)),
        "screw": ((-1, 4), (-0.1, 0.4)),
        "left": ((-1, 4), (0.1, -0.4)),
        "continuous": ((-4, 4), (0, 0)),
    }[kind]
    parts = (
        Part("base", box([0, 0, 0], [1, 2, 3])),
        Part("arm", box([1, 0, 0], [2, 1, 1]), 0, Joint([1, 0.3, 2], direction, angle, travel)),
        Part("tip", box([2, 0, 0], [3, 1, 1]), 1, Joint([2, 0, 1], direction, angle, travel)),
    )
    obj = ArticulatedObject(parts, scale=scale)
    _, notes, stage = written(obj, tmp_path_factory.mktemp("axis") / "x")
    assert largest_error(obj, stage, seed=2) <= 1e-6
    assert len(notes) == (2 if kind in ("screw", "left") else 0)


def test_what_is_wrong_is_one_line(cabinet, tmp_path, monkeypatch):
    given = write_files(cabinet, tmp_path / "a")
    path = tmp_path / "a" / "object.usda"

    def refused(
        match: str, path=path, surfaces=given.surfaces, bodies=given.bodies, texture=given.texture
    ):
        with pytest.raises(ValueError, match=match) as error:
            write_usd(cabinet, path, surfaces, bodies, texture)
        assert "\n" not in str(error.value)

    refused("surfaces has 1 entries for 6 parts", surfaces=given.surfaces[:1])
    refused("bodies has 2 entries", bodies=given.bodies[:2])
    refused("does not end in .usda", path=tmp_path / "a" / "object.usd")
    refused("texture .* is missing", texture="meshes/none.png")
    monkeypatch.setitem(sys.modules, "pxr", None)
    refused("pip install 'uniart_jax\\[usd\\]'")
    assert not list((tmp_path / "a").glob("*.usd*"))
