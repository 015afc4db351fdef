"""Networks of a checkpoint as those of the shipped model.

    python tools/ship_weights.py CHECKPOINT layout [structure_flow …] [--model nano]

Each is written into ``uniart_jax/pretrained/MODEL`` in float16, kernels of ``INT8`` in 8 bits, with
its part of the config and the statistics of its latent. Prints the size of all: more than ``MOST``
is refused before anything is written.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import tempfile
from pathlib import Path

from uniart_jax.config import LATENT_OF
from uniart_jax.models.checkpoint import PRETRAINED, Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network, write_statistics

MOST = 40 * 2**20  # bytes of all files
# kernels that lose little by it: rows of legs, panels and boards move by .001 object units; see
# docs/training_history.md for the structure flow's
_ATTENTION = (f"{kind}_attn.to_{of}" for kind in ("self", "cross") for of in ("q", "k", "v", "out"))
_LAYER = ("read_in", "read_out", "mlp.mlp.0", "mlp.mlp.2", *_ATTENTION)
_OF_SETS = ("guess", "hidden", "place_out", *(f"layer.{name}" for name in _LAYER))
_SETS = ("legs", "panels", "boards")
INT8 = {
    "layout": ("sketch1.kernel", *(f"{of}.{k}.kernel" for of in _SETS for k in _OF_SETS)),
    "structure_flow": ("pixel_cube.kernel",),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("checkpoint", help="folder, WORKDIR or name to take networks from")
    parser.add_argument("networks", nargs="+", help="their names")
    parser.add_argument("--model", default="nano", help="shipped model that gets them")
    args = parser.parse_args()
    try:
        size = ship(Checkpoint.find(args.checkpoint), args.networks, PRETRAINED / args.model)
    except (FileNotFoundError, ValueError) as error:
        parser.exit(2, f"ship_weights: {error}\n")
    print(f"{', '.join(args.networks)} -> {PRETRAINED / args.model}, {size / 1e6:.1f} MB in all")


def ship(source: Checkpoint, networks: list[str], folder: Path) -> int:
    """Write networks of ``source`` into a model's folder; returns the bytes of all its files.

    Raises:
      FileNotFoundError: ``source`` lacks one. ValueError: the files would be larger than ``MOST``.
    """
    with tempfile.TemporaryDirectory() as made:
        target = Path(made) / "model"
        shutil.copytree(folder, target)
        config = Checkpoint(target).config
        for name in networks:
            params = source.load(name)
            small = tuple(key for key in INT8.get(name, ()) if key.split(".")[0] in params)
            write_network(target, name, params, int8=small)
            part = {name: getattr(source.config.model, name)}
            config = dataclasses.replace(config, model=dataclasses.replace(config.model, **part))
            if name in LATENT_OF:
                write_statistics(target, LATENT_OF[name], *source.statistics(LATENT_OF[name]))
        write_config(target, config)
        files = [path for path in target.iterdir() if path.is_file()]
        size = sum(path.stat().st_size for path in files)
        if size > MOST:
            raise ValueError(f"{size:,} bytes in all; at most {MOST:,} are shipped")
        for path in files:
            shutil.copyfile(path, folder / path.name)
    return size


if __name__ == "__main__":
    main()
