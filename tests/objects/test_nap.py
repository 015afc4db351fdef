"""NAP's objects: graphs as NAP pickles them, through the exporter that runs in its environment."""

from __future__ import annotations

import ast
import io
import itertools
import pickle
import subprocess
import sys
from pathlib import Path

import networkx
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from urdf_texts import notes

from uniart_jax.objects.load import load_object
from uniart_jax.objects.nap import LEAST_RANGE, MAX_ARRAYS

EXPORT = Path(__file__).parents[2] / "tools" / "export_nap.py"
# y up, front +z -> z up, front -x (PartNet-Mobility's base joint)
TURN = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])


def screw(plucker, theta, d) -> np.ndarray:
    """NAP's ``screw_to_T``."""
    axis, moment = plucker[:3], plucker[3:]
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(theta * axis).as_matrix()
    matrix[:3, 3] = (np.eye(3) - matrix[:3, :3]) @ np.cross(axis, moment) + axis * d
    return matrix


def graph() -> networkx.Graph:
    """As NAP's ``get_G_from_VE`` and ``extract_recon_mesh_for_nodes``; node 1 is the largest.

    Edges: 0-1 a hinge whose ``src`` is the child, 1-2 a drawer, 1-3 both, 0-4 nothing that moves.
    """
    made = networkx.Graph()
    boxes = [(0.4, 0.3, 0.05), (0.5, 0.6, 0.4), (0.3, 0.1, 0.3), (0.05, 0.1, 0.05), (0.02,) * 3]
    places = [(0, 0.2, 0.45), (0, 0, 0), (0, -0.3, 0.1), (0.1, 0.7, 0.1), (0.2, 0.2, 0.52)]
    turns = [(0, 0.1, 0), (0, 0, 0), (0, 0, 0), (0.3, 0, 0.2), (0, 0, 0)]
    for k, (box, place, turn) in enumerate(zip(boxes, places, turns, strict=True)):
        made.add_node(
            k,
            vid=k,
            bbox=np.array(box, np.float32),
            R=Rotation.from_rotvec(turn).as_matrix(),
            t=np.array(place, np.float32),
            color=np.ones(4),
            additional=np.zeros(128),
        )
        if k != 4:
            made.nodes[k]["mesh"] = trimesh.creation.box(2 * np.array(box))
    line = Rotation.from_rotvec((0.2, 0.1, 0.3)).apply([0, 1, 0])
    lines = [(0, -1, 0), (0, 0, 1), line, (1, 0, 0)]
    points = [(0.35, 0, 0.02), (0.1, 0, 0), (0.05, 0.6, 0.1), (0, 0, 0)]
    ranges = [(0, 1.5, 0, 0.001), (0, 0.002, -0.1, 0.4), (-0.5, 1.0, -0.1, 0.2), (0, 0, 0, 0)]
    for (i, j), axis, point, span in zip(
        [(0, 1), (1, 2), (1, 3), (0, 4)], lines, points, ranges, strict=True
    ):
        plucker = np.concatenate([axis, np.cross(point, axis)])
        made.add_edge(
            i, j, src=i, dst=j, plucker=plucker, rlim=np.array(span[:2]), plim=np.array(span[2:])
        )
    return made


def poses(made: networkx.Graph, state: dict) -> dict[int, np.ndarray]:
    """Node to object at ``state`` {(src, dst): (theta, d)}, as NAP's ``forward_G``."""

    def place(node):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = made.nodes[node]["R"], made.nodes[node]["t"]
        return matrix

    found = {1: place(1)}
    for parent, child in networkx.bfs_edges(made, 1):
        edge = made.edges[parent, child]
        src, dst = edge["src"], edge["dst"]
        between = screw(edge["plucker"], *state[src, dst]) @ np.linalg.inv(place(src)) @ place(dst)
        found[child] = found[parent] @ (between if src == parent else np.linalg.inv(between))
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("nap")
    (root / "G").mkdir()
    alone = networkx.Graph()  # what get_G_from_VE gives where it finds less than two parts
    loop = graph()
    loop.add_edge(2, 3, src=2, dst=3, plucker=np.eye(6)[0], rlim=[0, 1], plim=[0, 0])
    for name, made in (("gen_0", graph()), ("gen_1", alone), ("gen_2", loop)):
        (root / "G" / f"{name}.pkl").write_bytes(pickle.dumps(made))
    (root / "G" / "gen_3.pkl").write_bytes(b"no pickle")
    # without our package: NAP's environment does not have it
    done = subprocess.run(
        [sys.executable, "-I", EXPORT, root / "G", root / "out"],
        capture_output=True,
        text=True,
        cwd=root,
    )
    assert done.returncode == 0, done.stderr
    for name in ("gen_1", "gen_2", "gen_3"):
        assert f"{name}.pkl" in done.stderr and not list((root / "out" / name).iterdir())
    assert "not one tree of at least two parts" in done.stderr
    return root / "out"


def test_the_exporter_names_no_module_of_ours():
    tree = ast.parse(EXPORT.read_text())
    names = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    own = {"numpy", "networkx", "trimesh"} | set(sys.stdlib_module_names)
    assert set(names) <= own and not [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]


def test_parts_tree_and_joint_types(folder):
    obj = load_object(folder / "gen_0")
    assert len(obj.parts) == 5 and obj.parts[0].name == "part_0"
    root, *others = obj.parts
    np.testing.assert_allclose(root.box[3:], 2 * np.abs(TURN @ [0.5, 0.6, 0.4]), atol=1e-6)
    kinds = {tuple(sorted(j.type for j in p.chain)) for p in others}
    assert kinds == {("revolute",), ("prismatic",), ("prismatic", "revolute"), ("fixed",)}
    assert notes(obj, "it had no mesh; shown by its box")
    lowered = obj.single_jointed()
    assert sorted(j.type for j in lowered.joints) == [
        "fixed",
        "fixed",
        "prismatic",
        "revolute",
        "screw",
    ]
    assert notes(lowered, "its independent turn and travel were lowered to one proportional screw")


@pytest.mark.parametrize(("theta", "d"), [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.4, 0.7)])
def test_parts_move_as_nap_moves_them(folder, theta, d):
    """Every part at shares of its ranges, turn and travel apart, where NAP's formula has it."""
    made, obj = graph(), load_object(folder / "gen_0")
    state = {}
    for _, _, edge in made.edges(data=True):
        (r0, r1), (p0, p1) = edge["rlim"], edge["plim"]
        turn = r0 + theta * (r1 - r0) if r1 - r0 > LEAST_RANGE else 0.0
        state[edge["src"], edge["dst"]] = turn, p0 + d * (p1 - p0) if p1 - p0 > LEAST_RANGE else 0.0
    expected = poses(made, state)
    order = list(networkx.dfs_preorder_nodes(made, 1))
    moved = [np.eye(4) for _ in obj.parts]
    for k, part in enumerate(obj.parts):
        if part.parent >= 0:
            moved[k] = moved[part.parent]
            for joint in part.chain:
                lo, hi = joint.limits
                moved[k] = moved[k] @ joint.motion(lo + (theta if joint.rotates else d) * (hi - lo))
        node = order[int(part.name.removeprefix("part_"))]
        mesh = made.nodes[node].get("mesh") or trimesh.creation.box(2 * made.nodes[node]["bbox"])
        theirs = trimesh.transform_points(mesh.vertices, expected[node]) @ TURN.T
        ours = trimesh.transform_points(part.mesh.vertices, moved[k])
        for a, b in ((ours, theirs), (theirs, ours)):  # in any order
            assert cKDTree(a).query(b)[0].max() < 1e-5, part.name


def test_graphs_that_have_z_up(folder, tmp_path):
    (tmp_path / "G").mkdir()
    made = graph()
    (tmp_path / "G" / "gen_0.pkl").write_bytes(pickle.dumps(made))
    subprocess.run(
        [sys.executable, EXPORT, tmp_path / "G", tmp_path / "out", "--up", "z"], check=True
    )
    obj, other = load_object(tmp_path / "out" / "gen_0"), load_object(folder / "gen_0")
    for part, same in itertools.zip_longest(obj.parts, other.parts):
        np.testing.assert_allclose(part.mesh.vertices @ TURN.T, same.mesh.vertices, atol=1e-6)
        if same.joint.type != "fixed":
            direction = part.joint.direction @ TURN.T
            np.testing.assert_allclose(direction, same.joint.direction, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"parents": None}, "it has no array 'parents' (tools/export_nap.py writes it)"),
        ({"parents": [-1, 7]}, "array 'parents' names a part that is not there (0 to 1)"),
        ({"parents": [-1.0, 0.0]}, "array 'parents' should be [2] of kind 'iu', got [2] float64"),
        ({"plucker": np.zeros((2, 3))}, "array 'plucker' should be [2, 6]"),
        ({"rotation": np.full((2, 2), np.nan)}, "'rotation' holds numbers that are not finite"),
        ({"parents": np.array([-1, {}], object)}, "Object arrays cannot be loaded"),
        ({"parents": [1, 0]}, "the joints form a cycle"),
        ({"plucker": np.zeros((MAX_ARRAYS // 8, 2))}, "its arrays have more than 64 MiB"),
    ],
)
def test_what_is_no_object_of_nap_is_said_in_one_line(tmp_path, change, said):
    arrays = {
        "parents": [-1, 0],
        "plucker": np.tile(np.eye(6)[1], (2, 1)),
        "rotation": np.tile([0.0, 1], (2, 1)),
        "travel": np.zeros((2, 2)),
    }
    arrays = {k: v for k, v in (arrays | change).items() if v is not None}
    np.savez_compressed(tmp_path / "nap.npz", **arrays)
    for k in range(2):
        trimesh.creation.box().export(tmp_path / f"part-{k}.ply")
    with pytest.raises(ValueError) as caught:
        load_object(tmp_path)
    assert said in str(caught.value) and "nap.npz: " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bytes_that_are_no_npz(tmp_path):
    np.savez_compressed(tmp_path / "nap.npz", parents=np.arange(2000) % 7)
    whole = bytearray((tmp_path / "nap.npz").read_bytes())
    whole[90] ^= 0xFF  # within what is compressed
    header = io.BytesIO()
    np.save(header, np.zeros(2))
    for data in (b"", b"PK\x03\x04broken", bytes(whole), header.getvalue() + bytes(whole)):
        (tmp_path / "nap.npz").write_bytes(data)
        with pytest.raises(ValueError, match=r"nap\.npz: it is not an npz that can be read"):
            load_object(tmp_path)
