"""NAP's generated objects as files that ``uniart evaluate`` reads: a folder an object, with
``nap.npz`` and ``part-<k>.ply``.

    python tools/export_nap.py log/test/G/K_8_cate_all_v6.1_5455 predictions/nap

Runs in NAP's own environment, of which it needs numpy, networkx and trimesh alone; it does not
import uniart_jax, and the other way round no pickle is opened. **A pickle can run any code: give
this script only graphs that you made yourself.**

NAP (github.com/JiahuiLei/NAP, ``eval/save_viz_utils.py``) saves one ``networkx.Graph`` an object,
``<name>.pkl``: nodes with ``bbox`` [3] (half sides), ``R`` [3, 3] and ``t`` [3] (node to object)
and ``mesh`` in the node's frame; edges with ``src``, ``dst``, ``plucker`` [6] = (l, m) in the frame
of ``src``, ``rlim`` (radians) and ``plim``. Its ``sample_pcl.py`` moves ``dst`` by the screw
R(l, theta), t = (1 - R)(l x m) + l d against ``src``; the root is the node with the largest box,
and where an edge points towards the root the motion is inverted. Here every line is written in the
object's frame at theta = d = 0, negated where the edge points towards the root: the same motion.

Which axis is up is inferred, not known: NAP's code does not say it, its preprocessing is not
public, and no graph of its checkpoint has been seen here. Its renderer takes y for up, which is
PartNet-Mobility's own frame (front +z), so that is the default. ``--up z`` is for graphs in the
frame of PartNet-Mobility's URDFs (z up, front -x). Look at one exported object (``uniart view``)
before you measure: if it lies on its back, export again with the other.

NAP generates without an image, so its names (``gen_12``) are no reference's: rename the folders to
what they are held against. The image-conditioned NAP-ICA of the paper's Table 1 has no public code.
"""

import argparse
import pathlib
import pickle
import sys

import networkx
import numpy
import trimesh

# PartNet-Mobility's URDF frame (z up, front -x) to its own (y up, front +z)
FROM_Z_UP = numpy.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])


def placed(data):
    """[4, 4] node to object."""
    matrix = numpy.eye(4)
    matrix[:3, :3], matrix[:3, 3] = data["R"], data["t"]
    return matrix


def line_in_object(plucker, frame):
    """[6] a line (l, m) of a node's frame [4, 4] in the object's, its direction of length 1."""
    length = numpy.linalg.norm(plucker[:3])
    if length < 1e-6:
        return numpy.zeros(6)
    direction, moment = plucker[:3] / length, plucker[3:] / length
    point = frame[:3, :3] @ numpy.cross(direction, moment) + frame[:3, 3]
    direction = frame[:3, :3] @ direction
    return numpy.concatenate([direction, numpy.cross(point, direction)])


def convert(graph, turn):
    """Arrays and meshes of a graph, parents before children.

    Args:
      graph: NAP's.
      turn: [3, 3] its frame to y up, front +z.

    Raises:
      ValueError: it is not one tree of at least two parts.
    """
    if len(graph) < 2 or not networkx.is_tree(graph):
        raise ValueError(f"not one tree of at least two parts ({len(graph)} nodes)")
    whole = numpy.eye(4)
    whole[:3, :3] = turn
    root = max(graph.nodes, key=lambda n: float(numpy.prod(graph.nodes[n]["bbox"])))
    order = list(networkx.dfs_preorder_nodes(graph, root))
    above = networkx.predecessor(graph, root)
    count = len(order)
    arrays = {
        "parents": numpy.full(count, -1),
        "plucker": numpy.zeros((count, 6)),
        "rotation": numpy.zeros((count, 2)),
        "travel": numpy.zeros((count, 2)),
        "boxed": numpy.zeros(count, bool),
    }
    meshes = []
    for k, node in enumerate(order):
        data = graph.nodes[node]
        frame = whole @ placed(data)
        mesh = data.get("mesh")
        arrays["boxed"][k] = mesh is None
        if mesh is None:
            mesh = trimesh.creation.box(2 * numpy.asarray(data["bbox"], float))
        vertices = numpy.asarray(mesh.vertices) @ frame[:3, :3].T + frame[:3, 3]
        meshes.append(trimesh.Trimesh(vertices, mesh.faces, process=False))
        if node == root:
            continue
        parent = above[node][0]
        edge = graph.edges[parent, node]
        source = whole @ placed(graph.nodes[edge["src"]])
        line = line_in_object(numpy.asarray(edge["plucker"], float), source)
        arrays["parents"][k] = order.index(parent)
        arrays["plucker"][k] = line if edge["src"] == parent else -line
        arrays["rotation"][k], arrays["travel"][k] = edge["rlim"], edge["plim"]
    return arrays, meshes


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("graphs", type=pathlib.Path, help="folder of <name>.pkl that you made")
    parser.add_argument("out", type=pathlib.Path, help="folder that gets <name>/nap.npz")
    parser.add_argument(
        "--up",
        choices=("y", "z"),
        default="y",
        help="axis that is up in the graphs; y is inferred from NAP's renderer, "
        "not known: look at one object (uniart view), else give z",
    )
    given = parser.parse_args()
    files = sorted(given.graphs.glob("*.pkl"))
    if not files:
        sys.exit(f"{given.graphs}: no <name>.pkl in it; give what gen_diffusion.ipynb writes")
    turn = FROM_Z_UP if given.up == "z" else numpy.eye(3)
    for file in files:
        folder = given.out / file.stem
        folder.mkdir(parents=True, exist_ok=True)  # empty where it fails: counted as a failure
        try:
            with file.open("rb") as opened:
                arrays, meshes = convert(pickle.load(opened), turn)
        except (ValueError, KeyError, EOFError, pickle.UnpicklingError) as error:
            why = f"no {error}" if isinstance(error, KeyError) else error
            print(f"{file}: {why}; left empty", file=sys.stderr)
            continue
        for k, mesh in enumerate(meshes):
            mesh.export(str(folder / f"part-{k}.ply"))
        numpy.savez(folder / "nap.npz", **arrays)
    print(given.out)


if __name__ == "__main__":
    main()
