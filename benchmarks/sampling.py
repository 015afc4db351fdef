"""Seconds and memory of every stage of ``sample.py``, once compiled.

    python benchmarks/sampling.py [--image IMAGE] [--repeats 3] [-- OPTIONS of sample.py]

The program runs as a user runs it; a stage lasts from the line in which it is told to the next one.
CPU seconds are of the program itself; those of the physics engines' processes are in the sum.
Medians of the repeats, after one run that fills the caches. Linux.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from uniart_jax.evaluation.table import markdown

ROOT = Path(__file__).parent.parent
TARGET = {"seconds": 7.0, "GB": 1.5}  # on two idle cores
TICKS = os.sysconf("SC_CLK_TCK")
FIRST = "start and imports"

Row = tuple[str, float, float, float]  # stage, seconds, CPU seconds, peak GB until its end


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--image", default="examples/images/oven.png")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("options", nargs="*", help="of sample.py")
    given = parser.parse_args()
    runs = [run(given.image, given.options) for _ in range(1 + given.repeats)][1:]
    rows = []
    for stage in zip(*runs, strict=True):
        columns = zip(*(row[1:] for row in stage), strict=True)
        numbers = [statistics.median(values) for values in columns]
        rows.append([stage[0][0], *(f"{n:.2f}" if n == n else "" for n in numbers)])
    print(markdown(["stage", "seconds", "CPU seconds", "GB at most"], rows))
    print(f"target: {TARGET['seconds']:g} s, {TARGET['GB']:g} GB")


def run(image: str, options: list[str]) -> list[Row]:
    """One run of sample.py; the last row is the sum, with the CPU seconds of what it started."""
    with tempfile.TemporaryDirectory() as folder:
        begun, before = time.perf_counter(), os.times()
        command = [sys.executable, "sample.py", image, "--out", f"{folder}/out", *options]
        process = subprocess.Popen(
            command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        rows: list[Row] = []
        stage, last, cpu, line = FIRST, begun, 0.0, ""
        for line in process.stderr or ():
            if line.startswith("· "):
                now, (used, peak) = time.perf_counter(), _used(process.pid)
                rows.append((stage, now - last, used - cpu, peak))
                stage, last, cpu = _stage(line), now, used
        if process.wait() or not rows:
            raise SystemExit(f"sampling: {' '.join(command)} told no stages; last: {line.strip()}")
        now, after = time.perf_counter(), os.times()
        both = after.children_user + after.children_system
        both -= before.children_user + before.children_system
        rows.append((stage, now - last, float("nan"), rows[-1][3]))
        return [*rows, ("sum", now - begun, both, rows[-1][3])]


def _stage(line: str) -> str:
    """What a line of progress tells, without the name of the image and numbers."""
    words = line[2:].strip().rpartition(": ")[2]
    return " ".join(word for word in words.split() if not word.isdigit())


def _used(process: int) -> tuple[float, float]:
    """CPU seconds of a process until now, and the most memory that it had, GB."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    status = Path(f"/proc/{process}/status").read_text()
    peak = int(status.partition("VmHWM:")[2].split()[0]) / 1e6
    return (int(fields[11]) + int(fields[12])) / TICKS, peak


if __name__ == "__main__":
    main()
