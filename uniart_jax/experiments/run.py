"""An experiment as a queue: seed by seed, every arm is trained, judged and put into the table.

    OUT/<arm>/settings.json               what its results depend on
    OUT/<arm>/seed-<s>/                   a training WORKDIR; absent where nothing is trained
    OUT/<arm>/seed-<s>/figures/<object>.json
    OUT/<arm>/seed-<s>/failure.json       instead of figures: why the training has no result
    OUT/table.md, OUT/metrics.json        of what is there so far

The same command goes on where it was stopped: in the middle of a training from its newest
checkpoint, in the middle of judging at the next object; a training that failed is tried again. All
arms of one seed come before the next seed, so that an unfinished queue still holds arms of equal
seeds against each other. An arm of another experiment is trained in that one's folder beside OUT,
once for all that are of it.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Sequence
from pathlib import Path

from uniart_jax.evaluation.result_store import write_result
from uniart_jax.experiments.design import Arm, Experiment
from uniart_jax.experiments.evaluate_arm import evaluate_arm
from uniart_jax.experiments.inputs import check_arm, check_networks, make_records, other_networks
from uniart_jax.experiments.reinit_aggregation import reinit_aggregation, shared_init
from uniart_jax.experiments.settings import check_settings, write_settings
from uniart_jax.experiments.table import FAILED, write_tables
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.runtime.locks import exclusive_lock
from uniart_jax.runtime.progress import messages
from uniart_jax.stages.trainer import check_workdir, run

console = messages()


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
      seeds, count: trainings of each arm and test objects; default: the experiment's own. More of
        either go on from fewer.
      arms: only these.

    Raises:
      ValueError: no such arm, or one whose networks nobody trains; several seeds where nothing is
        trained; ``out`` holds arms of other settings; records, test objects or checkpoints are
        missing or do not fit; or another process works on it.
      FileNotFoundError: as ``ValueError``, of what is missing.
    """
    if unknown := [name for name in arms if name not in experiment.arms]:
        raise ValueError(
            f"experiment: no arm '{unknown[0]}'; there are {', '.join(experiment.arms)}"
        )
    chosen = [name for name in experiment.arms if not arms or name in arms]
    if (seeds or 1) > 1 and not any(experiment.trained(name).stages for name in experiment.arms):
        raise ValueError(
            "experiment: nothing is trained in it, so there is one seed; more test objects are "
            "--count"
        )
    seeds, count = seeds or experiment.seeds, count or experiment.count
    with exclusive_lock(out):
        prepare(experiment, out, chosen, seeds, count)
        broken: dict[Path, str] = {}  # trainings that failed in this run
        for seed in range(seeds):
            for name in chosen:
                # of a given checkpoint a further seed would draw the noise of sampling alone
                if seed and not experiment.trained(name).stages:
                    continue
                console.print(f"{name}, seed {seed}")
                attempt(experiment, out, name, seed, count, broken)
                write_tables(experiment, out, count)
    console.print((out / "table.md").read_text(), markup=False)


def prepare(
    experiment: Experiment, out: Path, chosen: Sequence[str], seeds: int, count: int
) -> None:
    """Make the records, and look at everything that can be looked at before the first training. All
    arms that lie in ``out`` enter the table, so all are checked.

    Raises: as ``run_experiment``.
    """
    missing_networks(experiment, out, chosen, seeds)
    for name in chosen:
        if (
            "/" in experiment.arms[name].reuse
            and experiment.folder(name, out).parent.resolve() == out.resolve()
        ):
            raise ValueError(
                f"{out}: is the folder of the experiment that arm '{name}' reuses; give another "
                "--out"
            )
    entered = [name for name in experiment.arms if name in chosen or (out / name).is_dir()]
    for name in entered:
        check_networks(name, experiment.arms[name], experiment.trained(name))
    for records in experiment.records:
        make_records(records, experiment.trained(chosen[0]).config.model)
    for name in entered:
        check_settings(experiment, name, out / name)
    for name in chosen:
        if "/" in experiment.arms[name].reuse:
            there = experiment.folder(name, out)
            check_settings(alone_of(experiment, name), there.name, there)
        check_arm(name, experiment.arms[name], experiment.trained(name), count)
    for name in chosen:
        write_settings(experiment, name, out / name)


def missing_networks(experiment: Experiment, out: Path, chosen: Sequence[str], seeds: int) -> None:
    """Raises ValueError where an arm reuses another of this experiment that is neither chosen nor
    trained."""
    for name in chosen:
        reuse = experiment.arms[name].reuse
        if not reuse or "/" in reuse or reuse in chosen:
            continue
        exports = [Checkpoint.of_workdir(out / reuse / f"seed-{seed}") for seed in range(seeds)]
        if not all(export.has(*experiment.arms[reuse].stages) for export in exports):
            raise ValueError(
                f"experiment: arm '{name}' judges the networks of '{reuse}', which are not trained "
                f"in {out}; give it too: --arms {reuse} {name}"
            )


def attempt(
    experiment: Experiment, out: Path, name: str, seed: int, count: int, broken: dict[Path, str]
) -> None:
    """Train arm ``name`` as far as it is not, and judge it. A training that diverges is kept as its
    result, and in ``broken``, by its folder."""
    arm, made = experiment.arms[name], experiment.trained(name)
    place = f"seed-{seed}"
    workdir, here = experiment.folder(name, out) / place, out / name / place
    if workdir not in broken:
        try:
            with contextlib.ExitStack() as stack:
                if "/" in arm.reuse:
                    there = workdir.parent
                    stack.enter_context(
                        exclusive_lock(
                            there.parent,
                            lambda: console.print(
                                f"{there.parent}: another command works there; waiting until it is done",  # noqa: E501
                                markup=False,
                            ),
                        )
                    )
                    write_settings(alone_of(experiment, name), there.name, there)
                checkpoint = (
                    workdir
                    if arm.reuse and "/" not in arm.reuse
                    else train_arm(made, seed, workdir)
                )
        except FloatingPointError as error:  # others go on
            console.print(f"{name}, seed {seed}: {error}", markup=False)
            broken[workdir] = str(error)
    if workdir in broken:
        write_result(here / FAILED, {"failure": broken[workdir]})
        return
    (here / FAILED).unlink(missing_ok=True)
    evaluate_arm(arm, checkpoint, seed, here / "figures", count)


def alone_of(experiment: Experiment, name: str) -> Experiment:
    """The other experiment that arm ``name`` reuses, as far as that arm."""
    there = experiment.others[experiment.arms[name].reuse].folder.name
    return Experiment({there: experiment.trained(name)}, there, ())


def train_arm(arm: Arm, seed: int, workdir: Path) -> Path:
    """The checkpoint of an arm, trained as far as it is not yet; where nothing is trained, its
    ``init``.

    Raises:
      FloatingPointError: it diverged.
    """
    if not arm.stages:
        return Checkpoint.find(arm.init).folder
    data = dataclasses.replace(arm.config.data, seed=seed)
    config = dataclasses.replace(arm.config, seed=seed, data=data)
    if arm.other_networks_from:
        source, exported = Checkpoint.find(arm.other_networks_from), Checkpoint.of_workdir(workdir)
        check_workdir(config, workdir)
        source.copy_networks(other_networks(arm, source, exported), exported.folder)
    init = arm.init or config.init
    if init and "uniart_vae" in arm.stages:
        init = reinit_aggregation(Checkpoint.find(init), config, workdir / "init")
    elif not init:
        init = shared_init(config, arm.stages, workdir / "init")
    run(config, arm.stages, workdir, init or None)
    return workdir
