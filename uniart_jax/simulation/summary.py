"""What the checks of an asset come to: whether it loads and stands, and, apart from that, whether a
person would take it for an object."""

from __future__ import annotations

PLAUSIBILITY = "plausibility"
MOST = 4  # failed checks that a line names


def verdicts(result: dict) -> dict[str, dict]:
    """{engine, or "geometry", "plausibility": {check: verdict}}: what a report keeps of
    ``validate.validate``."""
    return {**result["engines"], **{name: result[name] for name in ("geometry", PLAUSIBILITY)}}


def stands(found: dict[str, dict]) -> bool:
    """Whether an asset loads, stands and opens: of ``verdicts``, all but those on plausibility, in
    at least one engine."""
    groups = {name: checks for name, checks in found.items() if name != PLAUSIBILITY}
    return bool(set(groups) - {"geometry"}) and not _failed(groups)


def is_plausible(found: dict[str, dict]) -> bool:
    """Whether ``verdicts`` tell of something that a person would take for an object; not where
    nothing could be read."""
    return bool(found.get(PLAUSIBILITY)) and not _failed({PLAUSIBILITY: found[PLAUSIBILITY]})


def is_sound(result: dict) -> bool:
    """Whether every check of ``validate.validate`` passed, in at least one engine."""
    found = verdicts(result)
    return stands(found) and is_plausible(found)


def summary(found: dict[str, dict]) -> str:
    """``verdicts`` in a line that says both apart: "loads and stands: yes; plausible: no
    (attached)"."""
    engines = {name: checks for name, checks in found.items() if name != PLAUSIBILITY}
    looks = found.get(PLAUSIBILITY, {})
    loads = _answer(stands(found), _failed(engines), "no engine ran")
    sense = _answer(is_plausible(found), _failed({"": looks}), "it could not be judged")
    return f"loads and stands: {loads}; plausible: {sense}"


def _failed(groups: dict[str, dict]) -> list[str]:
    """ "<group> <check>" of those that did not pass."""
    return [
        f"{where} {name}".strip()
        for where, checks in groups.items()
        for name, check in checks.items()
        if not check["passed"]
    ]


def _answer(yes: bool, failed: list[str], why: str) -> str:
    if yes:
        return "yes"
    told = ", ".join(failed[:MOST]) or why
    return f"no ({told}{f', and {len(failed) - MOST} more' if len(failed) > MOST else ''})"
