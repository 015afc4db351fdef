"""Compiled programs of a step: one for each set of batch shapes, compiled where it is first met,
with what it costs.

``jax.jit`` does the same silently; here a run can say that it compiles anew and for which shapes,
and knows how much a step computes.
"""

from __future__ import annotations

import contextlib
import time
import zlib
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from uniart_jax.training.flops import matmul_flops

SHOWN = 6  # shapes in the line about a compilation


class Program(NamedTuple):
    """A compiled step.

    Attributes:
      number: from 1, in the order of compiling.
      call: (state, batch, key, frozen_params) -> the step's result.
      shapes: dtype and shape of each leaf of the batch, by dotted name.
      flops: of its matrix products on all devices, by dtype (``flops.matmul_flops``).
      seconds: that tracing and compiling took.
      temporary: bytes of a device's memory that it needs beside arguments and results; 0: not
        known.
    """

    number: int
    call: Callable[..., Any]
    shapes: dict[str, str]
    flops: Counter[str]
    seconds: float
    temporary: int

    @property
    def label(self) -> str:
        """The padded width of its items, where they have one, and a digest of all shapes: the same
        in every run, whatever is compiled first."""
        digest = f"{zlib.crc32(repr(sorted(self.shapes.items())).encode()) & 0xFFFF:04x}"
        width = self.shapes.get("coords", "").split(", ")
        return f"{width[-2]}_{digest}" if len(width) > 2 else digest


class Programs:
    """``update(state, batch, key, frozen_params) -> (state, metrics)``, jitted with the state
    donated, as a callable of (state, batch, key) that keeps its programs.

    The returned state has the shardings of the state that each program was compiled with.

    Attributes:
      update: the function itself.
      frozen_params: its last argument in every call: arrays that stay as they are, such as a frozen
        network's parameters, or None.
      compiled: in the order in which their shapes were first met.
      latest: the program that the last call ran.
    """

    def __init__(self, update: Callable[..., Any], frozen_params: Any = None):
        self.update, self.frozen_params = update, frozen_params
        self._jitted: Any = None
        self._by_shapes: dict[Any, Program] = {}
        self.latest: Program | None = None

    @property
    def compiled(self) -> list[Program]:
        return list(self._by_shapes.values())

    def __call__(self, state: Any, batch: Any, key: jax.Array) -> tuple[Any, Any]:
        shapes = _shapes(batch)
        program = self._by_shapes.get(shapes)
        if program is None:
            program = self._by_shapes[shapes] = self.compile(state, batch, key)
        self.latest = program
        return program.call(state, batch, key, self.frozen_params)

    def is_compiled(self, batch: Any) -> bool:
        """Whether there is a program for a batch of these shapes."""
        return _shapes(batch) in self._by_shapes

    def precompile(self, state: Any, batch: Any, key: jax.Array) -> str:
        """Compile and keep the program for these arguments, without running it; the line about it
        (``describe``)."""
        self._by_shapes[_shapes(batch)] = self.compile(state, batch, key)
        return self.describe()

    def describe(self) -> str:
        """About the newest program: what differs in its shapes from the one before, seconds,
        products, memory."""
        *before, new = self.compiled
        known = before[-1].shapes if before else {}
        changed = [f"{n} {s}" for n, s in new.shapes.items() if known.get(n) != s]
        changed += [f"no {n}" for n in known if n not in new.shapes]
        left = f" and {len(changed) - SHOWN} more" if len(changed) > SHOWN else ""
        text = (
            f"compiled program {len(before) + 1} in {new.seconds:.1f} s: "
            f"{', '.join(changed[:SHOWN])}{left}"
        )
        text += f"; {new.flops.total() / 1e9:.3g} GFLOP a step"
        return text + (f", {new.temporary / 2**30:.3g} GiB of temporaries" if new.temporary else "")

    def compile(self, state: Any, batch: Any, key: Any) -> Program:
        """The program for these arguments, arrays or ShapeDtypeStructs (a state's with shardings),
        without running it."""
        begin = time.perf_counter()
        if self._jitted is None:
            # Pinned, because the compiler may otherwise choose others for its outputs and compile
            # the second step anew.
            shardings = jax.tree.map(lambda leaf: leaf.sharding, state)
            self._jitted = jax.jit(self.update, donate_argnums=0, out_shardings=(shardings, None))
        with _mesh_of(state):  # for what each device does with its own items (``nn.shard_map``)
            traced = self._jitted.trace(state, batch, key, self.frozen_params)
        call = traced.lower().compile()
        memory = call.memory_analysis()
        named = jax.tree_util.tree_leaves_with_path(batch)
        return Program(
            len(self._by_shapes) + 1,
            call,
            {_name(path): f"{leaf.dtype}{list(np.shape(leaf))}" for path, leaf in named},
            matmul_flops(traced.jaxpr),
            time.perf_counter() - begin,
            getattr(memory, "temp_size_in_bytes", 0),
        )


def _mesh_of(state: Any) -> Any:
    """The context of the mesh that a state lives on; none if it has no such sharding."""
    meshes = (getattr(leaf.sharding, "mesh", None) for leaf in jax.tree.leaves(state))
    mesh = next((mesh for mesh in meshes if mesh is not None), None)
    return contextlib.nullcontext() if mesh is None else jax.set_mesh(mesh)


def _shapes(batch: Any) -> Any:
    leaves, structure = jax.tree.flatten(batch)
    return structure, tuple((np.shape(leaf), leaf.dtype) for leaf in leaves)


def _name(path: Any) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".") or "batch"
