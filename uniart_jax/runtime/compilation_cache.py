"""Traced and compiled programs are kept between runs, or compiled in less time."""

from __future__ import annotations

import os
from importlib import metadata
from pathlib import Path

# Most of the time to compile a small program for a CPU goes into fusing its loops.
QUICK_XLA = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
TRIED_JAXLIB = "0.10.2"  # of ``QUICK_XLA``; XLA ends a process whose options it does not know


def keep_programs(quick: bool = False) -> None:
    """``uniart_jax.keep_programs()``: what command lines do about compiling, for programs and
    notebooks. Call it before anything is computed.

    Traced and compiled programs are kept for the next run (``enable_compilation_cache``).

    Args:
      quick: compile in less time what then runs slower (``quick_compile``), as ``train.py`` does
        where ``Config.quick_compile`` says so.
    """
    enable_compilation_cache()
    if quick:
        quick_compile()


def enable_compilation_cache() -> None:
    """Keep traced and compiled programs between runs, in the user's cache folder, unless JAX was
    told another; programs call this, the library does not."""
    import jax

    from uniart_jax.runtime import program_cache

    if jax.config.jax_compilation_cache_dir is None:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
        jax.config.update("jax_compilation_cache_dir", str(base / "uniart_jax" / "xla"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
        program_cache.keep_programs(base / "uniart_jax" / "programs")


def quick_compile() -> None:
    """Compile in less time what then runs slower: where programs run a few times only.

    It holds for the rest of the process and, as XLA's options are in the environment, for its
    children. Once JAX has touched a device, XLA's options are no longer read.
    """
    import jax

    jax.config.update("jax_disable_most_optimizations", True)
    add_quick_xla()


def add_quick_xla() -> None:
    """Put ``QUICK_XLA`` into the environment, once, where jaxlib is the one it was tried with."""
    flags = os.environ.get("XLA_FLAGS", "")
    if metadata.version("jaxlib") == TRIED_JAXLIB and QUICK_XLA not in flags:
        os.environ["XLA_FLAGS"] = f"{QUICK_XLA} {flags}".strip()
