"""A checkpoint: the folder that a training leaves and that sampling loads.

Which networks it holds, their parameters, the statistics of their latents, what of them is not
trained yet, and which of them another training can go on from.
"""

from __future__ import annotations

import dataclasses
import filecmp
import functools
import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.config import LATENT_OF, STAGES, Config, ModelConfig, from_json
from uniart_jax.models.checkpoint_files import (
    STATISTICS,
    read_network,
    read_statistics,
    write_config,
    write_file,
    write_statistics,
)
from uniart_jax.models.hub import PREFIX, hub_folder
from uniart_jax.models.network import build, is_of_this_package
from uniart_jax.runtime.files import check_local
from uniart_jax.runtime.program_cache import kept_shapes

PRETRAINED = Path(__file__).parent.parent / "pretrained"  # the shipped models
EXPORT = "export"  # folder of a WORKDIR
FLOW_INPUTS = ("image_encoder", "structure_vae", "uniart_vae")  # what a flow is trained on
# Networks that can get layers after they were trained, and the options that add them.
WIDENABLE = ("structure_flow", "latent_flow", "uniart_vae", "layout")
ADDED_LAYERS = (
    *("pixel_channels", "layout_channels", "refine_channels", "part_feature_channels"),
    *("legs", "panels", "boards", "revolutions"),
)


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """The networks in a folder. ``Checkpoint.find`` takes what people name;
    ``Checkpoint.of_workdir`` is what a training has left so far.

    Attributes:
      folder: holds ``config.json``, ``<network>.safetensors`` and ``latent_stats.safetensors``
        (``models.checkpoint_files``), or some of them.
    """

    folder: Path

    @classmethod
    def of_workdir(cls, workdir: Path) -> Checkpoint:
        """What the training in WORKDIR has left so far; its folder need not be there yet."""
        return cls(Path(workdir) / EXPORT)

    @classmethod
    def find(cls, given: str | Path) -> Checkpoint:
        """The checkpoint of that name: a folder with networks, a training WORKDIR (its ``export``),
        a shipped model, or one of the Hugging Face hub (``hf:ORG/NAME``, ``models.hub``).

        Raises:
          FileNotFoundError: none of these; the shipped ones are listed.
          ValueError: what the hub needs is not installed, or it is an address of a bucket.
        """
        if str(given).startswith(PREFIX):
            folder = hub_folder(str(given))
        else:
            check_local(given, "checkpoint")
            shipped = PRETRAINED / str(given)
            folder = shipped if not os.path.isdir(given) and os.path.isdir(shipped) else Path(given)
        if not str(given).strip() or not os.path.isdir(folder):  # isdir: False for a name too long
            known = sorted(p.name for p in PRETRAINED.glob("*") if p.is_dir())
            raise FileNotFoundError(
                f"checkpoint '{given}': neither a folder nor a shipped model (shipped: "
                f"{', '.join(known) or 'none'}; of the hub: hf:ORG/NAME)"
            )
        own = cls.of_workdir(folder)
        is_workdir = not any(folder.glob("*.safetensors")) and own.folder.is_dir()
        return own if is_workdir else cls(folder)

    @functools.cached_property
    def config(self) -> Config:
        """What the networks were trained with. Read once: after writing another into the folder,
        ask a new ``Checkpoint``.

        Raises:
          FileNotFoundError: no config.json.
          ValueError: it is malformed; all unknown fields are listed.
        """
        path = self.path("config.json")
        try:
            return from_json(Config, path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    def path(self, filename: str) -> Path:
        """Where a file of it lies.

        Raises:
          FileNotFoundError: there is no such file.
        """
        path = self.folder / filename
        if not path.is_file():
            raise FileNotFoundError(
                f"checkpoint {self.folder}: no {filename} in it; finish the training stage that "
                "writes it"
            )
        return path

    def has(self, *networks: str) -> bool:
        """Whether it holds all of these networks."""
        return all((self.folder / f"{name}.safetensors").is_file() for name in networks)

    def networks(self) -> list[str]:
        """Those of ``config.STAGES`` that it holds."""
        return [name for name in STAGES if self.has(name)]

    def untrained(self, networks: Sequence[str] | None = None) -> tuple[str, ...]:
        """Names of parameters, or prefixes of such names, that still hold their initial values
        (``Config.untrained``): of these networks; None = of all. () where there is no config."""
        if not (self.folder / "config.json").is_file():
            return ()
        names = self.config.untrained
        return tuple(n for n in names if networks is None or n.split(".")[0] in networks)

    def statistics(self, latent: str) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation [C] of latent "structure" or "latent".

        Raises:
          FileNotFoundError, ValueError: as ``checkpoint_files.read_statistics``.
        """
        return read_statistics(self.path(STATISTICS), latent)

    def load(self, name: str, model: ModelConfig | None = None, widen: bool = False) -> Any:
        """Parameters of a network, as nested dict of float32 numpy arrays.

        Args:
          model: that the network must fit; default: the checkpoint's own.
          widen: leave out layers that ``model`` adds to the checkpoint's network
            (``missing_layers``). What the checkpoint's network gives does not depend on them at
            first, so a training begins with the function that the checkpoint has.

        Raises:
          FileNotFoundError: it is not there. ValueError: as ``checkpoint_files.read_network``.
        """
        model = model or self.config.model
        if widen and (options := self.missing_layers(name, model)):
            narrow = dataclasses.replace(getattr(model, name), **dict.fromkeys(options, 0))
            model = dataclasses.replace(model, **{name: narrow})
        path = self.path(f"{name}.safetensors")
        make = lambda: build(name, model).abstract()  # noqa: E731
        kept = is_of_this_package(model)
        return read_network(path, kept_shapes(make, name, model) if kept else make())

    def missing_layers(self, name: str, model: ModelConfig) -> list[str]:
        """Which of ``ADDED_LAYERS`` network ``name`` has in ``model`` and lacks here."""
        wanted = [o for o in ADDED_LAYERS if getattr(getattr(model, name), o, 0)]
        known = self.has(name) and (self.folder / "config.json").is_file()
        if name not in WIDENABLE or not wanted or not known:
            return []
        return [o for o in wanted if not getattr(getattr(self.config.model, name), o)]

    def same_latent_space(self, other: Checkpoint | None, retrained: Sequence[str] = ()) -> bool:
        """Whether flows of this checkpoint can stand beside the networks of ``other``: their image
        encoder and VAEs are the same files, or ``other`` has none yet.

        Args:
          retrained: networks that ``other`` will train itself.
        """
        return all(
            name not in retrained
            and self.has(name)
            and (other is None or not other.has(name) or self._same_file(other, name))
            for name in FLOW_INPUTS
        )

    def _same_file(self, other: Checkpoint, name: str) -> bool:
        file = f"{name}.safetensors"
        return filecmp.cmp(self.path(file), other.path(file), shallow=False)

    def copyable(
        self, config: Config, trained: Sequence[str], target: Checkpoint | None = None
    ) -> list[str]:
        """The networks that a training of ``config`` can copy instead of training them.

        Not those that ``target`` has; not a flow whose latent space would differ there; not a
        network without layers that the config adds (``missing_layers``): it must be trained on.

        Args:
          trained: networks that are trained now. target: the training's checkpoint, if it is begun.
        """
        return [
            name
            for name in config.model.networks()
            if name not in trained
            and self.has(name)
            and (target is None or not target.has(name))
            and (name not in LATENT_OF or self.same_latent_space(target, trained))
            and not self.missing_layers(name, config.model)
        ]

    def copy_networks(self, names: Sequence[str], folder: Path) -> None:
        """Copy networks to another checkpoint folder: a flow with the statistics of its latent, and
        what is untrained of them with its names.

        Raises:
          FileNotFoundError: one is not there.
        """
        if untrained := self.untrained(names):
            set_untrained(folder, names, untrained)
        for name in names:  # a network last, so that one that is there is whole
            if name in LATENT_OF:
                write_statistics(folder, LATENT_OF[name], *self.statistics(LATENT_OF[name]))
            path = self.path(f"{name}.safetensors")
            write_file(folder / path.name, path.read_bytes())

    def digest(self) -> str:
        """16 hexadecimal digits of all networks and of the options that they are sampled with."""
        total = hashlib.sha256()
        for path in sorted([*self.folder.glob("*.safetensors"), *self.folder.glob("config.json")]):
            found = path.stat()
            total.update(path.name.encode() + _file_digest(path, found.st_size, found.st_mtime_ns))
        return total.hexdigest()[:16]


@functools.cache  # gigabytes, asked for by every arm
def _file_digest(path: Path, size: int, changed: int) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def set_untrained(folder: Path, networks: Sequence[str], names: Sequence[str] = ()) -> None:
    """Write into the config in ``folder`` that of these networks just the parameters ``names`` are
    untrained (``Checkpoint.untrained``)."""
    config = Checkpoint(folder).config
    kept = [name for name in config.untrained if name.split(".")[0] not in networks]
    write_config(folder, dataclasses.replace(config, untrained=(*kept, *names)))
