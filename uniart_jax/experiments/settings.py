"""What an arm's figures depend on but for the code, kept beside them: figures of other settings,
records or weights never enter a table."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from uniart_jax.config import Config, to_json
from uniart_jax.evaluation.result_store import read_result, write_result
from uniart_jax.experiments.design import Arm, Experiment
from uniart_jax.experiments.inputs import records_digest
from uniart_jax.models.checkpoint import Checkpoint

FILE = "settings.json"
SHOWN = 3  # differences that a message names


def settings(experiment: Experiment, name: str) -> dict[str, Any]:
    """Of arm ``name`` and, where it reuses another, of that one.

    Raises:
      FileNotFoundError, ValueError: a checkpoint or records that it names are not there.
    """
    arm = experiment.arms[name]
    found = described(arm)
    return found | {"of": described(experiment.trained(name))} if arm.reuse else found


def described(arm: Arm) -> dict[str, Any]:
    """An arm by its values: the whole config, so that a default that changes is seen, and digests
    of records and weights."""
    found: dict[str, Any] = {
        "stages": arm.stages,
        "station": arm.pipeline_stage,
        "tests": dataclasses.asdict(arm.tests),
        "views": arm.views,
        "init": arm.init,
        "beside": arm.other_networks_from,
        "sampling": arm.sampling,
    }
    records = {arm.tests.records}
    if arm.stages:
        found["config"] = json.loads(to_json(arm.config))
        records.add(arm.config.data.records)
    found["weights"] = {n: Checkpoint.find(n).digest() for n in arm.checkpoints()}
    found["records"] = {name: records_digest(name) for name in sorted(records - {""})}
    return json.loads(json.dumps(found))


def check_settings(experiment: Experiment, name: str, folder: Path) -> dict[str, Any]:
    """The settings of arm ``name``; what lies in its ``folder`` must be of the same.

    Raises:
      ValueError: it is not; the arm and what differs are named.
    """
    now = settings(experiment, name)
    if not any(folder.glob("seed-*")) and not (folder / FILE).is_file():
        return now
    kept = read_result(folder / FILE)
    if kept is None:
        raise ValueError(
            f"{folder}: arm {name} has results there without {FILE}; move that folder away, or "
            "choose another --out"
        )
    config = json.loads(to_json(Config()))
    if differ := differences(
        kept, now, {"config": config, "of": {"config": config, "sampling": {}}, "sampling": {}}
    ):
        more = f" and {len(differ) - SHOWN} more" if len(differ) > SHOWN else ""
        raise ValueError(
            f"{folder}: results of arm {name} there are of other settings "
            f"({'; '.join(differ[:SHOWN])}{more}); move that folder away, or choose another --out"
        )
    return now


def write_settings(experiment: Experiment, name: str, folder: Path) -> None:
    """Begin arm ``name`` in ``folder``, or go on there.

    Raises:
      ValueError: as ``check_settings``.
    """
    now = check_settings(experiment, name, folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_result(folder / FILE, now)


def differences(
    kept: dict[str, Any], now: dict[str, Any], defaults: dict[str, Any], at: str = ""
) -> list[str]:
    """In words, what of nested settings is not as it was. What was not there yet had its
    default."""
    found = []
    for key in [*now, *(key for key in kept if key not in now)]:
        default = defaults.get(key)
        before, after = kept.get(key, default), now.get(key)
        if isinstance(before, dict) and isinstance(after, dict):
            inner = default if isinstance(default, dict) else {}
            found += differences(before, after, inner, f"{at}{key}.")
        elif before != after:
            found.append(f"{at}{key} {before} instead of {after}")
    return [line if len(line) < 200 else f"{line[:200]} ..." for line in found]
