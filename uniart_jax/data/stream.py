"""Batches of an order, made by Grain a few ahead; their place is one number, whoever makes them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from uniart_jax.data.order import Draw

if TYPE_CHECKING:
    import grain

Batch = TypeVar("Batch")  # of ``voxels.typed_batches``


class Order(Protocol):
    """``data.order``: which records make batch n."""

    @property
    def batch_size(self) -> int: ...

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> Draw: ...


@dataclasses.dataclass(frozen=True)
class Batches(Generic[Batch]):
    """``load`` over ``order``, in order; ``iter`` begins with the first batch.

    Attributes:
      workers: processes that make batches; 0: threads of this one.
    """

    order: Order
    load: Callable[[Draw], Batch]
    workers: int = 0

    def __iter__(self) -> BatchIterator[Batch]:
        return BatchIterator(self)

    def after(self, number: int) -> grain.DatasetIterator[Batch]:
        """From batch ``number`` on."""
        import grain  # loads jax
        from absl import flags

        if not flags.FLAGS.is_parsed():  # programs without absl: Grain reads its flags on use
            flags.FLAGS.mark_as_parsed()
        batches = grain.MapDataset.source(_Rest(self.order, number)).map(self.load)
        if self.workers:
            ahead = grain.ReadOptions(num_threads=1, prefetch_buffer_size=1)
            options = grain.MultiprocessingOptions(
                num_workers=self.workers, per_worker_buffer_size=2
            )
            return iter(batches.to_iter_dataset(ahead).mp_prefetch(options))
        ahead = grain.ReadOptions(num_threads=2, prefetch_buffer_size=4)
        return iter(batches.to_iter_dataset(ahead))


class BatchIterator(Generic[Batch]):
    """Knows its place exactly: how many batches it has given. A place holds for any number of
    processes and workers."""

    def __init__(self, batches: Batches[Batch]):
        self._batches, self._number = batches, 0
        self._ahead: grain.DatasetIterator[Batch] | None = None

    def __iter__(self) -> BatchIterator[Batch]:
        return self

    def __next__(self) -> Batch:
        ahead = self._ahead or self._batches.after(self._number)
        self._ahead = ahead
        batch = next(ahead)
        self._number += 1
        return batch

    def get_state(self) -> dict[str, int]:
        return {"batch": self._number, "batch_size": self._batches.order.batch_size}

    def set_state(self, state: dict[str, int]) -> None:
        """Go to a place.

        Raises:
          ValueError: it counts batches of another size, or is not of ``get_state``.
        """
        here = self.get_state()
        if not isinstance(state, dict) or set(state) != set(here):
            raise ValueError(
                "data: the checkpoint's place in the data is of another version of this program; "
                "choose another --workdir"
            )
        if state["batch_size"] != here["batch_size"]:
            raise ValueError(
                f"data: the checkpoint counts batches of {state['batch_size']} items, the config "
                f"has {here['batch_size']}; keep batch_size, or choose another --workdir"
            )
        self.close()
        self._number = state["batch"]

    def close(self) -> None:
        """End what makes batches ahead (worker processes at once, a thread once its batch is made);
        the next batch is still the one of this place."""
        if self._ahead is not None:
            self._ahead.close()
        self._ahead = None


@dataclasses.dataclass(frozen=True)
class _Rest:
    """An order without its first batches."""

    order: Order
    first: int

    def __len__(self) -> int:
        return len(self.order) - self.first

    def __getitem__(self, number: int) -> Draw:
        return self.order[self.first + number]

    def __repr__(self) -> str:  # Grain puts it into messages
        return repr(self.order)
