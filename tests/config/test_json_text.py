"""Configs as JSON, and what older checkpoints say of options that are gone."""

import json

import pytest

from uniart_jax.config import Config, from_json, to_json
from uniart_jax.config.json_text import RETIRED
from uniart_jax.models.checkpoint import PRETRAINED, Checkpoint


def with_option(name, value):
    """A default config's JSON with one more field, by its dotted name."""
    data = json.loads(to_json(Config()))
    *path, last = name.split(".")
    place = data
    for key in path:
        place = place[key]
    place[last] = value
    return json.dumps(data)


def test_a_config_comes_back():
    assert from_json(Config, to_json(Config(seed=3))) == Config(seed=3)


@pytest.mark.parametrize("name", sorted(RETIRED))
def test_an_option_that_is_gone_is_passed_over(name):
    assert from_json(Config, with_option(name, 0.7)) == Config()


def test_the_shipped_checkpoint_names_options_that_are_gone():
    """Written before they went, it loads as it is."""
    held = json.loads((PRETRAINED / "nano/config.json").read_text())
    for name in RETIRED:
        group, option = name.split(".")
        assert option in held[group]
    assert Checkpoint.find("nano").config.name == "nano"


def test_an_unknown_field_is_named():
    with pytest.raises(ValueError, match=r"unknown or malformed fields: loss\.sample"):
        from_json(Config, with_option("loss.sample", 0.0))
