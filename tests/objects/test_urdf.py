"""URDF: round trips, repairs of what real files get wrong, and refusals in one line."""

from __future__ import annotations

import io
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from uniart_jax.objects import urdf_mesh
from uniart_jax.objects.appearance import sample_color, srgb_to_linear
from uniart_jax.objects.kinematics import Joint, line_distance
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.urdf import find_urdf, joint_name, load_object, mesh_inertial, write_urdf

SHARED = Path(__file__).resolve().parents[3] / "shared"
BOX = '<visual><geometry><box size="1 1 1"/></geometry></visual>'


def link(name: str, body: str = BOX) -> str:
    return f'<link name="{name}">{body}</link>'


def joint(kind: str, child: str, inner: str = "", parent: str = "base", name: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name or child + "_joint"}" type="{kind}">{ends}{inner}</joint>'


def limit(lo: float, hi: float) -> str:
    return f'<limit lower="{lo}" upper="{hi}"/>'


def mesh(file: str) -> str:
    return f'<visual><geometry><mesh filename="{file}"/></geometry></visual>'


def robot(*elements: str) -> str:
    return f'<robot name="thing">{"".join(elements)}</robot>'


@pytest.fixture
def load(tmp_path):
    """Write a URDF's text and read it."""

    def read(*elements: str, **options) -> ArticulatedObject:
        text = elements[0] if elements[0].startswith(("<?", "<robot", "<!")) else robot(*elements)
        (tmp_path / "a.urdf").write_text(text)
        return load_object(tmp_path / "a.urdf", **options)

    return read


@pytest.fixture
def refuse(load):
    """The one line with which a URDF is refused."""

    def read(*elements: str, **options) -> str:
        with pytest.raises(ValueError) as caught:
            load(*elements, **options)
        line = str(caught.value)
        assert "\n" not in line and "a.urdf" in line
        return line

    return read


def notes(obj: ArticulatedObject, words: str) -> list[str]:
    return [n for n in obj.provenance if words in n]


# --- Round trips ---------------------------------------------------------------------------------------------------------------


def random_object(rng: np.random.Generator) -> ArticulatedObject:
    parts = []
    for k in range(rng.integers(1, 8)):
        low = rng.uniform(-1, 0.5, 3)
        body = trimesh.creation.box(bounds=[low, low + rng.uniform(0.2, 0.6, 3)])
        lo, hi = -rng.uniform(0, 1) * (rng.random() < 0.5), rng.uniform(0.1, 1)
        kind = rng.integers(5)
        turns = {1: 3.0, 2: 3.2, 4: rng.choice([1, 5, 14])}.get(kind, 0.0)
        rate = {3: 0.5, 4: rng.choice([-0.2, 0.2])}.get(kind, 0.0)
        if kind == 2:
            lo, hi = -1, 1
        joint = Joint(
            rng.uniform(-1, 1, 3),
            rng.normal(size=3),
            (lo * turns, hi * turns),
            (lo * rate, hi * rate),
        )
        name = f"part {k} <&>" if k else "base"
        parts.append(
            Part(name, body, int(rng.integers(k)) if k else -1, joint if k else Joint.fixed())
        )
    return ArticulatedObject(tuple(parts), scale=float(rng.uniform(0.05, 3)), name="thing")


def save(obj: ArticulatedObject, folder: Path) -> Path:
    """Meshes in metres beside the URDF, as the exporter does."""
    files = []
    for k, part in enumerate(obj.parts):
        body = part.mesh.copy()
        body.apply_scale(obj.scale)
        body.export(folder / f"{k}.ply")
        files.append([f"{k}.ply"])
    return write_urdf(obj, folder, files)


def same_objects(a: ArticulatedObject, b: ArticulatedObject) -> None:
    """Names, tree, meshes and joints, with ``a.scale`` metres a unit against metres."""
    assert [p.name for p in a.parts] == [p.name for p in b.parts]
    assert a.parents == b.parents
    for ours, theirs in zip(a.parts, b.parts, strict=True):
        np.testing.assert_allclose(ours.mesh.bounds * a.scale, theirs.mesh.bounds, atol=2e-6)
        x, y = ours.joint, theirs.joint
        assert x.type == y.type
        if x.type != "fixed":
            np.testing.assert_allclose(x.direction, y.direction, atol=1e-9)
            np.testing.assert_allclose(x.angle, y.angle, atol=1e-9)
            np.testing.assert_allclose(np.multiply(x.travel, a.scale), y.travel, atol=1e-9)
            if x.rotates:
                here = Joint(x.origin * a.scale, x.direction, angle=(0, 1))
                assert line_distance(here, y) < 1e-9


@given(st.integers(0, 2**32 - 1))
def test_written_objects_read_back_the_same(tmp_path_factory, seed):
    obj = random_object(np.random.default_rng(seed)).normalized()
    read = load_object(save(obj, tmp_path_factory.mktemp("trip")))
    same_objects(obj, read)
    assert read.scale == 1 and read.name == "thing"
    assert all("one screw" in n or "collapsed" in n for n in read.provenance)
    same_objects(read, load_object(save(read, tmp_path_factory.mktemp("again"))))
    unit = read.normalized()
    assert unit.scale == pytest.approx(obj.scale)
    assert [j.type for j in unit.joints] == [j.type for j in obj.joints]


@pytest.mark.parametrize("seed", range(6))
def test_mujoco_moves_what_we_write_as_we_do(tmp_path, seed):
    rng = np.random.default_rng(seed)
    obj = random_object(rng).normalized()
    path = save(obj, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    q = np.array([j.sample(rng) for j in obj.joints])
    mujoco.mj_kinematics(model, data)
    rest = {p.name: data.body(p.name).xpos.copy() for p in obj.parts[1:]}
    for part, value in zip(obj.parts, q, strict=True):
        if part.joint.type == "fixed":
            continue
        value = value if part.joint.rotates else value * obj.scale
        data.joint(joint_name(part)).qpos[0] = value
        if (
            part.joint.type == "screw"
        ):  # mimic: MuJoCo makes it an equality, which kinematics alone do not hold
            data.joint(f"{part.name}_travel").qpos[0] = value * part.joint.pitch * obj.scale
    mujoco.mj_kinematics(model, data)
    moved = obj.forward_kinematics(q)
    for part, matrix in list(zip(obj.parts, moved, strict=True))[1:]:
        np.testing.assert_allclose(
            data.body(part.name).xmat.reshape(3, 3), matrix[:3, :3], atol=1e-7
        )
        expected = matrix[:3, :3] @ rest[part.name] + matrix[:3, 3] * obj.scale
        np.testing.assert_allclose(data.body(part.name).xpos, expected, atol=1e-7)
    assert model.body_mass[1:].min() > 0


def test_strict_parsers_read_what_we_write(tmp_path):
    obj = random_object(np.random.default_rng(4)).normalized()
    model = yourdfpy.URDF.load(str(save(obj, tmp_path)))
    for part in obj.parts:
        inertial = model.link_map[part.name].inertial
        principal = np.linalg.eigvalsh(inertial.inertia)
        assert (
            inertial.mass > 0 and principal[0] > 0 and principal[0] + principal[1] >= principal[2]
        )
    assert all(
        j.limit.effort > 0 and j.limit.velocity > 0 for j in model.robot.joints if j.type != "fixed"
    )


def test_the_writer_names_what_does_not_fit(tmp_path):
    obj = random_object(np.random.default_rng(0))
    with pytest.raises(ValueError, match="entries for"):
        write_urdf(obj, tmp_path, [])
    with pytest.raises(ValueError, match="list of files"):
        write_urdf(obj, tmp_path, ["a.obj"] * len(obj.parts))
    odd = ArticulatedObject((Part("a\x01", trimesh.creation.box()),))
    with pytest.raises(ValueError, match="XML"):
        write_urdf(odd, tmp_path, [[]])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "body",
    [
        trimesh.creation.box([1, 2, 3]),
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
        trimesh.creation.box([1e-6, 1, 1]),
        trimesh.Trimesh(trimesh.creation.box().vertices, trimesh.creation.box().faces[:7]),
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False),
    ],
)
def test_inertia_is_possible_whatever_the_mesh(body):
    mass, center, inertia = mesh_inertial(body, scale=0.3)
    principal = np.linalg.eigvalsh(inertia)
    assert mass >= 1e-3 and principal[0] > 0 and principal[0] + principal[1] > principal[2]
    assert np.all(center >= body.bounds[0] * 0.3 - 1e-3) and np.all(
        center <= body.bounds[1] * 0.3 + 1e-3
    )


def test_inertia_of_a_block():
    mass, center, inertia = mesh_inertial(
        trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]]), scale=0.5
    )
    assert mass == pytest.approx(6 / 8 * 500)
    np.testing.assert_allclose(center, [0.25, 0.5, 0.75])
    expected = mass / 12 * np.diag([1 + 2.25, 0.25 + 2.25, 0.25 + 1])
    np.testing.assert_allclose(inertia, expected, rtol=1e-4)


# --- Reading what is sound -----------------------------------------------------------------------------------------------------


def test_origins_scales_and_primitives(load, tmp_path):
    trimesh.creation.box().export(tmp_path / "unit cube.stl")
    shapes = [
        '<visual><origin xyz="0 0 2" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="1" length="6"/></geometry></visual>',
        '<visual><origin xyz="0 5 0"/><geometry><sphere radius="0.5"/></geometry></visual>',
        '<visual><origin xyz="0 -5 0"/><geometry><mesh filename="unit%20cube.stl" scale="1 -2 3"/></geometry></visual>',
    ]
    obj = load(link("base", "".join(shapes)))
    np.testing.assert_allclose(obj.bounds, [[-3, -6, -1.5], [3, 5.5, 3]], atol=1e-6)
    assert obj.parts[0].mesh.is_volume and obj.provenance == ()


def test_joint_frames_are_followed(load):
    obj = load(
        link("base"),
        link("door"),
        link("knob"),
        joint(
            "revolute",
            "door",
            f'<origin xyz="0 2 0" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/>{limit(0, 1)}',
        ),
        joint("fixed", "knob", '<origin xyz="1 0 0"/>', parent="door"),
    )
    np.testing.assert_allclose(obj.parts[1].joint.origin, [0, 2, 0], atol=1e-9)
    np.testing.assert_allclose(obj.parts[1].joint.direction, [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(obj.parts[2].box[:3], [0, 3, 0], atol=1e-9)
    assert obj.parents == [-1, 0, 1] and obj.provenance == ()


def test_colours_of_urdf_mtl_and_texture_live_together(load, tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "objs").mkdir()
    Image.new("RGB", (4, 4), (10, 200, 30)).save(tmp_path / "images" / "t.png")
    quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
    (tmp_path / "objs" / "a.obj").write_text(
        f"mtllib a.mtl\n{quad}usemtl m\nf 1/1 2/2 3/3\nusemtl n\nf 3/1 2/2 1/3\n"
    )
    (tmp_path / "objs" / "a.mtl").write_text(
        "newmtl m\nmap_Kd ../images/t.png\nnewmtl n\nKd 1 0 0.5\n"
    )
    named = '<material name="blue"><color rgba="0 0 1 1"/></material>'
    obj = load(
        named,
        link(
            "base",
            mesh("objs/a.obj") + BOX.replace("</visual>", '<material name="blue"/></visual>'),
        ),
    )
    body = obj.parts[0].mesh
    colors = sample_color(body, np.arange(len(body.faces)), np.full((len(body.faces), 3), 1 / 3))
    expected = srgb_to_linear(np.array([[10, 200, 30], [255, 0, 128]]) / 255)
    found = sorted(map(tuple, colors[:2]))
    np.testing.assert_allclose(found, sorted(map(tuple, expected)), atol=6e-3)
    np.testing.assert_allclose(colors[2:], [[0, 0, 1]] * 12, atol=1e-5)
    assert obj.provenance == ()


def test_factors_of_gltf_are_linear(load, tmp_path):
    body = trimesh.creation.box()
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[128, 0, 255, 255])
    uv = np.zeros((len(body.vertices), 2))
    body.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    (tmp_path / "a.glb").write_bytes(body.export(file_type="glb"))
    read = load(link("base", mesh("a.glb"))).parts[0].mesh
    color = sample_color(read, np.array([0]), np.full((1, 3), 1 / 3))
    np.testing.assert_allclose(color, [[128 / 255, 0, 1]], atol=5e-3)


def test_package_addresses_are_found_in_the_folder(load, tmp_path):
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box().export(tmp_path / "meshes" / "b.stl")
    for uri in (
        "package://some_robot/meshes/b.stl",
        "file://meshes/b.stl",
        "meshes\\b.stl",
        "./meshes/../meshes/b.stl",
    ):
        assert len(load(link("base", mesh(uri))).parts) == 1


def test_a_folder_is_asked_for_its_urdf(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        load_object(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match="holds no URDF"):
        load_object(tmp_path)
    for name in ("x.urdf", "y.urdf"):
        (tmp_path / name).write_text(robot(link("base")))
        assert find_urdf(tmp_path / name).name == name
    with pytest.raises(ValueError, match="name one of them"):
        load_object(tmp_path)
    for name in ("mobility.urdf", "object.urdf"):
        (tmp_path / name).write_text(robot(link("base")))
        assert find_urdf(tmp_path).name == name


def test_links_without_a_mesh_are_collapsed(load):
    obj = load(
        link("world", ""),
        link("base"),
        link("frame", ""),
        link("door"),
        link("sensor", ""),
        joint("floating", "base", parent="world"),
        joint("revolute", "frame", f'<origin xyz="1 0 0"/><axis xyz="0 0 1"/>{limit(0, 1)}'),
        joint("fixed", "door", '<origin xyz="1 0 0"/>', parent="frame"),
        joint("planar", "sensor", parent="door"),
    )
    assert [p.name for p in obj.parts] == ["base", "door"]
    assert obj.parts[1].joint.type == "revolute"
    np.testing.assert_allclose(obj.parts[1].joint.origin, [1, 0, 0])
    np.testing.assert_allclose(obj.parts[1].box[:3], [2, 0, 0])
    assert notes(obj, "'world', 'frame', 'sensor'")


def test_siblings_on_a_moving_link_without_a_mesh_move_together(load):
    obj = load(
        link("base"), link("arm", ""), link("a"), link("b"),
        joint("prismatic", "arm", limit(0, 2)),
        joint("fixed", "a", '<origin xyz="0 3 0"/>', parent="arm"),
        joint("fixed", "b", '<origin xyz="0 6 0"/>', parent="arm"),
    )  # fmt: skip
    assert obj.parents == [-1, 0, 1] and [j.type for j in obj.joints] == [
        "fixed",
        "prismatic",
        "fixed",
    ]


def test_a_root_without_a_mesh_gives_way_to_its_largest_child(load):
    big = '<visual><geometry><box size="3 3 3"/></geometry></visual>'
    obj = load(
        link("base", ""), link("a"), link("b", big),
        joint("revolute", "a", limit(0, 1)), joint("revolute", "b", limit(0, 1)),
    )  # fmt: skip
    assert [p.name for p in obj.parts] == ["b", "a"] and obj.parents == [-1, 0]
    assert notes(obj, "held fixed") and notes(obj, "'b_joint'")


def two_joints(first: str, second: str) -> list[str]:
    return [link("base"), link("mid", ""), link("cap"), first, second]


def test_mimic_through_a_link_without_a_mesh_is_a_screw(load):
    obj = load(
        *two_joints(
            joint("revolute", "mid", f'<axis xyz="0 0 1"/>{limit(0, 20)}'),
            joint(
                "prismatic",
                "cap",
                f'<axis xyz="0 0 -1"/>{limit(-9, 9)}<mimic joint="mid_joint" multiplier="0.02"/>',
                "mid",
            ),
        )
    )
    cap = obj.parts[1].joint
    assert cap.type == "screw"
    np.testing.assert_allclose(cap.angle, (0, 20))
    np.testing.assert_allclose(cap.travel, (0, -0.4))
    assert notes(obj, "one screw") and not notes(obj, "degrees")


def test_a_prismatic_joint_may_drive_the_turn(load):
    obj = load(
        *two_joints(
            joint("prismatic", "mid", f'<axis xyz="0 0 1"/>{limit(0, 0.4)}'),
            joint(
                "continuous",
                "cap",
                '<axis xyz="0 0 1"/><mimic joint="mid_joint" multiplier="-50"/>',
                "mid",
            ),
        )
    )
    cap = obj.parts[1].joint
    np.testing.assert_allclose(cap.angle, (0, 20))
    np.testing.assert_allclose(cap.travel, (0, -0.4))
    np.testing.assert_allclose(cap.motion(20)[:3, 3], [0, 0, 0.4], atol=1e-12)


def test_independent_turn_and_travel_become_one_proportional_screw(load):
    obj = load(
        *two_joints(
            joint("revolute", "mid", f'<axis xyz="0 0 1"/>{limit(-1, 3)}'),
            joint("prismatic", "cap", f'<axis xyz="0 0 1"/>{limit(0, 0.2)}', "mid"),
        )
    )
    cap = obj.parts[1].joint
    np.testing.assert_allclose(cap.angle, (0, 4))
    np.testing.assert_allclose(cap.travel, (0, 0.2))
    assert notes(obj, "proportional screw")


@pytest.mark.parametrize(
    ("first", "second", "kind"),
    [
        (
            '"continuous" <axis xyz="0 0 1"/>',
            f'"prismatic" <axis xyz="0 0 1"/>{limit(0, 0.1)}',
            "continuous",
        ),
        (
            f'"revolute" <axis xyz="0 0 1"/>{limit(0, 0.1)}',
            f'"prismatic" <axis xyz="1 0 0"/>{limit(0, 3)}',
            "prismatic",
        ),
        (
            f'"revolute" <axis xyz="0 0 1"/>{limit(0, 2)}',
            f'"revolute" <axis xyz="1 0 0"/>{limit(0, 0.1)}',
            "revolute",
        ),
    ],
)
def test_what_is_no_screw_is_lowered_to_the_larger_motion(load, first, second, kind):
    (a, inner), (b, more) = (s[1:].split('" ', 1) for s in (first, second))
    obj = load(*two_joints(joint(a, "mid", inner), joint(b, "cap", more, "mid")))
    assert obj.parts[1].joint.type == kind
    assert notes(obj, "dropped beside")


def test_telescopic_rails_add_up(load):
    obj = load(
        *two_joints(
            joint("prismatic", "mid", f'<axis xyz="1 0 0"/>{limit(0, 0.3)}'),
            joint("prismatic", "cap", f'<axis xyz="-1 0 0"/>{limit(-0.4, 0)}', "mid"),
        )
    )
    np.testing.assert_allclose(obj.parts[1].joint.travel, (0, 0.7))
    assert notes(obj, "are one joint")


def test_a_mimic_of_another_link_is_independent_but_shown_where_it_belongs(load):
    obj = load(
        link("base"), link("a"), link("b"),
        joint("prismatic", "a", limit(1, 2)),
        joint("prismatic", "b", f'{limit(-9, 9)}<mimic joint="a_joint" multiplier="2" offset="1"/>'),
    )  # fmt: skip
    np.testing.assert_allclose([p.box[0] for p in obj.parts], [0, 1, 3])
    np.testing.assert_allclose(obj.parts[2].joint.travel, (-12, 6))
    assert notes(obj, "mimics 'a_joint' of another link")


# --- Repairs -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inner", "kind", "limits", "words"),
    [
        (f'<axis xyz="0 0 5"/>{limit(0, 1)}', "revolute", (0, 1), "has length 5"),
        (f'<axis xyz="0 0 0"/>{limit(0, 1)}', "fixed", (0, 0), "axis is zero"),
        (f'<axis xyz="None None None"/>{limit(0, 1)}', "fixed", (0, 0), "axis is zero"),
        (limit(1, -1), "revolute", (-1, 1), "swapped"),
        ("", "continuous", (-np.pi, np.pi), "without limits"),
        ('<limit effort="1" velocity="1"/>', "continuous", (-np.pi, np.pi), "without limits"),
        (limit(0, 90), "revolute", (0, np.pi / 2), "degrees"),
        (limit(0.5, 1), "revolute", (0, 0.5), "shown at 0.5"),
        (limit(-2, -0.5), "revolute", (-1.5, 0), "shown at -0.5"),
        (limit(0, 0.01), "fixed", (0, 0), "less than the dead zone"),
        (limit(0, 1) + '<mimic joint="nobody"/>', "revolute", (0, 1), "cannot drive it"),
    ],
)
def test_joints_are_repaired(load, inner, kind, limits, words):
    obj = load(link("base"), link("door"), joint("revolute", "door", inner))
    assert obj.parts[1].joint.type == kind
    np.testing.assert_allclose(obj.parts[1].joint.limits, limits, atol=1e-9)
    found = notes(obj, words)
    assert len(found) == 1 and "'door_joint'" in found[0] and len(obj.provenance) == 1


def test_a_joint_clamped_to_its_limit_is_shown_there(load):
    obj = load(link("base"), link("drawer"), joint("prismatic", "drawer", limit(2, 3)))
    np.testing.assert_allclose(obj.parts[1].box[:3], [2, 0, 0])
    obj = load(
        link("base"),
        link("door"),
        joint("revolute", "door", '<origin xyz="0 0 1"/><axis xyz="0 0 1"/>' + limit(1, 2)),
    )
    corner = obj.parts[1].mesh.vertices.max(0)[0]
    assert corner == pytest.approx(0.5 * (np.cos(1) + np.sin(1)))


def test_a_prismatic_joint_without_limits_gets_its_parts_length(load):
    obj = load(link("base"), link("drawer"), joint("prismatic", "drawer"))
    np.testing.assert_allclose(obj.parts[1].joint.travel, (-0.5, 0.5))
    assert notes(obj, "prismatic without limits")


def test_cyclic_mimics_are_independent(load):
    obj = load(
        link("base"), link("a"), link("b"),
        joint("revolute", "a", limit(0, 1) + '<mimic joint="b_joint"/>'),
        joint("revolute", "b", limit(0, 1) + '<mimic joint="a_joint"/>'),
    )  # fmt: skip
    assert [j.type for j in obj.joints[1:]] == ["revolute", "revolute"]
    assert len(notes(obj, "cannot drive it")) == 2


def test_names_that_repeat_are_told_apart_where_that_is_possible(load, refuse):
    obj = load(
        link("base"),
        link("knob"),
        link("knob"),
        joint("fixed", "knob"),
        joint("fixed", "knob", '<origin xyz="5 0 0"/>'),
    )
    assert [p.name for p in obj.parts] == ["base", "knob", "knob_2"]
    assert obj.parts[2].box[0] == 5 and notes(obj, "had this name") and notes(obj, "renamed")
    assert "2 links are named 'a'" in refuse(link("a"), link("a"))


def test_harmless_faults_of_the_xml_are_passed_over(load):
    obj = load(f'<?xml version="0.0"?>{robot("<gz:plugin/>", link("a b"), link("unused", ""))}')
    assert obj.parts[0].name == "a b"
    assert notes(obj, "XML") and notes(obj, "'unused'")


def test_missing_meshes(load, refuse):
    obj = load(link("base", mesh("gone.glb") + BOX))
    assert notes(obj, "link 'base': mesh 'gone.glb' is missing; left out")
    collision = BOX.replace("visual", "collision")
    assert notes(
        load(link("base", mesh("gone.glb") + collision)), "shown by its collision geometry"
    )
    line = refuse(link("base"), link("door", mesh("gone.obj")), joint("fixed", "door"))
    assert "link 'door'" in line and "'gone.obj' is missing" in line
    assert "package://x/y.dae" in refuse(link("base", mesh("package://x/y.dae")))
    assert "no link has a mesh" in refuse(link("base", ""))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", b"", "no faces"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "'a.obj'"),
        ("a.stl", b"solid nothing", "'a.stl'"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "'a.ply'"),
        ("a.glb", b"glTF\0\0\0\0", "cannot be read as GLB"),
        ("a.dae", b'<!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>', "document type"),
        ("a.txt", b"hello", "format '.txt'"),
    ],
)
def test_broken_meshes(refuse, load, tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    line = refuse(link("base", mesh(name)))
    assert words in line and "link 'base'" in line
    assert notes(load(link("base", mesh(name) + BOX)), "left out")


@pytest.mark.parametrize(("old", "new"), [("<f4", np.nan), ("<u4", 99)])
def test_faces_at_nowhere_are_left_out(load, tmp_path, old, new):
    body = trimesh.creation.box()
    data = bytearray(body.export(file_type="glb"))
    first = body.vertices[0, 0] if old == "<f4" else body.faces
    place = data.find(np.asarray(first).astype(old).tobytes())
    data[place : place + 4] = np.array(new).astype(old).tobytes()
    (tmp_path / "a.glb").write_bytes(data)
    obj = load(link("base", mesh("a.glb")))
    np.testing.assert_allclose(obj.bounds, body.bounds, atol=1e-6)
    assert notes(obj, "non-finite or absent vertices")


def test_textures_that_are_absent_or_broken_leave_the_urdf_colour(load, tmp_path):
    quad = (
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.obj").write_text(quad)
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    red = mesh("a.obj").replace(
        "</visual>", '<material name="r"><color rgba="1 0 0 1"/></material></visual>'
    )
    for content, words in (
        (None, "'t.png' is missing"),
        (b"not an image", "'t.png' is not an image"),
    ):
        if content is not None:
            (tmp_path / "t.png").write_bytes(content)
        obj = load(link("base", red))
        np.testing.assert_allclose(
            sample_color(obj.parts[0].mesh, [0], np.full((1, 3), 1 / 3)), [[1, 0, 0]], atol=1e-5
        )
        assert notes(obj, words)


# --- Refusals ------------------------------------------------------------------------------------------------------------------


def test_nothing_outside_the_folder_is_read(tmp_path, monkeypatch):
    """Meshes by ``..``, absolute paths, links and packages; MTLs and textures of a mesh inside."""
    inside, outside = tmp_path / "asset", tmp_path / "other"
    inside.mkdir()
    outside.mkdir()
    trimesh.creation.box().export(outside / "b.stl")
    Image.new("RGB", (2, 2), (255, 0, 0)).save(outside / "t.png")
    (inside / "link.stl").symlink_to(outside / "b.stl")
    (inside / "a").mkdir()
    (inside / "folder").symlink_to(outside)
    path = inside / "object.urdf"
    opened = []
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda self: opened.append(str(self)) or read(self))
    for uri in (
        "../other/b.stl",
        str(outside / "b.stl"),
        f"file://{outside}/b.stl",
        "link.stl",
        "folder/b.stl",
        "a/../../other/b.stl",
    ):
        path.write_text(robot(link("base", mesh(uri))))
        with pytest.raises(
            ValueError, match="outside the asset's folder; allow_outside=True"
        ) as caught:
            load_object(inside)
        assert uri in str(caught.value) and "link 'base'" in str(caught.value) and not opened
        assert len(load_object(path, allow_outside=True).parts) == 1
        opened.clear()
    path.write_text(robot(link("base", mesh("package://other/b.stl"))))
    with pytest.raises(ValueError, match=r"is missing \(allow_outside=True"):
        load_object(path)
    assert len(load_object(path, allow_outside=True).parts) == 1

    (inside / "a.obj").write_text(
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    path.write_text(robot(link("base", mesh("a.obj"))))
    for texture in ("../other/t.png", "folder/t.png", str(outside / "t.png")):
        (inside / "a.mtl").write_text(f"newmtl m\nmap_Kd {texture}\n")
        obj = load_object(path)
        material = getattr(obj.parts[0].mesh.visual, "material", None)
        assert getattr(material, "image", None) is None
        assert notes(obj, "outside the asset's folder and was not read")
        image = load_object(path, allow_outside=True).parts[0].mesh.visual.material.image
        assert image.getpixel((0, 0)) == (255, 0, 0)


def test_networks_are_never_asked(refuse):
    assert "never fetched" in refuse(link("base", mesh("https://example.org/a.stl")))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty"),
        ("  \n ", "the file is empty"),
        ("hello", "not XML"),
        ("<robot><link name='a'>", "not XML"),
        ("<mujoco/>", "<mujoco>"),
        ("<sdf version='1.6'/>", "<sdf>"),
        ("<robot name='a'/>", "no <link>"),
        ('<robot xmlns:xacro="x"><xacro:include/></robot>', "xacro"),
        (
            '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>',
            "document type",
        ),
        (
            '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot>&a;</robot>',
            "document type",
        ),
        ('<!DOCTYPE r SYSTEM "http://example.org/r.dtd"><robot/>', "document type"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_what_is_no_urdf(tmp_path, text, words, encoding):
    path = tmp_path / "a.urdf"
    path.write_bytes(text.encode(encoding) if text else b"")
    if encoding == "utf-16" and words in ("the file is empty",):
        return
    with pytest.raises(ValueError, match=words) as caught:
        load_object(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("elements", "words"),
    [
        (
            [
                link("a"),
                link("b"),
                joint("fixed", "b", parent="a"),
                joint("fixed", "a", parent="b"),
            ],
            "cycle through link",
        ),
        ([link("base"), joint("fixed", "base")], "cycle through link 'base'"),
        ([link("a"), link("b")], "two roots: links 'a' and 'b'"),
        (
            [
                link("a"),
                link("b"),
                link("c"),
                joint("fixed", "c", parent="a"),
                joint("fixed", "c", parent="b"),
            ],
            "two parents",
        ),
        ([link("base"), joint("fixed", "door")], "no link 'door'"),
        (
            [link("base"), "<joint name='j' type='fixed'><parent link='base'/></joint>"],
            "names no child",
        ),
        ([link("base"), link("a"), joint("bendy", "a")], "unknown type 'bendy'"),
        ([link("base"), link("a"), joint("planar", "a")], "'a_joint' is planar"),
        ([link("base"), link("a"), joint("floating", "a")], "'a_joint' is floating"),
        ([link("base"), link("a"), joint("spherical", "a")], "'a_joint' is spherical"),
        (
            [link("base"), link("a"), joint("revolute", "a", limit(0, float("inf")))],
            "'a_joint': upper='inf'",
        ),
        (
            [link("base"), link("a"), joint("revolute", "a", '<axis xyz="0 1"/>')],
            "'a_joint': xyz='0 1'",
        ),
        (
            [link("base"), link("a"), joint("revolute", "a", '<origin xyz="a b c"/>')],
            "3 finite numbers",
        ),
        ([link("base", BOX.replace("1 1 1", "1 0 1"))], "sizes of its box must be positive"),
        ([link("base", BOX.replace("1 1 1", "1 1"))], "link 'base': size='1 1'"),
        ([link("base", mesh(""))], "names no file"),
        ([link("base", BOX.replace("box", "torus"))], "unknown geometry <torus>"),
        ([link("")], "has no name"),
    ],
)
def test_what_cannot_be_repaired_is_named(refuse, elements, words):
    assert words in refuse(*elements)


def test_what_is_too_large_is_refused(refuse, tmp_path, monkeypatch):
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "a.stl")
    monkeypatch.setattr(urdf_mesh, "MAX_FACES", 2000)
    assert "more than 2,000 faces" in refuse(link("base", mesh("a.stl") * 2))
    monkeypatch.setattr(urdf_mesh, "MAX_MESH_BYTES", 1000)
    assert "'a.stl': it has more than" in refuse(link("base", mesh("a.stl")))
    assert "MiB, more than the 16" in refuse(robot(link("base"), "<!--", "x" * (17 * 2**20), "-->"))


def test_huge_images_are_not_decoded(load, tmp_path, monkeypatch):
    monkeypatch.setattr(urdf_mesh, "MAX_PIXELS", 10)
    body = trimesh.creation.box()
    image = Image.new("RGB", (8, 8), (9, 9, 9))
    uv = np.zeros((len(body.vertices), 2))
    body.visual = trimesh.visual.TextureVisuals(
        uv=uv, material=trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    )
    (tmp_path / "a.glb").write_bytes(body.export(file_type="glb"))
    assert notes(load(link("base", mesh("a.glb"))), "too large")


def test_a_png_in_memory_is_not_a_urdf(tmp_path):
    buffer = io.BytesIO()
    Image.new("RGB", (2, 2)).save(buffer, "PNG")
    (tmp_path / "a.urdf").write_bytes(buffer.getvalue())
    with pytest.raises(ValueError, match="not XML"):
        load_object(tmp_path)


# --- Real files ----------------------------------------------------------------------------------------------------------------

REFUSED = {"hinge.urdf": "is spherical"}


@pytest.mark.skipif(not (SHARED / "real").is_dir(), reason="../shared/real is not here")
def test_every_real_file_is_an_object_or_one_line():
    found = sorted((SHARED / "real").rglob("*.urdf"))
    assert found
    for path in found:
        try:
            load_object(path)
        except ValueError as error:
            words = REFUSED.get(path.name, "allow_outside=True")
            assert words in str(error) and "\n" not in str(error)
        if path.name in REFUSED:
            with pytest.raises(ValueError, match=REFUSED[path.name]):
                load_object(path, allow_outside=True)
            continue
        obj = load_object(path, allow_outside=True).normalized()
        assert np.isfinite(obj.bounds).all()
        assert len(obj.provenance) == len(set(obj.provenance))
        obj.forward_kinematics(obj.open())


@pytest.mark.skipif(not (SHARED / "malformed").is_dir(), reason="../shared/malformed is not here")
def test_every_malformed_mesh_is_an_object_or_one_line(tmp_path):
    path = tmp_path / "a.urdf"
    for file in sorted((SHARED / "malformed" / "meshes").iterdir()):
        path.write_text(robot(link("base", mesh(str(file)))))
        try:
            obj = load_object(path, allow_outside=True)
        except ValueError as error:
            assert (
                file.name in str(error) and "link 'base'" in str(error) and "\n" not in str(error)
            )
        else:
            body = obj.parts[0].mesh
            assert np.isfinite(
                sample_color(body, np.arange(len(body.faces)), np.full((len(body.faces), 3), 1 / 3))
            ).all()
