"""``-q`` and ``-v``: how much a command says. Both may stand anywhere on the line."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from uniart_jax.runtime.progress import be_quiet

QUIET = ("-q", "--quiet")
VERBOSE = ("-v", "--verbose")


def take_verbosity(arguments: Sequence[str]) -> list[str]:
    """Apply ``-q`` and ``-v`` to this process, and give the other arguments.

    -q: nothing about progress; results on standard output, warnings and errors stay.
    -v: the library's and JAX's log, and where in the code an error was raised.

    Raises:
      ValueError: both are given.
    """
    quiet = any(word in arguments for word in QUIET)
    verbose = any(word in arguments for word in VERBOSE)
    if quiet and verbose:
        raise ValueError("-q and -v contradict each other; give one of them")
    be_quiet(quiet)
    logging.getLogger("uniart_jax").setLevel(logging.DEBUG if verbose else logging.NOTSET)
    if verbose:
        logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    return [word for word in arguments if word not in (*QUIET, *VERBOSE)]
