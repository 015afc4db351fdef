"""Which records make which batch: shuffled every epoch, one padded width a batch, a pure function
of (seed, batch number).

So the whole state of a pipeline is one integer, resuming is exact, and every host computes the same
order and takes its own rows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

ENDLESS = 1 << 40  # batches of an endless order


@dataclasses.dataclass(frozen=True)
class Draw:
    """One batch to be made.

    Attributes:
      number: of the batch, from 0.
      records: [B] indices of records; -1 fills up the last batches of an ordered pass.
      width: voxels each item is padded to.
    """

    number: int
    records: np.ndarray
    width: int

    def generator(self, seed: int) -> np.random.Generator:
        """Random numbers of this batch, the same on every host."""
        return np.random.default_rng([seed, 1, self.number])


def fitting_width(voxels: np.ndarray, widths: Sequence[int]) -> np.ndarray:
    """[N] the smallest of ``widths`` that holds each count; the largest where none does."""
    rising = np.sort(np.asarray(widths))
    return rising[np.minimum(np.searchsorted(rising, voxels), len(rising) - 1)]


def spread(number: int, most: int | None) -> list[int]:
    """At most ``most`` of ``number`` indices (None: all), at even distances: records come by
    category, stored items by size."""
    wanted = number if most is None else min(number, most)
    return np.unique(np.linspace(0, number - 1, wanted).astype(int)).tolist()


class ShuffledOrder:
    """An endless sequence of ``Draw``: ``order[n]`` is batch n.

    An epoch shuffles the records, cuts those of each width into batches, and shuffles the batches.
    What is left of a width joins the next wider one; what is left of the widest (fewer records than
    a batch, others every epoch) waits for another epoch.
    """

    def __init__(self, records: np.ndarray, widths: np.ndarray, batch_size: int, seed: int):
        """
        Args:
          records: [n] indices to draw from. widths: [n] the padded width each of them needs.

        Raises:
          ValueError: fewer records than a batch.
        """
        if len(records) < batch_size:
            raise ValueError(
                f"data: {len(records)} records are fewer than one batch of {batch_size}; prepare "
                "more or lower the batch size"
            )
        self._records, self._widths = np.asarray(records), np.asarray(widths)
        self.batch_size, self._seed = batch_size, seed
        self._length = len(records) // batch_size
        self._epoch: tuple[int, list[tuple[np.ndarray, int]]] = (-1, [])

    def __len__(self) -> int:
        return ENDLESS

    def __getitem__(self, number: int) -> Draw:
        epoch, index = divmod(int(number), self._length)
        current = self._epoch
        if current[0] != epoch:
            current = self._epoch = (epoch, self._shuffle(epoch))
        return Draw(int(number), *current[1][index])

    def _shuffle(self, epoch: int) -> list[tuple[np.ndarray, int]]:
        rng = np.random.default_rng([self._seed, 0, epoch])
        batches: list[tuple[np.ndarray, int]] = []
        left = np.zeros(0, np.int64)
        for width in np.unique(self._widths):
            mine = np.flatnonzero(self._widths == width)
            waiting = np.concatenate([left, rng.permutation(mine)])
            cut = len(waiting) // self.batch_size * self.batch_size
            left = waiting[cut:]
            for rows in waiting[:cut].reshape(-1, self.batch_size):
                batches.append((self._records[rows], int(width)))
        return [batches[i] for i in rng.permutation(len(batches))]

    def __repr__(self) -> str:  # Grain puts it into messages
        return f"ShuffledOrder({len(self._records)} records, batch {self.batch_size})"


class OnePass:
    """Every record once, in order of width, then of index; the last batch of a width is filled up
    with -1."""

    def __init__(
        self,
        records: np.ndarray,
        widths: np.ndarray,
        batch_size: int,
        mine: Callable[[int], bool] = lambda number: True,
    ):
        """
        Args:
          mine: whether batch ``number`` of the pass is drawn here; others are left out.
        """
        self.batch_size = batch_size
        self._draws: list[Draw] = []
        number = 0
        for width in np.unique(widths):
            these = np.asarray(records)[widths == width]
            padded = np.concatenate([these, np.full(-len(these) % batch_size, -1)])
            for rows in padded.reshape(-1, batch_size):
                if mine(number):
                    self._draws.append(Draw(number, rows, int(width)))
                number += 1

    def __len__(self) -> int:
        return len(self._draws)

    def __getitem__(self, number: int) -> Draw:
        return self._draws[number]

    def __repr__(self) -> str:
        return f"OnePass({len(self)} batches)"


def local_rows(
    batch_size: int, process_index: int, process_count: int, accumulate: int = 1
) -> np.ndarray:
    """[batch_size / process_count] which items of a batch are this process's: its share of each
    micro-batch in turn, so that a micro-batch is the same items, in the same order, whatever the
    number of processes.

    Raises:
      ValueError: the batch does not divide into the processes and micro-batches.
    """
    if batch_size % (process_count * accumulate) or not 0 <= process_index < process_count:
        parts = f" in {accumulate} micro-batches each" if accumulate > 1 else ""
        raise ValueError(
            f"data: a batch of {batch_size} cannot be shared equally by {process_count} "
            f"processes{parts} (this is {process_index})"
        )
    rows = np.arange(batch_size).reshape(accumulate, process_count, -1)
    return rows[:, process_index].reshape(-1)
