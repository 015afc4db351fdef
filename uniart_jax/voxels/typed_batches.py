"""Batches as networks and losses take them: one named tuple a kind, each field with its shape.

Named tuples, as plans (``nn.segments``) and part tables are: pytrees of JAX and of Grain without
being registered, so that data workers need no JAX. Arrays are numpy on the host and jax within a
program. What a batch does not have is None and no leaf of the pytree. ``nn.shapes.check_shapes``
holds the arrays against the shapes.

B items · V voxels, padded · r3 sub-cells of a voxel · K parts, padded · R voxels a side of the grid
· T coarse cells a side · C, D, F, P channels. Valid entries come first, padding is zero. Boxes are
centre and size in object units, codes joint codes (``voxels.joint_code``), images sRGB over black
in [0, 1], cameras ``voxels.camera_code``, parents rows of the parts' table, the root its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple, TypeVar

from uniart_jax.nn.shapes import Array
from uniart_jax.voxels.part_table import PartTable

T = TypeVar("T")
Plans = Mapping[str, Any]  # ``nn.segments.Segments`` and ``nn.grids.FlowPlan`` by name


class LayoutBatch(NamedTuple):
    """Pictures and part tables (``data.layouts``): what the layout network trains on.

    Attributes:
      colors: linear RGB of each part. part_counts: rows of each item that are parts.
      legs: what the object stands on (``voxels.leg_table.Legs.table``). leg_counts: rows of each
        item that are legs; -1 where they are not known. legs_alone: nothing else is as low.
      panels: corners of the boards of the body (``voxels.panel_table``). panel_counts: rows of each
        item that are panels; -1 where they are not known. panel_share: of the body that they and
        the legs explain.
      boards: the same of each part. board_counts: -1 where they are not known, as of the body and
        of what is narrow. board_share: of each.
      revolutions: parts that are round about an axis (``voxels.revolution_table.revolution_rows``).
    """

    image: Annotated[Array, "B H W 3", "float"]
    camera: Annotated[Array, "B 7", "float"]
    boxes: Annotated[Array, "B K 6", "float"]
    codes: Annotated[Array, "B K 9", "float"]
    parents: Annotated[Array, "B K", "int"]
    colors: Annotated[Array, "B K 3", "float"]
    part_counts: Annotated[Array, "B", "int"]
    legs: Annotated[Array, "B N 12", "float"] = None
    leg_counts: Annotated[Array, "B", "int"] = None
    legs_alone: Annotated[Array, "B", "bool"] = None
    panels: Annotated[Array, "B P 6", "float"] = None
    panel_counts: Annotated[Array, "B", "int"] = None
    panel_share: Annotated[Array, "B", "float"] = None
    boards: Annotated[Array, "B K M 6", "float"] = None
    board_counts: Annotated[Array, "B K", "int"] = None
    board_share: Annotated[Array, "B K", "float"] = None
    revolutions: Annotated[Array, "B K 11", "float"] = None


# fields of legs, panels and boards
BOX_SETS = tuple(name for name in LayoutBatch._field_defaults if name != "revolutions")


def parts_of(batch: LayoutBatch) -> LayoutBatch:
    """A batch without its legs, panels and boards."""
    return batch._replace(**dict.fromkeys(BOX_SETS))


def has_parts_alone(batch: LayoutBatch) -> bool:
    """Whether a batch has no legs, panels and boards."""
    return all(getattr(batch, name) is None for name in BOX_SETS)


class MaskBatch(NamedTuple):
    """Pictures with their backgrounds (``data.scene_batches``): what the mask network trains on.

    Attributes:
      mask: 1 where the object is seen, 0 where it is not.
    """

    image: Annotated[Array, "B H W 3", "float"]
    mask: Annotated[Array, "B H W", "float"]


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


class Condition(NamedTuple):
    """What the flows see of an image.

    Attributes:
      tokens: L of width D. volume: None where the image encoder has none (DINOv2).
      pixels, cameras: maps of N views and where they were taken from (``nn.lifting.read_pixels``,
        ``models.grid_pixels``); None where the flows read none.
      layout: that the flows follow; None where they see none.
    """

    tokens: Annotated[Array, "B L D"]
    volume: Annotated[Array, "B Rv Rv Rv C"] = None
    pixels: Annotated[Array, "B N S S Cp"] = None
    cameras: Annotated[Array, "B N 7"] = None
    layout: PartTable = None  # type: ignore[assignment]


class StructureBatch(NamedTuple):
    """What the structure flow trains on (``data.latents``).

    Attributes:
      structure: dense latents as encoded, s cells a side.
      occupancy: of the grid's voxels, for what is decoded.
      image: [B, H, W, 3], or N views [B, N, H, W, 3].
      layout: that the flow is shown, where it sees layouts.
      seen: what an image encoder makes of ``image``, with the layout
        (``training.flow_losses.with_image_condition``).
    """

    structure: Annotated[Array, "B s s s C", "float"]
    occupancy: Annotated[Array, "B R R R"] = None
    image: Annotated[Array, "B ... 3", "float"] = None
    layout: PartTable = None  # type: ignore[assignment]
    seen: Condition = None  # type: ignore[assignment]


class VoxelBatch(NamedTuple):
    """Padded voxels and what is known of them: all that the UniArt VAE encodes, the latents that
    the latent flow trains on (``data.latents``), or only places and plans, which decoders and
    samplers read.

    Attributes:
      coords: indices in the grid. counts: voxels of each item.
      voxel_part: the part of each voxel, a row of the items' tables ``boxes``, ``codes`` and
        ``parents``, of which ``part_counts`` are parts.
      sdf, color, owner: of each sub-cell. As records store them, int8, uint8 and uint8
        (``models.voxel_batch`` decodes them on the device), or distance in sub-cells, linear RGB
        and part.
      visual, part_feature: columns that the UniArt VAE reads (``data.columns``).
      latent: as encoded.
      plans: by name, "parts", "window_0", "window_1" (``nn.voxel_plans``) and "flow"
        (``nn.grids.flow_plan``), those that are read.
      layout: that networks are shown. layout_rows: its row of each true part, -1 where it is lost.
      image: that flows are shown, [B, H, W, 3], or N views [B, N, H, W, 3]. seen: as in
        ``StructureBatch``.
      images: all views. record: index of each item's record, -1 where it only fills up a batch.
    """

    coords: Annotated[Array, "B V 3", "int"]
    counts: Annotated[Array, "B", "int"]
    voxel_part: Annotated[Array, "B V", "int"] = None
    sdf: Annotated[Array, "B V r3"] = None
    color: Annotated[Array, "B V r3 3"] = None
    owner: Annotated[Array, "B V r3", "int"] = None
    boxes: Annotated[Array, "B K 6", "float"] = None
    codes: Annotated[Array, "B K 9", "float"] = None
    parents: Annotated[Array, "B K", "int"] = None
    part_counts: Annotated[Array, "B", "int"] = None
    visual: Annotated[Array, "B V F", "float"] = None
    part_feature: Annotated[Array, "B V P", "float"] = None
    latent: Annotated[Array, "B V C", "float"] = None
    plans: Plans = None  # type: ignore[assignment]
    layout: PartTable = None  # type: ignore[assignment]
    layout_rows: Annotated[Array, "B K", "int"] = None
    image: Annotated[Array, "B ... 3", "float"] = None
    images: Annotated[Array, "B N H W 3", "float"] = None
    record: Annotated[Array, "B", "int"] = None
    seen: Condition = None  # type: ignore[assignment]


def batch_of(
    kind: type[T],
    given: Mapping[str, Any] | T,
    wanted: Sequence[str] = (),
    needed: Sequence[str] = (),
) -> T:
    """A batch of a kind, also from a dictionary of its fields, as users give them; what the kind
    does not have is left out.

    Args:
      wanted: fields that it must have; the others are left out. () for all.
      needed: fields that it must have, beside those without a default.

    Raises:
      ValueError: a field is missing, or it is no batch at all.
    """
    fields, optional = kind._fields, kind._field_defaults  # type: ignore[attr-defined]
    if not (isinstance(given, Mapping) or hasattr(given, "_asdict")):
        raise ValueError(
            f"a batch is a {kind.__name__} or a dictionary, not {type(given).__name__}"
        )
    held = given if isinstance(given, Mapping) else given._asdict()  # type: ignore[attr-defined]
    asked = wanted or [*(name for name in fields if name not in optional), *needed]
    if lacking := [name for name in asked if held.get(name) is None]:
        raise ValueError(f"a batch has no '{lacking[0]}', which the stage reads")
    return kind(**{name: held[name] for name in wanted or fields if name in held})
