"""A pipeline without networks: a cabinet with a drawer, whatever the picture shows."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import trimesh

from uniart_jax.config import SampleConfig
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.pipeline import Sample
from uniart_jax.voxels.layout import Layout

BODY, DRAWER = [0, 0, 0, 0.6, 1, 0.8], [-0.31, 0, 0, 0.02, 0.9, 0.3]
PATIENCE = 800.0  # seconds that a sample waits at most: a second browser starts meanwhile
PULL = Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.3))


def toy_layout() -> Layout:
    """Body and drawer, as they are seen from the front."""
    camera = np.array([np.sin(0.6), np.cos(0.6), 0.35, 1.2, 0.4, 0, 0])
    boxes, colors = np.array([DRAWER, BODY]), np.full((2, 3), 0.4)
    return Layout(boxes, (PULL, Joint.fixed()), (1, -1), colors, np.array([0.9, 1.0]), camera)


def toy_object() -> ArticulatedObject:
    parts = []
    for (x, y, z, *size), joint, parent in ((BODY, Joint.fixed(), -1), (DRAWER, PULL, 0)):
        mesh = trimesh.creation.box(size)
        mesh.apply_translation((x, y, z))
        mesh.visual.face_colors = [180, 120, 60, 255]
        parts.append(Part(f"part_{len(parts)}", mesh, parent, joint))
    return ArticulatedObject(tuple(parts), name="toy")


class ToyPipeline:
    """``asked``: the options of every call of ``sample``; ``go``: samples wait for it; ``bad``:
    seeds for which no object is found."""

    config = SimpleNamespace(model=SimpleNamespace(image_encoder=SimpleNamespace(crop_margin=1.1)))

    def __init__(self, steps: int = 1, bad: tuple[int, ...] = ()):
        self.flow, self.bad = SampleConfig(steps=steps), bad
        self.asked: list[dict] = []
        self.go = threading.Event()
        self.go.set()

    def options(self, **changes):
        return self.flow, self.flow

    def layout_or_none(self, image, background="auto"):
        return toy_layout()

    def sample(self, image, *, progress=lambda step: None, **asked) -> Sample:
        self.asked.append(asked)
        progress("looking at the image")
        progress("structure")
        assert self.go.wait(PATIENCE)
        if asked["seed"] in self.bad:
            raise ValueError(f"{asked['name']}: the model found no object in the image")
        progress("12 voxels")
        progress("parts and joints")
        flows = ("structure", "latent")
        one, none = dict.fromkeys(flows, 1), dict.fromkeys(flows, 0)
        options = dict.fromkeys(flows, self.flow)
        return Sample(toy_object(), options, one, none, None, ("alpha",), layout=toy_layout())
