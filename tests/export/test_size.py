"""How large an object is taken to be."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.export.size import WIDEST, parse_size, typical_scale, typical_size
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.pipeline import _sized
from uniart_jax.voxels.kind import Kind


def fridge(width: float, opened: float = 0.0) -> ArticulatedObject:
    """1 unit high; a door as wide as itself that is shown opened by an angle."""
    body = trimesh.creation.box((0.4, width, 1.0))
    door = trimesh.creation.box((0.02, width, 1.0))
    door.apply_translation([-0.21, 0, 0])
    hinge = Joint([-0.2, width / 2, 0], [0, 0, 1], (-1.5, 0))
    obj = ArticulatedObject((Part("a", body), Part("b", door, 0, hinge)))
    return obj.shown_at(np.array([0.0, opened]))


def test_as_long_at_rest_as_usual():
    for opened in (0.0, -1.0):
        assert typical_scale(fridge(0.35, opened), "refrigerator") == pytest.approx(1.7)
        assert typical_scale(fridge(0.9, opened), "oven") == pytest.approx(0.9)
    assert typical_scale(fridge(0.35), "microwave") == pytest.approx(0.5)


def test_a_cube_is_a_small_refrigerator():
    assert typical_scale(fridge(1.0), "refrigerator") == pytest.approx(WIDEST["refrigerator"])


def test_what_nobody_knows_is_a_metre():
    assert typical_scale(fridge(0.5), "assembly of nothing") == 1.0
    assert typical_size("Storage Furniture") == parse_size("storagefurniture") == 1.25
    pane = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 0, 2], [0, 0, 2]], [[0, 1, 2], [0, 2, 3]])
    assert typical_scale(ArticulatedObject((Part("a", pane),)), "refrigerator") == 1.7 / 2
    for text in ("huge", "2 door"):
        with pytest.raises(ValueError, match=f"--size '{text}'"):
            parse_size(text)


def test_an_object_is_as_large_as_its_kind_usually_is():
    box = ArticulatedObject((Part("base", trimesh.creation.box((0.5, 0.6, 1.0))),))
    for named, side, scale, why in (
        (True, None, 0.9, "usual of its kind (oven)"),
        (False, None, 1.0, "does not tell"),
        (True, 1.0, 1.0, "by the layout's lengths"),
    ):
        obj = _sized(box, Kind("oven", 0.9, named), side)
        assert obj.scale == scale and f"{scale:.2f} m" in obj.provenance[-1]
        assert why in obj.provenance[-1]
