"""Where arrays live: one mesh ``("data", "fsdp")`` for one CPU core, a GPU node or a pod.

Batches are split over both axes. Parameters, moments and averages are split over ``fsdp`` (the
largest axis that divides) when they are big, else replicated. ``jax.jit`` inserts the collectives:
this is what ``jax.pmap`` became, and a sum over devices cannot be forgotten or done twice.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from uniart_jax.config import MeshConfig
from uniart_jax.nn.pad_plans import padded_plans, plan_sizes
from uniart_jax.training.distributed import largest
from uniart_jax.voxels.typed_batches import VoxelBatch

AXES = ("data", "fsdp")


def make_mesh(config: MeshConfig) -> Mesh:
    """The mesh over all devices of all processes; -1 for "all the rest".

    Over several processes the devices of each are neighbours, and ``fsdp`` is filled first: as much
    of it as goes stays within a host, and the rows of a batch are in the order of the processes.

    Raises:
      ValueError: the sizes do not multiply to the number of devices.
    """
    count = jax.device_count()
    sizes = [config.data, config.fsdp]
    known = int(np.prod([s for s in sizes if s != -1]))
    if sizes.count(-1) == 1 and known > 0 and count % known == 0:
        sizes[sizes.index(-1)] = count // known
    if min(sizes) < 1 or sizes[0] * sizes[1] != count:
        raise ValueError(
            f"mesh: data={config.data} x fsdp={config.fsdp} does not make {count} devices; "
            "set mesh.data and mesh.fsdp so that their product does (-1 once = all the rest)"
        )
    # Explicit since jax 0.9's default changed: collectives are left to the compiler.
    types = (AxisType.Auto,) * 2
    if jax.process_count() == 1:
        return jax.make_mesh(tuple(sizes), AXES, axis_types=types)
    devices = sorted(jax.devices(), key=lambda device: (device.process_index, device.id))
    return Mesh(np.array(devices).reshape(sizes), AXES, axis_types=types)


def replicated(mesh: Mesh) -> NamedSharding:
    """Every device holds all of it."""
    return NamedSharding(mesh, P())


def batch_sharding(mesh: Mesh) -> NamedSharding:
    """The first axis is split over all devices."""
    return NamedSharding(mesh, P(AXES))


def state_sharding(mesh: Mesh, abstract: Any, min_split: int = MeshConfig.min_split) -> Any:
    """Shardings of a pytree of arrays or ShapeDtypeStructs: the largest axis that ``fsdp`` divides,
    for arrays of ``min_split`` numbers and more."""
    parts = mesh.shape["fsdp"]

    def place(leaf: Any) -> NamedSharding:
        axes = [axis for axis, size in enumerate(leaf.shape) if size % parts == 0]
        if parts == 1 or not axes or int(np.prod(leaf.shape)) < min_split:
            return replicated(mesh)
        longest = max(axes, key=lambda axis: (leaf.shape[axis], axis))
        return NamedSharding(mesh, P(*(None,) * longest, "fsdp"))

    return jax.tree.map(place, abstract)


def split_words(mesh: Mesh, placed: Any) -> str:
    """ "fsdp 4: 93 % of 555 M numbers split", of arrays or ShapeDtypeStructs with shardings; ""
    where there is nothing to split over."""
    if (parts := mesh.shape["fsdp"]) == 1:
        return ""
    leaves = jax.tree.leaves(placed)
    whole = sum(leaf.size for leaf in leaves)
    split = sum(leaf.size for leaf in leaves if not leaf.sharding.is_fully_replicated)
    millions = f"{whole / 1e6:.{0 if whole >= 1e7 else 2}f}"
    return f"fsdp {parts}: {split / whole:.0%} of {millions} M numbers split".replace("%", " %")


def put_batch(batch: Any, mesh: Mesh) -> Any:
    """Host arrays of this process -> global arrays on the mesh.

    An array whose first axis this process's devices divide is split (items, and whatever goes with
    them, a plan's shares among it); another one is replicated. Either way the program computes the
    same numbers. Over several processes the plans of a ``VoxelBatch`` take the shapes that the
    largest needs (``nn.pad_plans``).

    Raises:
      ValueError: several processes and an array that cannot be split: replicas would differ.
    """
    split, whole = batch_sharding(mesh), replicated(mesh)
    processes = jax.process_count()
    local = mesh.size // processes
    if processes > 1 and isinstance(batch, VoxelBatch) and batch.plans:
        sizes = largest(plan_sizes(batch.plans))
        batch = batch._replace(plans=padded_plans(batch.plans, sizes))

    def put(path: Any, leaf: Any) -> jax.Array:
        leaf = np.asarray(leaf)
        divides = leaf.ndim > 0 and leaf.shape[0] > 0 and leaf.shape[0] % local == 0
        if not divides and processes > 1:
            name = jax.tree_util.keystr(path, simple=True, separator=".")
            raise ValueError(
                f"batch '{name}' {leaf.shape}: the first axis does not divide over this process's "
                f"{local} devices; choose a batch size that does"
            )
        return jax.make_array_from_process_local_data(split if divides else whole, leaf)

    return jax.tree_util.tree_map_with_path(put, batch)
