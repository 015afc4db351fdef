"""How flows are sampled, as asked of the pipeline: both, or one alone."""

import dataclasses
import inspect

import pytest

from uniart_jax.config import Config, LatentSampleConfig, SampleConfig, StructureSampleConfig
from uniart_jax.pipeline import Pipeline, SamplingOptions

STRUCTURE = StructureSampleConfig(steps=5, guidance=2.0, threshold=0.5)
LATENT = LatentSampleConfig(steps=7, guidance=3.0, sdf_offset=0.1)
ALONE = {"structure", "latent"}


@pytest.fixture
def pipeline():
    """Without networks."""
    return Pipeline(Config(sample_structure=STRUCTURE, sample_latent=LATENT), {}, {})


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"solver": "Heun"}, "solver must be euler or heun"),
        ({"solvr": "heun"}, "sampling has no option 'solvr'; there are solver, adaptive"),
        ({"guidance": float("nan")}, "guidance must be"),
        ({"steps": 0}, "at least 1 step"),
        ({"tolerance": 5.0}, "tolerance must be in"),
        (
            {"structure": {"stepz": 3}},
            "structure has no option 'stepz'; there are solver, .*thresh",
        ),
        ({"structure": {"sdf_blur": 3}}, "structure has no option 'sdf_blur'"),
        ({"latent": {"threshold": 0.0}}, "latent has no option 'threshold'"),
        ({"latent": {"steps": 0}}, "at least 1 step"),
        ({"latent": 3}, "latent: give its options by name, .* got 3"),
    ],
)
def test_options_that_cannot_be_are_told(pipeline, changes, says):
    with pytest.raises(ValueError, match=says):
        pipeline.options(**changes)


def test_a_flow_has_options_of_its_own_before_those_of_both(pipeline):
    assert pipeline.options() == (STRUCTURE, LATENT)
    both = pipeline.options(steps=4, guidance=None)
    assert [(o.steps, o.guidance) for o in both] == [(4, 2.0), (4, 3.0)]
    alone = pipeline.options(
        steps=4, structure={"steps": 3, "threshold": -1.0}, latent={"guidance": 1.0, "steps": None}
    )
    assert alone == (
        dataclasses.replace(STRUCTURE, steps=3, threshold=-1.0),
        dataclasses.replace(LATENT, steps=4, guidance=1.0),
    )


def test_sampling_has_every_option_of_the_config_by_name():
    fields = {field.name for field in dataclasses.fields(SampleConfig)} | ALONE
    assert set(SamplingOptions.__annotations__) == fields
    assert fields <= set(inspect.signature(Pipeline.sample).parameters)


def test_options_of_one_flow_are_asked_of_the_pipeline(pipeline, monkeypatch):
    asked = []
    monkeypatch.setattr(pipeline, "options", lambda **options: asked.append(options) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        pipeline([[]], structure={"steps": 3}, latent={"guidance": 1.0})
    assert asked[0]["structure"] == {"steps": 3} and asked[0]["latent"] == {"guidance": 1.0}
