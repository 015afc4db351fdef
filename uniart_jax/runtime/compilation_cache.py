"""Compiled programs are kept between runs."""

from __future__ import annotations

import os
from pathlib import Path


def enable_compilation_cache() -> None:
    """Keep compiled programs between runs, in the user's cache folder; programs call this, the
    library does not."""
    import jax

    if jax.config.jax_compilation_cache_dir is None:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
        jax.config.update("jax_compilation_cache_dir", str(base / "uniart_jax" / "xla"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
