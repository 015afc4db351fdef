"""Traced programs and the shapes of networks, kept between runs beside XLA's compiled programs.

Tracing the networks of a small model takes longer than running them. What is kept is read again
only with the same source files of this package, the same versions and kind of device, the same
settings, options of JAX and shapes. Programs are files of ``jax.export`` behind their SHA-256,
shapes are JSON: nothing is unpickled.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import logging
import os
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

from uniart_jax.runtime.files import complete

PACKAGE = Path(__file__).parents[1]
LIBRARIES = ("jax", "jaxlib", "flax", "numpy")
OPTIONS = (  # of JAX, which a trace depends on
    "jax_enable_x64",
    "jax_default_matmul_precision",
    "jax_default_dtype_bits",
    "jax_default_prng_impl",
    "jax_numpy_dtype_promotion",
    "jax_threefry_partitionable",
)
MOST_FILES = 200  # that are kept
DIGEST = hashlib.sha256().digest_size

logger = logging.getLogger(__name__)
_folder: Path | None = None  # None: nothing is kept


def keep_programs(folder: Path | None) -> None:
    """Keep programs in a folder from now on, in this process; None: no longer."""
    global _folder
    _folder = folder


def kept_program(jitted: Callable[..., Any], *settings: Any) -> Callable[..., Any]:
    """A jitted function whose traces are kept between runs, where ``keep_programs`` says so.

    Only on one device, and only called with arrays: with tracers it is ``jitted`` itself. What
    ``jax.export`` refuses, such as cuDNN's attention, is traced anew in every run.

    Args:
      jitted: a pure function of pytrees of arrays, by position, without static fields; of what it
        returns, named tuples must be known to ``jax.export``.
      settings: all that its trace depends on besides its arguments, in values whose ``repr`` says
        all of them.
    """
    programs: dict[Any, Callable[..., Any]] = {}

    @functools.wraps(jitted)
    def run(*args: Any) -> Any:
        import jax

        leaves, tree = jax.tree.flatten(args)
        if _folder is None or len(jax.devices()) > 1 or _traced(leaves):
            return jitted(*args)
        kinds = [jax.typeof(leaf) for leaf in leaves]
        shapes = tuple((kind.shape, kind.dtype, kind.weak_type) for kind in kinds)
        key = (tree, shapes, _options())
        if key not in programs:
            device = jax.devices()[0]
            kind = (device.platform, device.device_kind)
            path = _path(_folder, ".program", tree, shapes, kind, settings)
            programs[key] = _read_program(path) or _trace(path, jitted, tree, leaves)
        return programs[key](*leaves)

    return run


def kept_shapes(make: Callable[[], dict[str, Any]], *settings: Any) -> dict[str, Any]:
    """The nested dict of ``jax.ShapeDtypeStruct`` that ``make`` gives, kept between runs, where
    ``keep_programs`` says so.

    Args:
      settings: as in ``kept_program``.
    """
    import jax

    if _folder is None:
        return make()
    path = _path(_folder, ".json", settings)
    found = _read(path)
    try:
        if found is not None:
            tree = json.loads(found)
            return _nested(tree, lambda leaf: jax.ShapeDtypeStruct(leaf[0], leaf[1]))
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        logger.warning("cache: %s is damaged (%s) and is made again", path, error)
    made = make()
    text = json.dumps(_nested(made, lambda leaf: [leaf.shape, str(leaf.dtype)]))
    _write(path, text.encode())
    return made


def _nested(tree: Any, change: Callable[[Any], Any]) -> Any:
    if not isinstance(tree, dict):
        return change(tree)
    return {name: _nested(value, change) for name, value in tree.items()}


def _traced(leaves: list[Any]) -> bool:
    import jax

    return any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)


def _read_program(path: Path) -> Callable[..., Any] | None:
    """The program of a file, as function of a call's leaves; None where there is none."""
    import jax
    from jax import export

    data = _read(path)
    if data is None:
        return None
    try:
        return jax.jit(export.deserialize(bytearray(data)).call)
    except Exception as error:  # of another release of JAX with the same version, for instance
        logger.warning("cache: %s cannot be read (%s) and is made again", path, error)
        return None


def _trace(path: Path, jitted: Callable[..., Any], tree: Any, leaves: list[Any]) -> Any:
    """Trace, keep, and give the program as function of a call's leaves."""
    import jax
    from jax import export

    def flat(*values: Any) -> Any:
        return jitted(*jax.tree.unflatten(tree, values))

    try:
        made = export.export(jax.jit(flat))(*leaves)
        data = bytes(made.serialize())
    except Exception as error:  # what cannot be exported can run
        logger.info("cache: a program is not kept: %s", error)
        return flat
    _write(path, data)
    return jax.jit(made.call)


def _read(path: Path) -> bytes | None:
    """What ``_write`` put into a file, which is marked as used; None where there is none."""
    try:
        found = path.read_bytes()
    except OSError:  # none there, or a folder that cannot be read: ``_write`` tells
        return None
    digest, data = found[:DIGEST], found[DIGEST:]
    if hashlib.sha256(data).digest() != digest:
        logger.warning("cache: %s is damaged and is made again", path)
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return data


def _write(path: Path, data: bytes) -> None:
    """Put a file into the cache, and remove those that have not been used for longest; a cache
    that cannot be written is told once and is no error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with complete(path) as temporary:
            temporary.write_bytes(hashlib.sha256(data).digest() + data)
        files = sorted(path.parent.glob("[!.]*"), key=lambda file: file.stat().st_mtime)
        for old in files[:-MOST_FILES]:
            old.unlink(missing_ok=True)
    except OSError as error:
        _tell_once(f"cache: {path.parent} could not be written: {error}")


@functools.cache
def _tell_once(message: str) -> None:
    logger.warning(message)


def _options() -> tuple[Any, ...]:
    """Values of ``OPTIONS``."""
    import jax

    return tuple(getattr(jax.config, name, None) for name in OPTIONS)


def _path(folder: Path, suffix: str, *what: Any) -> Path:
    """The file of what depends on the sources, the versions, JAX's options and ``what``."""
    known = (_sources(), _options(), *what)
    return folder / (hashlib.sha256(repr(known).encode()).hexdigest() + suffix)


@functools.cache
def _sources() -> str:
    """A digest of this package's source files and of the versions of what traces them."""
    digest = hashlib.sha256(repr([metadata.version(name) for name in LIBRARIES]).encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
