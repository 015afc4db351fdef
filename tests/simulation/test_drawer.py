"""A drawer holds a ball that is dropped into it while it opens, and carries it along: cavities
survive in the collision shapes."""

from __future__ import annotations

import pytest
from collision_budget import holds_a_ball

from uniart_jax import procedural
from uniart_jax.export.asset import save_asset
from uniart_jax.export.placement import place

pytestmark = pytest.mark.usefixtures("small_pictures")
DRAWERS = [("storage_furniture", 1_000_000), ("table", 1_000_004), ("oven", 1_000_002)]


def first_drawer(family: str, seed: int):
    """The first held-out object from ``seed`` on that has a drawer, and that part's index."""
    for number in range(seed, seed + 40):
        obj = procedural.generate(family, number)
        for k, part in enumerate(obj.parts):
            if part.label == "drawer" and part.joint.type == "prismatic":
                return obj, k
    raise AssertionError(f"no {family} with a drawer")


@pytest.mark.slow
@pytest.mark.parametrize(("family", "seed"), DRAWERS)
def test_a_drawer_holds_a_ball_while_it_moves(family, seed, tmp_path):
    obj, k = first_drawer(family, seed)
    asset = save_asset(obj, tmp_path / "asset", formats=("mjcf",), motion=False)
    assert holds_a_ball(asset, place(obj).obj, k)


def test_a_filled_drawer_holds_none(tmp_path):
    obj, k = first_drawer(*DRAWERS[1])
    asset = save_asset(obj, tmp_path / "asset", formats=("mjcf",), motion=False, collision_budget=1)
    assert holds_a_ball(asset, place(obj).obj, k) is False
