"""Training from records to an exported checkpoint: the stages in their order, each from where it
stands (``Trainer``, and ``run``, which it calls).

WORKDIR holds ``config.json``, ``checkpoints/<stage>``, ``metrics``, ``tensorboard``, ``latents``
and ``export``, the checkpoint that sampling loads. Every stage resumes by itself; a finished one is
skipped.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import jax
import optax

from uniart_jax.config import NETWORKS, Config, ModelConfig
from uniart_jax.data.image_table import load_image_table
from uniart_jax.models.checkpoint import Checkpoint, set_untrained
from uniart_jax.models.checkpoint_files import write_config, write_network
from uniart_jax.models.network import Network, build
from uniart_jax.nn.shapes import check_shapes
from uniart_jax.pipeline import Pipeline
from uniart_jax.pipeline import load as load_pipeline
from uniart_jax.runtime.locks import exclusive_lock
from uniart_jax.runtime.progress import messages
from uniart_jax.stages.checks import (
    check_features,
    check_found,
    check_freeze,
    check_settings,
    ensure_records,
    networks_to_copy,
    overlapping,
)
from uniart_jax.stages.stage import Stage, Statistics
from uniart_jax.stages.table import STAGES
from uniart_jax.training import distributed
from uniart_jax.training.checkpoints import Checkpoints
from uniart_jax.training.loop import run_stage
from uniart_jax.training.microbatches import in_parts
from uniart_jax.training.programs import Programs
from uniart_jax.training.sharding import make_mesh, put_batch, replicated
from uniart_jax.training.state import (
    abstract_state,
    begin_with,
    create_state,
    make_optimizer,
)
from uniart_jax.training.step import make_train_step
from uniart_jax.voxels.typed_batches import batch_of

RUNTIME = ("kernel", "compute_dtype", "scan_blocks", "remat")  # how a model is run, not what it is
console = messages()


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


class CountedBatches:
    """Batches that know their place: how many were read. Set back, they are read over again."""

    def __init__(self, batches: Iterable[Any]):
        self._batches, self._iterator, self._read = batches, iter(batches), 0

    def __iter__(self) -> CountedBatches:
        return self

    def __next__(self) -> Any:
        batch = next(self._iterator)
        self._read += 1
        return batch

    def get_state(self) -> dict[str, int]:
        return {"read": self._read}

    def set_state(self, state: dict[str, int]) -> None:
        """
        Raises:
          ValueError: there are fewer batches, or they were read farther and cannot begin anew.
        """
        if state["read"] < self._read:
            again = iter(self._batches)
            if again is self._iterator:
                raise ValueError(
                    f"fit: batch {self._read} of an iterator was read, and a training goes on from "
                    f"batch {state['read']}; give something that can be read from its beginning"
                )
            self._iterator, self._read = again, 0
        while self._read < state["read"]:
            try:
                next(self)
            except StopIteration:
                raise ValueError(
                    f"fit: the training goes on from batch {state['read']}, and there are "
                    f"{self._read}; give as many as before, and those that follow"
                ) from None


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
        default: the config's own. A stage that has a checkpoint of its own resumes from that.
      batches: of one stage, in place of its own (``Trainer.fit``).

    Raises:
      ValueError: WORKDIR belongs to another model or another process works in it, a setting is out
        of range, a flow's checkpoint to other inputs, ``init`` does not fit the config, or a
        stage's ``freeze`` its network.
      FileNotFoundError: records, an earlier stage's weights or published ones are missing.
      FloatingPointError: loss or gradients are not finite (``StageConfig.skip_not_finite``).
    """
    workdir = Path(workdir)
    chosen = [STAGES[name] for name in trainable(config, stages)]
    names = [stage.name for stage in chosen]
    if not config.data.records and batches is None:
        raise ValueError(
            "config: data.records is empty; give the folder of 'uniart prepare … --out FOLDER'"
        )
    check_settings(config, chosen)
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
        for name in names:
            if goes_on(source, name):
                source.load(name, config.model, widen=True)
        copied = networks_to_copy(config, source, names, exported)
    for stage in chosen:
        if source is None or not goes_on(source, stage.name):
            stage.check_first_weights(config)
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
    """Make WORKDIR this config's, or check that it is: one folder holds one model."""
    if (workdir / "config.json").is_file():
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
    exported = Checkpoint.of_workdir(workdir)
    untrained = exported.untrained()
    write_config(exported.folder, dataclasses.replace(config, untrained=untrained))


def train_network(
    stage: Stage,
    config: Config,
    workdir: Path,
    source: Checkpoint | None = None,
    batches: Iterable[Any] | None = None,
) -> None:
    """One stage, from its checkpoint, the weights of checkpoint ``source`` or from scratch, to
    ``WORKDIR/export/<name>.safetensors``."""
    name, settings = stage.name, stage.settings(config)
    network = build(name, config.model)
    mesh = make_mesh(config.mesh)
    folder, exported = workdir / "checkpoints" / name, Checkpoint.of_workdir(workdir)
    stage.check_inputs(config, workdir, source)
    with Checkpoints(folder, settings.keep_checkpoints) as checkpoints:
        trained = distributed.broadcast_from_first(max(checkpoints.steps, default=0))
    if distributed.broadcast_from_first(trained >= settings.steps and exported.has(name)):
        if distributed.is_first():
            console.print(f"{name}: already trained ({settings.steps} steps); skipped")
        return
    items = settings.batch_size // settings.accumulate
    if items % mesh.size and jax.process_count() == 1:  # of several, sending the batch is an error
        console.print(
            f"{name}: {items} items at once do not divide over {mesh.size} devices, so each "
            "computes all of them; give a batch_size that does",
            style="yellow",
        )
    statistics = stage.statistics(config, workdir, source)
    key = jax.random.fold_in(jax.random.key(config.seed), list(STAGES).index(name))
    optimizer = make_optimizer(settings)
    step = make_step(stage, network, optimizer, config, workdir, mesh, statistics, source)
    if trained:  # nothing that the checkpoint would replace
        start = abstract_state(network.init, optimizer, mesh)
    else:
        start = create_state(network.init, optimizer, key, mesh)
        if source is not None and goes_on(source, name):
            start = begin_with(start, source.load(name, config.model, widen=True))
        elif first := stage.first_weights(config):
            start = begin_with(start, first)
    iterator = (
        iter(stage_batches(stage, config, workdir)) if batches is None else counted(stage, batches)
    )
    evaluate = stage.evaluation(config, workdir, statistics)
    with (
        Checkpoints(folder, settings.keep_checkpoints) as checkpoints,
        contextlib.ExitStack() as stack,
    ):
        if hasattr(iterator, "close"):
            stack.callback(iterator.close)
        state = run_stage(
            name,
            state=start,
            train_step=step,
            batches=iterator,
            put=make_put(stage, mesh, config.model, settings.accumulate),
            key=jax.random.fold_in(key, 1),
            checkpoints=checkpoints,
            stage=settings,
            workdir=workdir,
            evaluate=distributed.evaluate_on_first(evaluate),
        )
    write_network(exported.folder, name, state.ema)  # on every process; the first one writes
    distributed.on_first_process(lambda: set_untrained(exported.folder, [name]))


def goes_on(source: Checkpoint, name: str) -> bool:
    """Whether a training that goes on from ``source`` begins with its weights of a network: not
    where it has none of a network that models can do without, as checkpoints of before have."""
    return name in NETWORKS or source.has(name)


def counted(stage: Stage, batches: Iterable[Any]) -> Any:
    """An iterator over batches of one's own, with a place to come back to."""
    iterator = iter(batches)
    return iterator if hasattr(iterator, "get_state") else CountedBatches(batches)


def stage_batches(stage: Stage, config: Config, workdir: Path) -> Any:
    """The endless batches of a stage; ``batch_size`` is over all processes."""
    if not stage.reads_pictures_only:
        load_image_table.cache_clear()  # a gigabyte that nobody reads any more
    share = {
        "process_index": jax.process_index(),
        "process_count": jax.process_count(),
        "accumulate": stage.settings(config).accumulate,
    }
    return stage.batches(config, workdir, share)


def make_put(
    stage: Stage, mesh: jax.sharding.Mesh, model: ModelConfig, accumulate: int = 1
) -> Callable[[Any], Any]:
    """Host batch, or a dictionary of its fields -> what the stage's loss reads, on the devices;
    ``accumulate`` micro-batches of it (``microbatches.in_parts``).

    Raises:
      ValueError: a field is missing that the stage reads, or an array has another shape.
    """
    put = in_parts(functools.partial(put_batch, mesh=mesh), accumulate, model)

    def run(given: Any) -> Any:
        try:
            batch = batch_of(stage.batch, given, stage.wanted, stage.needed)
            check_shapes(batch)
        except ValueError as error:
            raise ValueError(f"{stage.name}: {error}") from None
        return put(batch)

    return run


def make_step(
    stage: Stage,
    network: Network,
    optimizer: optax.GradientTransformation,
    config: Config,
    workdir: Path,
    mesh: jax.sharding.Mesh,
    statistics: dict[str, Statistics],
    source: Checkpoint | None = None,
) -> Programs:
    """The train step of a stage; a flow's begins with the frozen image encoder's reading of the
    pictures, by WORKDIR's export.

    Args:
      network, optimizer: those that the state is made by.
      statistics: of latents (``Stage.statistics``).
      source: the checkpoint that WORKDIR goes on from.
    """
    settings = stage.settings(config)
    frozen = stage.frozen_params(config, workdir, source)
    return make_train_step(
        stage.loss(network, config, workdir, statistics),
        optimizer,
        settings.ema_decay,
        freeze=settings.freeze,
        accumulate=settings.accumulate,
        skip=settings.skip_not_finite > 0,
        frozen_params=jax.device_put(frozen, replicated(mesh)) if frozen else None,
    )
