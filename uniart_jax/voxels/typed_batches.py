"""Batches as networks and losses take them: one named tuple a kind, each field with its shape.

Named tuples, as plans (``nn.segments``) and part tables are: pytrees of JAX and of Grain without
being registered, so that data workers need no JAX. Arrays are numpy on the host and jax within a
program. What a batch does not have is None and no leaf of the pytree. ``nn.shapes.check_shapes``
holds the arrays against the shapes.

B items · V voxels, padded · r3 sub-cells of a voxel · K parts, padded · R voxels a side of the grid
· T coarse cells a side · C channels. Valid entries come first, padding is zero. Boxes are centre
and size in object units, codes joint codes (``voxels.joint_code``), images sRGB over black in
[0, 1], cameras ``voxels.camera_code``, parents rows of the parts' table, the root its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple, TypeVar

from uniart_jax.nn.shapes import Array

T = TypeVar("T")


class LayoutBatch(NamedTuple):
    """Pictures and part tables (``data.layouts``): what the layout network trains on.

    Attributes:
      colors: linear RGB of each part. part_counts: rows of each item that are parts.
    """

    image: Annotated[Array, "B H W 3", "float"]
    camera: Annotated[Array, "B 7", "float"]
    boxes: Annotated[Array, "B K 6", "float"]
    codes: Annotated[Array, "B K 9", "float"]
    parents: Annotated[Array, "B K", "int"]
    colors: Annotated[Array, "B K 3", "float"]
    part_counts: Annotated[Array, "B", "int"]


class PictureBatch(NamedTuple):
    """Pictures of records and what is coarse of them (``data.image_table``): what the image encoder
    and the structure VAE, which reads the occupancy alone, train on.

    Attributes:
      occupancy: of the grid's voxels. cell_part: the part that owns most surface in the cell, -1
        where no voxel is active. record: index of each item's record, -1 where it only fills up a
        batch.
    """

    image: Annotated[Array, "B H W 3", "float"] = None
    camera: Annotated[Array, "B 7", "float"] = None
    occupancy: Annotated[Array, "B R R R"] = None
    cell_part: Annotated[Array, "B T T T", "int"] = None
    boxes: Annotated[Array, "B K 6", "float"] = None
    codes: Annotated[Array, "B K 9", "float"] = None
    parents: Annotated[Array, "B K", "int"] = None
    record: Annotated[Array, "B", "int"] = None


def batch_of(kind: type[T], given: Mapping[str, Any] | T, wanted: Sequence[str] = ()) -> T:
    """A batch of a kind, also from a dictionary of its fields, as users give them; what the kind
    does not have is left out.

    Args:
      wanted: fields that it must have; the others are left out. () for all.

    Raises:
      ValueError: a field is missing.
    """
    fields, optional = kind._fields, kind._field_defaults  # type: ignore[attr-defined]
    held = given if isinstance(given, Mapping) else given._asdict()  # type: ignore[attr-defined]
    needed = wanted or [name for name in fields if name not in optional]
    if lacking := [name for name in needed if held.get(name) is None]:
        raise ValueError(f"a batch has no '{lacking[0]}', which the stage reads")
    return kind(**{name: held[name] for name in wanted or fields if name in held})
