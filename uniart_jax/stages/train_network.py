"""One stage: its network from a checkpoint or from scratch to its exported weights, by its own
batches or by a user's."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import jax
import optax

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data.image_table import load_image_table
from uniart_jax.models.checkpoint import Checkpoint, set_untrained
from uniart_jax.models.checkpoint_files import write_network
from uniart_jax.models.network import Network, build
from uniart_jax.nn.shapes import check_shapes
from uniart_jax.runtime.progress import messages
from uniart_jax.stages.stage import Stage, Statistics
from uniart_jax.stages.table import STAGES
from uniart_jax.training import distributed
from uniart_jax.training.checkpoints import Checkpoints
from uniart_jax.training.loop import run_stage
from uniart_jax.training.microbatches import in_parts
from uniart_jax.training.programs import Programs
from uniart_jax.training.sharding import make_mesh, put_batch, replicated, split_words
from uniart_jax.training.state import abstract_state, begin_with, create_state, make_optimizer
from uniart_jax.training.step import make_train_step
from uniart_jax.voxels.typed_batches import batch_of

console = messages()


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
    statistics = stage.statistics(config, workdir, source)
    key = jax.random.fold_in(jax.random.key(config.seed), list(STAGES).index(name))
    optimizer = make_optimizer(settings)
    step = make_step(stage, network, optimizer, config, workdir, mesh, statistics, source)
    if trained:  # nothing that the checkpoint would replace
        start = abstract_state(network.init, optimizer, mesh, config.mesh.min_split)
    else:
        start = create_state(network.init, optimizer, key, mesh, config.mesh.min_split)
        if source is not None and source.has(name):
            start = begin_with(start, source.load(name, config.model, widen=True))
        elif first := stage.first_weights(config):
            start = begin_with(start, first)
    if distributed.is_first() and (split := split_words(mesh, start.params)):
        console.print(f"{name}: {split}", highlight=False)
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
        idle=functools.partial(stage.idle, config),
        accumulate=settings.accumulate,
        skip=settings.skip_not_finite > 0,
        frozen_params=jax.device_put(frozen, replicated(mesh)) if frozen else None,
    )
