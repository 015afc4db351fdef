"""Runs the commands and the Python of README, quickstart and tutorial, in their order, in a copy of
the last commit.

    make try-docs        (or: python tools/try_docs.py [README.md docs/tutorial.md …] [--list])

Each is printed with its seconds and those that the document states beside it ("# 28 s", on two
cores, compiled programs kept from a run before); "slower" marks what took more than three times as
long. What cannot run as it stands (a name to replace, hours of training) is listed with the reason.
A command that fails makes the program end with 1. About a quarter of an hour on two cores.
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
    (r"\b(URL|ROOT|PRED|ASSET|OUT|TRELLIS-image-large/ckpts|dinov2\w*\.pth)\b", "a name to replace"),  # noqa: E501
    (r"\bphoto\.png\b", "a picture of one's own"),
    (r"\b(pip|venv)\b", "changes the environment"),
    (r"^make (test|docs)\b", "has a command of its own"),
    (r"configs/nano\.py|runs/nano|data-cache/mine|evaluate procedural", "takes hours, or needs what hours made"),  # noqa: E501
    (r"^make sample", "sets up an environment; sample.py is run"),
    (r"^uniart app", "runs until it is stopped; tests/app"),
    (r"^python -m mujoco\.viewer", "opens a window"),
)  # fmt: skip
LONGEST = 900  # seconds
SHOWS = r"^\w+\.show\(\).*$"  # opens a page
STATED = r"#.*?\b(\d+) (s|seconds|minutes?)\b"
SLOWER = 3.0  # times what a document states


class Command(NamedTuple):
    """A line of a shell block, or a block of Python; where it stands, and the seconds that are
    stated beside it (0: none)."""

    document: str
    line: int
    text: str
    python: bool
    stated: float = 0.0

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
            found.append(Command(document, line, block[2], True, seconds(block[2])))
        elif not block[1]:
            at = line
            for whole in re.sub(r"\\\n\s*", "", block[2]).splitlines():
                bare = re.sub(r"\s+#.*$", "", whole).strip()
                if bare.split(" ")[0] in PROGRAMS:
                    found.append(Command(document, at, bare, False, seconds(whole)))
                at += 1
    return found


def seconds(text: str) -> float:
    """The first time that a comment states; 0 where none does."""
    found = re.search(STATED, text)
    return float(found[1]) * (60 if found[2].startswith("m") else 1) if found else 0.0


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
            code, took, said = run(command, copy, environment)
            slower = "  slower" if took > SLOWER * command.stated > 0 else ""
            told = f"  ({code})\n{said}" if code else ""
            print(
                f"{took:6.1f} s ({command.stated:3.0f} stated){slower}  {where}  {text}{told}",
                flush=True,
            )
            failed += bool(code)
    sys.exit(min(failed, 1))


if __name__ == "__main__":
    main()
