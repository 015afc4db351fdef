"""Checkpoints: state and data position together, newest good one first, differences by name."""

import asyncio
import re
import sys
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.training import checkpoints as checkpoints_module
from uniart_jax.training.checkpoints import Checkpoints


class Counter:
    """An iterator whose state is whatever it is given."""

    def __init__(self, state):
        self.state = state

    def get_state(self):
        return self.state

    def set_state(self, state):
        self.state = state


def make_state(value: float):
    return {
        "params": {0: {"kernel": jnp.full((64, 48), value), "bias": jnp.arange(3) + value}},
        "step": jnp.int32(value),
    }


def fill(folder, steps):
    with Checkpoints(folder, keep=3) as checkpoints:
        for step in steps:
            checkpoints.save(step, make_state(step), Counter({"next": step}))


def restore(folder, like=None):
    data = Counter(None)
    with Checkpoints(folder, keep=3) as checkpoints:
        return checkpoints.restore(like or make_state(0), data), data.state


def value(state) -> float:
    assert len({float(v) for v in np.asarray(state["params"][0]["kernel"]).ravel()}) == 1
    return float(state["params"][0]["kernel"][0, 0])


@pytest.mark.parametrize("state", [{"next": np.int64(7)}, b"\x00\xff", [1, {"a": 2}], 5])
def test_iterator_states_come_back(tmp_path, state):
    with Checkpoints(tmp_path) as checkpoints:
        checkpoints.save(1, make_state(1), Counter(state))
    assert restore(tmp_path)[1] == state


def test_keeps_the_newest_and_is_none_when_empty(tmp_path):
    assert restore(tmp_path / "empty") == (None, None)
    fill(tmp_path / "full", [1, 2, 3, 4, 5])
    with Checkpoints(tmp_path / "full", keep=3) as checkpoints:
        assert checkpoints.steps == [3, 4, 5]
    state, data = restore(tmp_path / "full")
    assert (value(state), data) == (5, {"next": 5})


def test_a_state_changed_after_save_is_saved_as_it_was(tmp_path):
    change = jax.jit(lambda tree: jax.tree.map(lambda x: x * 0 - 1, tree), donate_argnums=0)
    state, data = make_state(3), Counter({"next": 3})
    with Checkpoints(tmp_path) as checkpoints:
        checkpoints.save(3, state, data)
        change(state)
        data.state["next"] = 99
    state, position = restore(tmp_path)
    assert (value(state), position) == (3, {"next": 3})


def test_saving_does_not_wait_for_the_disk_and_reads_no_donated_buffer(tmp_path, monkeypatch):
    """The disk is slow without end; the loop goes on all the same, and what it then does to the
    state is not what is saved."""
    written, released = checkpoints_module._Position.save, threading.Event()

    async def slow(self, directory):
        write = await written(self, directory)

        async def later():
            await asyncio.to_thread(released.wait, 300)
            await write

        return later()

    monkeypatch.setattr(checkpoints_module._Position, "save", slow)
    change = jax.jit(lambda tree: jax.tree.map(lambda x: x * 0 - 1, tree), donate_argnums=0)
    like = {"params": {"kernel": jnp.full((1024, 1024), 5.0)}}
    state = jax.tree.map(jnp.copy, like)
    with Checkpoints(tmp_path) as checkpoints:
        checkpoints.save(5, state, Counter({"next": 5}))
        for _ in range(10):
            state = change(state)
        now, complete = float(state["params"]["kernel"][0, 0]), (tmp_path / "5").exists()
        released.set()
        checkpoints.wait()
        assert (now, complete) == (-1, False)
        assert (tmp_path / "5").exists()
        found = checkpoints.restore(like, data := Counter(None))
    assert float(found["params"]["kernel"].min()) == float(found["params"]["kernel"].max()) == 5
    assert data.state == {"next": 5}


def test_a_save_that_was_cut_off_is_said_and_the_one_before_taken(tmp_path, capsys):
    fill(tmp_path, [1, 2])
    (tmp_path / "2").rename(tmp_path / "2.orbax-checkpoint-tmp-1234")
    capsys.readouterr()
    assert value(restore(tmp_path)[0]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and f"{tmp_path}/2 was not finished" in err
    fill(tmp_path, [2])
    assert value(restore(tmp_path)[0]) == 2
    assert capsys.readouterr().err == ""


def test_a_save_that_was_cut_off_is_gone_before_the_folder_is_opened(tmp_path, monkeypatch):
    """Two openings, one after the other, do not remove it side by side."""
    (tmp_path / "2.orbax-checkpoint-tmp-1234" / "d").mkdir(parents=True)
    found = []
    opened = checkpoints_module.ocp.training.Checkpointer
    monkeypatch.setattr(
        checkpoints_module.ocp.training,
        "Checkpointer",
        lambda folder, **options: found.append(list(folder.iterdir())) or opened(folder, **options),
    )
    with Checkpoints(tmp_path):
        assert found == [[]]


def truncate(folder):
    for path in folder.rglob("*"):
        if path.is_file() and "/d/" in str(path):
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(folder):
    for path in folder.rglob("*"):
        if path.is_file() and "/d/" in str(path):
            data = bytearray(path.read_bytes())
            data[len(data) // 2] ^= 0xFF
            path.write_bytes(bytes(data))


def no_position(folder):
    for path in (folder / "data").iterdir():
        path.unlink()


def no_metadata(folder):
    for path in (folder / "state").iterdir():
        if path.is_file():
            path.unlink()


def emptied(folder):
    for path in folder.rglob("*"):
        if path.is_file():
            path.write_bytes(b"")


@pytest.mark.parametrize("damage", [truncate, flip, no_position, no_metadata, emptied])
def test_a_damaged_newest_falls_back_and_saving_goes_on(tmp_path, damage, capsys):
    fill(tmp_path, [1, 2])
    damage(tmp_path / "2")
    capsys.readouterr()
    state, data = restore(tmp_path)
    assert (value(state), data) == (1, {"next": 1})
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "2 is damaged (" in err, err
    reasons = "DATA_LOSS|No such file|arrays|metadata"  # what was met, not what was being done
    assert re.search(reasons, err) and "handler" not in err and "NoneType" not in err, err
    fill(tmp_path, [2])
    damage(tmp_path / "2")
    assert value(restore(tmp_path)[0]) == 1
    fill(tmp_path, [2, 3])
    assert value(restore(tmp_path)[0]) == 3


def test_all_damaged_is_an_error(tmp_path):
    fill(tmp_path, [1, 2])
    truncate(tmp_path)
    for _ in range(2):  # the second time they are already aside: still no fresh start
        with pytest.raises(
            ValueError, match=r"none of the checkpoints \[1, 2\] can be read"
        ) as error:
            restore(tmp_path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        PermissionError(13, "Permission denied"),
        OSError(24, "Too many open files"),
        ValueError("PERMISSION_DENIED: Error opening d/1"),
        RuntimeError("RESOURCE_EXHAUSTED: Out of memory"),
    ],
    ids=str,
)
def test_what_says_nothing_about_a_checkpoint(error):
    assert checkpoints_module._of_the_machine(error)
    assert checkpoints_module._of_the_machine(ExceptionGroup("two", [ValueError("x"), error]))
    with pytest.raises(ValueError) as wrapped:
        raise ValueError("while reading") from error
    assert checkpoints_module._of_the_machine(wrapped.value)


@pytest.mark.parametrize("error", [FileNotFoundError(2, "absent"), ValueError("DATA_LOSS: x")])
def test_what_is_damage(error):
    assert not checkpoints_module._of_the_machine(error)


@pytest.mark.parametrize("method", ["metadata", "load_checkpointables"])
def test_what_is_no_damage_is_raised_and_touches_nothing(tmp_path, monkeypatch, method):
    fill(tmp_path, [1, 2])

    def fail(*_, **__):
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(f"orbax.checkpoint.v1.{method}", fail)
        with pytest.raises(MemoryError):
            restore(tmp_path)
    assert value(restore(tmp_path)[0]) == 2


def test_another_structure_lists_every_name_and_touches_nothing(tmp_path):
    fill(tmp_path, [1, 2])
    like = make_state(0)
    like["params"][1] = like["params"].pop(0)
    like["params"][1]["bias"] = jnp.zeros(4)
    like["step"] = jnp.float32(0)  # told only where the parameters agree
    with pytest.raises(ValueError) as error:
        restore(tmp_path, like)
    text = str(error.value)
    assert "\n" not in text
    assert "missing: params.1.bias, params.1.kernel;" in text
    assert "extra: params.0.bias, params.0.kernel;" in text
    with pytest.raises(ValueError, match=r"mismatched: step is int32\[\], expected float32\[\];"):
        restore(tmp_path, {**make_state(0), "step": jnp.float32(0)})
    assert value(restore(tmp_path)[0]) == 2


def test_restores_from_shapes_alone(tmp_path):
    fill(tmp_path, [1])
    sharding = jax.sharding.SingleDeviceSharding(jax.devices()[0])
    like = jax.tree.map(
        lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=sharding), make_state(0)
    )
    assert value(restore(tmp_path, like)[0]) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size")
@pytest.mark.parametrize("found", ["by the next save", "on leaving"])
def test_a_full_disk_is_one_line_and_the_checkpoint_before_stays(tmp_path, capfd, caplog, found):
    """No file may grow beyond 64 kB: what a full disk looks like to whoever writes."""
    import resource

    big = make_state(2)
    big["params"][0]["kernel"] = jax.random.normal(jax.random.key(0), (400, 400))
    fill(tmp_path, [1])
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 16, usual[1]))
    try:
        with (
            pytest.raises(OSError, match="no room on the disk") as error,
            Checkpoints(tmp_path) as c,
        ):
            c.save(2, big, Counter({"next": 2}))
            if found == "by the next save":
                c.save(3, big, Counter({"next": 3}))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert "\n" not in str(error.value) and str(tmp_path) in str(error.value)
    # tasks of other tests' damaged folders may be collected, and told of, meanwhile
    told = [r for r in caplog.records if r.name != "asyncio" or str(tmp_path) in r.getMessage()]
    assert not [record for record in told if record.exc_info]
    assert "Traceback" not in "".join(capfd.readouterr())
    assert [path.name for path in tmp_path.iterdir()] == ["1"]
    state, data = restore(tmp_path)
    assert (value(state), data) == (1, {"next": 1})
    assert not capfd.readouterr().err  # nothing is left to warn of


def test_other_failures_of_a_save_are_raised_as_they_are(tmp_path, monkeypatch):
    async def broken(*_):
        raise PermissionError("not yours")

    monkeypatch.setattr(checkpoints_module._Position, "save", broken)
    with pytest.raises(Exception) as error, Checkpoints(tmp_path) as checkpoints:
        checkpoints.save(1, make_state(1), Counter(1), wait=True)
    assert "no room" not in str(error.value) and "not yours" in str(error.value)
