"""Training from records to an exported checkpoint: the stages in their order, each from where it
stands (``Trainer``, and ``run``, which it calls).

WORKDIR holds ``config.json``, ``checkpoints/<stage>``, ``metrics``, ``tensorboard``, ``latents``
and ``export``, the checkpoint that sampling loads. Every stage resumes by itself; a finished one is
skipped.
"""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from uniart_jax.config import Config
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config
from uniart_jax.pipeline import Pipeline
from uniart_jax.pipeline import load as load_pipeline
from uniart_jax.runtime.files import check_local
from uniart_jax.runtime.locks import exclusive_lock
from uniart_jax.stages.checks import (
    check_devices,
    check_features,
    check_found,
    check_freeze,
    check_settings,
    ensure_records,
    networks_to_copy,
    overlapping,
    tell_from_scratch,
)
from uniart_jax.stages.table import STAGES
from uniart_jax.stages.train_network import train_network
from uniart_jax.training import distributed

RUNTIME = ("kernel", "compute_dtype", "scan_blocks", "remat")  # how a model is run, not what it is


class Trainer:
    """Trains the networks of a config in a folder. ``train.py`` does no more than this:

        trainer = Trainer(uniart_jax.config("nano"), "runs/mine")
        trainer.fit()                            # all stages, in their order
        trainer.fit("layout", my_batches)        # one, on batches of one's own

    Attributes:
      workdir: holds checkpoints, logs and ``export``, the checkpoint for ``uniart_jax.load``.
    """

    def __init__(
        self,
        config: Config,
        workdir: str | Path | None = None,
        init: str | Path | None = None,
    ):
        """
        Args:
          workdir: default: ``runs/<config's name>``.
          init: a checkpoint to go on from (``run``).
        """
        self.config, self.init = config, init
        self.workdir = Path("runs") / config.name if workdir is None else Path(workdir)

    def __repr__(self) -> str:
        names, exported = self.config.model.networks(), Checkpoint.of_workdir(self.workdir)
        trained = sum(exported.has(name) for name in names)
        init = self.init or self.config.init
        return (
            f"Trainer({self.config.name}: {', '.join(names)}; {trained} of {len(names)} exported "
            f"in {self.workdir}{f'; goes on from {init}' if init else ''})"
        )

    def fit(
        self, stages: str | Sequence[str] = "all", batches: Iterable[Any] | None = None
    ) -> Trainer:
        """Train a stage, several, or all; a stage goes on from its last checkpoint and is skipped
        once it has taken its steps.

        Args:
          batches: host batches of one stage (``Stage.batch``), or dictionaries of their fields,
            at least as many as the stage has steps. An iterator without
            ``get_state`` and ``set_state`` is read again from its beginning when a training is
            resumed.

        Raises:
          ValueError, FileNotFoundError, FloatingPointError: as ``run``.
        """
        names = list(STAGES) if stages == "all" else [stages] if isinstance(stages, str) else stages
        if batches is not None and len(names) != 1:
            raise ValueError("fit: batches are of one stage; name it")
        run(self.config, names, self.workdir, self.init, batches)
        return self

    def pipeline(self) -> Pipeline:
        """What has been trained, ready to sample.

        Raises:
          FileNotFoundError: a network is missing.
        """
        return load_pipeline(self.workdir)


def run(
    config: Config,
    stages: Sequence[str],
    workdir: Path,
    init: str | Path | None = None,
    batches: Iterable[Any] | None = None,
) -> None:
    """Train ``stages`` in their order; prepares the config's own procedural records first if they
    are not there.

    Args:
      init: a checkpoint (``Checkpoint.find``) to go on from, see ``Checkpoint.copyable``;
        default: the config's own. A stage that has a checkpoint of its own resumes from that; one
        whose network ``init`` lacks begins from scratch.
      batches: of one stage, in place of its own (``Trainer.fit``).

    Raises:
      ValueError: WORKDIR belongs to another model or another process works in it, a setting is out
        of range or does not fit the devices, a flow's checkpoint to other inputs, ``init`` does not
        fit the config, or a stage's ``freeze`` its network.
      FileNotFoundError: records, an earlier stage's weights or published ones are missing.
      FloatingPointError: loss or gradients are not finite (``StageConfig.skip_not_finite``).
    """
    check_local(workdir, "workdir")
    workdir = Path(workdir)
    chosen = [STAGES[name] for name in trainable(config, stages)]
    names = [stage.name for stage in chosen]
    if not config.data.records and batches is None:
        raise ValueError(
            "config: data.records is empty; give the folder of 'uniart prepare … --out FOLDER'"
        )
    check_settings(config, chosen)
    check_devices(config, chosen if batches is None else ())
    check_features(config, chosen)
    if overlapping(config.data) and distributed.is_first():
        warnings.warn(
            "data.validation holds records that are trained on: its figures say nothing about new "
            "objects; give another folder or split",
            stacklevel=2,
        )
    init = init or config.init
    source, exported = Checkpoint.find(init) if init else None, Checkpoint.of_workdir(workdir)
    copied: list[str] = []
    check_freeze(config, chosen)
    if source is not None:  # before anything is written
        for name in filter(source.has, names):
            source.load(name, config.model, widen=True)
        copied = networks_to_copy(config, source, names, exported)
    for stage in chosen:
        resumed = (workdir / "checkpoints" / stage.name).is_dir() or exported.has(stage.name)
        if not resumed and (source is None or not source.has(stage.name)):
            stage.check_first_weights(config)
            if source is not None:
                tell_from_scratch(source, stage.name)
    check_found(config, chosen, exported, copied)
    with exclusive_lock(workdir) if distributed.is_first() else contextlib.nullcontext():
        distributed.on_first_process(lambda: check_workdir(config, workdir))
        if not (workdir / "config.json").is_file():
            raise ValueError(
                f"workdir '{workdir}': not the first process's folder; give all processes one on a "
                "shared file system"
            )
        if source is not None:
            distributed.on_first_process(lambda: source.copy_networks(copied, exported.folder))
        if not all(stage.makes_data for stage in chosen):
            distributed.on_first_process(lambda: ensure_records(config, training=batches is None))
        for stage in chosen:
            train_network(stage, config, workdir, source, batches)


def trainable(config: Config, names: Sequence[str]) -> list[str]:
    """The stages of those asked for that the config's model has something to train in, in their
    order.

    Raises:
      ValueError: no such stage, or nothing is left; why and what to do is said.
    """
    if not names:
        raise ValueError(f"no stage was given; choose of {', '.join(STAGES)}")
    if unknown := [name for name in names if name not in STAGES]:
        raise ValueError(f"stage {unknown[0]}: unknown; choose one of {', '.join(STAGES)}")
    asked = [stage for name, stage in STAGES.items() if name in names]
    why = {stage.name: stage.left_out(config.model) for stage in asked}
    left = [name for name, reason in why.items() if not reason]
    if not left:
        raise ValueError("; ".join(f"stage {name}: {reason}" for name, reason in why.items()))
    return left


def check_workdir(config: Config, workdir: Path) -> None:
    """Make WORKDIR this config's, or check that it is: one folder holds one model, as soon as
    something of it has been trained or copied."""
    exported = Checkpoint.of_workdir(workdir)
    saved = [p for p in workdir.glob("checkpoints/*/*") if p.name.isdigit()]
    begun = bool(saved) or any(exported.folder.glob("*.safetensors"))
    if begun and (workdir / "config.json").is_file():
        found = Checkpoint(workdir).config
        runtime = {name: getattr(config.model, name) for name in RUNTIME}
        other = dataclasses.replace(found.model, **runtime)
        parts = [f.name for f in dataclasses.fields(other)]
        differ = [n for n in parts if getattr(other, n) != getattr(config.model, n)]
        if differ:
            raise ValueError(
                f"workdir '{workdir}' holds another model (different: "
                f"{', '.join(f'model.{n}' for n in differ)}); choose another --workdir"
            )
    workdir.mkdir(parents=True, exist_ok=True)
    write_config(workdir, config)
    untrained = exported.untrained() if begun else ()
    write_config(exported.folder, dataclasses.replace(config, untrained=untrained))
