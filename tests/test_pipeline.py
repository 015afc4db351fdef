"""The pipeline's steps with random weights at debug size: batching, padding, views, files."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import parameters as parameters_of

from uniart_jax.cli import load_config
from uniart_jax.config import (
    NETWORKS,
    Config,
    DataConfig,
    FlowConfig,
    GaussianConfig,
    GridConfig,
    ImageEncoderConfig,
    LatentSampleConfig,
    LayoutConfig,
    ModelConfig,
    SampleConfig,
    StructureSampleConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.data.layout_renders import render_layout
from uniart_jax.inference.samplers import flow_arguments, flow_inputs, join_views, pad_coords
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network, write_statistics
from uniart_jax.models.network import build
from uniart_jax.objects.kinematics import Joint
from uniart_jax.pipeline import Pipeline, load
from uniart_jax.voxels.camera_code import project
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.typed_batches import Condition

ROOT = Path(__file__).parent.parent
GUIDED = SampleConfig(steps=2, guidance=1.5, rescale_t=3.0)


@pytest.fixture(scope="module")
def pipeline():
    config = load_config(ROOT / "configs" / "debug.py")
    flows = {
        name: dataclasses.replace(getattr(config.model, name), layout_channels=4)
        for name in ("structure_flow", "latent_flow")
    }
    shallow = {
        "image_encoder": dataclasses.replace(config.model.image_encoder, num_blocks=0),
        "uniart_vae": dataclasses.replace(config.model.uniart_vae, num_blocks=1),
    }
    model = dataclasses.replace(config.model, **flows, **shallow)
    config = dataclasses.replace(config, model=model)
    parameters = {
        name: parameters_of(build(name, config.model), seed=i) for i, name in enumerate(NETWORKS)
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
    seen = pipeline.encode_images(rng.random((2, 64, 64, 3), np.float32))
    return pipeline.following(seen, [make_layout(0.0), make_layout(0.3)])


def make_layout(y):
    """A body and a panel before it."""
    boxes = np.array([[0, 0, 0, 0.8, 1, 1], [-0.45, y, 0, 0.1, 0.4, 0.8]])
    return Layout(boxes, (Joint.fixed(),) * 2, (-1, 0), np.full((2, 3), 0.5), np.ones(2))


def one(condition, b):
    return jax.tree.map(lambda a: a[b : b + 1], condition)


def test_a_batch_is_its_items_also_when_guided(pipeline, condition):
    rng = np.random.default_rng(1)
    coords = [np.argwhere(rng.random((32, 32, 32)) < share) for share in (0.01, 0.03)]
    coords = [c.astype(np.int32) for c in coords]
    key = jax.random.key(0)
    both = pipeline.sample_latents(coords, condition, key, GUIDED)
    noise = pipeline.sample_latents(coords[::-1], condition, key, GUIDED)
    assert [len(z) for z in both] == [len(c) for c in coords]
    assert not np.allclose(both[0], noise[1][: len(both[0])])
    # the first item's noise is the same in a batch of one only if drawn so: compare through
    # decoding of given latents instead
    together = pipeline.decode(coords, both)
    alone = [pipeline.decode([c], [z])[0] for c, z in zip(coords, both, strict=True)]
    for a, b in zip(together, alone, strict=True):
        np.testing.assert_allclose(a.sdf, b.sdf, atol=1e-4)
        np.testing.assert_allclose(a.own_box, b.own_box, atol=1e-4)
        np.testing.assert_allclose(a.joint_code, b.joint_code, atol=1e-4)


def test_guided_velocities_use_each_items_own_voxels(pipeline, condition):
    """Swapping the items of a batch swaps the results, with the noise swapped too."""
    network = build("latent_flow", pipeline.config.model)
    rng = np.random.default_rng(2)
    coords = [
        np.argwhere(rng.random((32, 32, 32)) < share).astype(np.int32) for share in (0.01, 0.02)
    ]
    padded, counts = pad_coords(coords, (1024,))
    x = rng.normal(size=(2, 1024, pipeline.config.model.uniart_vae.latent_channels)).astype("f4")
    x = jnp.asarray(x)

    @jax.jit
    def apply(order, inputs, condition):
        seen = jax.tree.map(lambda c: jnp.repeat(c[order], 2, axis=0), condition)
        return network.apply(
            pipeline.parameters["latent_flow"],
            jnp.repeat(x[order], 2, axis=0),
            jnp.full(4, 0.5),
            seen.tokens,
            seen.volume,
            **flow_arguments(inputs, seen),
        )

    def velocity(order, condition=condition):
        inputs = flow_inputs(padded[order], counts[order], pipeline.config.model)
        return apply(np.array(order), inputs, condition)

    straight, swapped = velocity([0, 1]), velocity([1, 0])
    np.testing.assert_allclose(straight[:2], swapped[2:], atol=2e-5)
    np.testing.assert_allclose(straight[2:], swapped[:2], atol=2e-5)
    np.testing.assert_allclose(straight[0], straight[1], atol=2e-5)
    for field in condition._fields:  # nothing of it goes unread
        turned = jax.tree.map(lambda a: a[::-1], getattr(condition, field))
        other = condition._replace(**{field: turned})
        assert np.abs(velocity([0, 1], other) - straight).max() > 1e-3, field


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


def test_every_view_is_looked_at(pipeline, monkeypatch):
    seen = []

    def encode(pixels):
        seen.append(pixels)
        raise ValueError("enough")

    monkeypatch.setattr(pipeline, "encode_images", encode)
    views = [np.full((40, 40, 4), value, np.uint8) for value in (80, 160, 240)]
    for view in views:
        view[:8, :, 3] = 0
        view[8:, :, 3] = 255
    with pytest.raises(ValueError, match="enough"):
        pipeline.sample(views)
    means = seen[0].mean((1, 2, 3))
    assert len(means) == 3 and (np.diff(means) > 0.1).all()
    with pytest.raises(ValueError, match="no image; give one"):
        pipeline.sample([])


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
        write_network(tmp_path / "export", name, pipeline.parameters[name], dtype="float32")
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


def test_the_layout_network_is_shown_a_crop_of_its_own_size(pipeline, tmp_path, monkeypatch):
    layout = LayoutConfig(
        queries=3, image_size=96, backbone="convolutions", map_channels=8, width=8, layers=1,
        heads=2, sketch_width=8, head_width=8,
    )  # fmt: skip
    model = dataclasses.replace(pipeline.config.model, layout=layout)
    mine = Pipeline(
        dataclasses.replace(pipeline.config, model=model), pipeline.parameters,
        pipeline.statistics, Checkpoint(tmp_path),
    )  # fmt: skip
    write_config(tmp_path, mine.config)
    network = build("layout", model)
    write_network(tmp_path, "layout", parameters_of(network))
    shown, run = [], mine._layout_predictor._run
    monkeypatch.setattr(
        mine._layout_predictor, "_run", lambda params, x: shown.extend(x) or run(params, x)
    )
    image = np.full((300, 200, 4), 255, np.uint8)
    image[:20, :, 3] = 0
    found = mine.layout_or_none(image)
    assert [picture.shape for picture in shown] == [(96, 96, 3)] * 2  # as it is, and mirrored
    assert found.to_json() == mine.layout(image).to_json()
    assert shown[0].shape != mine.prepare(image).shape


def test_a_misspelt_background_is_refused_with_the_choices(pipeline):
    image = np.full((64, 64, 4), 255, np.uint8)
    for ask in (pipeline, pipeline.sample, pipeline.layout_or_none, pipeline.cut_out):
        with pytest.raises(ValueError, match=r"'rembgg' is unknown; choose one of auto, keep, "):
            ask(image, background="rembgg")


@pytest.mark.parametrize("pixels", [np.zeros((9, 9), np.uint8), np.zeros((9, 9, 3), np.float32)])
def test_wrong_arrays(pipeline, pixels):
    with pytest.raises(ValueError, match="uint8"):
        pipeline(pixels)


@pytest.fixture(scope="module")
def trellis():
    """A pipeline of TRELLIS's form with random weights: DINOv2 without a volume, convolutional
    stems, a Gaussian decoder."""
    flow = FlowConfig(model_channels=24, num_blocks=1, num_heads=2, cond_channels=16)
    model = ModelConfig(
        grid=GridConfig(resolution=8, subdivisions=2, max_parts=4),
        image_encoder=ImageEncoderConfig(
            architecture="dinov2", image_size=28, width=16, num_blocks=1, num_heads=2
        ),
        structure_vae=StructureVAEConfig(
            channels=(4, 8), latent_channels=3, num_res_blocks=1, num_res_blocks_middle=1
        ),
        uniart_vae=UniArtVAEConfig(
            width=24, num_blocks=2, num_heads=2, latent_channels=4, window=4, visual_channels=16
        ),
        structure_flow=flow,
        latent_flow=dataclasses.replace(flow, patch_size=2, io_channels=(8,)),
        gaussians=GaussianConfig(num_gaussians=2),
    )
    config = Config(
        name="trellis-form",
        untrained=("uniart_vae.geometry_head", "uniart_vae.front"),
        model=model,
        data=DataConfig(voxel_buckets=(512,)),
        sample_structure=StructureSampleConfig(steps=2, guidance=5.0, guidance_interval=(0.5, 1.0)),
        sample_latent=LatentSampleConfig(steps=2, guidance=3.0, guidance_interval=(0.5, 1.0)),
    )
    parameters = {
        name: parameters_of(build(name, model), seed=i)
        for i, name in enumerate((*NETWORKS, "gaussian_decoder"))
    }
    statistics = {
        "structure": (np.zeros(3, np.float32), np.ones(3, np.float32)),
        "latent": (np.full(4, 0.1, np.float32), np.full(4, 2.0, np.float32)),
    }
    return Pipeline(config, parameters, statistics)


@pytest.mark.slow
def test_networks_of_trelliss_form_go_from_image_to_gaussians(trellis):
    image = np.random.default_rng(0).integers(0, 255, (40, 30, 4)).astype(np.uint8)
    image[..., 3] = 0
    image[5:30, 5:25, 3] = 255
    views = trellis.encode_images(np.stack([trellis.prepare(image)] * 2))
    assert views.volume is None and views.tokens.shape == (2, 1 + 4 + 2 * 2, 16)
    condition = join_views(views)
    assert condition.volume is None and condition.tokens.shape == (1, 18, 16)
    keys = jax.random.split(jax.random.key(0))
    # random weights may leave every logit on one side: take all voxels and drop some
    options = dataclasses.replace(trellis.config.sample_structure, threshold=-100.0)
    coords = trellis.sample_structure(condition, keys[0], options)[0]
    assert coords.shape == (512, 3)
    coords = coords[::3]
    latent = trellis.sample_latents([coords], condition, keys[1])[0]
    assert latent.shape == (len(coords), 4) and np.isfinite(latent).all()
    found, again = trellis.gaussians([coords, coords[:50]], [latent, latent[:50]])
    assert {name: value.shape for name, value in found.items()} == {
        "xyz": (2 * len(coords), 3),
        "features_dc": (2 * len(coords), 1, 3),
        "scaling": (2 * len(coords), 3),
        "rotation": (2 * len(coords), 4),
        "opacity": (2 * len(coords), 1),
    }
    assert again["xyz"].shape == (100, 3)
    distance = np.abs(found["xyz"] - np.repeat((coords + 0.5) / 8, 2, axis=0))
    assert 0 < distance.max() <= 0.75 / 8 + 1e-6


def test_untrained_heads_are_an_error_of_one_line(trellis):
    with pytest.raises(ValueError, match=r"not trained yet.*uniart_vae\.geometry_head") as error:
        trellis(np.zeros((20, 20, 4), np.uint8))
    assert "\n" not in str(error.value) and "gaussians" in str(error.value)


def test_a_checkpoint_names_all_that_it_lacks_and_reads_gaussians_late(trellis, tmp_path):
    folder = tmp_path / "converted"
    write_config(folder, trellis.config)
    for name in ("structure_vae", "uniart_vae", "structure_flow"):
        write_network(folder, name, trellis.parameters[name], dtype="float32")
    with pytest.raises(
        FileNotFoundError, match=r"no image_encoder.safetensors, latent_flow.safetensors in it"
    ):
        load(folder)
    for name in ("image_encoder", "latent_flow"):
        write_network(folder, name, trellis.parameters[name], dtype="float32")
    for name, (mean, std) in trellis.statistics.items():
        write_statistics(folder, name, mean, std)
    pipeline = load(folder)
    assert "gaussian_decoder" not in pipeline.parameters
    coords, latent = np.array([[1, 2, 3]], np.int32), np.ones((1, 4), np.float32)
    with pytest.raises(FileNotFoundError, match=r"no gaussian_decoder.safetensors"):
        pipeline.gaussians([coords], [latent])
    write_network(
        folder, "gaussian_decoder", trellis.parameters["gaussian_decoder"], dtype="float32"
    )
    found, expected = pipeline.gaussians([coords], [latent]), trellis.gaussians([coords], [latent])
    np.testing.assert_array_equal(found[0]["xyz"], expected[0]["xyz"])


def test_a_layout_needs_no_image(pipeline, monkeypatch):
    crowd = make_layout(0.0).taken([0] + [1] * 16)
    for given, says in (
        (True, "an image, a layout, or both"),
        (crowd, "17 parts; this checkpoint"),
    ):
        with pytest.raises(ValueError, match=says):
            pipeline(layout=given)
    picture, camera = render_layout(layout := make_layout(0.0).normalized()[0])
    seen = []
    note = lambda _, pixels, found, *options: seen.append((pixels, found)) or 1 / 0  # noqa: E731
    monkeypatch.setattr("uniart_jax.pipeline.encode_views", note)
    boxes = 3 * layout.boxes + np.array([5, 0, 1, 0, 0, 0])
    metres = dataclasses.replace(layout, boxes=boxes, metres=True)
    with pytest.raises(ZeroDivisionError):
        pipeline(layout=metres)
    with pytest.raises(ZeroDivisionError):
        pipeline(picture, layout=metres)
    for pixels, found in seen:
        assert np.allclose(found.boxes, layout.boxes) and not found.metres
        np.testing.assert_allclose(pixels[0], pipeline.prepare(picture), atol=0.02)
    assert np.allclose(seen[0][1].camera, camera, atol=1e-6)
    spots = [project(found.camera, found.boxes[:, :3]) for _, found in seen]  # found by the outline
    assert np.abs(spots[0] - spots[1]).max() < 0.1


def test_a_vision_language_model_tells_the_layout_of_an_image(pipeline):
    picture, _ = render_layout(make_layout(0.0).normalized()[0])
    rows = json.loads(dataclasses.replace(make_layout(0.0), camera=None).to_json())
    told = {
        "parts": [{n: row[n] for n in ("name", "parent", "box", "joint")} for row in rows["parts"]]
    }
    asked = []
    answer = lambda text, path: asked.append((text, path.suffix)) or json.dumps(told)  # noqa: E731
    layout = pipeline.ask_layout(picture, answer)
    assert asked[0][0].startswith("Describe the object") and asked[0][1] == ".png"
    assert len(layout) == len(make_layout(0.0)) and layout.camera is not None
    assert layout.size == pytest.approx(make_layout(0.0).normalized()[1], rel=0.2)


def test_an_object_of_a_layout_in_metres_has_its_size(pipeline, monkeypatch):
    solved = SimpleNamespace(evaluations=[1], steps_over_tolerance=[0])
    made = {
        "encode_views": lambda *_: SimpleNamespace(original=None),
        "find_voxels": lambda *_: (np.ones((1, 3), int), solved),
        "find_grid": lambda *_: (None, solved),
        "assemble_layout": lambda grid, found, name: found.to_object(),
    }
    for name, step in made.items():
        monkeypatch.setattr(f"uniart_jax.pipeline.{name}", step)
    layout = dataclasses.replace(make_layout(0.0), boxes=3 * make_layout(0.0).boxes)
    sizes = [
        pipeline.sample(layout=dataclasses.replace(layout, metres=metres)).obj.scale
        for metres in (True, False)
    ]
    assert sizes[0] == pytest.approx(3) and sizes[1] != sizes[0]
    picture, camera = render_layout(make_layout(0.0).normalized()[0])
    beside = dataclasses.replace(make_layout(0.0), size=0.7, camera=camera)
    monkeypatch.setattr(pipeline, "_picture", lambda *_: None)
    assert pipeline.sample(picture, layout=beside).obj.scale == pytest.approx(0.7)
    one = pipeline.sample(layout=layout)
    assert one.background == () and one.cut[0].shape == (512, 512, 4)
