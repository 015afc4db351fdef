"""Programs and shapes that are kept between runs: read again where nothing has changed, and only
there."""

import logging
import os
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import parameters
from jax import export

from uniart_jax.config import SampleConfig, load_config
from uniart_jax.inference.samplers import make_structure_sampler
from uniart_jax.models.network import build
from uniart_jax.runtime import program_cache
from uniart_jax.runtime.program_cache import keep_programs, kept_program, kept_shapes
from uniart_jax.voxels.typed_batches import Condition


class Twice(NamedTuple):
    double: jax.Array
    draw: jax.Array


export.register_namedtuple_serialization(Twice, serialized_name="tests.Twice")


@pytest.fixture
def folder(tmp_path):
    """A cache that is used while a test runs."""
    keep_programs(tmp_path / "programs")
    yield tmp_path / "programs"
    keep_programs(None)


class Counted:
    """A function that counts how often it is traced; a new one stands for another run."""

    def __init__(self, factor: float = 2.0):
        self.traces, self.factor = 0, factor

    def program(self, *settings):
        return kept_program(jax.jit(self.run), *settings)

    def run(self, params, x, key):
        self.traces += 1
        return {"out": Twice(self.factor * x + params["bias"], jax.random.normal(key, x.shape))}


ARGS = ({"bias": np.float32(1)}, np.arange(3, dtype=np.float32), jax.random.key(3))


def test_a_second_run_traces_nothing_and_gives_the_same_bits(folder):
    first, second = Counted(), Counted()
    expected, found = first.program("a")(*ARGS), second.program("a")(*ARGS)
    assert (first.traces, second.traces) == (1, 0)
    assert isinstance(found["out"], Twice)
    plain = jax.jit(Counted().run)(*ARGS)
    for other in (expected, found):
        for name in ("double", "draw"):
            a, b = getattr(plain["out"], name), getattr(other["out"], name)
            assert np.array_equal(a, b)


@pytest.mark.parametrize(
    "change", ["settings", "shapes", "types", "names", "sources", "versions", "options"]
)
def test_what_a_trace_depends_on_makes_another_program(folder, change, monkeypatch):
    Counted().program("a")(*ARGS)
    digest, (params, x, key) = program_cache._sources, ARGS
    if change == "shapes":
        x = np.arange(4, dtype=np.float32)
    if change == "types":
        x = np.arange(3, dtype=np.int32)
    if change == "names":
        params = {"bias": np.float32(1), "more": np.float32(1)}
    if change == "sources":
        monkeypatch.setattr(program_cache, "_sources", lambda: "edited")
    if change == "versions":
        digest.cache_clear()
        monkeypatch.setattr(program_cache.metadata, "version", lambda name: "99")
    precision = "highest" if change == "options" else None
    other = Counted(3.0)
    with jax.default_matmul_precision(precision):
        found = other.program("b" if change == "settings" else "a")(params, x, key)
    digest.cache_clear()
    assert other.traces == 1
    assert np.array_equal(found["out"].double, 3 * x + 1)


def test_a_new_source_file_changes_the_digest(tmp_path, monkeypatch):
    monkeypatch.setattr(program_cache, "PACKAGE", tmp_path)
    digests = set()
    for text in ("x = 1\n", "x = 2\n"):
        program_cache._sources.cache_clear()
        (tmp_path / "module.py").write_text(text)
        digests.add(program_cache._sources())
    program_cache._sources.cache_clear()
    assert len(digests) == 2


@pytest.mark.parametrize("how", ["cut", "one bit"])
def test_damaged_files_are_made_again_and_said(folder, caplog, how):
    Counted().program("a")(*ARGS)
    kept_shapes(lambda: {"w": jax.ShapeDtypeStruct((2,), np.float32)}, "a")
    files = sorted(folder.iterdir())
    assert {file.suffix for file in files} == {".json", ".program"}
    for file in files:
        data = bytearray(file.read_bytes())
        if how == "cut":
            data = data[:7]
        else:
            data[len(data) * 3 // 4] ^= 1
        file.write_bytes(data)
    again = Counted()
    with caplog.at_level(logging.WARNING):
        again.program("a")(*ARGS)
        shapes = kept_shapes(lambda: {"w": jax.ShapeDtypeStruct((2,), np.float32)}, "a")
    assert again.traces == 1 and shapes["w"].shape == (2,)
    assert sum("is damaged" in record.message for record in caplog.records) == 2
    third = Counted()
    third.program("a")(*ARGS)
    assert third.traces == 0


def test_without_a_folder_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    keep_programs(None)
    for _ in range(2):
        counted = Counted()
        counted.program("a")(*ARGS)
        assert counted.traces == 1
    assert kept_shapes(lambda: {"w": jax.ShapeDtypeStruct((2,), np.float32)}) is not None
    assert not list(tmp_path.iterdir())


def test_inside_another_program_it_is_the_plain_function(folder):
    kept = Counted().program("a")
    found = jax.jit(lambda *args: kept(*args)["out"].double * 2)(*ARGS)
    assert np.array_equal(found, 2 * (2 * ARGS[1] + 1))
    assert not folder.exists()


def test_several_devices_keep_nothing(folder, monkeypatch):
    monkeypatch.setattr(jax, "devices", lambda: ["one", "two"])
    Counted().program("a")(*ARGS)
    assert not folder.exists()


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, caplog):
    (tmp_path / "file").write_text("")
    keep_programs(tmp_path / "file" / "programs")
    try:
        with caplog.at_level(logging.WARNING):
            found = Counted().program("a")(*ARGS)
    finally:
        keep_programs(None)
    assert np.array_equal(found["out"].double, 2 * ARGS[1] + 1)
    assert caplog.text.count("could not be written") == 1


def test_files_that_were_not_used_for_longest_are_removed(folder, monkeypatch):
    monkeypatch.setattr(program_cache, "MOST_FILES", 2)
    shapes = {"w": jax.ShapeDtypeStruct((2,), np.float32)}
    for k in (0, 1):
        kept_shapes(lambda: shapes, k)
    for age, file in enumerate(sorted(folder.iterdir(), key=lambda file: file.stat().st_mtime)):
        os.utime(file, (1000 + age, 1000 + age))
    kept_shapes(lambda: pytest.fail("made again"), 0)  # used: 1 is the oldest now
    kept_shapes(lambda: shapes, 2)
    assert len(list(folder.iterdir())) == 2
    kept_shapes(lambda: pytest.fail("made again"), 0)
    again = []
    kept_shapes(lambda: again.append(1) or shapes, 1)
    assert again


class Unknown(NamedTuple):
    """A named tuple that ``jax.export`` does not know."""

    x: jax.Array


def test_what_cannot_be_exported_runs_and_is_not_kept(folder):
    kept = kept_program(jax.jit(lambda x: Unknown(x + 1)), "a")
    for _ in range(2):
        assert kept(ARGS[1]).x.tolist() == [1, 2, 3]
    assert not folder.exists()


def test_options_and_weak_types_tell_calls_of_one_program_apart(folder):
    kept = kept_program(jax.jit(lambda x, y: x * y), "a")
    half = np.ones(2, jnp.bfloat16)
    assert kept(half, 2.0).dtype == jnp.bfloat16
    assert kept(half, np.float32(2)).dtype == np.float32
    double = np.ones(2)
    assert kept(double, 2.0).dtype == np.float32
    with jax.enable_x64(True):
        assert kept(double, 2.0).dtype == np.float64


def test_shapes_of_a_network_come_back_as_they_were(folder):
    model = load_config("configs/debug.py").model
    expected = build("uniart_vae", model).abstract()
    for make in (lambda: expected, lambda: pytest.fail("made again")):
        found = kept_shapes(make, "uniart_vae", model)
        assert jax.tree.structure(found) == jax.tree.structure(expected)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            assert (a.shape, a.dtype) == (b.shape, b.dtype)


def test_a_sampler_that_is_kept_gives_the_same_bits(folder):
    model = load_config("configs/debug.py").model
    options, rng = SampleConfig(steps=2), np.random.default_rng(0)
    flow = build("structure_flow", model)
    c = model.structure_flow
    shapes = ((1, 5, c.cond_channels), (1, *3 * [c.volume_resolution], c.volume_channels))
    condition = Condition(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))
    given = (parameters(flow), (np.float32(0), np.float32(1)), condition, jax.random.key(0))
    sampler = make_structure_sampler(model, options)
    expected = sampler(*given)
    for _ in range(2):
        found = kept_program(sampler, "structure sampler", model, options)(*given)
        assert type(found) is type(expected)
        assert np.array_equal(found.x, expected.x)
