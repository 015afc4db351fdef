"""What the commands share: options that several have, user errors as one line, and a look at the
output folder before any work."""

from __future__ import annotations

import contextlib
import errno
import logging
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import tyro

from uniart_jax.config import Background
from uniart_jax.export.formats import Collision, Format, Origin
from uniart_jax.export.printing.settings import PrintSettings

logger = logging.getLogger(__name__)

Out = Annotated[Path, tyro.conf.arg(help="Folder to write.")]
Overwrite = Annotated[
    bool, tyro.conf.arg(help="Replace OUT if it is not empty (swapped at the end).")
]
Formats = Annotated[
    tuple[Format, ...] | None,
    tyro.conf.arg(
        help="What to write beside the URDF (default: all but stl; usd if usd-core is installed). "
        "stl: for printing, millimetres."
    ),
]
Size = Annotated[
    str | None,
    tyro.conf.arg(help='Metres of the longest side, or a kind of thing ("oven") of usual size.'),
]
Density = Annotated[
    float | None, tyro.conf.arg(help="kg / m^3 of all parts (default: 500, light wood).")
]
Mass = Annotated[float | None, tyro.conf.arg(help="kg of the whole object, instead of a density.")]

CollisionBudget = Annotated[
    int, tyro.conf.arg(help="Convex collision shapes of the whole object at most; 16 a part.")
]
CollisionKind = Annotated[
    Collision,
    tyro.conf.arg(
        help="Collision shapes: boxes and hulls as close to the surface as the budget allows "
        "(merged); boxes alone; a hull a part; coacd's pieces (pip install "
        "'uniart_jax[coacd]')."
    ),
]
Friction = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        help="Dry friction: a factor for all joints (.5), or JOINT=VALUE for each that is meant "
        "(hinge_1_joint=2), N m or N."
    ),
]
Damping = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        help="Damping: a factor for all joints, or JOINT=VALUE for each that is meant, N m s / rad "
        "or N s / m."
    ),
]

CutOut = Annotated[
    Background,
    tyro.conf.arg(
        help="How the object is cut out. auto: alpha, else a plain background, else rembg where "
        "installed (pip install 'uniart_jax[photo]'), else the checkpoint's mask network, else "
        "GrabCut. keep: nothing is cut away. rembg: by rembg."
    ),
]
Stand = Annotated[
    Origin,
    tyro.conf.arg(
        help="Where 0 lies: on the floor below the middle of the object at rest, or in its middle."
    ),
]
Actuators = Annotated[bool, tyro.conf.arg(help="Give the MJCF a position actuator a joint.")]
Print = Annotated[
    bool,
    tyro.conf.arg(
        name="print",
        help="With --formats stl: pieces with hinges and slides that print (docs/printing.md).",
    ),
]
PrintSize = Annotated[
    float, tyro.conf.arg(help="Of --print: longest side of the assembled object, millimetres.")
]
Clearance = Annotated[
    float, tyro.conf.arg(help="Of --print: gap between parts that move, millimetres.")
]
PrintWall = Annotated[float, tyro.conf.arg(help="Of --print: thinner walls are told, millimetres.")]


def print_settings(
    wanted: bool, formats: tuple[Format, ...] | None, size: float, clearance: float, wall: float
) -> PrintSettings | None:
    """What ``--print`` and its measures ask for; None without it.

    Raises:
      ValueError: ``--print`` without ``--formats stl``, its measures without it, or one that cannot
        be.
    """
    settings = PrintSettings(size, clearance, wall)
    if wanted and (formats is None or "stl" not in formats):
        raise ValueError("--print needs STL files: add --formats stl")
    if not wanted and settings != PrintSettings():
        raise ValueError("--print-size, --clearance and --print-wall belong to --print: add it")
    return settings if wanted else None


def guarded(command: Callable[[], int | None]) -> int:
    """Run a command; user errors become one line and exit code 2, Ctrl-C becomes 130, SIGTERM 143
    with temporary folders removed."""

    def show(message, category, filename, lineno, file=None, line=None):
        if issubclass(category, UserWarning):
            print(f"warning: {message}", file=sys.stderr)

    def stop(*_):
        raise SystemExit(143)

    warnings.showwarning = show
    with contextlib.suppress(ValueError):  # not the main thread: somebody else's program
        signal.signal(signal.SIGTERM, stop)
    try:
        return command() or 0
    except (ValueError, OSError, ArithmeticError, MemoryError) as error:
        message = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            message += "; make room on the disk and run the same command again"
        logger.info("raised here:", exc_info=True)  # shown with -v
        print(f"error: {message}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130


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


def tried(folder: Path, found: list[dict]) -> dict:
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
