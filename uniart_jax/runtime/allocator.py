"""glibc keeps the memory that XLA's CPU programs free, instead of giving it back to the system
after every step.

A training step of nano faulted in 60,000 to 117,000 pages that the step before had given back: a
quarter to a third of its time. Kept, they cost .3 GB of resident memory at most. Other C libraries
are left as they are.
"""

from __future__ import annotations

import ctypes
import os
import sys

SWITCH = "UNIART_ALLOCATOR"  # environment: 0 leaves the allocator as it is
# of malloc.h
M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_MAX, M_ARENA_MAX = -1, -2, -4, -8
TOP_PAD = 256 << 20  # bytes asked of the system at once
NEVER = 2**31 - 1


def keep_freed_memory() -> bool:
    """Set glibc's allocator for training; whether it was done. Any time will do, best before
    threads start.

    Large blocks come from the heap, not from mappings of their own; the heap is not trimmed; all
    threads share one.
    """
    if os.environ.get(SWITCH) == "0" or sys.platform != "linux":
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
        ctypes.CDLL(None).gnu_get_libc_version  # noqa: B018  musl has mallopt too, as a stub
    except (OSError, AttributeError):
        return False
    options = ((M_MMAP_MAX, 0), (M_TRIM_THRESHOLD, NEVER), (M_TOP_PAD, TOP_PAD), (M_ARENA_MAX, 1))
    return all([mallopt(name, value) == 1 for name, value in options])
