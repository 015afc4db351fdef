"""Training on a pool of objects that are made all the time: ``tools/train_pool.py`` and what it
runs on."""

import argparse
import dataclasses
import importlib
import os
import runpy
import time
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from uniart_jax import procedural
from uniart_jax.config import StageConfig, load_config
from uniart_jax.data.cameras import mirror_camera_codes
from uniart_jax.data.layouts import COLUMNS, LayoutSettings, make_item
from uniart_jax.data.mirror import (
    mirror_boxes,
    mirror_codes,
    mirror_corners,
    mirror_images,
    mirror_legs,
    mirror_revolutions,
)
from uniart_jax.models.network import build
from uniart_jax.training.state import frozen_mask, make_optimizer
from uniart_jax.voxels.part_table import ROWS, PartTable
from uniart_jax.voxels.typed_batches import LayoutBatch
from uniart_jax.voxels.voxelize import voxelize

ROOT = Path(__file__).parent.parent


@pytest.fixture
def pool_tools(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tools")
    return SimpleNamespace(
        host=importlib.import_module("pool_objects"), device=importlib.import_module("pool_losses")
    )


@pytest.fixture(scope="module")
def pool_rows():
    """Rows of 12 objects as ``tools/train_pool.py`` draws them, and the objects."""
    host = runpy.run_path(str(ROOT / "tools/pool_objects.py"))
    settings = LayoutSettings(64, views=1, families=procedural.WORLDS["wide"])
    made = [m for i in range(14) if (m := make_item(i, settings)) is not None][:12]
    rows = {k: np.stack([row[k] for _, row in made]) for k in COLUMNS if k != "masks"}
    photographer = host["Photographer"](host["Sizes"](64, 32, 32))
    photos = [
        photographer.take(np.random.default_rng(i), row)[0] for i, (_, row) in enumerate(made)
    ]
    rows |= {k: np.stack([photo[k] for photo in photos]) for k in photos[0]}
    rows["images"], rows["cameras"] = rows["images"][:, 0], rows["cameras"][:, 0]
    rows["voxels"] = np.stack([host["packed_voxels"](obj) for obj, _ in made])
    return rows, [obj for obj, _ in made]


def test_the_pools_voxels_are_those_of_records(pool_rows):
    rows, objects = pool_rows
    for bits, obj in list(zip(rows["voxels"], objects, strict=True))[:3]:
        found = np.argwhere(np.unpackbits(bits).reshape(32, 32, 32))
        np.testing.assert_array_equal(found, voxelize(obj).coords)


def test_the_pool_keeps_the_newest_and_draws_them_more_often(pool_tools):
    pool = pool_tools.host.Pool(8)
    for first in range(0, 12, 3):
        pool.add({"boxes": np.arange(first, first + 3)})
    drawn = pool.draw(np.random.default_rng(0), 4000)["boxes"]
    assert set(drawn) == set(range(4, 12))
    assert (drawn >= 8).mean() > 0.55


def test_the_pools_mirror_is_that_of_records(pool_tools, pool_rows):
    rows, _ = pool_rows
    run = jax.jit(pool_tools.device.prepared)
    out = jax.device_get(run(rows, jax.random.key(2), True))
    plain = jax.device_get(run(rows, jax.random.key(2), False))
    flipped, photos, looked = 0, 0, 0
    for b in range(len(rows["boxes"])):
        cells = plain.occupancy[b]
        mirrored = not np.allclose(out.layout.boxes[b], rows["boxes"][b])
        flipped += mirrored
        same = (lambda x: x, lambda x: x) if not mirrored else (mirror_boxes, mirror_codes)
        np.testing.assert_allclose(out.layout.boxes[b], same[0](rows["boxes"][b]), atol=1e-6)
        np.testing.assert_allclose(out.layout.codes[b], same[1](rows["codes"][b]), atol=1e-6)
        legs = mirror_legs(rows["legs"][b]) if mirrored else rows["legs"][b]
        np.testing.assert_allclose(out.layout.legs[b], legs, atol=1e-6)
        panels = mirror_corners(rows["panels"][b]) if mirrored else rows["panels"][b]
        np.testing.assert_allclose(out.layout.panels[b], panels, atol=1e-6)
        boards = mirror_corners(rows["boards"][b]) if mirrored else rows["boards"][b]
        np.testing.assert_allclose(out.layout.boards[b], boards, atol=1e-6)
        rounds = rows["revolutions"][b]
        rounds = mirror_revolutions(rounds) if mirrored else rounds
        np.testing.assert_allclose(out.layout.revolutions[b], rounds, atol=1e-6)
        np.testing.assert_array_equal(out.occupancy[b], cells[:, ::-1] if mirrored else cells)
        image, photo = (rows[k][b] / np.float32(255) for k in ("images", "photos"))
        if mirrored:
            image, photo = mirror_images(image), mirror_images(photo)
        taken = np.allclose(out.layout.image[b], photo, atol=1e-6)
        photos += taken
        camera = rows["photo_cameras" if taken else "cameras"][b]
        camera = mirror_camera_codes(camera) if mirrored else camera
        np.testing.assert_allclose(out.layout.camera[b], camera, atol=1e-6)
        if not taken:
            assert ((out.layout.image[b] > 0) == (image > 0)).mean() > 0.99  # black stays
            np.testing.assert_allclose(out.flow_image[b], image, atol=1e-6)
        seen = np.allclose(out.flow_image[b], photo, atol=1e-6)
        looked += seen
        camera = rows["photo_cameras" if seen else "cameras"][b]
        camera = mirror_camera_codes(camera) if mirrored else camera
        np.testing.assert_allclose(out.flow_camera[b], camera, atol=1e-6)
    assert all(0 < number < len(rows["boxes"]) for number in (flipped, photos, looked))
    np.testing.assert_array_equal(plain.layout.image, plain.flow_image)
    np.testing.assert_allclose(plain.flow_image, rows["images"] / np.float32(255), atol=1e-6)


def test_the_pools_scenes_keep_their_masks(pool_tools):
    images = np.arange(2 * 8 * 8 * 3, dtype=np.uint8).reshape(2, 8, 8, 3)
    masks = np.zeros((2, 8, 8), bool)
    masks[:, 2:5, 1:4] = True
    rows = {"scenes": images, "scene_masks": np.packbits(masks.reshape(2, -1), axis=-1)}
    flipped = set()
    for seed in range(6):
        batch = jax.device_get(pool_tools.device.prepared_scenes(rows, jax.random.key(seed)))
        for b in range(2):
            turned = not np.array_equal(batch.mask[b], masks[b])
            flipped.add(turned)
            mask, image = masks[b], images[b] / np.float32(255)
            expected = (mask[:, ::-1], image[:, ::-1]) if turned else (mask, image)
            np.testing.assert_array_equal(batch.mask[b], expected[0])
            np.testing.assert_allclose(batch.image[b], expected[1], atol=1e-6)
    assert flipped == {True, False}


def test_the_pools_layouts_with_errors_are_trees_of_the_objects_parts(pool_tools, pool_rows):
    rows, _ = pool_rows
    batch = {k: np.concatenate([rows[k]] * 4) for k in rows}
    true = PartTable(*(batch[k] for k in ROWS), batch["part_counts"])
    found = jax.device_get(jax.jit(pool_tools.device.tables_with_errors)(true, jax.random.key(0)))
    exact, lost = 0, 0
    for b, count in enumerate(found.counts):
        parts, parents = int(batch["part_counts"][b]), found.parents[b, :count]
        assert count <= parts and not found.boxes[b, count:].any()
        if not count:
            lost += 1
            continue
        assert (parents == np.arange(count)).sum() == 1  # one root, and all hang on it
        at = parents
        for _ in range(count):
            at = parents[at]
        assert len(set(at)) == 1
        apart = np.abs(found.boxes[b, :count, None] - batch["boxes"][b, None, :parts]).max(-1)
        exact += (apart.min(1) < 1e-6).all()
        if count == parts and (apart.min(1) < 0.02).all():
            row = apart.argmin(1)
            np.testing.assert_array_equal(batch["parents"][b][row], row[parents])
    assert 0.25 < exact / len(batch["boxes"]) < 0.85 and lost < 0.3 * len(batch["boxes"])


def test_makers_objects_are_held_back_until_they_are_judged(pool_tools):
    host = pool_tools.host
    sizes, pools = host.Sizes(32, 64, 32), (host.Pool(256), host.Pool(256))
    with host.Objects(1, 200_000, sizes, *pools, "wide") as objects:
        for _ in range(3000):  # a busy machine takes its time
            if rows := objects.unseen():
                break
            objects.check()
            time.sleep(0.1)
        assert rows[0]["images"].shape == (host.JUDGED_ROWS, 32, 32, 3)
        objects.wait_for(host.CHUNK // 2)  # what was judged has joined
        drawn = objects.batch(np.random.default_rng(0), 5)
        seen = objects.scene_batch(np.random.default_rng(0), 3)
    assert {k: len(v) for k, v in drawn.items()} == dict.fromkeys(host.READ, 5)
    assert seen["scenes"].shape == (3, 64, 64, 3) and seen["scene_masks"].shape == (3, 512)
    assert 0.2 < pools[1].total / pools[0].total < 1


def test_a_pool_whose_makers_have_ended_says_so(pool_tools):
    host = pool_tools.host
    sizes = host.Sizes(32, 32, 32)
    with host.Objects(1, 0, sizes, host.Pool(4), host.Pool(4), "wide") as objects:
        objects.check()
        for maker in objects._makers:
            maker.terminate()
            maker.join()
        with pytest.raises(RuntimeError, match="nothing makes objects"):
            objects.wait_for(1000)


def test_a_step_that_is_not_finite_changes_nothing(pool_tools):
    tool = importlib.import_module("train_pool")
    update = tool.make_update(lambda p, b, k: ((p * b).sum(), {}), optax.sgd(1.0), False)
    start = lambda: tool.Run(np.ones(2), optax.sgd(1.0).init(np.ones(2)), np.ones(2))  # noqa: E731
    key = jax.random.key(0)
    moved, _ = update(start(), np.ones(2), key, np.float32(0.5))
    np.testing.assert_allclose(moved.params, [0.5, 0.5])
    np.testing.assert_allclose(moved.average, 1 - 0.5 * (1 - tool.DECAY), rtol=1e-6)
    kept, metrics = update(start(), np.array([np.nan, 1]), key, np.float32(0.5))
    np.testing.assert_array_equal(kept.params, 1)
    np.testing.assert_array_equal(kept.average, 1)
    assert np.isnan(metrics["loss"])


def test_what_a_stage_freezes_stays_as_it_is(pool_tools):
    """``make_optimizer`` alone would let their gradients through."""
    tool = importlib.import_module("train_pool")
    stage = StageConfig(warmup_steps=1, freeze=("kept",))
    params = {"kept": np.ones((2, 2), np.float32), "moved": np.ones((2, 2), np.float32)}
    optimizer = make_optimizer(stage)
    update = tool.make_update(
        lambda p, b, k: (((p["kept"] + p["moved"]) * b).sum(), {}),
        optimizer,
        frozen_mask(params, stage.freeze),
    )
    run = tool.Run(params, optimizer.init(params), jax.tree.map(np.copy, params))
    for _ in range(3):
        run, _ = update(run, np.full((2, 2), 3.0, np.float32), jax.random.key(0), np.float32(1))
    np.testing.assert_array_equal(run.params["kept"], 1)
    np.testing.assert_array_equal(run.average["kept"], 1)
    assert (np.asarray(run.params["moved"]) < 1).all()


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="Linux keeps processes to cores")
def test_each_maker_keeps_to_a_core_of_its_own(pool_tools):
    cores = sorted(os.sched_getaffinity(0))
    try:
        for worker, core in enumerate(reversed(cores)):
            pool_tools.host.keep_to_core(worker)
            assert os.sched_getaffinity(0) == {core}
            os.sched_setaffinity(0, cores)
        pool_tools.host.keep_to_core(len(cores))  # more makers than cores: the first again
        assert os.sched_getaffinity(0) == {cores[-1]}
    finally:
        os.sched_setaffinity(0, cores)


def test_an_update_is_compiled_for_batches_like_one(pool_tools):
    tool = importlib.import_module("train_pool")
    update = tool.make_update(
        lambda p, b, k, weights: ((p * b * weights[0]).sum(), {}), optax.sgd(1.0), False
    )
    ones = np.ones(2, np.float32)
    start = lambda: tool.Run(ones.copy(), optax.sgd(1.0).init(ones), ones.copy())  # noqa: E731
    weights = (np.full(2, 2.0, np.float32),)
    program = tool.compiled(update, start(), ones, weights)
    key, half = jax.random.key(0), np.float32(0.5)
    np.testing.assert_allclose(program(start(), ones, key, half, weights)[0].params, 0.0)
    with pytest.raises(TypeError):  # it is compiled, for this shape alone
        program(start(), np.ones((3, 2), np.float32), key, half, weights)


def test_the_refiner_learns_in_one_of_a_few_steps_of_the_flow(pool_tools):
    """Every step that is the structure flow's is of one loss."""
    tool = importlib.import_module("train_pool")
    given = argparse.Namespace(flow_every=2, refine_every=3, mask_every=4, refine_channels=8)
    steps = tool.due_steps("structure_flow", given)
    taken = {name: [s for s in range(13) if due(s)] for name, due in steps.items()}
    assert taken == {"structure_flow": [0, 6, 12], "unrefined": [2, 4, 8, 10]}
    given.refine_channels = 0  # both would be the same
    assert list(tool.due_steps("structure_flow", given)) == ["structure_flow"]
    given.refine_every, given.refine_channels = 1, 8
    assert list(tool.due_steps("structure_flow", given)) == ["structure_flow"]
    assert [s for s in range(9) if tool.due_steps("mask", given)["mask"](s)] == [0, 4, 8]


@pytest.mark.parametrize(("items", "looked_at", "pixels"), [(1, 1, 0), (4, 2, 4), (10, 4, 4)])
def test_the_layout_network_looks_at_those_pictures_whose_layouts_are_shown(
    pool_tools, items, looked_at, pixels
):
    """Two in five, one at least; traced, not run."""
    config, seen = load_config("nano"), []
    flow = dataclasses.replace(config.model.structure_flow, pixel_channels=pixels)
    config = dataclasses.replace(
        config, model=dataclasses.replace(config.model, structure_flow=flow)
    )
    names = ("structure_flow", "image_encoder", "structure_vae", "layout")
    nets = {name: build(name, config.model) for name in names}
    params = {name: net.abstract() for name, net in nets.items()}

    def apply(params, image, **given):
        seen.append(len(image))
        return nets["layout"].apply(params, image, **given)

    def floats(*shape, dtype=jnp.float32):
        return jax.ShapeDtypeStruct((items, *shape), dtype)

    layout = LayoutBatch(
        image=floats(256, 256, 3),
        camera=floats(7),
        boxes=floats(16, 6),
        codes=floats(16, 9),
        parents=floats(16, dtype=jnp.int32),
        colors=floats(16, 3),
        part_counts=floats(dtype=jnp.int32),
    )
    voxels = floats(32, 32, 32, dtype=bool)
    batch = pool_tools.device.PoolBatch(layout, layout.image, layout.camera, voxels)
    statistics = np.zeros(config.model.structure_vae.latent_channels), np.float32(1)
    loss = pool_tools.device.make_structure_loss(
        nets | {"layout": SimpleNamespace(apply=apply)}, config, statistics
    )
    frozen = tuple(params[name] for name in names[1:])
    value, terms = jax.eval_shape(loss, params[names[0]], batch, jax.random.key(0), frozen)
    assert seen == [looked_at] and value.shape == () and {"iou", "refined"} < {*terms}


def test_cameras_with_errors_are_mostly_near_and_sometimes_far_off(pool_tools):
    true = np.tile(np.float32([0.6, 0.8, 0.4, 1.6, 0.3, 0.1, 0.0]), (2000, 1))
    off = np.abs(pool_tools.device.cameras_with_errors(true, jax.random.key(0)) - true)
    scale = np.array(pool_tools.device.CAMERA_ERRORS)
    np.testing.assert_allclose(np.median(off, 0), 0.55 * scale, rtol=0.15)
    assert (off.max(0) > 8 * scale).all()
    items = np.median(off / scale, 1)  # an object is off in all or in nothing
    assert np.quantile(items, 0.95) > 5 * np.quantile(items, 0.2)


def test_legs_panels_and_boards_are_learned_in_one_of_a_few_steps(pool_tools):
    tool = importlib.import_module("train_pool")
    given = argparse.Namespace(flow_every=2, refine_every=1, mask_every=4, box_sets_every=3)
    steps = tool.due_steps("layout", given)
    taken = {name: [s for s in range(7) if due(s)] for name, due in steps.items()}
    assert taken == {"layout": [0, 3, 6], "parts": [1, 2, 4, 5]}
    given.box_sets_every = 1
    (due,) = tool.due_steps("layout", given).values()
    assert all(due(s) for s in range(9))


def test_the_deadline_of_no_file_is_the_one_before(pool_tools, tmp_path):
    tool, file = importlib.import_module("train_pool"), tmp_path / "end"
    assert tool.read_deadline("", 3.0) == tool.read_deadline(str(file), 3.0) == 3.0
    file.write_text("")
    assert tool.read_deadline(str(file), 3.0) == 3.0
    file.write_text("7.5\n")
    assert tool.read_deadline(str(file), 3.0) == 7.5


def test_bent_pictures_are_moved_a_little(pool_tools):
    ramp = np.broadcast_to(np.linspace(0, 1, 64, dtype=np.float32)[:, None, None], (2, 64, 64, 3))
    out = np.asarray(
        jax.jit(pool_tools.device.bent, static_argnums=1)(ramp, 0.03, jax.random.key(1))
    )
    inner = np.abs(out - ramp)[:, 8:-8, 8:-8]
    assert 0 < inner.mean() < 0.05 and not np.allclose(out[0], out[1])
