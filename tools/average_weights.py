"""One network of two checkpoints, averaged weight by weight: (1 - share) FIRST + share SECOND.

    python tools/average_weights.py layout FIRST SECOND --share .7 --out CHECKPOINT

SECOND went on from FIRST on other data. On such a line between the two, a network is often better
on both kinds of data than either end (Wortsman et al. 2022, "Robust fine-tuning of zero-shot
models"). CHECKPOINT must exist; its file of that network is replaced. Judge it before it is used.
"""

from __future__ import annotations

import argparse

import jax

from uniart_jax.config import STAGES
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_network


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("network", choices=STAGES)
    parser.add_argument("first")
    parser.add_argument("second")
    parser.add_argument("--share", type=float, required=True, help="of the second, 0 to 1")
    parser.add_argument("--out", required=True, help="checkpoint whose file is replaced")
    given = parser.parse_args()
    out = Checkpoint.find(given.out)
    first, second = (
        Checkpoint.find(c).load(given.network, out.config.model)
        for c in (given.first, given.second)
    )
    averaged = jax.tree.map(lambda a, b: (1 - given.share) * a + given.share * b, first, second)
    print(write_network(out.folder, given.network, averaged))


if __name__ == "__main__":
    main()
