"""The hand-made cabinet, and its asset folder written once."""

from __future__ import annotations

import functools

import pytest
from asset_objects import make_block, make_cabinet


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


@pytest.fixture(scope="session")
def page_file(cabinet, tmp_path_factory):
    """The cabinet's page. Tests only read it."""
    from page_objects import write_all

    return write_all(cabinet, tmp_path_factory.mktemp("page"))


@pytest.fixture
def block(monkeypatch):
    """Two boxes, and small pictures: quick to write."""
    from uniart_jax.export import asset as asset_module
    from uniart_jax.export import preview
    from uniart_jax.export.atlas import make_atlas

    monkeypatch.setattr(asset_module, "make_atlas", functools.partial(make_atlas, size=64))
    monkeypatch.setattr(preview, "TILE", 48)
    monkeypatch.setattr(preview, "MOTION_SIZE", 48)
    return make_block()
