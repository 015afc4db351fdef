"""All five stages, trained once at toy size."""

import os

import pytest


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """A config and the WORKDIR of its five stages. Of several pytest processes one trains; the
    others wait, and find every stage trained."""
    # not above: JAX would be there before it is told where compiled programs are kept
    from toy_stages import toy

    from uniart_jax import stages
    from uniart_jax.config import NETWORKS
    from uniart_jax.runtime.locks import in_turn

    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    config = toy(folder / "stages")
    with in_turn(folder / "stages", lambda: None):
        stages.run(config, NETWORKS, folder / "stages" / "work")
    return config, folder / "stages" / "work"
