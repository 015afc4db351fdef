"""What an experiment is: arms, what is trained in each, and which pipeline stage is judged.
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
# the steps from image to object after which quality is measured, given the truth before them:
# evaluation.procedural's rows, and the structure alone
PipelineStage = Literal["vae", "structure", "latent_flow", "object"]
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
    """One variant of the experiment, a row of its table.

    Attributes:
      config: what is trained; its seeds are set by the run.
      stages: the networks that are trained, in this order. (): nothing is trained, and the
        checkpoint ``init``, or that of the arm ``reuse``, is judged as it is.
      pipeline_stage: what is judged.
      tests: on which objects.
      init: checkpoint whose weights the stages begin with; "" = the config's own.
      other_networks_from: checkpoint that gives the networks that are not trained, where the stages
        begin from scratch.
      reuse: a trained arm whose networks are judged again, on other objects or in another way: one
        before this one, or EXPERIMENT/ARM of another experiment, which is trained only once.
      views: images of the object that are shown together.
      reference: the arm from whose figures differences are taken; "" = the experiment's reference.
      sampling: options of both flows that differ from the checkpoint's (``Pipeline.options``).
    """

    config: Config
    stages: tuple[str, ...]
    pipeline_stage: PipelineStage
    tests: Objects = Objects()
    init: str = ""
    other_networks_from: str = ""
    reuse: str = ""
    views: int = 1
    reference: str = ""
    sampling: dict[str, Any] = dataclasses.field(default_factory=dict)

    def checkpoints(self) -> list[str]:
        """All that it names."""
        given = {self.init, self.other_networks_from, self.config.init if self.stages else ""}
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
      others: EXPERIMENT/ARM -> the arm, for all that arms ``reuse``; ``load_experiment`` fills it.
    """

    arms: dict[str, Arm]
    reference: str
    columns: tuple[str, ...]
    seeds: int = 3
    count: int = 70
    records: tuple[Records, ...] = ()
    others: dict[str, ExternalArm] = dataclasses.field(default_factory=dict)

    def trained(self, name: str) -> Arm:
        """The arm whose networks arm ``name`` is judged by: itself, or the one that it reuses."""
        reuse = self.arms[name].reuse
        if not reuse:
            return self.arms[name]
        return self.others[reuse].arm if "/" in reuse else self.arms[reuse]

    def folder(self, name: str, out: Path) -> Path:
        """Where that arm is trained, of an experiment in ``out``."""
        reuse = self.arms[name].reuse
        return out.parent / self.others[reuse].folder if "/" in reuse else out / (reuse or name)


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
    that its arms reuse.

    Raises:
      FileNotFoundError: no such file. ValueError: it has no such function, the function refuses the
        size, or what it gives is inconsistent.
    """
    path = find_experiment(name)
    found = _made(path, size)
    others = {}
    for arm in found.arms.values():
        if "/" not in arm.reuse:
            continue
        stem, _, other = arm.reuse.partition("/")
        beside = path.with_name(f"{stem}.py")
        there = _made(beside, size).arms.get(other) if beside.is_file() else None
        if there is None or not there.stages:
            raise ValueError(f"experiment '{path}': no trained arm '{arm.reuse}' at size {size}")
        others[arm.reuse] = ExternalArm(there, Path(folder_name(beside, size), other))
    return dataclasses.replace(found, others=others)


def _made(path: Path, size: Size) -> Experiment:
    make: Callable[[str], Experiment] | None = runpy.run_path(str(path)).get("experiment")
    if make is None:
        raise ValueError(f"experiment '{path}': it must define experiment(size)")
    found = make(size)
    if not isinstance(found, Experiment):
        raise ValueError(f"experiment '{path}': experiment(size) must give a {Experiment.__name__}")
    arms = found.arms
    for wanted in [found.reference, *(arm.reference for arm in arms.values() if arm.reference)]:
        if wanted not in arms:
            raise ValueError(f"experiment '{path}': no arm '{wanted}' to hold others against")
    for name, arm in arms.items():
        if bool(arm.stages) + bool(arm.reuse) + (not arm.stages and bool(arm.init)) != 1:
            raise ValueError(
                f"experiment '{path}': arm {name} must have just one of stages, reuse, and init "
                "without stages"
            )
        before = [other for other in list(arms)[: list(arms).index(name)] if arms[other].stages]
        if arm.reuse and "/" not in arm.reuse and arm.reuse not in before:
            raise ValueError(
                f"experiment '{path}': arm {name} reuses '{arm.reuse}', which is not a trained arm "
                "before it"
            )
    return found
