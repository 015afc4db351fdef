"""Checkpoints of a stage: the train state and the data iterator's state, saved together by Orbax.

A run that is killed at any moment and resumed equals one that was not: a checkpoint is complete or
absent, and holds the position in the data beside the weights. Leaves are stored under flat dotted
names (``params.blocks.0.mlp.kernel``), so that a checkpoint of another config can be told apart
name by name.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import errno
import json
import logging
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeVar

import jax
from orbax.checkpoint import v1 as ocp

from uniart_jax.models.network import differences, flat_names
from uniart_jax.training import distributed

State = TypeVar("State")
_ASIDE = "damaged-"
_POSITION = "process_0.json"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_ABSENT = (None, errno.ENOENT, errno.ENOTDIR, errno.EISDIR)


class CheckpointableIterator(Protocol):
    """Anything that knows where it is: ``data.stream``'s, or a test's. A state is bytes or
    JSON-able."""

    def __next__(self) -> Any: ...

    def get_state(self) -> Any: ...

    def set_state(self, state: Any) -> None: ...


class _Position:
    """An iterator's state as an Orbax ``StatefulCheckpointable``: one JSON file for all processes,
    of whatever number, since batches are drawn globally."""

    def __init__(self, state: Any = None):
        self.state = state

    async def save(self, directory: Any) -> Any:
        raw = isinstance(self.state, bytes)
        value = {"base64": base64.b64encode(self.state).decode()} if raw else {"json": self.state}
        text = json.dumps(value, default=lambda number: number.item())  # numpy scalars

        async def write() -> None:
            path = await directory.await_creation()
            if jax.process_index() == 0:
                await asyncio.to_thread((path / _POSITION).write_text, text)

        return write()

    async def load(self, directory: Any) -> Any:
        async def read() -> None:
            value = json.loads(await asyncio.to_thread((directory / _POSITION).read_text))
            raw = "base64" in value
            self.state = base64.b64decode(value["base64"]) if raw else value["json"]

        return read()


class Checkpoints:
    """The newest ``keep`` checkpoints of one stage in ``folder``; a context manager, so that
    leaving waits for the last save."""

    def __init__(self, folder: str | Path, keep: int = 2):
        self.folder = Path(folder).absolute()
        # Orbax's threads log a failure once for each of them; it is raised, and told in a line
        logging.getLogger("absl").addFilter(_not_of_orbax_threads)
        self._full = False
        self._remove_cut_off()
        self._orbax = ocp.training.Checkpointer(
            self.folder,
            preservation_policy=ocp.training.preservation_policies.LatestN(max(keep, 1)),
        )

    def __enter__(self) -> Checkpoints:
        return self

    def __exit__(self, *error: Any) -> None:
        try:
            with self._full_disk_as_a_line():
                self._orbax.close()
        finally:
            if self._full and jax.process_index() == 0:
                for _ in range(5):  # a thread of TensorStore's may still write its last file
                    for path in self._unfinished():
                        shutil.rmtree(path, ignore_errors=True)
                    time.sleep(0.2)

    @property
    def steps(self) -> list[int]:
        """Steps that have a complete checkpoint, or whose save is under way, ascending."""
        return [checkpoint.step for checkpoint in self._orbax.checkpoints]

    def _remove_cut_off(self) -> None:
        """A process killed during a save leaves it under another name. Orbax would remove that in
        the background, where a second opening runs into the first."""
        if jax.process_index() == 0:
            left = self._unfinished()
            for step in sorted(set(left.values())):
                print(
                    f"warning: checkpoint {self.folder}/{step} was not finished, the run was "
                    "killed while it was saved; taking the one before",
                    file=sys.stderr,
                )
            _remove(left)

    def _unfinished(self) -> dict[Path, int]:
        """Folders of saves that are not complete, and their steps."""
        found = (
            (p, re.match(r"(\d+)\.orbax-checkpoint-tmp", p.name)) for p in self.folder.glob("*")
        )
        return {path: int(name[1]) for path, name in found if name}

    @contextlib.contextmanager
    def _full_disk_as_a_line(self) -> Iterator[None]:
        """Raise a full disk as an error of one line. What the failed save left is removed on
        leaving; earlier checkpoints stay."""
        try:
            yield
        except Exception as error:
            if not _of_a_full_disk(error):
                raise
            self._full = True
            step = max(self._unfinished().values(), default=None)
            which = "a checkpoint" if step is None else f"checkpoint {step}"
            raise OSError(
                f"{self.folder}: no room on the disk for {which}; make room and run the same "
                "command again, it goes on from the last checkpoint that is whole, if there is "
                "one"
            ) from None

    def save(
        self,
        step: int,
        state: Any,
        iterator: CheckpointableIterator | None = None,
        *,
        wait: bool = False,
    ) -> None:
        """Save in the background; the state may be donated and the iterator advanced as soon as
        this returns.

        A step that is already saved is left as it is. A failure of an earlier save is raised here
        or on leaving.
        """
        if step not in self.steps:
            items: dict[str, Any] = {"state": flat_names(state)}
            if iterator is not None:
                items["data"] = _Position(iterator.get_state())
            with self._full_disk_as_a_line():
                self._orbax.save_checkpointables_async(step, items, force=True)
        if wait:
            self.wait()

    def wait(self) -> None:
        """Until all saves are on disk."""
        with self._full_disk_as_a_line():
            self._orbax.wait()

    def restore(self, like: State, iterator: CheckpointableIterator | None = None) -> State | None:
        """The newest good checkpoint, with ``iterator`` set to its place; None where there is none.

        Args:
          like: a state of the same structure; arrays or ShapeDtypeStructs, whose shardings the
            result takes.

        A damaged checkpoint is moved aside (``damaged-<step>``) with a one-line warning, and the
        one before is taken. Failures that say nothing about the checkpoint, such as too little
        memory or a missing permission, are raised as they are. Each of several processes reads its
        part without waiting for the others; then they agree on whether all could.

        Raises:
          ValueError: the checkpoint is of another structure (missing, extra and mismatched names
            are listed), or all are damaged, those moved aside before included.
        """
        abstract = jax.tree.map(_abstract, like)
        expected = flat_names(abstract)
        for step in distributed.broadcast_from_first(self.steps[::-1]):
            saved = self._read(step, _metadata)
            if saved is None:
                continue
            here, there = _kinds(expected), _kinds(saved)
            # moments and averages repeat the parameters' names: once is enough to read
            problems = differences(_of_params(here), _of_params(there)) or differences(here, there)
            if problems:
                raise ValueError(
                    f"{self.folder}/{step} was made with another config; {'; '.join(problems)}; "
                    "use that config or another workdir"
                )
            items: dict[str, Any] = {"state": expected}
            if iterator is not None:
                items["data"] = _Position()
            loaded = self._read(
                step, lambda path, items=items: ocp.load_checkpointables(path, items)
            )
            if loaded is None:
                continue
            if iterator is not None:
                iterator.set_state(loaded["data"].state)
            leaves = [loaded["state"][name] for name in expected]
            return jax.tree.unflatten(jax.tree.structure(abstract), leaves)
        names = [p.name.removeprefix(_ASIDE) for p in self.folder.glob(f"{_ASIDE}*")]
        aside = sorted(int(name) for name in names if name.isdigit())
        if aside:
            raise ValueError(
                f"{self.folder}: none of the checkpoints {aside} can be read; remove the folder to "
                "start anew"
            )
        return None

    def _read(self, step: int, read: Callable[[Path], dict[str, Any]]) -> dict[str, Any] | None:
        """What ``read`` makes of a checkpoint; None where it is damaged for any process, and then
        it is aside."""
        me, alone = jax.process_index(), ocp.Context()
        # at Orbax's barriers the others would wait for a process that has failed, and take the
        # time-out for damage
        alone.multiprocessing.primary_host = me
        alone.multiprocessing.active_processes = {me}
        found, error = None, None
        try:
            with alone:
                found = read(self.folder / str(step))
        except Exception as failure:
            if _of_the_machine(failure):
                raise
            error = ValueError(_innermost(failure))
        error = distributed.shared_error(error)
        if error is None:
            return found
        if distributed.is_first():
            print(
                f"warning: checkpoint {self.folder}/{step} is damaged ({error}); trying the one "
                "before",
                file=sys.stderr,
            )
            source, aside = self.folder / str(step), self.folder / f"{_ASIDE}{step}"
            shutil.rmtree(aside, ignore_errors=True)
            if source.exists():
                source.rename(aside)
        distributed.wait()
        self._orbax.reload()
        return None


def _remove(folders: Iterable[Path]) -> None:
    for path in folders:
        with contextlib.suppress(FileNotFoundError):  # another process is at it too
            shutil.rmtree(path)


def _not_of_orbax_threads(record: logging.LogRecord) -> bool:
    return not (record.exc_info and "orbax" in record.pathname)


def _metadata(folder: Path) -> dict[str, Any]:
    found = ocp.metadata(folder, "state").metadata
    if found is None:
        raise ValueError("nothing tells which arrays it holds")
    return dict(found)


def _innermost(error: BaseException) -> str:
    """What went wrong first, in a line: libraries wrap it in what they were doing."""
    seen: list[BaseException] = []
    within: BaseException | None = error
    while within is not None and within not in seen:
        seen.append(within)
        grouped = getattr(within, "exceptions", (None,))[0]
        within = grouped or within.__cause__ or within.__context__
    texts = [" ".join(str(one).split()) for one in seen]
    return next(filter(None, reversed(texts)), type(seen[-1]).__name__)[:200]


def _of_a_full_disk(error: BaseException | None) -> bool:
    """Whether a write failed because the disk, a quota or the largest size of a file was full."""
    if error is None:
        return False
    if isinstance(error, OSError) and error.errno in _FULL:
        return True
    code = re.search(r"os_error_code='(\d+)'", str(error))  # of TensorStore
    if code and int(code[1]) in _FULL:
        return True
    causes = (error.__cause__ or error.__context__, *getattr(error, "exceptions", ()))
    return any(_of_a_full_disk(cause) for cause in causes)


def _of_the_machine(error: BaseException | None) -> bool:
    """Whether reading failed for want of memory, access, time or a working disk, and so says
    nothing about what was to be read."""
    if error is None:
        return False
    if isinstance(error, MemoryError) or (
        isinstance(error, OSError) and error.errno not in _ABSENT
    ):
        return True
    if re.search(
        "RESOURCE_EXHAUSTED|PERMISSION_DENIED|DEADLINE_EXCEEDED", str(error)
    ):  # of XLA and TensorStore
        return True
    causes = (error.__cause__ or error.__context__, *getattr(error, "exceptions", ()))
    return any(_of_the_machine(cause) for cause in causes)


def _abstract(leaf: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=leaf.sharding)


def _of_params(kinds: dict[str, str]) -> dict[str, str]:
    return {name: kind for name, kind in kinds.items() if name.startswith("params.")}


def _kinds(leaves: dict[str, Any]) -> dict[str, str]:
    return {name: f"{leaf.dtype}{list(leaf.shape)}" for name, leaf in leaves.items()}
