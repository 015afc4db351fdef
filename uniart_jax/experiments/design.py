"""What an experiment is: arms, what is trained in each, and where on the road it is judged.
``configs/experiments/*.py`` make them."""

from __future__ import annotations

import dataclasses
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from uniart_jax.config import Config
from uniart_jax.runtime.config_files import CONFIGS, find_file

Size = Literal["nano", "paper"]
# from what to what the networks of a checkpoint are judged: evaluation.procedural's rows, and the
# structure alone
Station = Literal["vae", "structure", "latent_flow", "object"]
FOLDER = CONFIGS / "experiments"
# every network that configs/paper.py trains; DINOv2 is taken as it is
PAPER_STAGES = ("structure_vae", "uniart_vae", "structure_flow", "latent_flow")
OBJECT_COLUMNS = (
    "rs_psnr",
    "as_psnr",
    "rs_chamfer",
    "as_chamfer",
    "part_recall",
    "parts_right",
    "part_count",
    "type_accuracy",
    "axis_median",
    "pivot",
    "pose_error",
)


@dataclasses.dataclass(frozen=True)
class Objects:
    """The objects that an arm is judged on.

    Attributes:
      unseen: procedural families that are never trained on, instead of the trained ones.
      joint_type: only objects that have such a joint; "" = all.
      records: a prepared folder and the split of it that is tested, instead of procedural objects.
        Of each object its first record (state 0) is taken; the truth is what that record's voxels
        say.
    """

    unseen: bool = False
    joint_type: str = ""
    records: str = ""
    split: str = ""


@dataclasses.dataclass(frozen=True)
class Arm:
    """One line of the table.

    Attributes:
      config: what is trained; its seeds are set by the run.
      stages: the networks that are trained, in this order; () = the checkpoint ``init``, or that of
        the arm ``of``, is judged as it is.
      station: where on the road it is judged.
      tests: on which objects.
      init: checkpoint whose weights the stages begin with; "" = the config's own.
      beside: checkpoint that gives the networks that are not trained, where the stages begin from
        scratch.
      of: an arm that is trained, whose networks are judged again: one before this one, or
        EXPERIMENT/ARM of another experiment, which is trained only once.
      views: images of the object that are shown together.
      against: the arm that it is held against; "" = the experiment's reference.
      sampling: options of both flows that differ from the checkpoint's (``Pipeline.options``).
    """

    config: Config
    stages: tuple[str, ...]
    station: Station
    tests: Objects = Objects()
    init: str = ""
    beside: str = ""
    of: str = ""
    views: int = 1
    against: str = ""
    sampling: dict[str, Any] = dataclasses.field(default_factory=dict)

    def checkpoints(self) -> list[str]:
        """All that it names."""
        given = {self.init, self.beside, self.config.init if self.stages else ""}
        return sorted(given - {""})


@dataclasses.dataclass(frozen=True)
class Records:
    """Procedural training records that an experiment needs.

    Attributes:
      folder: where they go. families: of ``procedural``. count: objects. views: images of each.
      source: instead of making them, the records of this folder without those that have a joint of
        ``leave_out``, whose split is that word.
      matched: leave out as many of each family, whatever their joints.
      part_features: "geometric": with that column (``data.geometric_features``).
    """

    folder: str
    families: tuple[str, ...] = ()
    count: int = 0
    views: int = 2
    source: str = ""
    leave_out: str = ""
    matched: bool = False
    part_features: Literal["", "geometric"] = ""


@dataclasses.dataclass(frozen=True)
class ExternalArm:
    """An arm of another experiment, and its folder seen from beside this one's."""

    arm: Arm
    folder: Path


@dataclasses.dataclass(frozen=True)
class Experiment:
    """Arms by name, the one that the others are held against, and how much of it is run by default.

    Attributes:
      seeds: trainings of each arm. count: test objects of each.
      columns: the figures of the table (``evaluate_arm.METRICS``).
      others: EXPERIMENT/ARM -> the arm, for all that arms are ``of``; ``load_experiment`` fills it.
    """

    arms: dict[str, Arm]
    reference: str
    columns: tuple[str, ...]
    seeds: int = 3
    count: int = 70
    records: tuple[Records, ...] = ()
    others: dict[str, ExternalArm] = dataclasses.field(default_factory=dict)

    def trained(self, name: str) -> Arm:
        """The arm whose networks arm ``name`` is judged by: itself, or what it is ``of``."""
        of = self.arms[name].of
        if not of:
            return self.arms[name]
        return self.others[of].arm if "/" in of else self.arms[of]

    def folder(self, name: str, out: Path) -> Path:
        """Where that arm is trained, of an experiment in ``out``."""
        of = self.arms[name].of
        return out.parent / self.others[of].folder if "/" in of else out / (of or name)


def trained_on(config: Config, records: Records, **more: Any) -> Config:
    """The config with the records that the experiment makes, without validation; ``more``: of its
    data."""
    data = {"records": records.folder, "procedural": 0, "views": records.views, "validation": ""}
    return dataclasses.replace(config, data=dataclasses.replace(config.data, **data | more))


def with_aggregation(config: Config, kind: str) -> Config:
    """The config with another aggregation in its UniArt VAE."""
    vae = dataclasses.replace(config.model.uniart_vae, aggregation=kind)
    return dataclasses.replace(config, model=dataclasses.replace(config.model, uniart_vae=vae))


def folder_name(path: Path, size: Size) -> str:
    """Of the results of the experiment in file ``path``."""
    return path.stem + ("-paper" if size == "paper" else "")


def find_experiment(name: str | Path) -> Path:
    """The file of an experiment: a path, or a name of configs/experiments/.

    Raises:
      FileNotFoundError: no such file; those that there are, are listed.
    """
    return find_file(name, "experiment", FOLDER)


def load_experiment(name: str | Path, size: Size = "nano") -> Experiment:
    """The ``experiment(size)`` of a file, with the arms of other experiments (beside that file)
    that its arms are of.

    Raises:
      FileNotFoundError: no such file. ValueError: it has no such function, the function refuses the
        size, or what it gives is inconsistent.
    """
    path = find_experiment(name)
    found = _made(path, size)
    others = {}
    for arm in found.arms.values():
        if "/" not in arm.of:
            continue
        stem, _, other = arm.of.partition("/")
        beside = path.with_name(f"{stem}.py")
        there = _made(beside, size).arms.get(other) if beside.is_file() else None
        if there is None or not there.stages:
            raise ValueError(f"experiment '{path}': no trained arm '{arm.of}' at size {size}")
        others[arm.of] = ExternalArm(there, Path(folder_name(beside, size), other))
    return dataclasses.replace(found, others=others)


def _made(path: Path, size: Size) -> Experiment:
    make: Callable[[str], Experiment] | None = runpy.run_path(str(path)).get("experiment")
    if make is None:
        raise ValueError(f"experiment '{path}': it must define experiment(size)")
    found = make(size)
    if not isinstance(found, Experiment):
        raise ValueError(f"experiment '{path}': experiment(size) must give a {Experiment.__name__}")
    arms = found.arms
    for wanted in [found.reference, *(arm.against for arm in arms.values() if arm.against)]:
        if wanted not in arms:
            raise ValueError(f"experiment '{path}': no arm '{wanted}' to hold others against")
    for name, arm in arms.items():
        if bool(arm.stages) + bool(arm.of) + (not arm.stages and bool(arm.init)) != 1:
            raise ValueError(
                f"experiment '{path}': arm {name} must have just one of stages, of, and init "
                "without stages"
            )
        before = [other for other in list(arms)[: list(arms).index(name)] if arms[other].stages]
        if arm.of and "/" not in arm.of and arm.of not in before:
            raise ValueError(
                f"experiment '{path}': arm {name} is of '{arm.of}', which is not a trained arm "
                "before it"
            )
    return found
