"""Every file of configs/ builds all of its networks; shapes only, so also at the paper's size."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.cli import load_config
from uniart_jax.config import NETWORKS, StageConfig
from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.shapes import check_shapes
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.voxels.part_table import PartTable
from uniart_jax.voxels.typed_batches import VoxelBatch

CONFIGS = sorted((Path(__file__).parent.parent / "configs").glob("*.py"))


def shape(*sizes, dtype="float32"):
    return jax.ShapeDtypeStruct(sizes, dtype)


def outputs(network, *inputs, method="__call__", **options):
    """Shapes of what a network gives; nothing is computed."""

    def run(params, inputs, options):
        return network.apply(params, *inputs, method=method, **options)

    return jax.eval_shape(run, network.abstract(), inputs, options)


@pytest.mark.slow
@pytest.mark.parametrize("path", CONFIGS, ids=lambda p: p.stem)
def test_the_networks_of_a_config_fit_each_other(path):
    model = load_config(path).model
    networks = {name: build(name, model) for name in NETWORKS}
    grid, side = model.grid, model.image_encoder.image_size
    image = outputs(networks["image_encoder"], shape(2, side, side, 3))
    tokens, volume = image["tokens"], image.get("volume")
    occupancy = shape(2, *[grid.resolution] * 3)
    encoded = outputs(networks["structure_vae"], occupancy)
    assert encoded["logits"].shape == occupancy.shape
    n = grid.max_parts
    layout = PartTable(
        shape(2, n, 6),
        shape(2, n, 9),
        shape(2, n, dtype="int32"),
        shape(2, n, 3),
        shape(2, dtype="int32"),
    )
    views = (shape(2, 1, *image[n].shape[1:]) for n in ("pixels", "camera") if n in image)
    views = tuple(views) or (None, None)
    given = {"views": views} | ({"layout": layout} if model.structure_flow.layout_channels else {})
    v = outputs(networks["structure_flow"], encoded["latent"], shape(2), tokens, volume, **given)
    assert v.shape == encoded["latent"].shape

    width, rng = 256, np.random.default_rng(0)
    coords = np.zeros((2, width, 3), np.int32)
    counts = np.array([200, 256], np.int32)
    for b, n in enumerate(counts):
        cells = np.sort(rng.choice(grid.resolution**3, n, replace=False))
        coords[b, :n] = np.stack(np.unravel_index(cells, (grid.resolution,) * 3), -1)
    parts = rng.integers(0, grid.max_parts, (2, width))
    plans = voxel_plans(coords, counts, model.uniart_vae, grid, voxel_part=parts)
    cells, k = grid.subdivisions**3, grid.max_parts
    batch = VoxelBatch(
        coords,
        counts,
        parts,
        sdf=shape(2, width, cells),
        color=shape(2, width, cells, 3),
        owner=shape(2, width, cells, dtype="int32"),
        boxes=shape(2, k, 6),
        codes=shape(2, k, 9),
        parents=shape(2, k, dtype="int32"),
        visual=shape(2, width, model.uniart_vae.visual_channels),
        part_feature=shape(2, width, model.uniart_vae.part_feature_channels),
        plans=plans,
        layout=layout,
    )
    check_shapes(batch)
    out = outputs(networks["uniart_vae"], batch)
    assert out["sdf"].shape == (2, width, cells) and out["joint_code"].shape == (2, width, 9)
    plan = flow_plan(coords, counts, model.latent_flow, grid)
    voxels = {"coords": coords, "counts": counts, "plan": plan}
    if model.latent_flow.pixel_channels:
        voxels["views"] = views
    if model.latent_flow.layout_channels:
        voxels["layout"] = layout
    v = outputs(networks["latent_flow"], out["latent"], shape(2), tokens, volume, **voxels)
    assert v.shape == out["latent"].shape


def test_the_paper_is_trelliss_size_and_starts_from_its_weights():
    config = load_config(CONFIGS[0].with_name("paper.py"))
    assert config.model.uniart_vae.feature_channels == {"visual": 1024, "part_feature": 448}
    assert config.init and config.model.image_encoder.architecture == "dinov2"
    stage = StageConfig(steps=800_000, batch_size=64, ema_decay=0.9995, skip_not_finite=10)
    assert config.latent_flow == config.structure_flow == config.uniart_vae == stage
    for network, millions in (
        ("structure_flow", 555.5),
        ("latent_flow", 600.4),
        ("image_encoder", 304.4),
    ):
        params = build(network, config.model).abstract()
        assert sum(leaf.size for leaf in jax.tree.leaves(params)) / 1e6 == pytest.approx(
            millions, abs=0.1
        )
    assert jnp.dtype(config.model.compute_dtype) == jnp.bfloat16
