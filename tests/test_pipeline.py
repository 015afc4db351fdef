"""The pipeline's steps with random weights at debug size: batching, padding, views, files."""

from pathlib import Path

import jax
import numpy as np
import pytest

from uniart_jax.cli import load_config
from uniart_jax.config import NETWORKS, SampleConfig
from uniart_jax.models.network import build
from uniart_jax.pipeline import Condition, Pipeline, join_views, load, pad_coords
from uniart_jax.training.export import export_network, write_config, write_statistics

ROOT = Path(__file__).parent.parent
GUIDED = SampleConfig(steps=2, guidance=1.5, rescale_t=3.0)


@pytest.fixture(scope="module")
def pipeline():
    config = load_config(ROOT / "configs" / "debug.py")
    parameters = {
        name: jax.tree.map(lambda x: x + 0.01, build(name, config.model).init(jax.random.key(i)))
        for i, name in enumerate(NETWORKS)  # zero-initialised layers must not hide mistakes
    }
    channels = (
        config.model.structure_vae.latent_channels,
        config.model.uniart_vae.latent_channels,
    )
    statistics = {
        name: (np.zeros(c, np.float32), np.ones(c, np.float32))
        for name, c in zip(("structure", "latent"), channels, strict=True)
    }
    return Pipeline(config, parameters, statistics)


@pytest.fixture(scope="module")
def condition(pipeline):
    rng = np.random.default_rng(0)
    return pipeline.encode_images(rng.random((2, 64, 64, 3), np.float32))


def one(condition, b):
    return Condition(condition.tokens[b : b + 1], condition.volume[b : b + 1])


def test_a_batch_is_its_items_also_when_guided(pipeline, condition):
    rng = np.random.default_rng(1)
    coords = [np.argwhere(rng.random((32, 32, 32)) < share) for share in (0.01, 0.03)]
    coords = [c.astype(np.int32) for c in coords]
    key = jax.random.key(0)
    both = pipeline.sample_latents(coords, condition, key, GUIDED)
    noise = pipeline.sample_latents(coords[::-1], condition, key, GUIDED)
    assert [len(z) for z in both] == [len(c) for c in coords]
    assert not np.allclose(both[0], noise[1][: len(both[0])])
    # the first item's noise is the same in a batch of one only if drawn so: compare through decoding of given latents instead
    together = pipeline.decode(coords, both)
    alone = [pipeline.decode([c], [z])[0] for c, z in zip(coords, both, strict=True)]
    for a, b in zip(together, alone, strict=True):
        np.testing.assert_allclose(a.sdf, b.sdf, atol=1e-4)
        np.testing.assert_allclose(a.own_box, b.own_box, atol=1e-4)
        np.testing.assert_allclose(a.joint_code, b.joint_code, atol=1e-4)


def test_guided_velocities_use_each_items_own_voxels(pipeline, condition):
    """Swapping the items of a batch swaps the results, with the noise swapped too."""
    import jax.numpy as jnp

    from uniart_jax.pipeline import flow_inputs

    network = build("latent_flow", pipeline.config.model)
    rng = np.random.default_rng(2)
    coords = [
        np.argwhere(rng.random((32, 32, 32)) < share).astype(np.int32) for share in (0.01, 0.02)
    ]
    padded, counts = pad_coords(coords, (1024,))
    x = rng.normal(size=(2, 1024, pipeline.config.model.uniart_vae.latent_channels)).astype("f4")

    def velocity(order):
        inputs = flow_inputs(padded[order], counts[order], pipeline.config.model)
        seen = Condition(*(jnp.repeat(c[np.array(order)], 2, axis=0) for c in condition))
        twice = jnp.repeat(x[order], 2, axis=0)
        return network.apply(
            pipeline.parameters["latent_flow"],
            twice,
            jnp.full(4, 0.5),
            seen.tokens,
            seen.volume,
            **inputs,
        )

    straight, swapped = velocity([0, 1]), velocity([1, 0])
    np.testing.assert_allclose(straight[:2], swapped[2:], atol=2e-5)
    np.testing.assert_allclose(straight[2:], swapped[:2], atol=2e-5)
    np.testing.assert_allclose(straight[0], straight[1], atol=2e-5)


def test_an_image_becomes_an_object_or_a_clear_error(pipeline):
    rng = np.random.default_rng(0)
    image = np.zeros((50, 60, 4), np.uint8)
    image[10:40, 10:50] = rng.integers(0, 255, (30, 40, 4))
    image[10:40, 10:50, 3] = 255
    try:
        obj = pipeline(image, seed=1, name="noise")
    except ValueError as error:
        assert "no object" in str(error)
    else:
        assert all(part.mesh.is_watertight for part in obj.parts)


def test_views_side_by_side():
    joined = join_views(
        Condition(
            np.arange(12.0).reshape(2, 3, 2),
            np.stack([np.zeros((1, 1, 1, 2)), np.ones((1, 1, 1, 2))]),
        )
    )
    assert joined.tokens.shape == (1, 6, 2) and joined.volume.shape == (1, 1, 1, 1, 2)
    assert float(joined.volume.mean()) == 0.5


def test_widths():
    lists = [np.zeros((n, 3), np.int32) for n in (3, 7)]
    assert pad_coords(lists, (5, 8))[0].shape == (2, 8, 3)
    assert pad_coords([np.zeros((9, 3), np.int32)], (5, 8))[0].shape == (1, 4096, 3)


def test_a_checkpoint_folder_round_trip_and_its_errors(pipeline, tmp_path):
    write_config(tmp_path / "export", pipeline.config)
    for name in NETWORKS:
        export_network(tmp_path / "export", name, pipeline.parameters[name], dtype="float32")
    for name, (mean, std) in pipeline.statistics.items():
        write_statistics(tmp_path / "export", name, mean, std)
    again = load(tmp_path)  # a WORKDIR: its export is found
    assert again.config == pipeline.config
    same = jax.tree.map(np.array_equal, again.parameters, pipeline.parameters)
    assert all(jax.tree.leaves(same))
    (tmp_path / "export" / "latent_flow.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match="latent_flow"):
        load(tmp_path)
    with pytest.raises(FileNotFoundError, match="neither a folder nor a shipped model"):
        load("absent")


@pytest.mark.parametrize("pixels", [np.zeros((9, 9), np.uint8), np.zeros((9, 9, 3), np.float32)])
def test_wrong_arrays(pipeline, pixels):
    with pytest.raises(ValueError, match="uint8"):
        pipeline(pixels)
