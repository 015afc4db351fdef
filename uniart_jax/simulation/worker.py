"""One engine's process: ``python -m uniart_jax.simulation.worker JOB RESULT``.

JOB is JSON: {"engine", "path" of the staged description, "plan" or null, "seconds", "gate": whether
it is to be judged by ``gate.judge`` instead}. A file that breaks an engine breaks this process
only. It ends when its input does, a pipe that whoever started it holds open.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
from pathlib import Path

from uniart_jax.runtime.files import write_text
from uniart_jax.simulation.engine import Engine, Plan, make_plan

_PR_SET_PDEATHSIG = 1  # Linux's sys/prctl.h


def load(engine: str, path: Path, plan: Plan | None) -> Engine:
    """The asset in an engine, ``mujoco`` or ``pybullet``.

    Raises:
      ValueError, RuntimeError, ImportError: it does not load; engines have their own ways to say
        so.
    """
    if engine == "mujoco":
        from uniart_jax.simulation.mujoco_engine import MujocoEngine

        return MujocoEngine(path, plan)
    from uniart_jax.simulation.bullet_engine import BulletEngine

    return BulletEngine(path, plan)


def main(job_file: str, result_file: str) -> None:
    """Do a job; the result is there complete or not at all."""
    _end_with_parent()
    job = json.loads(Path(job_file).read_text("utf-8"))
    _bound(job["seconds"])
    plan = make_plan(job["plan"]) if job["plan"] else None
    try:
        if job["gate"]:
            from uniart_jax.simulation.gate import judge

            result = judge(Path(job["path"]), plan)
        else:
            engine = load(job["engine"], Path(job["path"]), plan)
    except Exception as error:  # whatever an engine raises on a file that it does not take
        result = {"refused": f"{error}" or type(error).__name__}
    else:
        if not job["gate"]:
            from uniart_jax.simulation.measure import measure

            result = measure(engine) if plan else {}
    write_text(Path(result_file), json.dumps(result, allow_nan=False))


def _end_with_parent() -> None:
    """Do not outlive whoever started this, even where an engine blocks."""
    if sys.platform == "linux":  # also where an engine never lets the thread below run
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL))
    threading.Thread(target=_watch, daemon=True).start()


def _watch() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


def _bound(seconds: float) -> None:
    """No more processor time than that: SIGXCPU ends this process. Waiting for a busy processor
    does not count."""
    try:
        import resource
    except ImportError:  # Windows
        return
    whole = max(1, round(seconds))
    resource.setrlimit(resource.RLIMIT_CPU, (whole, whole + 1))


if __name__ == "__main__":
    main(*sys.argv[1:])
