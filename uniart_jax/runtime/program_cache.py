"""Traced programs and the shapes of networks, kept between runs beside XLA's compiled programs.

To trace the networks of a small model takes longer than to run them. What is kept is read again
only with the same source files of this package, the same versions and kind of device, the same
settings and shapes. Programs are files of ``jax.export``, shapes are JSON: nothing is unpickled.
"""

from __future__ import annotations

import functools
import hashlib
import json
import logging
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

from uniart_jax.runtime.files import complete, write_text

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
MOST_FILES = 200  # that are kept; the oldest are removed

logger = logging.getLogger(__name__)
_folder: Path | None = None  # None: nothing is kept


def keep_programs(folder: Path | None) -> None:
    """Keep programs in a folder from now on, in this process; None: no longer."""
    global _folder
    _folder = folder


def kept_program(jitted: Callable[..., Any], *settings: Any) -> Callable[..., Any]:
    """A jitted function whose traces are kept between runs, where ``keep_programs`` says so.

    Only on one device, and only called with arrays: with tracers it is ``jitted`` itself.

    Args:
      jitted: a pure function of pytrees of arrays; of what it returns, named tuples must be known
        to ``jax.export``.
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
        shapes = tuple((jax.numpy.shape(leaf), jax.numpy.result_type(leaf)) for leaf in leaves)
        if (tree, shapes) not in programs:
            device = jax.devices()[0]
            kind = (device.platform, device.device_kind)
            path = _path(_folder, ".program", tree, shapes, kind, settings)
            programs[tree, shapes] = _read_program(path) or _trace(path, jitted, tree, leaves)
        return programs[tree, shapes](*leaves)

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
    try:
        found = json.loads(path.read_text())
        return _nested(found, lambda leaf: jax.ShapeDtypeStruct(leaf[0], leaf[1]))
    except FileNotFoundError:
        pass
    except (OSError, ValueError, TypeError, LookupError, RecursionError) as error:
        logger.warning("cache: %s is damaged (%s) and is made again", path, error)
    made = make()
    text = json.dumps(_nested(made, lambda leaf: [leaf.shape, str(leaf.dtype)]))
    _write(path, lambda: write_text(path, text))
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

    try:
        return jax.jit(export.deserialize(bytearray(path.read_bytes())).call)
    except FileNotFoundError:
        return None
    except Exception as error:  # whatever damaged bytes lead to
        logger.warning("cache: %s is damaged (%s) and is made again", path, error)
        return None


def _trace(path: Path, jitted: Callable[..., Any], tree: Any, leaves: list[Any]) -> Any:
    """Trace, keep, and give the program as function of a call's leaves."""
    import jax
    from jax import export

    def flat(*values: Any) -> Any:
        return jitted(*jax.tree.unflatten(tree, values))

    made = export.export(jax.jit(flat))(*leaves)
    _write(path, functools.partial(_write_bytes, path, bytes(made.serialize())))
    return jax.jit(made.call)


def _write_bytes(path: Path, data: bytes) -> None:
    with complete(path) as temporary:
        temporary.write_bytes(data)


def _write(path: Path, write: Callable[[], None]) -> None:
    """Put a file into the cache, and remove the oldest; a cache that cannot be written is no
    error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write()
        files = sorted(path.parent.glob("[!.]*"), key=lambda file: file.stat().st_mtime)
        for old in files[:-MOST_FILES]:
            old.unlink(missing_ok=True)
    except OSError as error:
        logger.warning("cache: %s could not be written: %s", path, error)


def _path(folder: Path, suffix: str, *what: Any) -> Path:
    """The file of what depends on the sources, the versions, JAX's options and ``what``."""
    import jax

    known = (_sources(), [getattr(jax.config, name, None) for name in OPTIONS], *what)
    return folder / (hashlib.sha256(repr(known).encode()).hexdigest() + suffix)


@functools.cache
def _sources() -> str:
    """A digest of this package's source files and of the versions of what traces them."""
    digest = hashlib.sha256(repr([metadata.version(name) for name in LIBRARIES]).encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
