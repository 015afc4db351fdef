"""An experiment as a queue: seed by seed, every arm is trained, judged and put into the table.

    OUT/<arm>/seed-<s>/                   a training WORKDIR; absent where nothing is trained
    OUT/<arm>/seed-<s>/figures/<object>.json
    OUT/table.md, OUT/metrics.json        of what is there so far

The same command goes on where it was stopped: in the middle of a training from its newest checkpoint, in the middle of judging at the next
object. All arms of one seed come before the next seed, so that an unfinished queue still holds arms of equal seeds against each other.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from uniart_jax.config import NETWORKS, Config, to_json
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.records import record_rows, shard_paths
from uniart_jax.evaluation.kept import claim as claim_results
from uniart_jax.experiments.design import Arm, Experiment, Records
from uniart_jax.experiments.fronts import fitted
from uniart_jax.experiments.judge import judge
from uniart_jax.experiments.table import write_tables
from uniart_jax.pipeline import checkpoint_folder
from uniart_jax.stages import adopt, claim, ensure_records, exported, run
from uniart_jax.training.export import has_export

console = Console(stderr=True, highlight=False)


def run_experiment(
    experiment: Experiment,
    out: Path,
    *,
    seeds: int | None = None,
    count: int | None = None,
    arms: Sequence[str] = (),
) -> None:
    """Train, judge and tabulate what is not there yet.

    Args:
      seeds, count: trainings of each arm and test objects; default: the experiment's own. More of either go on from fewer.
      arms: only these.

    Raises:
      ValueError: no such arm, ``out`` holds arms of other settings, or another process works on it.
    """
    if unknown := [name for name in arms if name not in experiment.arms]:
        raise ValueError(f"experiment: no arm '{unknown[0]}'; there are {', '.join(experiment.arms)}")  # fmt: skip
    chosen = {name: arm for name, arm in experiment.arms.items() if not arms or name in arms}
    seeds, count = seeds or experiment.seeds, count or experiment.count
    with alone(out):
        for name, arm in chosen.items():
            claim_results(out / name, settings(arm), "an arm of other settings or weights")
        for records in experiment.records:
            make_records(records, next(iter(chosen.values())))
        for seed in range(seeds):
            for name, arm in chosen.items():
                # of a given checkpoint a further seed would draw the noise of sampling alone
                if seed and not (arm.stages or arm.of):
                    continue
                console.print(f"{name}, seed {seed}")
                place = f"seed-{seed}"
                checkpoint = out / arm.of / place
                if not arm.of:
                    checkpoint = train_arm(arm, seed, out / name / place)
                judge(arm, checkpoint, seed, out / name / place / "figures", count)
                write_tables(experiment, out, count)
    console.print((out / "table.md").read_text(), markup=False)


@contextlib.contextmanager
def alone(out: Path) -> Iterator[None]:
    """One process at a time in ``out``: two would write each other's checkpoints. The lock goes with its process, however that ends."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / "lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(f"{out}: another process works on it; wait for it, or stop it first") from None  # fmt: skip
        yield


def train_arm(arm: Arm, seed: int, workdir: Path) -> Path:
    """The checkpoint of an arm, trained as far as it is not yet; where nothing is trained, its ``init``."""
    if not arm.stages:
        return checkpoint_folder(arm.init)
    data = dataclasses.replace(arm.config.data, seed=seed)
    config = dataclasses.replace(arm.config, seed=seed, data=data)
    if arm.beside:
        source = checkpoint_folder(arm.beside)
        claim(config, workdir)
        given = [
            name
            for name in NETWORKS
            if name not in arm.stages
            and not name.endswith("_flow")  # it would speak of other latents
            and has_export(source, f"{name}.safetensors")
            and not exported(workdir, name)
        ]
        adopt(source, given, workdir)
    init = arm.init or config.init
    if init and "uniart_vae" in arm.stages:
        init = fitted(checkpoint_folder(init), config, workdir / "init")
    run(config, arm.stages, workdir, init or None)
    return workdir


def settings(arm: Arm) -> dict[str, Any]:
    """Everything that an arm's figures depend on but for the code: what its config says that is no default, and the weights that are given."""
    said = {f.name: getattr(arm, f.name) for f in dataclasses.fields(arm) if f.name != "config"}
    said["tests"] = dataclasses.asdict(arm.tests)
    if arm.stages:
        said["config"] = changed(json.loads(to_json(arm.config)), json.loads(to_json(Config())))
    given = {arm.init, arm.beside, arm.config.init if arm.stages else ""} - {""}
    said["weights"] = {name: digest(checkpoint_folder(name)) for name in sorted(given)}
    return json.loads(json.dumps(said))


def changed(values: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    """What of nested settings is not as it is by default; a setting that a later version adds changes nothing."""
    found = {}
    for key, value in values.items():
        if isinstance(value, dict):
            value = changed(value, defaults[key])
            if value:
                found[key] = value
        elif value != defaults[key]:
            found[key] = value
    return found


def digest(checkpoint: Path) -> str:
    """Of all networks of a checkpoint."""
    total = hashlib.sha256()
    folder = checkpoint if list(checkpoint.glob("*.safetensors")) else checkpoint / "export"
    for path in sorted(folder.glob("*.safetensors")):
        with path.open("rb") as file:
            total.update(path.name.encode() + hashlib.file_digest(file, "sha256").digest())
    return total.hexdigest()[:16]


def make_records(records: Records, arm: Arm) -> None:
    """Make the records of an experiment where they are not there yet, on the grid of ``arm``."""
    model, folder = arm.config.model, Path(records.folder)
    if (folder / "manifest.csv").is_file():
        return
    if records.source:
        ensure_records(dataclasses.replace(arm.config, data=dataclasses.replace(arm.config.data, records=records.source, validation="")))  # fmt: skip
        leave_out(Path(records.source), folder, records.leave_out)
        return
    prepare_procedural(
        folder,
        records.count,
        families=records.families or None,
        grid=dataclasses.replace(model.grid, max_parts=64),
        views=records.views,
        image_size=model.image_encoder.image_size,
        processes=os.cpu_count() or 1,
    )


def leave_out(source: Path, folder: Path, joint_type: str) -> None:
    """Another view of prepared records: the same shards, of which those with a joint of that type have it as their split, the others "train".

    Raises:
      ValueError: no record has such a joint, or all have.
    """
    rows = record_rows(source)
    has = [joint_type in {j.split(":")[0] for j in row["joints"].split()} for row in rows]
    if not any(has) or all(has):
        raise ValueError(f"{source}: {sum(has)} of {len(has)} records have a joint '{joint_type}'; nothing to hold apart")  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    for path in [*shard_paths(source), source / "metadata.json"]:
        link = folder / path.name
        link.unlink(missing_ok=True)
        link.symlink_to(path.resolve())
    partial = folder / "manifest.new"
    with partial.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        for row, apart in zip(rows, has, strict=True):
            writer.writerow({**row, "split": joint_type if apart else "train"})
    partial.replace(folder / "manifest.csv")
