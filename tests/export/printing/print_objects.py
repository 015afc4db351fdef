"""Small objects to print, made by hand; object units, about 1 long."""

from __future__ import annotations

import functools

import numpy as np
import trimesh

from uniart_jax.export.placement import place
from uniart_jax.export.printing.build import Print, make_print
from uniart_jax.export.printing.settings import PrintSettings
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def box(lo, hi) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[lo, hi])


def shell(lo, hi, wall: float) -> trimesh.Trimesh:
    """A box open towards -x."""
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    inner = box(lo + [-wall, wall, wall], hi - wall)
    return trimesh.boolean.difference([box(lo, hi), inner], engine="manifold")


def door_box() -> ArticulatedObject:
    """A cupboard whose door is hung at its front left edge and has a fixed handle."""
    return ArticulatedObject(
        (
            Part("body", shell([-0.3, -0.4, 0.0], [0.3, 0.4, 1.0], 0.03)),
            Part(
                "door",
                box([-0.335, -0.4, 0.01], [-0.303, 0.4, 0.99]),
                0,
                Joint([-0.335, 0.4, 0.5], [0, 0, -1], (0.0, 1.7)),
            ),
            Part("handle", box([-0.37, -0.36, 0.4], [-0.335, -0.33, 0.6]), 1),
        ),
        name="door box",
    )


def drawer_box(beside: float = 0.01) -> ArticulatedObject:
    """A case with one drawer, ``beside`` from its walls."""
    case = shell([-0.4, -0.3, 0.0], [0.4, 0.3, 0.5], 0.03)
    wide = 0.27 - beside
    drawer = trimesh.boolean.difference(
        [
            box([-0.4, -wide, 0.04], [0.3, wide, 0.46]),
            box([-0.37, -wide + 0.03, 0.07], [0.27, wide - 0.03, 1.0]),
        ],
        engine="manifold",
    )
    slide = Joint([0, 0, 0], [-1, 0, 0], (0.0, 0.0), (0.0, 0.4))
    return ArticulatedObject((Part("case", case), Part("drawer", drawer, 0, slide)), name="drawers")


def knob_box(radius: float = 0.08) -> ArticulatedObject:
    """A hollow box with a knob on its front that turns all round."""
    body = trimesh.boolean.difference(
        [box([-0.3, -0.5, 0.0], [0.3, 0.5, 0.6]), box([-0.27, -0.47, 0.03], [0.27, 0.47, 0.57])],
        engine="manifold",
    )
    knob = trimesh.creation.cylinder(radius, 0.07, sections=24)
    knob.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    knob.apply_translation([-0.34, 0.2, 0.3])
    turn = Joint([-0.34, 0.2, 0.3], [1, 0, 0], (-np.pi, np.pi))
    return ArticulatedObject((Part("body", body), Part("knob", knob, 0, turn)), name="knob box")


def surfaces(obj: ArticulatedObject) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.array(p.mesh.vertices), np.array(p.mesh.faces)) for p in obj.parts]


def printed(obj: ArticulatedObject, settings: PrintSettings | None = None) -> Print:
    """The print of an object, its pieces called after its parts."""
    stood = place(obj).obj
    names = [p.name for p in stood.parts]
    return make_print(stood, surfaces(stood), names, settings or PrintSettings())


@functools.cache
def print_of(name: str) -> Print:
    """The print of one of the objects above, or of ``<family>:<seed>``, made once."""
    if ":" in name:
        from uniart_jax.procedural import generate

        family, seed = name.split(":")
        return printed(generate(family, int(seed)))
    return printed({"door": door_box, "drawer": drawer_box, "knob": knob_box}[name]())
