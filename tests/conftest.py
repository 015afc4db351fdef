"""Settings of the whole suite: JAX on the CPU, compiling quickly and no program twice; hypothesis draws the same examples every time, without deadlines."""

import gc
import os

from hypothesis import HealthCheck, settings

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Most of the suite's time is compiling. Processes that tests start inherit this; ``make test-full`` sets it to 0.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
QUICK = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
if os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] == "1":
    os.environ["XLA_FLAGS"] = f"{QUICK} {os.environ.get('XLA_FLAGS', '')}"

settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("suite")


def pytest_configure(config):
    """Compiled programs in ``.pytest_cache``, for all workers and what they start, and for the next run: JAX's own cache, whose keys hold the program, the options and the version. ``--cache-clear`` empties it."""
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(config.cache.mkdir("xla")))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")


def pytest_collection_finish():
    """What is imported by now stays: the collector need not walk it again and again."""
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)
