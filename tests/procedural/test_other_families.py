"""What the families beyond the seven add: screws of both hands, fixed parts, trees three deep, and
parts that survive the voxels."""

from __future__ import annotations

from collections import Counter
from typing import get_args

import numpy as np
import pytest
from overlaps import check_clear, check_closed

from uniart_jax import procedural
from uniart_jax.config import World
from uniart_jax.procedural import (
    DETAILED_FAMILIES,
    EVERYDAY_FAMILIES,
    FAMILIES,
    HELD_OUT_SEED,
    MORE_FAMILIES,
    SEEN_FAMILIES,
    UNSEEN_FAMILIES,
    WORLDS,
    draw,
    generate,
)
from uniart_jax.procedural.shapes import screw
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.voxelize import voxelize

OTHERS = MORE_FAMILIES + DETAILED_FAMILIES + EVERYDAY_FAMILIES + UNSEEN_FAMILIES


def kind(joint) -> str:
    """A joint's type; screws by their hand."""
    return joint.type if joint.type != "screw" else f"screw {'+' if joint.pitch > 0 else '-'}"


def test_no_family_is_in_two_tuples_and_six_are_never_trained_on():
    assert len(set(FAMILIES)) == len(FAMILIES)
    never = {"bottle", "toilet", "swivel_chair", "laptop", "trash_can", "faucet"}
    assert set(UNSEEN_FAMILIES) == never
    assert not any(never & set(world) for world in WORLDS.values())


def test_half_of_the_wide_world_is_of_the_seven_and_all_families_are_even():
    counts = Counter(WORLDS["wide"])
    assert set(counts) == {*SEEN_FAMILIES, *MORE_FAMILIES}
    seen, more = ({counts[name] for name in names} for names in (SEEN_FAMILIES, MORE_FAMILIES))
    assert len(seen) == len(more) == 1
    assert seen.pop() * len(SEEN_FAMILIES) == more.pop() * len(MORE_FAMILIES)
    drawn = Counter(draw(seed, WORLDS["wide"]).category in SEEN_FAMILIES for seed in range(40))
    assert 8 <= drawn[True] <= 32


@pytest.mark.parametrize(
    ("world", "tuples"),
    [
        ("detailed", (SEEN_FAMILIES, MORE_FAMILIES, DETAILED_FAMILIES)),
        ("everyday", (SEEN_FAMILIES, MORE_FAMILIES, DETAILED_FAMILIES, EVERYDAY_FAMILIES)),
    ],
)
def test_worlds_are_of_each_tuple_evenly_and_so_are_their_families(world, tuples):
    counts = Counter(WORLDS[world])
    assert set(counts) == {name for names in tuples for name in names}
    for names in tuples:
        assert {counts[name] for name in names} == {len(WORLDS[world]) // len(tuples) // len(names)}


def test_half_of_the_household_is_of_everyday_things_and_a_sixth_of_each_of_the_others():
    world = WORLDS["household"]
    counts = Counter(world)
    for names, share in (
        (EVERYDAY_FAMILIES, 3),
        (SEEN_FAMILIES, 1),
        (MORE_FAMILIES, 1),
        (DETAILED_FAMILIES, 1),
    ):
        assert {6 * len(names) * counts[name] for name in names} == {share * len(world)}
    assert sum(counts.values()) == len(world)


def test_a_config_and_the_command_line_know_every_world():
    assert set(get_args(World)) == set(WORLDS)


def test_an_eighth_and_a_little_more_of_the_open_world_is_assemblies_and_half_everyday_things():
    world = WORLDS["open"]
    counts = Counter(world)
    for names, share in ((EVERYDAY_FAMILIES, 4), (SEEN_FAMILIES, 1), (DETAILED_FAMILIES, 1)):
        assert {8 * len(names) * counts[name] for name in names} == {share * len(world)}
    others = {counts[name] for name in MORE_FAMILIES if name != "assemblies"}
    assert others == {len(world) // 8 // len(MORE_FAMILIES)}
    assert counts["assemblies"] == len(world) // 8 + len(world) // 8 // len(MORE_FAMILIES)
    assert sum(counts.values()) == len(world)


def test_every_joint_type_and_trees_three_deep():
    found, deepest = set(), 0
    for seed in range(HELD_OUT_SEED, HELD_OUT_SEED + 60):
        obj = draw(seed, MORE_FAMILIES + UNSEEN_FAMILIES)
        found |= {kind(joint) for joint in obj.joints[1:]}
        depth = {-1: 0}
        for k, parent in enumerate(obj.parents):
            depth[k] = depth[parent] + 1
        deepest = max(deepest, *depth.values())
    assert found == {"fixed", "revolute", "continuous", "prismatic", "screw +", "screw -"}
    assert deepest >= 3


@pytest.mark.parametrize("left_handed", [False, True])
def test_a_screw_rises_by_its_travel(left_handed):
    joint = screw((0.1, 0.2, 0), (0, 0, 1), 2.5, 0.02, left_handed=left_handed)
    low, high = joint.limits
    far = low if left_handed else high
    assert abs(far) == pytest.approx(5 * np.pi)
    np.testing.assert_allclose(joint.motion(far)[2, 3], 0.02)
    quarter = joint.motion(0.1 * far)  # a quarter turn: x goes to y, or to -y
    np.testing.assert_allclose(quarter[:2, 0], [0, -1 if left_handed else 1], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("family", OTHERS)
def test_the_voxels_keep_parts_and_joints(family):
    obj = generate(family, HELD_OUT_SEED)
    copy = assemble(voxelize(obj, 32, 4).gather())
    assert sorted(map(kind, copy.joints[1:])) == sorted(map(kind, obj.joints[1:]))


def test_a_bay_lower_than_its_clearances_takes_a_front_alone():
    """Seed 1037 made a drawer's box of negative height; its lowest drawer is no deeper than a
    front."""
    obj = generate("trolley", 1037)
    depths = [np.ptp(p.mesh.bounds[:, 0]) for p in obj.parts if p.name.startswith("drawer")]
    assert min(depths) < 0.15 and max(depths) > 0.7


@pytest.mark.parametrize("family, seed", [("desk", 830604), ("assemblies", 830752)])
def test_drawers_too_small_to_be_hollow_are_made(family, seed):
    """A desk's drawer in a room lower than its clearances is a front alone; a block that is
    thinner than its walls is solid."""
    obj = generate(family, seed)
    check_closed(obj, obj.name)
    check_clear(obj, obj.name)
    assert "prismatic" in {joint.type for joint in obj.joints}


def test_caps_keep_their_turns():
    for seed in range(3):
        obj = generate("bottle", seed)
        copy = assemble(voxelize(obj, 32, 4).gather())
        cap, back = obj.joints[1], copy.joints[1]
        assert np.ptp(back.angle) == pytest.approx(np.ptp(cap.angle), rel=1e-3)
        assert back.pitch == pytest.approx(cap.pitch, rel=1e-3)


@pytest.mark.parametrize(
    "seed", [27246, 32128]
)  # a thick sash in a small bay; a bay within its walls
def test_narrow_rooms_make_objects_too(seed):
    obj = procedural.draw(seed, procedural.SEEN_FAMILIES)
    assert len(obj.parts) > 1
