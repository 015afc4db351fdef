"""``train.py`` and ``uniart train``: a config file and any of its fields by dotted name."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import signal
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_type_hints

import tyro

import uniart_jax
from uniart_jax.cli.help_texts import readable
from uniart_jax.config import STAGES, Config, load_config, to_json

if TYPE_CHECKING:
    Stage = str
else:
    Stage = Literal[("all", *STAGES)]


@dataclasses.dataclass
class TrainArguments:
    """Train one stage or all of them; resumes by itself if WORKDIR holds checkpoints.

    Any field of the config can follow by its dotted name, as in --data.procedural 0. With --config
    NAME, --help lists them.
    """

    config: Path
    """A file like those of configs/, or the name of one: debug, nano, small, paper."""
    stage: Stage = "all"
    """Which network; 'all' runs them in order, encoding latents between."""
    workdir: Path | None = None
    """Where checkpoints, logs and the export go (default: runs/<config name>)."""
    init: str | None = None
    """A checkpoint ("nano", a folder) to go on from: the stage begins with its weights, the other networks are taken as they are."""  # noqa: E501
    distributed: bool = False
    """One of several processes that train together; TPU pods, SLURM, Open MPI and Kubernetes are detected (docs/scaling.md)."""  # noqa: E501
    coordinator: str | None = None
    """HOST:PORT of process 0, where nothing is detected; with --processes and --process."""
    processes: int | None = None
    """How many processes there are."""
    process: int | None = None
    """Which of them this is, from 0."""
    wait: float = 300.0
    """Seconds for all processes to come."""


def settings(config: Config, stages: Sequence[str], init: str | Path | None) -> dict[str, Any]:
    """What processes that train together must have in common, by name: every field of the config, what is asked for, versions."""  # noqa: E501
    named = {
        "stages": list(stages),
        "init": str(init),
        "jax": version("jax"),
        "uniart_jax": uniart_jax.__version__,
    }

    def flatten(prefix: str, values: dict[str, Any]) -> None:
        for key, value in values.items():
            if isinstance(value, dict):
                flatten(f"{prefix}{key}.", value)
            else:
                named[f"{prefix}{key}"] = value

    flatten("", json.loads(to_json(config)))
    return named


def check_fields(words: Sequence[str]) -> None:
    """Whether each option of ``words`` is a field of the config, by its dotted name.

    Raises:
      ValueError: one is not; what there is at its place is listed.
    """
    for word in words:
        if not word.startswith("--") or word == "--help":
            continue
        at, path = Config, ""
        for name in word[2:].partition("=")[0].replace("-", "_").split("."):
            hints = get_type_hints(at) if dataclasses.is_dataclass(at) else {}
            known = name if name in hints else name.removeprefix("no_")
            if hints.get(known) is None or (known != name and hints[known] is not bool):
                options = (
                    [] if path else [field.name for field in dataclasses.fields(TrainArguments)]
                )
                raise ValueError(
                    f"{word.partition('=')[0]}: {path or 'the command'} has no '{name}'; it has "
                    f"{', '.join(dict.fromkeys((*options, *hints))) or 'no fields'}"
                )
            at, path = hints[known], f"{path}.{name}" if path else name


def train(arguments: list[str], prog: str = "train.py") -> None:
    """Parse ``--config`` and friends, then any field of the config by its dotted name, and train.

    ``prog``: the program's name in its help.
    """
    # with a config given, --help shows its fields too
    fields = "--config" in " ".join(arguments) and bool({"-h", "--help"} & set(arguments))
    first = [a for a in arguments if not (fields and a in ("-h", "--help"))]
    known, rest = tyro.cli(TrainArguments, args=first, return_unknown_args=True, prog=prog)
    rest += ["--help"] if fields else []
    default = load_config(known.config)
    check_fields(rest)
    readable(Config)
    if fields:
        with contextlib.suppress(SystemExit):
            tyro.cli(TrainArguments, args=["--help"], prog=prog)
    config = tyro.cli(Config, default=default, args=rest, prog=f"{prog} --config {known.config}")
    from uniart_jax.runtime.compilation_cache import keep_programs
    from uniart_jax.stages import Trainer
    from uniart_jax.training import distributed

    keep_programs(config.quick_compile)
    stages = STAGES if known.stage == "all" else (known.stage,)
    by_hand = (known.coordinator, known.processes, known.process)
    if known.distributed or any(value is not None for value in by_hand):
        distributed.start(*by_hand, wait=known.wait)
    with contextlib.suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # asks for a trace, where there are steps
    with distributed.together(), device_memory():
        distributed.check_equal(settings(config, stages, known.init))
        Trainer(config, known.workdir, known.init).fit(stages)


@contextlib.contextmanager
def device_memory() -> Iterator[None]:
    """A device without memory for what was asked of it, as a line that says what helps."""
    import jax

    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if "RESOURCE_EXHAUSTED" not in str(error):
            raise
        raise MemoryError(
            f"a device is out of memory; raise <stage>.accumulate or mesh.fsdp, set model.remat True, or lower <stage>.batch_size ({str(error).splitlines()[0]})"  # noqa: E501
        ) from error
