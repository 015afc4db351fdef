"""``validate``: an asset in, what every check found out.

The asset is read and judged by itself here; each engine has a process of its own, with a limit of
processor time: what crashes or hangs there is a check that failed, with its reason.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import uniart_jax
from uniart_jax.objects.names import one_line
from uniart_jax.simulation.figure import write_figure
from uniart_jax.simulation.measure import check
from uniart_jax.simulation.reading import NO_MJCF, Description, descriptions
from uniart_jax.simulation.summary import PLAUSIBILITY

ENGINES = ("mujoco", "pybullet")
GATES = ("affordcraft",)
SECONDS = 120.0  # of processor time that an engine may take, however busy the machine is
PATIENCE = 10  # times as long by the clock ends one that waits for something, or is not limited
# how a process ends that used up its processor time; Windows knows no such limit
_OUT_OF_TIME = (-signal.SIGXCPU,) if hasattr(signal, "SIGXCPU") else ()
INSTALL = {"mujoco": "pip install mujoco", "pybullet": "pip install pybullet"}


def validate(
    asset: str | Path,
    *,
    out: Path | None = None,
    engines: Sequence[str] | None = None,
    allow_outside: bool = False,
) -> dict:
    """Load an asset in physics engines, move its joints, judge it.

    Args:
      asset: a folder with ``object.urdf`` (and ``object.xml``, which MuJoCo then takes), a URDF or
        an MJCF.
      out: a folder that takes ``validation.json`` and ``validation.png``; made if it is not there.
      engines: of ``ENGINES``; default MuJoCo and, where it is installed, PyBullet.
      allow_outside: also read what the asset names outside its folder.

    Returns:
      JSON values: ``engines`` {engine: {check: {"passed", "value", "limit", "reason" where it
        failed}}},
      ``geometry`` and ``plausibility`` {check: the same} (the latter empty where our reader does
      not take the asset), ``not_run`` {engine: why}, ``joints`` {engine: {joint: numbers}},
      ``motions`` {engine: [curves]}, ``asset`` and ``version``.

    Raises:
      FileNotFoundError: there is no such asset. ValueError: it cannot be read or names files
        outside its folder, an engine is not installed, or ``out`` cannot be written.
    """
    chosen = _chosen(engines)
    given = descriptions(asset, allow_outside)
    main = given.get("pybullet", given["mujoco"])
    results: dict[str, dict] = {}
    not_run = {name: NO_MJCF for name in chosen if name not in given}
    with tempfile.TemporaryDirectory(prefix="uniart-validate-") as temporary:
        folder = Path(temporary)
        staged = {n: given[n].stage(n, folder / n) for n in chosen if n in given}
        for description in dict.fromkeys([main, *(given[n] for n in staged)]):
            description.read()
        with contextlib.ExitStack() as running:
            jobs = {}
            for name, (path, why) in staged.items():
                if path is None:
                    results[name] = {"checks": {"loads": check(1, 0, False, why)}}
                else:
                    jobs[name] = running.enter_context(_Job(name, path, given[name]))
            geometry, looks = main.geometry(), main.plausibility()
            results |= {name: job.result() for name, job in jobs.items()}
    ran = [name for name in chosen if name in results]
    found = {
        "asset": main.path.name,
        "version": uniart_jax.__version__,
        "engines": {name: results[name]["checks"] for name in ran},
        "geometry": geometry,
        PLAUSIBILITY: looks,
        "not_run": not_run,
        "joints": {name: results[name].get("joints", {}) for name in ran},
        "motions": {name: results[name].get("motions", []) for name in ran},
    }
    if out is not None:
        write(found, Path(out), lambda path: write_figure(found, main.obj, main.plan, path))
    return found


def gate(
    asset: str | Path,
    *,
    name: str = "affordcraft",
    out: Path | None = None,
    allow_outside: bool = False,
) -> dict:
    """Put an asset through a published gate, in MuJoCo.

    Args:
      asset: a folder with ``object.urdf`` (and ``object.xml``, which is then taken), a URDF or an
        MJCF.
      name: of the gate; "affordcraft" (``simulation.gate``).
      out: a folder that takes ``validation.json``; made if it is not there.
      allow_outside: also read what the asset names outside its folder.

    Returns:
      JSON values: ``gate`` {"name", "passed", "articulated": whether a part of it can move,
      "checks": {rule: {"passed", "value", "limit", "reason" where it failed}}}, ``asset`` and
      ``version``.

    Raises:
      FileNotFoundError: there is no such asset. ValueError: no such gate, MuJoCo is not installed,
        it cannot be read or names files outside its folder, or ``out`` cannot be written.
    """
    if name not in GATES:
        raise ValueError(f"validate: no gate is called '{name}'; choose of {', '.join(GATES)}")
    _chosen(("mujoco",))
    given = descriptions(asset, allow_outside)["mujoco"]
    with tempfile.TemporaryDirectory(prefix="uniart-gate-") as temporary:
        path, why = given.stage("mujoco", Path(temporary) / "mujoco")
        given.read()
        result = _failed(why)
        if path is not None:
            with _Job("mujoco", path, given, gate=True) as job:
                result = job.result()
    passed = all(verdict["passed"] for verdict in result["checks"].values())
    verdict = {"name": name, "passed": passed, "articulated": result.get("articulated", False)}
    found = {
        "asset": given.path.name,
        "version": uniart_jax.__version__,
        "gate": verdict | {"checks": result["checks"]},
    }
    if out is not None:
        write(found, Path(out))
    return found


def _chosen(engines: Sequence[str] | None) -> list[str]:
    installed = [name for name in ENGINES if importlib.util.find_spec(name)]
    if engines is None:
        if "mujoco" not in installed:
            raise ValueError(f"validate: MuJoCo is not installed: {INSTALL['mujoco']}")
        return installed
    for name in engines:
        if name not in ENGINES:
            raise ValueError(
                f"validate: no engine is called '{name}'; choose of {', '.join(ENGINES)}"
            )
        if name not in installed:
            raise ValueError(f"validate: {name} is not installed: {INSTALL[name]}")
    if not engines:
        raise ValueError(f"validate: no engine was chosen; choose of {', '.join(ENGINES)}")
    return list(dict.fromkeys(engines))


class _Job:
    """One engine's process; leaving it ends the process."""

    def __init__(self, engine: str, path: Path, description: Description, *, gate: bool = False):
        self.engine, self.started = engine, time.monotonic()
        plan = description.plan
        job = {
            "engine": engine,
            "path": str(path),
            "plan": None if plan is None else dataclasses.asdict(plan),
            "seconds": SECONDS,
            "gate": gate,
        }
        folder = path.parent.parent
        job_file, self.result_file = folder / f"{engine}.job", folder / f"{engine}.result"
        self.said = folder / f"{engine}.said"
        job_file.write_text(json.dumps(job), "utf-8")
        root = str(Path(uniart_jax.__file__).parent.parent)
        paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
        command = [sys.executable, "-m", "uniart_jax.simulation.worker"]
        with self.said.open("wb") as said:
            self.process = subprocess.Popen(
                [*command, str(job_file), str(self.result_file)],
                stdin=subprocess.PIPE,  # nothing is said; that it ends tells the worker to end
                stdout=subprocess.DEVNULL,  # engines talk
                stderr=said,
                cwd=folder,  # MuJoCo writes its log where it stands
                env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"},
            )

    def __enter__(self) -> _Job:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()

    def result(self) -> dict:
        """What ``measure.measure`` found, with the check ``loads``."""
        try:
            left = PATIENCE * SECONDS - (time.monotonic() - self.started)
            code = self.process.wait(max(0.0, left))
        except subprocess.TimeoutExpired:
            return _failed(f"{self.engine} was not done after {PATIENCE * SECONDS:.0f} s")
        if code in _OUT_OF_TIME:
            return _failed(f"{self.engine} was not done after {SECONDS:.0f} s of processor time")
        if not self.result_file.is_file():
            return _failed(f"{self.engine} ended: {_exit_reason(code, self.said)}")
        found = json.loads(self.result_file.read_text("utf-8"))
        if "refused" in found:
            return _failed(one_line(found["refused"]))
        loads = {"loads": check(0, 0, True)}
        return found | {"checks": loads | found.get("checks", {})}


def _failed(reason: str) -> dict:
    return {"checks": {"loads": check(1, 0, False, reason)}}


def _exit_reason(code: int, said: Path) -> str:
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"it crashed ({signal.Signals(-code).name})"
    lines = said.read_text("utf-8", errors="replace").strip().splitlines()
    return one_line(lines[-1] if lines else f"exit code {code}")


def write(found: dict, out: Path, picture: Callable[[Path], None] | None = None) -> None:
    """Write ``validation.json``, and ``validation.png`` by ``picture``, each complete or absent."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".validation-", dir=out) as folder:
            text = json.dumps(found, indent=2, allow_nan=False) + "\n"
            (Path(folder) / "validation.json").write_text(text, "utf-8")
            if picture is not None:
                picture(Path(folder) / "validation.png")
            for name in sorted(os.listdir(folder), reverse=True):
                os.replace(Path(folder) / name, out / name)
    except OSError as error:
        raise ValueError(f"{out}: cannot write there ({error.strerror})") from None
