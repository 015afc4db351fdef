"""Runs the commands and the Python of README, quickstart and tutorial, in their order, in a copy of
the last commit.

    make try-docs        (or: python tools/try_docs.py [README.md docs/tutorial.md …] [--list])

Each is printed with its seconds. What cannot run as it stands (a name to replace, hours of
training) is listed with the reason. A command that fails makes the program end with 1.
About ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = ("README.md", "docs/quickstart.md", "docs/tutorial.md", "docs/app.md")
PROGRAMS = ("make", "python", "python3", "uniart", "git", "pip")
LEFT_OUT = (  # what a command holds, and why it is not run
    (r"\b(URL|ROOT|PRED|ASSET|OUT|TRELLIS-image-large/ckpts|dinov2\w*\.pth)\b", "a name to replace"),  # noqa: E501
    (r"\bphoto\.png\b", "a picture of one's own"),
    (r"\b(pip|venv)\b", "changes the environment"),
    (r"^make (test|docs)\b", "has a command of its own"),
    (r"configs/nano\.py|runs/nano|data-cache/mine|evaluate procedural", "takes hours, or needs what hours made"),  # noqa: E501
    (r"^make sample", "sets up an environment; sample.py is run"),
    (r"^uniart app", "runs until it is stopped; tests/app"),
)  # fmt: skip
LONGEST = 900  # seconds
SHOWS = r"^\w+\.show\(\).*$"  # serves a page until it is stopped


class Command(NamedTuple):
    """A line of a shell block, or a block of Python; where it stands."""

    document: str
    line: int
    text: str
    python: bool

    @property
    def left_out(self) -> str:
        """Why it is not run; "" where it is."""
        if self.python:
            return ""
        return next((why for pattern, why in LEFT_OUT if re.search(pattern, self.text)), "")


def commands(document: str, text: str) -> list[Command]:
    """Those of a document, in their order; blocks of output are none."""
    found = []
    for block in re.finditer(r"^```(\w*)\n(.*?)^```", text, re.S | re.M):
        line = text[: block.start()].count("\n") + 2
        if block[1] == "python":
            found.append(Command(document, line, block[2], True))
        elif not block[1]:
            at = line
            for whole in re.sub(r"\\\n\s*", "", block[2]).splitlines():
                bare = re.sub(r"\s+#.*$", "", whole).strip()
                if bare.split(" ")[0] in PROGRAMS:
                    found.append(Command(document, at, bare, False))
                at += 1
    return found


def run(command: Command, folder: Path, environment: dict[str, str]) -> tuple[int, float, str]:
    """Exit code, seconds, and the end of what was printed."""
    code = "import uniart_jax as ua\n" + re.sub(SHOWS, "", command.text, flags=re.M)
    call = [sys.executable, "-c", code] if command.python else ["bash", "-c", command.text]
    begin = time.perf_counter()
    try:
        done = subprocess.run(
            call, cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST
        )
    except subprocess.TimeoutExpired:
        return 124, LONGEST, f"not done after {LONGEST} s"
    said = (done.stdout + done.stderr).strip().splitlines()
    return done.returncode, time.perf_counter() - begin, "\n".join(said[-8:])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("documents", nargs="*", default=DOCUMENTS)
    parser.add_argument("--list", action="store_true", help="say what would be run")
    arguments = parser.parse_args()
    found = [c for name in arguments.documents for c in commands(name, (ROOT / name).read_text())]
    failed = 0
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / "uniart_jax"
        if not arguments.list:
            subprocess.run(["git", "clone", "--quiet", str(ROOT), str(copy)], check=True)
        environment = os.environ | {
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(copy),
            "BROWSER": "true",  # pages are written, none is opened
        }
        for command in found:
            where = f"{command.document}:{command.line}"
            text = command.text.strip().splitlines()[-1] if command.python else command.text
            if arguments.list or command.left_out:
                print(f"{'-':>8}  {where}  {text}  ({command.left_out or 'is run'})", flush=True)
                continue
            code, seconds, said = run(command, copy, environment)
            print(
                f"{seconds:6.1f} s  {where}  {text}" + ("" if not code else f"  ({code})\n{said}"),
                flush=True,
            )
            failed += bool(code)
    sys.exit(min(failed, 1))


if __name__ == "__main__":
    main()
