"""Networks that go on from a checkpoint with more than it has: inputs, layers, losses."""

import dataclasses
import shutil

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

import uniart_jax
from uniart_jax import stages
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network
from uniart_jax.models.network import build, flat_names
from uniart_jax.stages.checks import networks_to_copy


@pytest.mark.slow
def test_a_flow_that_read_no_pixels_goes_on_with_them(trained, tmp_path, capsys):
    """Its weights are kept and the new layers add nothing yet, so the network begins with the
    function that it was."""
    config, workdir = trained
    reads = dataclasses.replace(config.model.latent_flow, voxel_channels=8)  # as nano has it
    blind = dataclasses.replace(reads, pixel_channels=0)
    model = dataclasses.replace(config.model, latent_flow=blind)
    config = dataclasses.replace(config, model=dataclasses.replace(config.model, latent_flow=reads))
    source = tmp_path / "source"
    shutil.copytree(workdir / "export", source)
    before = jax.jit(build("latent_flow", model).init)(jax.random.key(7))
    write_network(source, "latent_flow", before, "float32")
    still = dataclasses.replace(config.latent_flow, steps=1, learning_rate=0.0, weight_decay=0.0)
    config = dataclasses.replace(config, latent_flow=still)
    with pytest.raises(ValueError, match=r"does not fit this config; missing: pixel_cube\.bias"):
        stages.run(config, ["latent_flow"], tmp_path / "work", init=source)  # it should have them
    write_config(source, dataclasses.replace(config, model=model))
    target = Checkpoint.of_workdir(tmp_path / "work")
    assert networks_to_copy(config, Checkpoint(source), ["structure_flow"], target) == [
        "image_encoder",
        "structure_vae",
        "uniart_vae",
    ]
    assert "latent_flow has no pixel_channels" in capsys.readouterr().err.replace("\n", " ")
    stages.run(config, ["latent_flow"], tmp_path / "work", init=source)
    after = load_file(tmp_path / "work/export/latent_flow.safetensors")
    for name, leaf in flat_names(before).items():
        np.testing.assert_array_equal(after.pop(name), np.asarray(leaf).astype(np.float16))
    assert {name.split(".")[0] for name in after} == {
        "pixel_in",
        "pixel_hidden",
        "pixel_cube",
        "pixel_voxel",
    }
    added = {name for name in after if name.split(".")[0] in ("pixel_cube", "pixel_voxel")}
    assert len(added) == 4 and not any(after[name].any() for name in added)


@pytest.mark.slow
def test_a_decoder_learns_on_what_a_flow_samples_while_the_encoder_stays(trained, tmp_path):
    config, workdir = trained
    sees = dataclasses.replace(config.model.uniart_vae, layout_channels=4)
    changed = dataclasses.replace(
        config,
        model=dataclasses.replace(config.model, uniart_vae=sees),
        data=dataclasses.replace(config.data, voxel_crop=0),
        loss=dataclasses.replace(config.loss, sampled=0.5),
    )
    with pytest.raises(ValueError, match="give --uniart_vae"):
        stages.run(changed, ["uniart_vae"], tmp_path / "a", init=workdir)
    frozen = dataclasses.replace(config.uniart_vae, freeze=("front", "encoder"))
    changed = dataclasses.replace(changed, uniart_vae=frozen)
    with pytest.raises(FileNotFoundError, match="as --init"):
        stages.run(changed, ["uniart_vae"], tmp_path / "b")
    stages.run(changed, ["uniart_vae"], tmp_path / "c", init=workdir)
    before, after = (
        load_file(folder / "export/uniart_vae.safetensors") for folder in (workdir, tmp_path / "c")
    )
    for name, values in before.items():
        kept = name.split(".")[0] in ("front", "encoder")
        assert np.array_equal(values, after[name]) == kept or not values.any(), name
    assert any(name.startswith("layout.") for name in after)


@pytest.mark.slow
def test_a_flow_gets_a_refiner_that_trains_while_the_flow_stays(trained, tmp_path):
    config, workdir = trained
    refining = dataclasses.replace(config.model.structure_flow, refine_channels=4)
    kept = tuple(k for k in build("structure_flow", config.model).abstract())
    changed = dataclasses.replace(
        config,
        model=dataclasses.replace(config.model, structure_flow=refining),
        loss=dataclasses.replace(config.loss, refined=1.0),
        structure_flow=dataclasses.replace(config.structure_flow, freeze=kept),
    )
    stages.run(changed, ["structure_flow"], tmp_path / "w", init=workdir)
    before, after = (
        load_file(folder / "export/structure_flow.safetensors")
        for folder in (workdir, tmp_path / "w")
    )
    assert all(np.array_equal(values, after[name]) for name, values in before.items())
    assert after["refiner.out.kernel"].any()
    stages.run(changed, ["latent_flow"], tmp_path / "w", init=workdir)
    pipeline = uniart_jax.load(tmp_path / "w")
    seen = pipeline.encode_images(np.full((1, 32, 32, 3), 0.5, np.float32))
    condition = pipeline.following(seen, [None])
    latent = pipeline.solve_structure(condition, jax.random.key(0)).x
    refiner = pipeline.parameters["structure_flow"]["refiner"]
    found, active = [], []
    for bias in (0, 50):
        refiner["out"]["bias"] = np.full_like(refiner["out"]["bias"], bias)
        found.append(pipeline.structure_logits(latent, condition))
        active.append(len(pipeline.sample_structure(condition, jax.random.key(0))[0]))
    np.testing.assert_allclose(found[1] - found[0], 50, atol=1e-3)  # as added to every voxel
    assert active[1] > active[0]


@pytest.mark.slow
def test_what_is_untrained_stays_marked_until_its_stage_is_through(trained, tmp_path):
    config, workdir = trained
    source = tmp_path / "converted"
    shutil.copytree(workdir / "export", source)
    marked = dataclasses.replace(Checkpoint(source).config, untrained=("uniart_vae.front", "x.y"))
    write_config(source, marked)
    work = tmp_path / "work"
    stages.run(config, ("image_encoder",), work, source)
    assert Checkpoint.of_workdir(work).config.untrained == ("uniart_vae.front",)
    with pytest.raises(ValueError, match=r"uniart_vae: not trained yet .*--stage uniart_vae"):
        stages.run(config, ("latent_flow",), work)
    stages.run(config, ("uniart_vae",), work)
    assert Checkpoint.of_workdir(work).config.untrained == ()
