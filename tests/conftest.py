"""Settings of the whole suite: JAX on the CPU, compiling quickly; hypothesis draws the same examples every time, without deadlines; tests that need
PyBullet are skipped where it is not installed."""

import importlib.util
import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Most of the suite's time is compiling. Processes that tests start inherit this; ``make test-full`` sets it to 0.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("suite")


def pytest_collection_modifyitems(items):
    if importlib.util.find_spec("pybullet") is None:
        skip = pytest.mark.skip(reason="pip install 'uniart_jax[pybullet]'")
        for item in items:
            if item.get_closest_marker("pybullet"):
                item.add_marker(skip)
