"""Memory given back between objects, so that a worker needs what its largest object needs and not
what all of them left behind."""

from __future__ import annotations

import ctypes
import gc


def release() -> None:
    """Free what nobody uses: meshes and their colours point at each other, which keeps decoded
    textures until Python looks for such rings, and the C library keeps pages that are free."""
    gc.collect()
    if _trim is not None:
        _trim(0)


try:
    _trim = ctypes.CDLL(None).malloc_trim  # glibc alone has it
except (OSError, TypeError, AttributeError):
    _trim = None
