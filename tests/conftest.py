"""Settings of the whole suite: JAX on the CPU, compiling quickly and no program twice; hypothesis
draws the same examples every time, without deadlines; tests that need PyBullet are skipped where it
is not installed."""

import ctypes
import gc
import importlib.util
import os
import subprocess
import sys
import types
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from uniart_jax.runtime.compilation_cache import add_quick_xla

assert "jax" not in sys.modules  # it would not see the settings below
os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Most of the suite's time is compiling. Processes that tests start inherit this; ``make test-full``
# sets it to 0.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
LARGE = 0.8e9  # bytes: a worker above gives back what it can
# The longest modules, first: one that began last would keep a single worker busy at the end.
_LONGEST = (
    "test_whole_stages", "test_pipeline", "test_sample", "test_flow_transformer",
    "test_distributed", "test_follow", "test_validate", "test_box_sets", "test_samplers",
    "test_attention", "test_tools", "test_assets", "test_parity", "test_sources",
)  # fmt: skip
_large = LARGE  # and above this: what it could not give back does not count
LONG = {name: place for place, name in enumerate(_LONGEST)}
if os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] == "1":
    add_quick_xla()

gc.disable()  # until all is imported: a quarter of collecting's time
settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("suite")


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: LONG.get(item.path.stem, len(LONG)))
    if importlib.util.find_spec("pybullet") is None:
        skip = pytest.mark.skip(reason="pip install 'uniart_jax[pybullet]'")
        for item in items:
            if item.get_closest_marker("pybullet"):
                item.add_marker(skip)


def pytest_configure(config):
    """Compiled programs in ``.pytest_cache``, for all workers and what they start, and for the next
    run: JAX's own cache, whose keys hold the program, the options and the version.

    An entry that another process has half written cannot be unpacked, and is compiled.
    ``--cache-clear`` empties it.
    """
    if getattr(config, "cache", None) is None:  # -p no:cacheprovider
        return
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(config.cache.mkdir("xla")))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")


def pytest_collection_finish():
    """What is imported by now stays: the collector need not walk it again and again."""
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)
    gc.enable()


@pytest.fixture(scope="module")
def small_pictures():
    """Textures and pictures of assets have few pixels, for modules that do not look at them: most
    of the time of ``save`` is theirs."""
    from uniart_jax.export import atlas, preview
    from uniart_jax.simulation import figure

    with pytest.MonkeyPatch.context() as patch:
        for module, name, pixels in (
            (atlas, "TEXTURE_SIZE", 128),
            (atlas, "ROUGH_TEXTURE", 128),
            (preview, "TILE", 48),
            (preview, "MOTION_SIZE", 48),
            (figure, "TILE", 48),
        ):
            assert getattr(module, name) > pixels
            patch.setattr(module, name, pixels)
        yield


@pytest.fixture
def mujoco_here():
    """``validate`` and ``gate`` run MuJoCo in this process: starting one, with its imports, costs
    more than what it does. Not for tests of the process itself."""
    from uniart_jax.simulation import validate, worker

    def start(command, *, cwd, **options):
        job, result = command[-2:]
        if not job.endswith("mujoco.job"):
            return subprocess.Popen(command, cwd=cwd, **options)
        with pytest.MonkeyPatch.context() as within:
            within.chdir(cwd)  # MuJoCo writes its log where it stands
            within.setattr(worker, "_end_with_parent", lambda: None)
            within.setattr(worker, "_bound", lambda seconds: None)
            worker.main(job, result)
        return types.SimpleNamespace(stdin=None, kill=lambda: None, wait=lambda *seconds: 0)

    names = ("PIPE", "DEVNULL", "TimeoutExpired")
    known = {name: getattr(subprocess, name) for name in names}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validate, "subprocess", types.SimpleNamespace(Popen=start, **known))
        yield


def resident() -> int:
    """Bytes that this process holds; 0 where the system does not say."""
    statm = Path("/proc/self/statm")  # Linux's; elsewhere a worker keeps all
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if statm.is_file() else 0


@pytest.fixture(scope="module", autouse=True)
def forget_programs():
    """A worker that has grown drops a module's programs at its end; those that come again are read
    from the cache. What it still holds then is no reason to look again."""
    global _large
    yield
    if "jax" in sys.modules and resident() > _large:
        sys.modules["jax"].clear_caches()
        gc.unfreeze()
        gc.collect()
        gc.freeze()
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's
        if trim is not None:  # or what was freed stays the worker's
            trim(0)
        _large = max(LARGE, resident() + LARGE / 8)


@pytest.fixture(scope="package")
def little_to_collect():
    """For tests of what collects garbage for each object: JAX's programs, which other modules have
    left, need not be walked each time."""
    gc.collect()
    gc.freeze()
