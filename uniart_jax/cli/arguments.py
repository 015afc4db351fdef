"""What the commands share: options that several have, user errors as one line, and a look at the
output folder before any work."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import select
import signal
import sys
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import tyro

from uniart_jax.config import Background
from uniart_jax.runtime.files import check_local

logger = logging.getLogger(__name__)

Out = Annotated[Path, tyro.conf.arg(help="Folder to write.")]
Overwrite = Annotated[
    bool, tyro.conf.arg(help="Replace OUT if it is not empty (swapped at the end).")
]
CutOut = Annotated[
    Background,
    tyro.conf.arg(
        help="How the object is cut out. auto: alpha, else a plain background, else rembg where "
        "installed (pip install 'uniart_jax[photo]'), else the checkpoint's mask network, else "
        "GrabCut. keep: nothing is cut away. rembg: by rembg."
    ),
]


def exit_on_error(command: Callable[[], int | None]) -> int:
    """Run a command; user errors become one line and exit code 2, Ctrl-C becomes 130, SIGTERM 143
    with temporary folders removed, and 141, without a word, where nobody reads what it prints any
    more (``uniart --help | head``)."""

    def show(message, category, filename, lineno, file=None, line=None):
        if issubclass(category, UserWarning):
            print(f"warning: {message}", file=sys.stderr)

    def stop(*_):
        raise SystemExit(143)

    warnings.showwarning = show
    with contextlib.suppress(ValueError):  # not the main thread: somebody else's program
        signal.signal(signal.SIGTERM, stop)
    try:
        try:
            return command() or 0
        finally:
            print(end="", flush=True)  # at the end of the program it is too late
    except (ValueError, OSError, ArithmeticError, MemoryError) as error:
        if isinstance(error, BrokenPipeError) and _nobody_reads():
            return 141
        message = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            message += "; make room on the disk and run the same command again"
        logger.info("raised here:", exc_info=True)  # shown with -v
        print(f"error: {message}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130


def _nobody_reads() -> bool:
    """Whether standard output is a pipe whose reader has ended; what is printed then goes
    nowhere."""
    try:
        poll, out = select.poll(), sys.stdout.fileno()
    except (AttributeError, ValueError):  # no such call on this system, or no file
        return False
    poll.register(out, select.POLLOUT)
    ended = any(event & select.POLLERR for _, event in poll.poll(0))
    if ended:
        os.dup2(os.open(os.devnull, os.O_WRONLY), out)
    return ended


def check_written(arguments: Sequence[str]) -> None:
    """Refuse addresses of buckets where any command writes: ``--out`` and ``--workdir``.

    Raises:
      ValueError: ``runtime.files.check_local``.
    """
    for word, following in zip(arguments, [*arguments, ""][1:], strict=True):
        name, given, value = word.partition("=")
        if name in ("--out", "--workdir"):
            check_local(value if given else following, name)


def check_out(
    folder: Path,
    overwrite: bool,
    inputs: tuple[Path, ...] = (),
    marks: tuple[str, ...] | None = None,
) -> None:
    """Refuse, before any work, an output folder that cannot be written or that holds an input.

    Args:
      marks: files one of which a folder must hold to be replaced (default: an asset's).

    Raises:
      ValueError: it or a parent is a file, or it is not empty and may not be replaced.
    """
    from uniart_jax.export.folder import MARKS, check_target

    for place in (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            raise ValueError(f"output '{place}': a file of that name exists; choose another --out")
    check_target(folder, overwrite, inputs=inputs, marks=marks or MARKS)


def check_options(
    command: str, use: str, asked: Collection[str], takes: Mapping[str, Collection[str]]
) -> None:
    """Refuse options that belong to other uses of a command.

    Args:
      asked: names of the options that are given. takes: of each use, those that it takes.
    """
    for name in asked:
        if name not in takes[use]:
            others = ", ".join(other for other, names in takes.items() if name in names)
            raise ValueError(
                f"{command} {use}: it takes no --{name.replace('_', '-')}, which goes with {others}"
            )


def run_physics_checks(folder: Path, found: list[dict]) -> dict:
    """What the physics engines say of an asset, also put into ``found``."""
    from uniart_jax.simulation.summary import verdicts
    from uniart_jax.simulation.validate import validate

    found.append(verdicts(validate(folder)))
    return found[0]


def validation_lines(verdicts: dict[str, dict]) -> Iterator[str]:
    """What a person wants to know of a report's ``validation``: a line an engine, one for each
    check that failed, and the sum of it."""
    from uniart_jax.simulation.summary import summary

    for where, checks in verdicts.items():
        yield from _group_lines(where, checks)
    yield summary(verdicts)


def gate_lines(gate: dict) -> Iterator[str]:
    """What a person wants to know of ``validate.gate``'s ``gate``: each rule that failed, and the
    verdict."""
    yield from _group_lines(gate["name"], gate["checks"])
    moves = "moving parts" if gate["articulated"] else "no moving part"
    yield f"gate {gate['name']}: {'passed' if gate['passed'] else 'failed'} ({moves})"


def folder_lines(judged: dict) -> Iterator[str]:
    """What a person wants to know of ``gate_folder.gate_folder``: each asset that failed, with the
    rules and the first reason; each rule's share; and the sum."""
    assets = judged["assets"]
    for name, asset in assets.items():
        failed = {rule: check for rule, check in asset["checks"].items() if not check["passed"]}
        if failed:
            first = next(iter(failed.values()))
            why = first.get("reason") or f"{first['value']:.3g}, limit {first['limit']:.3g}"
            yield f"{name}: {', '.join(failed)} ({why})"
    for rule, (passed, count) in judged["rules"].items():
        yield f"{rule}: {passed} of {count}"
    share = judged["passed"] / len(assets)
    yield (
        f"gate {judged['gate']}: {judged['passed']} of {len(assets)} assets passed ({share:.1%}); "
        f"{judged['articulated']} have moving parts"
    )


def _group_lines(where: str, checks: dict[str, dict]) -> Iterator[str]:
    failed = {name: check for name, check in checks.items() if not check["passed"]}
    yield f"{where}: {len(checks) - len(failed)} of {len(checks)} checks passed"
    for name, check in failed.items():
        why = check.get("reason") or f"{check['value']:.3g}, limit {check['limit']:.3g}"
        yield f"  {name}: {why}"


def shard_numbers(text: str) -> tuple[int, int]:
    """ "i/n" as two numbers."""
    number, slash, of = text.partition("/")
    if not (slash and number.isdecimal() and of.isdecimal() and int(number) < int(of)):
        raise ValueError(f"--shard must be i/n with i in 0..n-1, got '{text}'")
    return int(number), int(of)
