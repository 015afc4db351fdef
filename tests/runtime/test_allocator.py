"""Freed memory stays with the process where glibc says so, and nothing happens where it is switched
off."""

import platform
import subprocess
import sys

import pytest

from uniart_jax.runtime import allocator

PROGRAM = """
import resource
from uniart_jax.runtime.allocator import keep_freed_memory
kept = keep_freed_memory()
def fill():
    block = bytearray(64 << 20)
    block[::4096] = b"1" * len(block[::4096])
fill()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(4):
    fill()
print(int(kept), resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def faults(**environment):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, env=environment
    )
    return [int(word) for word in done.stdout.split()]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc's allocator alone is set")
def test_freed_blocks_are_not_faulted_in_again():
    kept, few = faults()
    left, many = faults(UNIART_ALLOCATOR="0")
    assert (kept, left) == (1, 0)
    assert few < 1000 < 16_000 < many  # 64 MiB are 16,384 pages


def test_other_systems_are_left_alone(monkeypatch):
    monkeypatch.setattr(allocator.sys, "platform", "darwin")
    assert allocator.keep_freed_memory() is False
