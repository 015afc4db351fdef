"""Hinges, finishes and what real objects have: that all of it is made, and that doors clear what
they close."""

from collections.abc import Iterable

import numpy as np
import pytest
from compare_worlds import object_values

from uniart_jax import procedural
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import finishes, hinges, materials


@pytest.mark.parametrize("depth", [0.0, 0.4, 1.0])
def test_an_axis_lies_within_the_door_and_lets_it_open(depth):
    thick = 0.03
    behind, into = hinges.place(thick, 0.5, depth, 0.02)
    assert 0 <= behind <= thick and 0 <= into < 0.02
    assert (behind == 0) == (into == 0) == (depth == 0)
    # the corner beyond the axis, where it swings farthest back, against the case ``AIR`` behind the
    # door
    assert np.hypot(thick - behind, into) <= thick - behind + hinges.AIR + 1e-9
    free = hinges.clear_angle(thick, behind, into, beyond=0.0)
    blocked = hinges.clear_angle(thick, behind, into, beyond=1.0)
    assert np.pi / 2 <= blocked <= free <= np.pi
    if depth == 1.0:
        assert blocked < np.deg2rad(100) and free > blocked + np.deg2rad(10)


def test_openings_and_hinges_vary():
    rng = np.random.default_rng(0)
    angles = np.rad2deg([hinges.opening(rng) for _ in range(300)])
    assert angles.min() >= 80 and angles.max() <= 180.001
    assert (np.isclose(angles, 90).mean() > 0.25) and (np.isclose(angles, 180).mean() > 0.08)
    kinds = [hinges.hang(rng, 0.01)["axis_depth"] for _ in range(200)]
    assert {0.0, 1.0} <= set(kinds) and len(set(kinds)) > 20


def test_finishes_reach_where_materials_do_not():
    rng = np.random.default_rng(1)
    white = np.array([finishes.white_plastic(rng).color for _ in range(100)])
    assert (np.ptp(white, axis=1) < 1e-6).mean() > 0.3 and 0.97 < white.max() <= 1
    assert min(min(finishes.dark(rng).color) for _ in range(60)) < 0.06
    grained = materials.wood(rng, textured=True)
    gray = finishes.varied(rng, grained, gray=1.0)
    assert gray.image.shape == grained.image.shape and np.ptp(gray.image, axis=-1).max() <= 1
    assert finishes.varied(rng, grained).image.dtype == np.uint8


def values(objects: Iterable[ArticulatedObject]) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for obj in objects:
        for name, numbers in object_values(obj).items():
            found.setdefault(name, []).extend(numbers)
    return found


def test_storage_has_axes_at_the_rear_pull_outs_and_whole_fronts():
    found = values(procedural.generate("storage_furniture", seed) for seed in range(80))
    assert max(found["door: axis inside its edge"]) > 0.003
    assert np.quantile(found["door: axis behind its front"], 0.9) > 0.04
    assert 0.02 < np.mean(found["drawer: hidden"]) < 0.4
    assert max(found["door: width of object's"]) > 0.95
    assert max(found["object: depth / width"]) > 1.3


def test_ovens_have_cooktops_twin_doors_and_leaning_knobs():
    found = values(procedural.generate("oven", seed) for seed in range(90))
    assert 0 in found["flap: an object"] and max(found["object: depth / height"]) > 2.5
    assert min(found["flap: width of object's"]) < 0.7
    assert max(found["knob: axis off square (deg)"]) > 15
    assert max(found["knob: an object"]) >= 7


def test_tables_roll_on_casters_and_stand_back_under_their_tops():
    tables = [procedural.generate("table", seed) for seed in range(120)]
    assert max(values(tables)["drawer: behind object's front"]) > 0.15
    wheels = [part for obj in tables for part in obj.parts if part.label == "wheel"]
    assert wheels and all(part.joint.type == "continuous" for part in wheels)
    assert all(part.mesh.bounds[0, 2] < -0.1 for part in wheels)  # at the floor
