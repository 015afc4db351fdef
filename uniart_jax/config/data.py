"""What training reads: records, pictures, layouts, and how they are varied."""

from __future__ import annotations

import dataclasses
from typing import Literal

Background = Literal["auto", "keep", "rembg"]  # how an object is cut out (data.background)
World = Literal["seven", "wide", "detailed", "everyday", "household", "open"]  # procedural.WORLDS


@dataclasses.dataclass(frozen=True)
class DataConfig:
    """Where records are and how batches are made of them.

    ``split``, ``validation_split``: of each folder, only the records of this split, or of several
    joined by commas, as its manifest says; "" = all. So one folder can serve for both. ``mirror``,
    ``mirror_latents``: not for a UniArt VAE that reads features of voxels (``visual_channels``,
    ``part_feature_channels``): they come from networks that see a mirrored object otherwise, so its
    features are not known.
    """

    records: str = ""
    split: str = ""
    validation: str = ""
    validation_split: str = ""
    procedural: int = 0  # objects to prepare in ``records`` where it is not there yet
    # families of those and of ``layouts``
    world: World = "seven"
    views: int = 2  # images of each
    # flows: images of an item that a step shows at once (the supplement's multi-view model); the
    # records must have as many
    condition_views: int = 1
    validation_count: int = 64  # objects to prepare in ``validation`` where it is not there yet
    validation_seed: int = (
        900_000  # never trained on, and not the held-out seeds of the evaluation either
    )
    voxel_buckets: tuple[int, ...] = (8192, 16384, 32768)
    voxel_crop: int = (
        0  # UniArt VAE: voxels of an object that a training step sees (``data.windows``); 0 = all
    )
    mirror: bool = True  # left-right mirror of object and image with probability 1/2
    mirror_latents: bool = (
        True  # so in the flows too, whose latents then take twice as long to encode
    )
    live: float = (
        0.0  # UniArt VAE: share of the items made again from their objects (``data.live``)
    )
    part_scale: float = (
        0.0  # of those: parts grow or shrink by up to this share (``objects.perturb``)
    )
    part_color: float = (
        0.0  # UniArt VAE, all items: so the brightness and each channel of a part's colour
    )
    layouts: str = "data-cache/layouts"  # blocks of pictures and part tables (``data.layouts``)
    reuse: int = 3  # of those: how often training shows each object
    first_block: int = 0  # of those: where training begins; later ones see what earlier did not
    # layout network: one batch in so many has legs, panels and boards, about half of a step's time;
    # the others have only parts, and which of these are round
    box_sets_every: int = 1
    # layout network: share of the pictures that are as if cut out of a photograph
    photographs: float = 0.0
    # folder of pictures that stand behind most objects of these photographs, and of the mask
    # network's pictures ("" = none)
    backgrounds: str = ""
    # flows that see a layout: share of the side by which pictures are bent at most, so that the
    # layout says where things are; not of a structure flow that reads pixels
    image_warp: float = 0.0
    layout_errors: float = 0.0  # and the strength of the errors in it (``data.layout_errors``)
    # UniArt VAE: share of the parts whose joint and parent are drawn anew
    # (``objects.perturb.draw_joint``)
    new_joints: float = 0.0
    seed: int = 0  # of the order and of what is drawn for each item
    workers: int = 0  # processes that make batches; 0 = a thread
