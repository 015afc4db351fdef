"""What ``print`` and ``dir`` show: of what the package gives a short line, of a sample a few."""

import dataclasses

import jax
import numpy as np

import uniart_jax
from uniart_jax.config import Config, MaskConfig, ModelConfig, StructureVAEConfig
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import Pipeline, Sample
from uniart_jax.procedural import generate
from uniart_jax.stages import Trainer
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.panel_table import Panels


def test_an_object_names_its_parts_and_joints():
    oven = generate("oven", 3)
    shown = str(oven)
    assert shown.startswith("ArticulatedObject(oven-3, oven: 6 parts: body, door (revolute), ")
    assert shown.endswith(f"1 unit = {oven.scale:.4g} m)") and len(shown) < 200
    many = ArticulatedObject([oven.parts[0], *[part(oven, i) for i in range(20)]])
    assert "unnamed: 21 parts" in str(many) and str(many).count("more") == 8 - 1
    assert ", ...; 1 unit = 1 m)" in str(many)


def part(oven, i):
    return dataclasses.replace(oven.parts[1], name=f"more_{i}")


def test_a_network_counts_its_parameters():
    small = StructureVAEConfig(patch_size=2, channels=(8, 16), num_res_blocks=1)
    network = build("structure_vae", ModelConfig(structure_vae=small))
    count = sum(leaf.size for leaf in jax.tree.leaves(network.abstract()))
    assert str(network) == f"Network(structure_vae: {count:,} parameters)" and count > 1000


def test_a_pipeline_says_what_it_holds(tmp_path):
    parameters = {"image_encoder": {"kernel": np.zeros(1_500_000)}}
    pipeline = Pipeline(Config(name="mine"), parameters, {})
    assert str(pipeline) == (
        "Pipeline(mine: 1.5 million parameters in image_encoder; "
        "64^3 voxels of 4^3 sub-cells; from memory)"
    )
    (tmp_path / "mask.safetensors").touch()  # counted, though it is not read yet
    mask = MaskConfig(channels=8, width=16)
    pipeline.config = Config(name="mine", model=ModelConfig(mask=mask))
    pipeline.checkpoint = Checkpoint(tmp_path)
    network = build("mask", pipeline.config.model)
    count = sum(leaf.size for leaf in jax.tree.leaves(network.abstract()))
    assert count > 100_000
    millions = f"{1.5 + count / 1e6:.1f} million parameters in image_encoder, mask; "
    assert millions in str(pipeline) and str(tmp_path) in str(pipeline)


def test_a_layout_names_the_joints_of_its_parts():
    layout = Layout.of_object(generate("oven", 3))
    sure = np.linspace(0.72, 1, len(layout))
    layout = dataclasses.replace(layout, confidence=sure, camera=np.zeros(7))
    types = ", ".join(joint.type for joint in layout.joints)
    assert str(layout) == f"Layout(6 parts: {types}; confidence from 0.72; with camera)"
    boards = (None, Panels(np.zeros((1, 6)), 0.9), *[None] * 4)
    assert str(dataclasses.replace(layout, boards=boards)).endswith("; with camera, boards)")
    assert str(dataclasses.replace(layout, camera=None, boards=(None,) * 6)).endswith("from 0.72)")


def test_a_sample_says_what_was_found_and_how():
    oven = generate("oven", 3)
    cut = np.zeros((64, 64, 4), np.uint8)
    evaluations, layout = {"structure": 2, "latent": 3}, Layout.of_object(oven)
    sample = Sample(oven, {}, evaluations, {}, None, ("alpha",), (cut,), layout)
    first, *rest = str(sample).splitlines()
    assert first == "Sample(an oven-like object: 1 door, 4 knobs"
    assert [line.strip() for line in rest] == [
        str(oven),
        "network evaluations: structure 2, latent 3",
        "cut out by: alpha",
        f"follows {layout})",
    ]
    assert str(Sample(oven, {}, {}, {})).endswith("\n  follows no layout)")


def test_a_trainer_says_what_it_trains_and_how_far_it_is(tmp_path):
    (tmp_path / "export").mkdir()
    (tmp_path / "export" / "uniart_vae.safetensors").touch()
    networks = "image_encoder, structure_vae, uniart_vae, structure_flow, latent_flow"
    assert str(Trainer(Config(name="mine"), tmp_path)) == (
        f"Trainer(mine: {networks}; 1 of 5 exported in {tmp_path})"
    )
    assert str(Trainer(Config(), tmp_path, "nano")).endswith("; goes on from nano)")


def test_the_package_lists_its_public_names():
    assert set(uniart_jax.__all__) <= set(dir(uniart_jax))
    assert {"load", "Trainer", "load_object", "ArticulatedObject"} <= set(dir(uniart_jax))
