"""Break lines on purpose, one at a time, in a temporary copy, and see that a named test fails.

    python tools/mutants.py [NAME ...]      NAME: part of a mutant's text; none: all

The mutants are in ``mutant_table.py``; the text of one stands once in its file. First all of the
tests are run on the copy as it is, and must pass. Ends with 1 where a mutant survives.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from mutant_table import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("uniart_jax", "tests", "configs", "benchmarks", "tools", "pyproject.toml")
LIMIT = 600  # seconds a run


def passes(folder: Path, tests: list[str]) -> bool:
    """Whether pytest ends well on ``tests`` in the copy, within ``LIMIT`` seconds.

    Raises:
      RuntimeError: it ran no test (a name that is not there), or ends otherwise than by failures.
    """
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-m", "", *tests]
    try:
        run = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT
        )
    except subprocess.TimeoutExpired:  # a broken line may make a test run on for ever
        return False
    if run.returncode not in (0, 1):
        raise RuntimeError(
            f"pytest ended with {run.returncode}: {(run.stdout + run.stderr)[-600:]}"
        )
    return run.returncode == 0


def survives(folder: Path, mutant: Mutant) -> bool:
    """Whether the named test passes although the line is broken; the file is restored.

    Raises:
      ValueError: the text does not stand in the file exactly once.
    """
    path = folder / mutant.file
    before = path.read_text()
    if (found := before.count(mutant.text)) != 1:
        raise ValueError(
            f"{mutant.file}: '{mutant.text}' is there {found} times; write it so that it is there "
            "once"
        )
    path.write_text(before.replace(mutant.text, mutant.replacement))
    try:
        return passes(folder, [mutant.test])
    finally:
        path.write_text(before)


def copy(folder: Path) -> None:
    """What the tests need of the repository."""
    ignore = shutil.ignore_patterns("__pycache__")
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=ignore)
        else:
            shutil.copy(source, folder / name)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", help="part of a mutant's text; none: all")
    names = parser.parse_args().names
    chosen = [m for m in MUTANTS if not names or any(n in " ".join(m) for n in names)]
    if not chosen:
        parser.error(f"no mutant holds {' or '.join(names)}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        copy(folder)
        if not passes(folder, sorted({mutant.test for mutant in chosen})):
            print("the tests fail before anything is broken")
            return 1
        survivors = 0
        for mutant in chosen:
            alive = survives(folder, mutant)
            survivors += alive
            change = " ".join(f"{mutant.text} -> {mutant.replacement}".split())
            print(f"{'SURVIVES' if alive else 'caught  '} {mutant.file}: {change}", flush=True)
    print(f"{len(chosen) - survivors} of {len(chosen)} caught")
    return int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main())
