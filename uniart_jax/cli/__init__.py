"""Command lines: ``uniart …``, ``train.py`` and ``sample.py``.

Every mistake a user can make ends in one line on stderr and exit code 2. Heavy imports happen inside the commands.
"""

from __future__ import annotations

import sys

import tyro

from uniart_jax.allocator import keep_freed_memory
from uniart_jax.cli.arguments import guarded
from uniart_jax.cli.assets import convert, export, reconstruct, validate, view
from uniart_jax.cli.data import features, inspect, prepare, stats
from uniart_jax.cli.evaluation import evaluate
from uniart_jax.cli.experiment import experiment
from uniart_jax.cli.layout import layout
from uniart_jax.cli.sample import sample
from uniart_jax.cli.train import load_config, train

__all__ = ["COMMANDS", "guarded", "load_config", "main", "sample_main", "train_main"]

COMMANDS = {
    "prepare": prepare,
    "features": features,
    "sample": sample,
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


def main() -> None:
    """The ``uniart`` program."""
    if sys.argv[1:2] == ["train"]:
        keep_freed_memory()
        sys.exit(guarded(lambda: train(sys.argv[2:])))
    sys.exit(
        guarded(
            lambda: tyro.extras.subcommand_cli_from_dict(
                COMMANDS,
                prog="uniart",
                description="Articulated 3D objects from one image. Also: uniart train …",
            )
        )
    )


def sample_main() -> None:
    """``sample.py``."""
    sys.exit(guarded(lambda: tyro.cli(sample, prog="sample.py")))


def train_main() -> None:
    """``train.py``."""
    keep_freed_memory()
    sys.exit(guarded(lambda: train(sys.argv[1:])))
