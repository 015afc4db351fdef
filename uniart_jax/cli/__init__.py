"""Command lines: ``uniart …``, ``train.py`` and ``sample.py``.

Every mistake a user can make ends in one line on stderr and exit code 2. Heavy imports happen
inside the commands.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import tyro

from uniart_jax import __version__
from uniart_jax.cli.app import app
from uniart_jax.cli.arguments import check_written, exit_on_error
from uniart_jax.cli.assets import convert, export, reconstruct, validate, view
from uniart_jax.cli.data import features, inspect, prepare, stats
from uniart_jax.cli.evaluation import evaluate
from uniart_jax.cli.experiment import experiment
from uniart_jax.cli.help_texts import readable
from uniart_jax.cli.layout import layout
from uniart_jax.cli.sample import sample
from uniart_jax.cli.train import TrainArguments, train
from uniart_jax.cli.verbosity import take_verbosity
from uniart_jax.config import load_config
from uniart_jax.runtime.allocator import keep_freed_memory

__all__ = ["COMMANDS", "exit_on_error", "load_config", "main", "sample_main", "train_main"]

COMMANDS = {
    "prepare": prepare,
    "features": features,
    "sample": sample,
    "app": app,
    "train": TrainArguments,  # for --help; the config's own fields follow, see main
    "layout": layout,
    "export": export,
    "validate": validate,
    "view": view,
    "reconstruct": reconstruct,
    "evaluate": evaluate,
    "experiment": experiment,
    "inspect": inspect,
    "stats": stats,
    "convert": convert,
}


DESCRIPTION = """Articulated 3D objects from one image.

Every command takes -q (say only results, warnings and errors) and -v (log in detail, and say where
in the code an error was raised). uniart --version prints the version."""

for _command in COMMANDS.values():
    readable(_command)


def main() -> None:
    """The ``uniart`` program."""
    sys.exit(exit_on_error(lambda: _uniart(sys.argv[1:])))


def sample_main() -> None:
    """``sample.py``."""
    _exit(lambda rest: tyro.cli(sample, prog="sample.py", args=_help_alone(rest)))


def train_main() -> None:
    """``train.py``."""
    keep_freed_memory()
    _exit(train)


def _uniart(arguments: Sequence[str]) -> int | None:
    rest = take_verbosity(arguments)
    check_written(rest)
    if rest == ["--version"]:
        print(f"uniart_jax {__version__}")
        return None
    if rest[:1] == ["train"]:
        keep_freed_memory()
        return train(rest[1:], prog="uniart train")
    return tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="uniart",
        description=DESCRIPTION,
        args=[*rest[:1], *_help_alone(rest[1:])],
    )


def _help_alone(arguments: list[str]) -> list[str]:
    """``--help`` where that is among them: tyro leaves what stands before it out of the usage."""
    return ["--help"] if {"-h", "--help"} & set(arguments) else arguments


def _exit(command: Callable[[list[str]], int | None]) -> None:
    def run() -> int | None:
        rest = take_verbosity(sys.argv[1:])
        check_written(rest)
        return command(rest)

    sys.exit(exit_on_error(run))
