"""One process at a time in a folder."""

import subprocess
import sys

import pytest

from uniart_jax.runtime import locks

HOLD = """
import sys
from pathlib import Path
from uniart_jax.runtime.locks import exclusive_lock
with exclusive_lock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_refused_until_the_first_is_gone(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path / "run")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as first:
        assert first.stdout is not None and first.stdout.readline() == b"held\n"
        with (
            pytest.raises(ValueError, match="another process works on it"),
            locks.exclusive_lock(tmp_path / "run"),
        ):
            pass
        first.kill()
    with locks.exclusive_lock(tmp_path / "run"):  # a killed process keeps nothing
        pass


@pytest.mark.parametrize("kind", ["exclusive_lock", "in_turn"])
def test_who_comes_second_waits_until_the_first_is_gone(tmp_path, kind):
    code = HOLD.replace(
        "exclusive_lock(Path(sys.argv[1]))", f"{kind}(Path(sys.argv[1]), print)"
    ).replace("import exclusive_lock", f"import {kind}")
    command = [sys.executable, "-c", code, str(tmp_path / "records")]
    held = getattr(locks, kind)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as first:
        assert first.stdout is not None and first.stdout.readline() == b"held\n"
        waited = []

        def told():
            waited.append(first.poll())
            first.kill()

        with held(tmp_path / "records", told):
            assert first.wait() and waited == [None]
            name = {"exclusive_lock": "records/lock", "in_turn": ".records.lock"}[kind]
            with (tmp_path / name).open("w") as other:  # it is held, not only awaited
                assert not locks.try_lock(other)
        with held(tmp_path / "records", told):  # nobody has it
            assert len(waited) == 1


def test_a_file_system_without_locks_holds_nothing(tmp_path, monkeypatch):
    def none(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(locks.fcntl, "flock", none)
    with locks.exclusive_lock(tmp_path), locks.exclusive_lock(tmp_path):
        pass
