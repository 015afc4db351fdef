"""The checks of an asset (docs/simulation.md, "What is checked") in plain words."""

from __future__ import annotations

import dataclasses

from uniart_jax.simulation.summary import PLAUSIBILITY, is_plausible, stands

ENGINES = {"mujoco": "MuJoCo", "pybullet": "PyBullet"}
GEOMETRY = "geometry"
TITLES = {GEOMETRY: "the files", PLAUSIBILITY: "as a person sees it"}
# group -> check -> what it asks
_ENGINE = {
    "loads": "takes the file",
    "inertia": "every moving part has a possible mass and inertia",
    "overlap": "at rest no two parts are inside each other",
    "damping": "joints are damped no more than the engine can bear",
    "stands": "left alone, the joints stay where they are",
    "sweep": "every joint goes through its whole range without running into something",
    "hinge_opening": "a hand at the handle opens every hinge",
    "slider_pulling": "a hand at the handle pulls every slider out",
    "flip_and_rotate": "two joints can be opened one after the other",
    "drift": "joints stay within their limits",
    "energy": "no motion comes from nowhere",
    "explosion": "nothing flies apart",
}
_SHAPE = {
    "finite": "all numbers of the file are finite",
    "reads": "the file can be read again",
    "meshes": "all meshes are there",
    "watertight": "all meshes are closed",
    "normals": "no mesh is inside out",
    "finite_meshes": "all vertices are finite",
    "inertia": "every moving part has a possible mass and inertia",
    "collision": "every moving part has a collision shape",
    "gaps": "no part floats beside the others",
}
_LOOKS = {
    "attached": "every moving part keeps touching what it hangs on",
    "crumb": "no part is a mere speck or rag",
    "free": "nothing hangs in the air",
    "plausible": "moving parts do not pass through others",
}


@dataclasses.dataclass(frozen=True)
class CheckLine:
    """One check: whether it passed, what it asks, and why it failed."""

    passed: bool
    asks: str
    reason: str = ""


def check_groups(found: dict[str, dict]) -> dict[str, list[CheckLine]]:
    """Title of a group -> its checks in words, those that failed first.

    Args:
      found: a report's ``validation`` (``simulation.summary.verdicts``).
    """
    groups = {}
    for name, checks in found.items():
        words: dict[str, str] = {GEOMETRY: _SHAPE, PLAUSIBILITY: _LOOKS}.get(name, _ENGINE)
        lines = [
            CheckLine(bool(check["passed"]), words.get(key) or key.replace("_", " "), _cause(check))
            for key, check in checks.items()
        ]
        groups[_title(name)] = sorted(lines, key=lambda line: line.passed)
    return groups


def verdict_lines(found: dict[str, dict] | None) -> list[CheckLine]:
    """The sum of the checks: does it work in a simulator, does it look like an object?

    Args:
      found: a report's ``validation``; None or empty where nothing was tried.
    """
    if not found:
        return []
    engines = [name for name in found if name not in (GEOMETRY, PLAUSIBILITY)]
    failed = [
        name
        for name in (*engines, GEOMETRY)
        if not all(check["passed"] for check in found.get(name, {}).values())
    ]
    works, sense = stands(found), is_plausible(found)
    told = f"Loads, stands and opens in {' and '.join(map(_title, engines))}"
    if not works:
        told = f"Fails checks: {', '.join(map(_title, failed))}" if failed else "No engine ran"
    return [
        CheckLine(works, told),
        CheckLine(sense, "Looks like an object" if sense else "Does not look like an object"),
    ]


def _title(group: str) -> str:
    """What a group of checks is called."""
    return ENGINES.get(group) or TITLES.get(group, group)


def _cause(check: dict) -> str:
    """Why a check failed; "" where it passed."""
    if check["passed"]:
        return ""
    return check.get("reason") or f"{check['value']:.3g}, where {check['limit']:.3g} is the limit"
