"""What an experiment is: arms, what is trained in each, and where on the road it is judged. ``configs/experiments/*.py`` make them."""

from __future__ import annotations

import dataclasses
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from uniart_jax.config import Config

Size = Literal["nano", "paper"]
# from what to what the networks of a checkpoint are judged: evaluation.procedural's rows, and the structure alone
Station = Literal["vae", "structure", "latent_flow", "object"]
FOLDER = Path("configs/experiments")


@dataclasses.dataclass(frozen=True)
class Objects:
    """The objects that an arm is judged on.

    Attributes:
      unseen: procedural families that are never trained on, instead of the trained ones.
      joint_type: only objects that have such a joint; "" = all.
      records: a prepared folder and the split of it that is tested, instead of procedural objects; a record's object is what its voxels say.
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
      stages: the networks that are trained, in this order; () = the checkpoint ``init``, or that of the arm ``of``, is judged as it is.
      station: where on the road it is judged.
      tests: on which objects.
      init: checkpoint whose weights the stages begin with; "" = the config's own.
      beside: checkpoint that gives the networks that are not trained, where the stages begin from scratch.
      of: an arm before this one whose networks are judged again, in another way.
      views: images of the object that are shown together.
    """

    config: Config
    stages: tuple[str, ...]
    station: Station
    tests: Objects = Objects()
    init: str = ""
    beside: str = ""
    of: str = ""
    views: int = 1


@dataclasses.dataclass(frozen=True)
class Records:
    """Procedural training records that an experiment needs and ``uniart prepare`` would not make from a config alone.

    Attributes:
      folder: where they go. families: of ``procedural``. count: objects. views: images of each.
      source: instead of making them, the records of this folder without those that have a joint of ``leave_out``, whose split is that word.
    """

    folder: str
    families: tuple[str, ...] = ()
    count: int = 0
    views: int = 2
    source: str = ""
    leave_out: str = ""


@dataclasses.dataclass(frozen=True)
class Experiment:
    """Arms by name, the one that the others are held against, and how much of it is run by default.

    Attributes:
      seeds: trainings of each arm. count: test objects of each.
      columns: the figures of the table (``judge.METRICS``).
    """

    arms: dict[str, Arm]
    reference: str
    columns: tuple[str, ...]
    seeds: int = 3
    count: int = 70
    records: tuple[Records, ...] = ()


def find_experiment(name: str | Path) -> Path:
    """The file of an experiment: a path, or a name of configs/experiments/.

    Raises:
      FileNotFoundError: no such file; those that there are, are listed.
    """
    path = Path(name) if str(name).endswith(".py") else FOLDER / f"{name}.py"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.py")))
        raise FileNotFoundError(
            f"experiment '{name}': no {path}; give a file, or in the repository's root one of {known or '(none here)'}"
        )
    return path


def load_experiment(name: str | Path, size: Size = "nano") -> Experiment:
    """The ``experiment(size)`` of a file.

    Raises:
      FileNotFoundError: no such file. ValueError: it has no such function, the function refuses the size, or what it gives is inconsistent.
    """
    path = find_experiment(name)
    make: Callable[[str], Experiment] | None = runpy.run_path(str(path)).get("experiment")
    if make is None:
        raise ValueError(f"experiment '{path}': it must define experiment(size)")
    found = make(size)
    if not isinstance(found, Experiment):
        raise ValueError(f"experiment '{path}': experiment(size) must give a {Experiment.__name__}")
    if found.reference not in found.arms:
        raise ValueError(f"experiment '{path}': no arm '{found.reference}' to hold others against")
    for arm_name, arm in found.arms.items():
        if bool(arm.stages) + bool(arm.of) + (not arm.stages and bool(arm.init)) != 1:
            raise ValueError(f"experiment '{path}': arm {arm_name} must have just one of stages, of, and init without stages")  # fmt: skip
        if arm.of and arm.of not in list(found.arms)[: list(found.arms).index(arm_name)]:
            raise ValueError(f"experiment '{path}': arm {arm_name} is of '{arm.of}', which does not come before it")  # fmt: skip
    return found
