"""Runs the commands and the Python of README, quickstart and tutorial, in their order, in a copy of
the last commit.

    make try-docs        (or: python tools/try_docs.py [README.md docs/tutorial.md …] [--list])

Each is printed with its seconds, on the clock and of processors, and those that the document states
beside it ("# 28 s", on two cores, compiled programs kept from a run before); "slower" marks what
took more than three times as long by both. "differs" lists lines of the output that the document
shows and that did not come (numbers may be a tenth off). Names to replace (ROOT, photo.png) have
stand-ins; what cannot run as it stands (hours of training) is listed with the reason. A command
that fails makes the program end with 1. About twenty minutes on two cores.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = (
    "README.md",
    "docs/quickstart.md",
    "docs/tutorial.md",
    "docs/photograph.md",
    "docs/own_urdfs.md",
    "docs/app.md",
)
PROGRAMS = ("make", "python", "python3", "uniart", "git", "pip")
LEFT_OUT = (  # what a command holds, and why it is not run
    (r"\bURL\b", "a name to replace"),
    (r"TRELLIS-image-large/ckpts|dinov2\w*\.pth", "needs weights that others publish"),
    (r"\b(pip|venv)\b", "changes the environment"),
    (r"^make (test|docs)\b", "has a command of its own"),
    (r"^make sample", "sets up an environment; sample.py is run"),
    (r"configs/nano\.py|runs/nano|evaluate procedural", "takes hours, or needs what hours made"),
    (r"^uniart app", "runs until it is stopped; tests/app"),
    (r"^python -m mujoco\.viewer", "opens a window"),
)  # fmt: skip
STAND_INS = {  # names that a reader replaces, and what they are here
    r"\bphoto\.png\b": "examples/photograph.jpg",
    r"\bASSET\b": "out/sample",
    r"\bOUT\b": "out/of-ones-own",
    r"\b(ROOT|PRED|REF)\b": "assets",
}
ASSETS = """from uniart_jax.procedural import generate
for k, family in enumerate(("storage_furniture", "oven", "storage_furniture", "oven")):
    obj = generate(family, 500_000 + k)
    obj.save(f"assets/{family}/{k}", formats=("urdf",), motion=False)"""
LONGEST = 3600  # seconds
NUMBER = r"\d+(?:\.\d+)?(?:e[-+]?\d+)?"
RATE = r"\S+ \w+/s"  # as fast as the machine is
SHOWS = r"^\w+\.show\(\).*$"  # opens a page
STATED = r"#.*?\b(\d+) (s|seconds|minutes?|hours?)\b"
UNITS = {"s": 1, "m": 60, "h": 3600}  # seconds, by a unit's first letter
SLOWER = 3.0  # times what a document states


class Command(NamedTuple):
    """A line of a shell block, or a block of Python; where it stands, the seconds that are stated
    beside it (0: none), and the output that is shown below it ("": none)."""

    document: str
    line: int
    text: str
    python: bool
    stated: float = 0.0
    shown: str = ""

    @property
    def bare(self) -> str:
        """What is run, without comments."""
        lines = (re.sub(r"\s*#.*$", "", line) for line in self.text.strip().splitlines())
        return "\n".join(lines)

    @property
    def left_out(self) -> str:
        """Why it is not run; "" where it is."""
        if self.python:
            return ""
        return next((why for pattern, why in LEFT_OUT if re.search(pattern, self.text)), "")


def commands(document: str, text: str) -> list[Command]:
    """Those of a document, in their order. A block without any that follows one at once is what the
    last of them prints."""
    found: list[Command] = []
    end = 0  # of the block before
    for block in re.finditer(r"^```(\w*)\n(.*?)^```", text, re.S | re.M):
        line, before = text[: block.start()].count("\n") + 2, len(found)
        if block[1] == "python":
            found.append(Command(document, line, block[2], True, seconds(block[2])))
        elif not block[1]:
            at = line
            for whole in re.sub(r"\\\n\s*", "", block[2]).splitlines():
                bare = re.sub(r"\s+#.*$", "", whole).strip()
                if bare.split(" ")[0] in PROGRAMS:
                    found.append(Command(document, at, bare, False, seconds(whole)))
                at += 1
            if len(found) == before and before and not text[end : block.start()].strip():
                found[-1] = found[-1]._replace(shown=block[2])
        end = block.end()
    return found


def seconds(text: str) -> float:
    """The first time that a comment states; 0 where none does."""
    found = re.search(STATED, text)
    return float(found[1]) * UNITS[found[2][0]] if found else 0.0


def missing(shown: str, said: str) -> list[str]:
    """Lines of ``shown`` that ``said`` has not: other words, or numbers more than a tenth off."""
    there = [_parted(line) for line in said.splitlines()]
    return [
        line
        for line in shown.splitlines()
        if not any(_alike(_parted(line), other) for other in there)
    ]


def _parted(line: str) -> tuple[str, list[str]]:
    """The words of a line, with a mark that no line has for each number, and the numbers."""
    line = " ".join(re.sub(RATE, "", line).split())
    return re.sub(NUMBER, "\0", line), re.findall(NUMBER, line)


def _alike(one: tuple[str, list[str]], other: tuple[str, list[str]]) -> bool:
    return one[0] == other[0] and all(map(_near, one[1], other[1]))


def _near(one: str, other: str) -> bool:
    """A tenth apart at most, and what rounding to the digits shown may add."""
    a, b = float(one), float(other)
    return abs(a - b) <= 0.1 * max(a, b) + min(0.02, 1.001 * _last_digit(one))


def _last_digit(number: str) -> float:
    """What one more in the last digit is worth."""
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


class Run(NamedTuple):
    """Exit code, seconds on the clock and of processors, and what was printed."""

    code: int
    took: float
    processors: float
    said: str


def run(command: Command, folder: Path, environment: dict[str, str]) -> Run:
    code = "import uniart_jax as ua\n" + re.sub(SHOWS, "", command.text, flags=re.M)
    text = command.text
    for name, value in STAND_INS.items():
        text = re.sub(name, value, text)
    call = (
        [sys.executable, "-c", code] if command.python else ["bash", "-o", "pipefail", "-c", text]
    )
    begin, used = time.perf_counter(), _processors()
    try:
        done = subprocess.run(
            call, cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST
        )
    except subprocess.TimeoutExpired:
        return Run(124, LONGEST, _processors() - used, f"not done after {LONGEST} s")
    took = time.perf_counter() - begin
    return Run(done.returncode, took, _processors() - used, done.stdout + done.stderr)


def _processors() -> float:
    """Seconds of processors that programs started here have used."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("documents", nargs="*", default=DOCUMENTS)
    parser.add_argument("--list", action="store_true", help="say what would be run")
    arguments = parser.parse_args()
    found = [c for name in arguments.documents for c in commands(name, (ROOT / name).read_text())]
    tried = failed = differ = 0
    before: dict[str, str] = {}  # what was run -> where
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / "uniart_jax"
        environment = os.environ | {
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(copy),
            "BROWSER": "true",  # pages are written, none is opened
        }
        if not arguments.list:
            subprocess.run(["git", "clone", "--quiet", str(ROOT), str(copy)], check=True)
            made = [sys.executable, "-c", ASSETS]
            subprocess.run(made, cwd=copy, env=environment, check=True)
        for command in found:
            where = f"{command.document}:{command.line}"
            text = command.text.strip().splitlines()[-1] if command.python else command.text
            left_out = command.left_out or before.get(command.bare, "")
            before.setdefault(command.bare, f"as {where}")
            if arguments.list or left_out:
                print(f"{'-':>8}  {where}  {text}  ({left_out or 'is run'})", flush=True)
                continue
            tried += 1
            done = run(command, copy, environment)
            stated = f"{command.stated:.0f} stated" if command.stated else "none stated"
            slower = min(done.took, done.processors) > SLOWER * command.stated > 0
            print(
                f"{done.took:6.1f} s ({done.processors:.0f} of processors, {stated})"
                f"{'  slower' if slower else ''}  {where}  {text}",
                flush=True,
            )
            if done.code:
                failed += 1
                end = "\n".join(done.said.strip().splitlines()[-8:])
                print(f"  failed ({done.code}):\n{end}", flush=True)
            elif lines := missing(command.shown, done.said):
                differ += 1
                print("  differs, not printed:", *lines, sep="\n    ", flush=True)
    if not arguments.list:
        print(
            f"{tried} run: {failed} failed, {differ} with other output; "
            f"{len(found) - tried} left out or run before"
        )
    sys.exit(min(failed, 1))


if __name__ == "__main__":
    main()
