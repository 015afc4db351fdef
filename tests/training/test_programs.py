"""How many programs a stage compiles: one for each set of batch shapes, and those come from a short
list."""

import dataclasses
import json
import os
import re
import subprocess
import sys

import jax
import numpy as np
import pytest
import tiny_run
from hand_records import make_record, write_folder, write_latents

from uniart_jax.data import latents
from uniart_jax.data.batches import voxel_batches
from uniart_jax.nn.grids import CELL_SHARES
from uniart_jax.voxels.part_table import EMPTY

SIZES = [6 + 3 * k for k in range(40)]  # voxels: 6 to 123, two widths
BATCHES = 60


def shapes(batches) -> set:
    """The distinct sets of shapes among ``BATCHES`` batches."""
    drawn = iter(batches)
    return {
        tuple((np.shape(leaf), str(leaf.dtype)) for leaf in jax.tree.leaves(next(drawn)))
        for _ in range(BATCHES)
    }


def test_runs_of_voxels_have_one_set_of_shapes_a_width(tmp_path):
    write_folder(tmp_path, [make_record(k, voxels=n) for k, n in enumerate(SIZES)])
    config = tiny_run.make_config(tmp_path)
    windows = dataclasses.replace(config.model.uniart_vae, attention="serial", window=16)
    model = dataclasses.replace(config.model, uniart_vae=windows)
    widths = len(config.data.voxel_buckets)
    assert len(shapes(voxel_batches(tmp_path, config.data, model, 2))) == widths
    cropped = dataclasses.replace(config.data, voxel_crop=48)
    assert len(shapes(voxel_batches(tmp_path, cropped, model, 2))) == 1


@pytest.mark.parametrize("shares", [1, 2])
def test_cubic_windows_have_nine_at_most(tmp_path, shares):
    """Three numbers of rows for each of the two plans, and the most that there can be is among
    them."""
    write_folder(tmp_path, [make_record(k, voxels=n) for k, n in enumerate(SIZES)])
    config = tiny_run.make_config(tmp_path)
    widths = len(config.data.voxel_buckets)
    for data, limit in (
        (config.data, 9 * widths),
        (dataclasses.replace(config.data, voxel_crop=48), 9),
    ):
        batches = voxel_batches(tmp_path, data, config.model, 2 * shares, shares=shares)
        assert len(shapes(batches)) <= limit


@pytest.mark.parametrize("stem", ["conv", "patch"])
def test_batches_of_latents_have_a_few_sets_of_shapes_a_width(tmp_path, stem):
    rng = np.random.default_rng(0)

    def items():
        for k, count in enumerate(SIZES):
            spread = 512 if k % 2 else 128  # surfaces in all of the grid, and in a corner of it
            flat = np.sort(rng.choice(spread, count, replace=False))
            yield {
                "record": k,
                "mirrored": False,
                "structure": rng.normal(size=(2, 2, 2, 4)),
                "coords": np.stack(np.unravel_index(flat, (8, 8, 8)), 1),
                "voxel_part": np.zeros(count, int),
                "latent": rng.normal(size=(count, 6)),
                "images": np.zeros((1, 4, 4, 3)),
                **EMPTY,
            }

    write_latents(tmp_path / "latents", items(), key="")
    config = tiny_run.make_config(tmp_path)
    options = {} if stem == "conv" else {"stem": "patch", "patch_size": 4}
    flow = dataclasses.replace(config.model.latent_flow, **options)
    model = dataclasses.replace(config.model, latent_flow=flow)
    found = shapes(
        latents.latent_batches(tmp_path / "latents", config.data, model, 2, stage="latent_flow")
    )
    widths = len(config.data.voxel_buckets)
    assert widths < len(found) <= widths * len(CELL_SHARES)


@pytest.mark.slow
def test_a_stage_compiles_no_more_than_that_and_its_log_tells_how_many(tmp_path):
    """XLA's own account of what it compiles, of every stage as ``train.py`` runs it, over 60
    steps."""
    for name, sizes in (("records", SIZES[:24]), ("validation", SIZES[:3])):
        (tmp_path / name).mkdir()
        write_folder(tmp_path / name, [make_record(k, voxels=n) for k, n in enumerate(sizes)])
    command = [sys.executable, tiny_run.HERE, tmp_path, "base", *tiny_run.STAGES, "--steps", "60"]
    env = {**os.environ, "JAX_LOG_COMPILES": "1"}
    ran = subprocess.run(map(str, command), env=env, capture_output=True, text=True, timeout=900)
    assert not ran.returncode, ran.stderr[-2000:]
    programs = {}
    for name in tiny_run.STAGES:
        rows = (tmp_path / "base" / name / "metrics" / f"{name}.jsonl").read_text().splitlines()
        programs[name] = max(json.loads(row).get("programs", 0) for row in rows)
    compiled = re.findall(r"Finished XLA compilation of jit\(update\)", ran.stderr)
    assert len(compiled) == sum(programs.values())
    widths = len(tiny_run.make_config(tmp_path).data.voxel_buckets)
    assert programs.pop("uniart_vae") <= 9 * widths
    assert widths <= programs.pop("latent_flow") <= widths * len(CELL_SHARES)
    assert set(programs.values()) == {1}
