"""The mean of what the flows predict from a picture and from its mirror image.

A flow that takes one step predicts a mean. Half of the error of that mean differs between the
picture and its mirror image, so the average of both predictions is better
(``config.SampleConfig.mirrored``). A flow that takes several steps draws a sample. The average of
two samples is not a sample, so such a flow uses the original picture alone.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import numpy as np

from uniart_jax.config import LatentSampleConfig, StructureSampleConfig
from uniart_jax.data.cameras import mirror_camera_codes
from uniart_jax.data.mirror import (
    mirror_coords,
    mirror_dense,
    mirror_images,
    mirror_subcells,
    mirror_table,
)
from uniart_jax.flow.solvers import Solution
from uniart_jax.inference.networks import Networks
from uniart_jax.inference.samplers import join_views, with_first_view_cameras
from uniart_jax.voxels.grid import VoxelGrid, smoothed
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.typed_batches import Condition


class ImageConditions(NamedTuple):
    """The flows' condition on the views of one object (one item), and that on the mirrored views
    with the mirrored layout; None where no flow averages."""

    original: Condition
    mirrored: Condition | None


def encode_views(
    networks: Networks,
    pixels: np.ndarray,
    layout: Layout | None,
    structure: StructureSampleConfig,
    latent: LatentSampleConfig,
) -> ImageConditions:
    """Encode views [N, S, S, 3] in [0, 1] of one object, and their mirror images where the options
    of a flow ask for the average."""
    encode = lambda views: join_views(networks.encode_images(views))  # noqa: E731
    original = networks.following(encode(pixels), [layout])
    if not (_averages(structure) or _averages(latent)):
        return ImageConditions(original, None)
    mirrored = encode(np.ascontiguousarray(mirror_images(pixels)))
    table = original.layout
    mirrored = mirrored._replace(layout=None if table is None else mirror_table(table))
    (camera,) = networks.cameras_of([layout])
    if camera is not None:
        mirrored = with_first_view_cameras(mirrored, [mirror_camera_codes(camera)])
    return ImageConditions(original, mirrored)


def find_voxels(
    networks: Networks,
    conditions: ImageConditions,
    key: jax.Array,
    options: StructureSampleConfig,
) -> tuple[np.ndarray, Solution]:
    """Active voxels [V, 3], and the solution for the original with the evaluations of both. Both
    solutions begin with the noise of ``key``."""
    found = networks.solve_structure(conditions.original, key, options)
    logits = networks.structure_logits(found.x, conditions.original)
    if conditions.mirrored is not None and _averages(options):
        other = networks.solve_structure(conditions.mirrored, key, options)
        there = networks.structure_logits(other.x, conditions.mirrored)
        logits, found = (logits + mirror_dense(there, 1)) / 2, _with_cost_of(found, other)
    return networks.active_voxels(logits, options)[0], found


def find_grid(
    networks: Networks,
    coords: np.ndarray,
    conditions: ImageConditions,
    key: jax.Array,
    options: LatentSampleConfig,
    layout: Layout | None,
) -> tuple[VoxelGrid, Solution]:
    """Distances, colours and the codes of parts on voxels [V, 3], thickened and smoothed as the
    options say; and the solution for the original with the evaluations of both. Distances and
    colours are averages, codes of parts come from the original alone. ``layout``: in the frame of
    the original."""
    table = networks.part_table([layout], 1)

    def one(coords, condition, table):
        found = networks.solve_latents([coords], condition, key, options)
        latent = np.asarray(found.x)[0, : len(coords)]
        return networks.decode([coords], [latent], table)[0], found

    grid, found = one(coords, conditions.original, table)
    if conditions.mirrored is not None and _averages(options):
        turned = mirror_coords(coords, grid.resolution)
        order = np.lexsort(turned.T[::-1])  # voxels come in lexicographic order
        there, other = one(turned[order], conditions.mirrored, mirror_table(table))
        back, cells = np.argsort(order), grid.subdivisions
        sdf, color = (mirror_subcells(v, cells)[back] for v in (there.sdf, there.color))
        grid = dataclasses.replace(grid, sdf=(grid.sdf + sdf) / 2, color=(grid.color + color) / 2)
        found = _with_cost_of(found, other)
    return smoothed(grid, options.sdf_offset, options.sdf_blur, options.sdf_blur_along), found


def _with_cost_of(found: Solution, other: Solution) -> Solution:
    return found._replace(
        evaluations=found.evaluations + other.evaluations,
        steps_over_tolerance=found.steps_over_tolerance + other.steps_over_tolerance,
    )


def _averages(options: StructureSampleConfig | LatentSampleConfig) -> bool:
    return options.mirrored and options.steps == 1 and not options.adaptive
