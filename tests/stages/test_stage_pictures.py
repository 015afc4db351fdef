"""Pictures of what validation sees: true beside found, from the front and from the side."""

import dataclasses
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.data.records import RecordSource
from uniart_jax.flow.solvers import Solution
from uniart_jax.stages import STAGES
from uniart_jax.stages.pictures import beside, filled, solid

sys.path += [str(Path(__file__).parents[1] / name) for name in ("training", "data")]
import tiny_run


class Network:
    """Every network at once, without weights: it finds what it likes, in the right shapes."""

    def __init__(self, model):
        self.grid, self.target = model.grid, model.image_encoder.target_resolution

    def abstract(self):
        return {}

    def apply(self, params, first, batch=None, method=None):
        if method == "encode":
            return {"mean": jnp.zeros((*first.coords.shape[:2], 4))}
        if method == "decode" and batch is not None:
            shape = batch.coords.shape[:2]
            cells = self.grid.subdivisions**3
            of_voxels = {"joint_code": (9,), "part_boxes": (2, 6), "parent_box": (6,)}
            of_cells = {"sdf": (cells,), "color": (cells, 3), "own_box": (cells, 6)}
            of_cells["own_logits"] = of_cells["owner"] = (cells,)
            found = {n: jnp.full((*shape, *s), 0.2) for n, s in (of_voxels | of_cells).items()}
            return {**found, "sdf": -found["sdf"]}
        if method == "decode":
            return jnp.ones((len(first), *(self.grid.resolution,) * 3))
        if first.ndim == 5 or (first.ndim == 4 and first.shape[-1] != 3):
            return {"logits": first * 2.0 - 1.0}
        side = (len(first), *(self.target,) * 3)
        return {
            "occupancy": jnp.ones((len(first), *(self.grid.resolution,) * 3)),
            "camera": jnp.zeros((len(first), 7)),
            "codes": jnp.zeros((*side, 15)),
        }


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    folder = tmp_path_factory.mktemp("validation")
    tiny_run.make_records(folder)
    config = tiny_run.make_config(folder)
    data = dataclasses.replace(config.data, validation=str(folder / "validation"))
    return dataclasses.replace(config, data=data)


@pytest.mark.parametrize("name", tiny_run.STAGES)
def test_every_stage_shows_what_it_makes(config, tmp_path, monkeypatch, name):
    records = RecordSource(config.data.validation)
    image = np.full((1, 16, 16, 3), 255, np.uint8)
    items = [{"record": i, "coords": records[i].coords, "images": image} for i in range(3)]
    network = Network(config.model)
    for attribute, fake in {
        "build": lambda name, model: network,
        "load": lambda *_: {},
        "LatentSource": lambda folder: items,
        "load_conditioner": lambda *_: lambda images: images,
        "make_structure_sampler": lambda *_: lambda *given: Solution(jnp.zeros((3, 1)), None, None),
        "make_structure_decoder": lambda _: (
            lambda vae, flow, latent, seen: network.apply(vae, latent, method="decode")
        ),
        "make_latent_sampler": lambda *_: lambda *given: Solution(jnp.zeros((1, 1)), None, None),
    }.items():
        monkeypatch.setattr(f"uniart_jax.stages.{name}.{attribute}", fake, raising=False)
    statistics = {"structure": None, "latent": None}
    evaluate = STAGES[name].evaluation(config, tmp_path, statistics)
    figures, pictures = evaluate(SimpleNamespace(ema={}), 1)
    assert figures
    ((what, picture),) = pictures.items()
    assert what == ("surface" if name in ("uniart_vae", "latent_flow") else "occupancy")
    with_image = name in ("image_encoder", "structure_flow", "latent_flow")
    size = 16 if with_image else 128
    assert picture.shape == (3 * size, (5 if with_image else 4) * size, 3)
    assert 0 <= picture.min() < picture.max() <= 1


def views(picture, size):
    return [picture[:, k : k + size] for k in range(0, picture.shape[1], size)]


def test_true_and_found_cells_stand_side_by_side():
    true, found = np.zeros((8, 8, 8), bool), np.zeros((8, 8, 8), bool)
    true[0, 1, 7] = True  # in front, to the right as seen from there, at the top
    found[7, 1, 0] = True  # behind, at the bottom
    front, side, front_found, side_found = views(beside(filled(true), filled(found), 8), 128)
    pixel = 128 // 8
    for view, row, column in (
        (front, 0, 6),
        (side, 0, 0),
        (front_found, 7, 6),
        (side_found, 7, 7),
    ):
        lit = np.argwhere(view.max(-1) > 0)
        assert len(lit) == pixel**2
        assert (lit // pixel == (row, column)).all()
    assert front.max() > front_found.max() > 0  # what is nearer is brighter


def test_the_nearest_cell_hides_the_others_and_keeps_its_colour():
    coords = np.array([[1, 0, 0], [0, 0, 0]], np.uint8)
    sdf = np.full((2, 8), 1.0)
    sdf[0, 0], sdf[1, 0] = -1, -1  # the first sub-cell of each
    color = np.zeros((2, 8, 3))
    color[0, 0], color[1, 0] = (1, 0, 0), (0, 1, 0)
    cells, colors = solid(coords, sdf, color)
    np.testing.assert_array_equal(cells, [[2, 0, 0], [0, 0, 0]])
    nothing = np.zeros((0, 3), int), np.zeros((0, 3))
    image = np.full((12, 12, 3), 0.5)
    shown, front, side, *empty = views(beside((cells, colors), nothing, 4, image), 12)
    np.testing.assert_array_equal(shown, image)
    assert front.reshape(-1, 3).max(0).tolist() == [0, 1, 0]  # green is in front of red
    assert (side.reshape(-1, 3).max(0)[:2] > 0).all()  # from the side both are seen
    assert not np.any(empty)


def test_pictures_of_a_large_object_take_a_moment():
    rng = np.random.default_rng(0)
    coords = rng.integers(0, 64, (16_384, 3))
    begin = time.process_time()
    cells = solid(coords, rng.normal(size=(16_384, 64)), rng.random((16_384, 64, 3)))
    picture = beside(cells, cells, 256)
    assert time.process_time() - begin < 2.0
    assert picture.shape == (128, 512, 3) and 0 < picture.max() <= 1
