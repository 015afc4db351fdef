"""Held-out objects and the table made of them."""

import functools
import json

import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.config import GridConfig, ImageEncoderConfig, ModelConfig
from uniart_jax.evaluation.procedural import (
    check_first_seed,
    evaluate_representation,
    held_out,
    held_out_for,
    score,
)
from uniart_jax.voxels.assemble import assemble

COARSE = GridConfig(resolution=16, subdivisions=2)


@functools.cache
def drawn(index: int):
    return held_out(index)


def test_held_out_objects_are_drawn_alike_and_never_trained_on():
    one, again = drawn(3), held_out(3)
    assert one.seed == procedural.HELD_OUT_SEED + 3 and one.family == procedural.SEEN_FAMILIES[3]
    assert np.array_equal(one.image, again.image)
    assert np.array_equal(one.grid.coords, again.grid.coords)
    assert held_out(0, unseen=True).family in procedural.UNSEEN_FAMILIES


def test_validation_objects_are_others_and_never_trained_on_either():
    test = held_out(3, first_seed=900_000)
    assert (test.seed, test.family) == (900_003, procedural.SEEN_FAMILIES[3])
    assert not np.array_equal(test.image, drawn(3).image)
    for seed in (899_999, 9_999_999):
        with pytest.raises(ValueError, match=f"from {seed} on may have been trained on; give"):
            check_first_seed(seed, 2)
    with pytest.raises(ValueError, match="are partly held-out ones"):
        check_first_seed(999_999, 2)
    check_first_seed(900_000, 100_000)
    assert held_out_for(ModelConfig(grid=COARSE), 3, first_seed=900_000).seed == 900_003


def test_their_pictures_are_larger_than_what_networks_see():
    assert drawn(3).image.shape == (256, 256, 4)
    large = ModelConfig(grid=COARSE, image_encoder=ImageEncoderConfig(image_size=288))
    assert held_out_for(ModelConfig(grid=COARSE), 3).image.shape == (256, 256, 4)
    assert held_out_for(large, 3).image.shape == (288, 288, 4)


def test_an_object_against_itself_and_against_another():
    test = drawn(0)
    same = score(test.obj, test)
    assert same.parts.right.all() and same.parts.count_right and same.chamfer < 0.01
    other = score(drawn(1).obj, test)
    assert other.chamfer > 2 * same.chamfer and other.chamfer_open > 2 * same.chamfer_open


@pytest.mark.slow
def test_workers_change_nothing(tmp_path):
    for processes in (1, 2):
        evaluate_representation(tmp_path / str(processes), count=2, processes=processes)
    texts = [(tmp_path / name / "metrics.json").read_text() for name in ("1", "2")]
    assert texts[0] == texts[1]
    direct = score(assemble(drawn(1).grid.gather()), drawn(1))
    family = json.loads(texts[0])["families"][direct.family]["representation"]
    assert family["chamfer"] == direct.chamfer and family["watertight"] == 1.0
    assert (tmp_path / "1" / "table.md").read_text().count("representation") == 1
