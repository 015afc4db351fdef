"""What ``print`` shows of a pipeline, a network and an object: one short line."""

import dataclasses

import jax
import numpy as np

from uniart_jax.config import Config, ModelConfig, StructureVAEConfig
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import Pipeline
from uniart_jax.procedural import generate


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
    (tmp_path / "layout.safetensors").touch()
    pipeline.checkpoint = Checkpoint(tmp_path)
    assert "image_encoder, beside them layout; " in str(pipeline) and str(tmp_path) in str(pipeline)
