"""Files are complete or absent, and nobody else's unfinished ones are touched."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from uniart_jax.runtime import files


def test_a_failure_leaves_the_file_as_it_was_and_nothing_beside_it(tmp_path):
    path = tmp_path / "table.md"
    files.write_text(path, "old\n")
    with pytest.raises(ZeroDivisionError), files.complete(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    with pytest.raises(UnicodeEncodeError):
        files.write_text(path, "\ud800")
    assert path.read_bytes() == b"old\n" and os.listdir(tmp_path) == ["table.md"]


def test_what_a_process_that_is_gone_left_is_removed_and_no_other(tmp_path):
    call = "from uniart_jax.runtime.files import *; import sys; print(temporary_path(Path('a')))"
    gone = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, check=True)
    mine = files.temporary_path(tmp_path / "b").name
    for name in (gone.stdout.strip(), mine, ".a.elsewhere-1.tmp", ".a.tmp"):
        (tmp_path / name).touch()
    files.sweep(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {mine, ".a.elsewhere-1.tmp", ".a.tmp"}


def test_containers_of_one_host_name_have_names_of_their_own(monkeypatch):
    places = []
    for namespace in ("pid:[4026531836]", "pid:[4026532201]"):
        monkeypatch.setattr(os, "readlink", lambda _, namespace=namespace: namespace)
        places.append(files._place())
    assert places[0] != places[1]
    assert "." not in places[0] + places[1] and "-" not in places[0] + places[1]


@pytest.mark.parametrize("make", [str, Path])
def test_the_address_of_a_bucket_is_no_folder(make):
    for address in ("gs://bucket/run", "s3://b", "https://host/x"):
        with pytest.raises(ValueError, match=f"--out '{address}': .*mount the bucket .gcsfuse"):
            files.check_local(make(address), "--out")
    for folder in ("", "runs/a", "/mnt/gs/run", "C:/runs", "hf:org/name", "a b: c/d"):
        files.check_local(make(folder), "--out")
