"""Per-device computation with ``jax.shard_map``, where XLA's partitioner would insert an
all-gather.

XLA splits products and norms over a mesh. But where rows are gathered by computed positions, or
sorted into tiles for a loop, it cannot know that an item's rows stay with the item. It would send
every device the rows of all, which is many times the size of the gradients and grows with every
block (docs/scaling.md). ``shard_map_items`` keeps them where they are. It also lets Pallas kernels,
which XLA cannot split, run on many devices.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from jax.sharding import AxisType
from jax.sharding import PartitionSpec as P


def shard_map_items(
    function: Callable[..., Any], split: tuple[Any, ...], whole: tuple[Any, ...] = ()
) -> Any:
    """``function(*split, *whole)``, computed by each device on its part of ``split``, where a mesh
    is set (``jax.set_mesh``).

    Args:
      function: each row of its results depends on the same row of ``split`` only, whatever the
        number of rows; all results have that leading axis.
      split: arrays, or pytrees of them, whose first axis is a batch's items or consecutive equal
        shares of them.
      whole: what every device needs all of, such as a kernel; its gradients are summed.

    Without a mesh, on one device, and where a first axis does not divide over the devices, the
    function is called as it is.
    """
    mesh = jax.sharding.get_abstract_mesh()
    leaves = jax.tree.leaves(split)
    if mesh.empty or mesh.size == 1 or AxisType.Manual in mesh.axis_types:
        return function(*split, *whole)
    if any(leaf.shape[0] % mesh.size for leaf in leaves):
        return function(*split, *whole)
    items = P(mesh.axis_names)
    specs = (*[items] * len(split), *[P()] * len(whole))
    mapped = jax.shard_map(function, in_specs=specs, out_specs=items, check_vma=False)
    return mapped(*split, *whole)


def on_single_device() -> bool:
    """Whether the code being traced runs on one device: there is only one, or this is inside
    ``shard_map_items``."""
    mesh = jax.sharding.get_abstract_mesh()
    return jax.device_count() == 1 or (not mesh.empty and AxisType.Manual in mesh.axis_types)
