"""Assemblies: random trees of boxes, plates, rods and rounds with every type of joint, so that no
category gives a joint away.

A part sits on a face of its parent, hinges there, turns on a pin, slides along it, is a piston or a
screw in a bore or a drawer in a pocket. The same shapes serve for every joint; what tells joints
apart is what a mechanic would look at (pins, barrels, rails, bores), and that is shown in most
cases but not in all. The parts are in ``assembly_parts``.
"""

from __future__ import annotations

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural.assembly_parts import (
    drawer,
    flap,
    make_solid,
    piston,
    random_finish,
    random_material,
    sliding,
    turning,
)
from uniart_jax.procedural.fitting import Candidate, Piece, host_with
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Assembly, Shape

TRIES = 12  # a part
MANNERS = {
    "turn": 0.15, "arm": 0.13, "flap": 0.2, "slide": 0.17, "piston": 0.3, "drawer": 0.15
}  # fmt: skip
FACES = {(0, -1): 3.0, (2, 1): 2.5, (1, -1): 1.5, (1, 1): 1.5, (0, 1): 0.15, (2, -1): 0.3}


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A random assembly, metres, all joints at the end of their range where they begin.

    Solids that touch along an edge or at a point come apart when a reader merges equal vertices:
    such a one is drawn again.
    """
    while True:
        obj = _draw(rng)
        merged = (trimesh.Trimesh(p.mesh.vertices, p.mesh.faces, process=True) for p in obj.parts)
        if all(mesh.is_watertight for mesh in merged):
            return obj


def _draw(rng: np.random.Generator) -> ArticulatedObject:
    count = int(rng.choice(np.arange(2, 10), p=[0.1, 0.16, 0.18, 0.17, 0.14, 0.11, 0.08, 0.06]))
    palette = [random_material(rng) for _ in range(int(rng.integers(1, 5)))]
    pieces = [_root(rng, palette)]
    solids = [pieces[0].solid]
    for _ in range(TRIES * count):
        if len(pieces) == count:
            break
        found = _grow(rng, pieces, palette)
        if found is not None and (host := host_with(pieces, solids, found)) is not None:
            pieces[found.piece.parent] = host
            solids[found.piece.parent] = host.solid
            pieces.append(found.piece)
            solids.append(found.piece.solid)
    size = float(np.exp(rng.uniform(np.log(0.08), np.log(1.5))))
    matrix = np.eye(4) * [size, size, size, 1]
    asm = Assembly()
    for piece in pieces:
        shape = Shape()
        for solid, material in piece.solids:
            shape.add(solid.scale((size, size, size)), material)
        asm.add("part", shape, piece.parent, piece.joint.transformed(matrix))
    return asm.object()


def _root(rng: np.random.Generator, palette: list[Material]) -> Piece:
    """The part that all stands on: a block, a slab, a post, a frame, a tray."""
    kind = str(rng.choice(["block", "slab", "post", "wall"], p=[0.4, 0.25, 0.15, 0.2]))
    size = {
        "block": rng.uniform(0.4, 1.0, 3),
        "slab": np.array([*rng.uniform(0.5, 1.0, 2), rng.uniform(0.06, 0.2)]),
        "post": np.array([*rng.uniform(0.12, 0.35, 2), rng.uniform(0.6, 1.0)]),
        "wall": np.array([rng.uniform(0.08, 0.25), *rng.uniform(0.5, 1.0, 2)]),
    }[kind]
    lo, hi = -size / 2, size / 2
    form = str(rng.choice(["box", "round", "frame", "tray"], p=[0.66, 0.18, 0.08, 0.08]))
    if form == "tray" and kind != "block":
        form = "box"
    solid = make_solid(rng, lo, hi, form, 2)
    return Piece(lo, hi, [(solid, random_finish(rng, palette))], -1, Joint.fixed())


def _grow(rng, pieces: list[Piece], palette) -> Candidate | None:
    """A candidate part; None if what was drawn cannot be."""
    weights = np.array([1.0 if k == 0 else 0.6 for k in range(len(pieces))])
    parent = int(rng.choice(len(pieces), p=weights / weights.sum()))
    seat = pieces[parent]
    faces = list(FACES)
    shares = np.array(list(FACES.values()))
    i, s = faces[rng.choice(len(faces), p=shares / shares.sum())]
    names = list(MANNERS)
    manner = names[
        rng.choice(len(names), p=np.array(list(MANNERS.values())) / sum(MANNERS.values()))
    ]
    room = seat.hi - seat.lo
    if np.delete(room, i).min() < 0.07:
        return None
    make = {
        "turn": turning,
        "arm": turning,
        "flap": flap,
        "slide": sliding,
        "piston": piston,
        "drawer": drawer,
    }
    more = {"arm": True} if manner == "arm" else {}
    return make[manner](rng, seat, parent, i, s, palette, **more)
