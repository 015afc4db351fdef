"""What a training stage is: one network, the batches it reads, what it minimises, how it is judged.

A stage is one file of this folder with one subclass of ``Stage``, and one line in ``table.STAGES``;
its numbers (steps, rates) are the ``StageConfig`` of the same name in ``config.Config``. The losses
stand in ``training/``, which runs without the input pipeline.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ClassVar

import jax
import numpy as np

from uniart_jax.config import Config, ModelConfig, StageConfig
from uniart_jax.data.folder import read_metadata
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import Network
from uniart_jax.training.state import TrainState

Statistics = tuple[np.ndarray, np.ndarray]  # mean and deviation of a latent's channels
Evaluation = Callable[[TrainState, int], tuple[dict[str, float], dict[str, np.ndarray]]]


class Stage(abc.ABC):
    """The training of one network.

    Attributes:
      name: of the network (``models.network.build``), of its ``StageConfig`` and of its files.
      latent: "structure" or "latent" where the stage is a flow of that latent, which is encoded
        before (``precompute.encoding.encode_all``); else "".
      makes_data: that it makes its own objects and reads no records.
      reads_features: that it reads the columns of the UniArt VAE (``data.columns``).
      reads_pictures_only: that it reads ``data.image_table``, which others need not keep in memory.
      batch: the kind of its batches (``voxels.typed_batches``).
      wanted: fields of a batch that it must have and that go to the devices; () for all.
      needed: fields that a batch must have, where ``wanted`` does not say it.
    """

    name: ClassVar[str]
    latent: ClassVar[str] = ""
    makes_data: ClassVar[bool] = False
    reads_features: ClassVar[bool] = False
    reads_pictures_only: ClassVar[bool] = False
    batch: ClassVar[type]
    wanted: ClassVar[tuple[str, ...]] = ()
    needed: ClassVar[tuple[str, ...]] = ()

    def settings(self, config: Config) -> StageConfig:
        """Its steps, batch size and rates.

        Raises:
          ValueError: the config has none of its name.
        """
        settings = getattr(config, self.name, None)
        if not isinstance(settings, StageConfig):
            raise ValueError(
                f"stage {self.name}: the config has no StageConfig of this name; override "
                "Stage.settings, or give the stage the name of a network that it takes the place of"
            )
        return settings

    def left_out(self, model: ModelConfig) -> str:
        """Why a model has nothing to train here, with what to do; "" where it has."""
        return ""

    def check(self, config: Config) -> None:
        """What of the config can be told to be wrong before anything is written.

        Raises:
          ValueError, FileNotFoundError: it cannot be trained so.
        """
        return None

    def shows_found_layouts(self, config: Config) -> bool:
        """Whether ``loss.found`` shows its network layouts that the layout network finds."""
        return False

    def check_inputs(self, config: Config, workdir: Path, source: Checkpoint | None) -> None:
        """Tie the stage's checkpoints in WORKDIR to what it trains on.

        Raises:
          FileNotFoundError: a network that it needs has not been trained. ValueError: the
            checkpoints belong to other inputs.
        """
        return None

    @abc.abstractmethod
    def batches(self, config: Config, workdir: Path, share: dict[str, int]) -> Iterable[Any]:
        """Endless host batches with ``get_state`` and ``set_state``.

        Args:
          share: ``process_index``, ``process_count`` and ``accumulate``.
        """

    @abc.abstractmethod
    def loss(
        self, network: Network, config: Config, workdir: Path, statistics: dict[str, Statistics]
    ) -> Callable[..., tuple[jax.Array, dict[str, jax.Array]]]:
        """(params, batch, key) -> loss and scalar metrics; with ``frozen_params``, of (params,
        batch, key, frozen_params)."""

    def idle(self, config: Config, batch: Any) -> tuple[str, ...]:
        """Parameters that the loss of such a batch does not read, named as in ``freeze``; they stay
        as they are in its step."""
        return ()

    def frozen_params(
        self, config: Config, workdir: Path, source: Checkpoint | None
    ) -> tuple[Any, ...]:
        """Parameters of frozen networks that the loss takes after its key; () for none.

        Args:
          source: the checkpoint that WORKDIR goes on from.
        """
        return ()

    def statistics(
        self, config: Config, workdir: Path, source: Checkpoint | None
    ) -> dict[str, Statistics]:
        """Of latents that the loss or the evaluation reads, other than those of a flow's own
        encoding."""
        return {}

    def first_weights(self, config: Config) -> dict[str, Any]:
        """Weights that a training without a checkpoint to go on from begins with, in place of drawn
        ones."""
        return {}

    def check_first_weights(self, config: Config) -> None:
        """Check, before anything is written, that what ``first_weights`` reads is there.

        Raises:
          FileNotFoundError: it is not installed.
        """
        return None

    @abc.abstractmethod
    def evaluation(
        self, config: Config, workdir: Path, statistics: dict[str, Statistics]
    ) -> Evaluation | None:
        """Judges the averaged weights on records that are never trained on (``training.loop``);
        None without any."""


def load(workdir: Path, name: str, config: Config) -> Any:
    """Parameters of a network that WORKDIR has trained or copied."""
    return Checkpoint.of_workdir(workdir).load(name, config.model)


def check_picture_size(config: Config) -> None:
    """ValueError where records that are there hold pictures of another size than the image encoder
    that is trained here reads."""
    data, encoder = config.data, config.model.image_encoder
    for folder in filter(None, (data.records, data.validation)):
        if not encoder.kind.trained or not (Path(folder) / "metadata.json").is_file():
            continue
        held = int(read_metadata(folder).get("image_size", encoder.image_size))
        if held != encoder.image_size:
            raise ValueError(
                f"{folder}: its pictures have {held} pixels a side, model.image_encoder.image_size "
                f"is {encoder.image_size}; prepare records with --image-size {encoder.image_size}"
            )
