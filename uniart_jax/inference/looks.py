"""A picture looked at twice, as it is and mirrored: the mean of what the flows make of both.

A flow that takes one step gives a mean, and half of what a mean has wrong differs between the two
looks (``config.SampleConfig.mirrored``). A flow that takes several draws a sample; two samples have
no mean, so it looks once.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import numpy as np

from uniart_jax.config import LatentSampleConfig, StructureSampleConfig
from uniart_jax.data.mirror import (
    mirror_coords,
    mirror_dense,
    mirror_images,
    mirror_subcells,
    mirror_table,
)
from uniart_jax.flow.solvers import Solution
from uniart_jax.inference.networks import Networks
from uniart_jax.inference.samplers import join_views
from uniart_jax.voxels.grid import VoxelGrid, smoothed
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.typed_batches import Condition


class Looks(NamedTuple):
    """What the flows see of the views of one object (a condition of one item), and of its mirror
    image with the mirrored layout; None where no flow asks for that."""

    plain: Condition
    mirrored: Condition | None


def look(
    networks: Networks,
    pixels: np.ndarray,
    layout: Layout | None,
    structure: StructureSampleConfig,
    latent: LatentSampleConfig,
) -> Looks:
    """Views [N, S, S, 3] in [0, 1] of one object, once or twice, as the flows' options ask."""
    see = lambda views: join_views(networks.encode_images(views))  # noqa: E731
    plain = networks.following(see(pixels), [layout])
    if not (_twice(structure) or _twice(latent)):
        return Looks(plain, None)
    mirrored = see(np.ascontiguousarray(mirror_images(pixels)))
    table = plain.layout
    return Looks(plain, mirrored._replace(layout=None if table is None else mirror_table(table)))


def find_voxels(
    networks: Networks, looks: Looks, key: jax.Array, options: StructureSampleConfig
) -> tuple[np.ndarray, Solution]:
    """Active voxels [V, 3], and the plain look's solution with the evaluations of both; both begin
    with the noise of ``key``."""
    found = networks.solve_structure(looks.plain, key, options)
    logits = networks.structure_logits(found.x, looks.plain)
    if looks.mirrored is not None and _twice(options):
        other = networks.solve_structure(looks.mirrored, key, options)
        there = networks.structure_logits(other.x, looks.mirrored)
        logits, found = (logits + mirror_dense(there, 1)) / 2, _with_cost_of(found, other)
    return networks.active_voxels(logits, options)[0], found


def find_grid(
    networks: Networks,
    coords: np.ndarray,
    looks: Looks,
    key: jax.Array,
    options: LatentSampleConfig,
    layout: Layout | None,
) -> tuple[VoxelGrid, Solution]:
    """Distances, colours and what they say of parts on voxels [V, 3], thickened and smoothed as
    the options say; and the plain look's solution with the evaluations of both. Distances and
    colours are of both looks, what is said of parts is of the plain one. ``layout``: in the plain
    look's frame."""
    table = networks.part_table([layout], 1)

    def one(coords, condition, table):
        found = networks.solve_latents([coords], condition, key, options)
        latent = np.asarray(found.x)[0, : len(coords)]
        return networks.decode([coords], [latent], table)[0], found

    grid, found = one(coords, looks.plain, table)
    if looks.mirrored is not None and _twice(options):
        turned = mirror_coords(coords, grid.resolution)
        order = np.lexsort(turned.T[::-1])  # voxels come in lexicographic order
        there, other = one(turned[order], looks.mirrored, mirror_table(table))
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


def _twice(options: StructureSampleConfig | LatentSampleConfig) -> bool:
    return options.mirrored and options.steps == 1 and not options.adaptive
