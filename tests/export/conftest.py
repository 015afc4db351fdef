"""The hand-made cabinet, and its asset folder written once."""

from __future__ import annotations

import pytest
from asset_objects import make_cabinet


@pytest.fixture(scope="session")
def cabinet():
    return make_cabinet()


@pytest.fixture(scope="session")
def stood(cabinet):
    """The cabinet as its files have it: closed, on the floor."""
    from uniart_jax.export.placement import place

    return place(cabinet).obj


@pytest.fixture(scope="session")
def asset(cabinet, tmp_path_factory):
    """The cabinet's asset folder. Tests only read it."""
    from uniart_jax.export.asset import save_asset

    return save_asset(cabinet, tmp_path_factory.mktemp("asset") / "cabinet", seed=7, checkpoint="x")
