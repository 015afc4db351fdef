"""Evaluation reads asset after asset."""

import pytest


@pytest.fixture(scope="package", autouse=True)
def collected(little_to_collect):
    """``compare`` collects garbage before each object."""
