"""The two velocity networks: rectified-flow transformers with cross-attention to image tokens.

Upstream: TRELLIS ``models/sparse_structure_flow.py`` and ``models/structured_latent_flow.py``.
Ours, as config options: a 'patch' stem that makes one token of a cube of voxels, features of the
image encoder's volume added to the tokens that they are aligned with, pixels that each voxel
(structure flow: each cell, ``models.grid_pixels``) reads where the camera sees it, what each voxel
or cell sees of a layout (``models.layout_features``), and prediction of the clean sample instead of
the velocity.

A call may carry several noise draws per image: x has n times the context's batch, item-major, and
shares its image's condition.
"""

from __future__ import annotations

import itertools
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.flow_trunk import FlowTrunk, check_camera, required
from uniart_jax.models.grid_pixels import GridPixels
from uniart_jax.models.image_encoder import pixel_width
from uniart_jax.models.occupancy_refiner import OccupancyRefiner
from uniart_jax.nn.blocks import (
    LayerNorm,
    layer_norm,
    linear,
    modulation,
    xavier,
    zeros,
)
from uniart_jax.nn.convolution import SubmanifoldConv
from uniart_jax.nn.embeddings import grid_coords, position_embedding
from uniart_jax.nn.grids import FlowPlan
from uniart_jax.nn.lifting import read_pixels
from uniart_jax.nn.pooling import (
    at_cells,
    downsample,
    from_cells,
    occupied,
    repeat_plan,
    to_cells,
    upsample,
)
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.voxels.part_table import PartTable

Views = tuple[jax.Array | None, jax.Array | None]  # maps and cameras, of a Condition


class StructureFlow(FlowTrunk):
    """Velocity of the dense structure latent."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.structure_flow, compute_dtype(config)
        s = config.structure_vae
        latent_side = config.grid.resolution // s.patch_size // 2 ** (len(s.channels) - 1)
        channels = s.latent_channels * c.patch_size**3
        self.make_trunk(c, config, latent_side // c.patch_size, rngs)
        if p := c.layout_channels:
            self.latent_side = latent_side
            self.make_layout(config.grid.resolution // latent_side, c.patch_size**3, rngs, dtype)
            self.cell_in = linear(2 * s.latent_channels, p, rngs, dtype=dtype)
            self.cell_hidden = linear(p, p, rngs, dtype=dtype)
            self.cell_out = linear(p, s.latent_channels, rngs, init=zeros)
        if c.pixel_channels:
            self.grid_pixels = GridPixels(c.pixel_channels, latent_side, config, rngs, dtype)
            width, cells = self.grid_pixels.width, c.patch_size**3
            self.pixel_cube = linear(cells * width, c.model_channels, rngs, init=zeros, dtype=dtype)
            if c.layout_channels:
                self.pixel_cell = linear(width, c.layout_channels, rngs, init=zeros, dtype=dtype)
        self.input_layer = linear(channels, c.model_channels, rngs, dtype=dtype)
        self.out_layer = linear(c.model_channels, channels, rngs, init=zeros)
        self.pos_emb = nnx.Param(self._computed_positions()) if c.position_table else None
        if c.refine_channels:
            self.refiner = OccupancyRefiner(c.refine_channels, config, rngs)

    def position_embedding(self) -> jax.Array:
        """[tokens, D]; where it is a table of the weights, it is frozen (TRELLIS's buffer)."""
        if self.pos_emb is None:
            return self._computed_positions()
        return jax.lax.stop_gradient(self.pos_emb[...])

    def _computed_positions(self) -> jax.Array:
        return position_embedding(grid_coords(self.side), self.config.model_channels)

    def __call__(
        self,
        x: jax.Array,
        t: jax.Array,
        tokens: jax.Array,
        volume: jax.Array | None = None,
        *,
        views: Views = (None, None),
        layout: PartTable | None = None,
    ) -> jax.Array:
        """Velocity at x [B, r, r, r, C] and time t [B] in [0, 1], or one t of all.

        Args:
          tokens: [B / n, M, D']. volume: [B / n, Rv, Rv, Rv, C'].
          views: with ``pixel_channels``, maps [B / n, N, S, S, C''] and cameras [B / n, N, 7] of N
            pictures.
          layout: [B / n, ...], with ``layout_channels``.
        """
        t = jnp.broadcast_to(t, x.shape[:1])
        seen, draws = self.see(x, t), x.shape[0] // tokens.shape[0]
        h = self.input_layer(_patchify(seen, self.config.patch_size))
        parts = self._see_cells(layout, draws)
        if parts is not None:
            h = h + self.layout_cube(_patchify(parts, self.config.patch_size))
        if self.config.pixel_channels:
            read = jnp.repeat(self.read_pictures(*views), draws, axis=0)
            h = h + self.pixel_cube(_patchify(read, self.config.patch_size))
            parts = None if parts is None else parts + self.pixel_cell(read)
        h = h + self.position_embedding().astype(h.dtype)
        if self.config.volume_channels:
            volume = required(volume, "volume_channels", "volume")
            added = self.embed_volume(volume, draws)
            h = h + added.reshape(h.shape)
        h = self.run_blocks(h, self.embed_time(t), tokens)
        out = self.out_layer(layer_norm(h.astype(jnp.float32), 1e-5))
        out = _unpatchify(out, self.side, self.config.patch_size)
        if parts is not None:  # a token is narrower than what its cells see
            cell = self.cell_in(jnp.concatenate([out, seen], -1)) + parts
            out = out + self.cell_out(jax.nn.gelu(self.cell_hidden(jax.nn.gelu(cell))))
        return self.to_velocity(out, x, t)

    def refine(
        self,
        logits: jax.Array,
        pixels: jax.Array | None,
        cameras: jax.Array | None,
        layout: PartTable | None = None,
    ) -> jax.Array:
        """Logits [B, R, R, R] that the structure VAE decodes of a sample, sharpened.

        Args:
          pixels, cameras: [B, N, S, S, C], [B, N, 7] of N pictures, as for the latent flow.
          layout: [B, ...], where the flow sees layouts.

        Raises:
          ValueError: one of them is None.
        """
        pixels = required(pixels, "refine_channels", "pixels")
        if self.config.layout_channels:
            layout = required(layout, "layout_channels", "layout", "the part table of a")
        return self.refiner(logits, pixels, required(cameras, "refine_channels", "cameras"), layout)

    def read_pictures(self, pixels: jax.Array | None, cameras: jax.Array | None) -> jax.Array:
        """What the latent's cells read in N pictures (``GridPixels``): [B, r, r, r, C]."""
        return self.grid_pixels(*_required_views((pixels, cameras)))

    def _see_cells(self, layout: PartTable | None, draws: int) -> Any:
        """[B, r, r, r, layout_channels] of the latent's cells; None without ``layout_channels``."""
        if not self.config.layout_channels:
            return None
        coords = jnp.asarray(grid_coords(self.latent_side))[None]
        parts = self.see_layout(layout, coords, self.latent_side)
        return jnp.repeat(parts.reshape(-1, *(self.latent_side,) * 3, parts.shape[-1]), draws, 0)


class SparseResBlock(nnx.Module):
    """TRELLIS's SparseResBlock3d: change of level first, then two submanifold convolutions with the
    time in between."""

    def __init__(
        self,
        inputs: int,
        outputs: int,
        emb: int,
        level: int,
        change: int,
        rngs: nnx.Rngs,
        dtype,
        plain: bool,
    ):
        self.level, self.change = level, change  # level of the input; -1 = finer, +1 = coarser
        self.plain = plain
        self.norm1 = LayerNorm(inputs)
        made = {"plain": plain, "dtype": dtype}
        self.conv1 = nnx.Dict(conv=SubmanifoldConv(inputs, outputs, rngs, **made))
        self.conv2 = nnx.Dict(conv=SubmanifoldConv(outputs, outputs, rngs, zero=True, **made))
        self.emb_layers = modulation(emb, 2 * outputs, rngs, init=xavier, dtype=dtype)
        self.skip_connection = (
            linear(inputs, outputs, rngs, dtype=dtype) if inputs != outputs else None
        )

    def __call__(self, x: jax.Array, time: jax.Array, plan: FlowPlan) -> jax.Array:
        if self.change > 0:
            x = downsample(x, plan.pools[self.level], plain=self.plain)
        elif self.change < 0:
            x = upsample(x, plan.pools[self.level - 1], plain=self.plain)
        neighbors = plan.neighbors[self.level + self.change]
        scale, shift = jnp.split(self.emb_layers["1"](jax.nn.silu(time))[:, None, :], 2, -1)
        h = self.conv1["conv"](jax.nn.silu(self.norm1(x)), neighbors)
        h = layer_norm(h, 1e-6) * (1 + scale) + shift
        h = self.conv2["conv"](jax.nn.silu(h), neighbors)
        return h + (x if self.skip_connection is None else self.skip_connection(x))


class LatentFlow(FlowTrunk):
    """Velocity of the latents on the active voxels."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.latent_flow, compute_dtype(config)
        latent, d = config.uniart_vae.latent_channels, c.model_channels
        self.make_trunk(c, config, config.grid.resolution // c.patch_size, rngs)
        self.plain = config.kernel == "plain"
        if c.stem == "patch":
            slots = c.patch_size**3
            self.input_layer = linear(slots * (latent + 1), d, rngs, dtype=dtype)
            e = c.voxel_channels
            if e:
                self.out_layer = linear(d, slots * e, rngs, dtype=dtype)
                self.voxel_in = linear(latent, e, rngs, dtype=dtype)
                self.voxel_hidden = linear(e, 2 * e, rngs, dtype=dtype)
                self.voxel_out = linear(2 * e, latent, rngs, init=zeros)
            else:
                self.out_layer = linear(d, slots * latent, rngs, init=zeros)
            if p := c.pixel_channels:
                check_camera(config, "latent_flow: pixel_channels")
                self.resolution = config.grid.resolution
                self.pixel_in = linear(
                    pixel_width(config.image_encoder) + 1, 2 * p, rngs, dtype=dtype
                )
                self.pixel_hidden = linear(2 * p, p, rngs, dtype=dtype)
                self.pixel_cube = linear(slots * p, d, rngs, init=zeros, dtype=dtype)
                if e:
                    self.pixel_voxel = linear(p, e, rngs, init=zeros, dtype=dtype)
            if c.layout_channels:
                self.resolution = config.grid.resolution
                self.make_layout(config.grid.subdivisions, slots, rngs, dtype)
                if e:
                    self.layout_voxel = linear(c.layout_channels, e, rngs, init=zeros, dtype=dtype)
            return
        for name in ("voxel_channels", "pixel_channels", "layout_channels"):
            if not getattr(c, name):
                continue
            raise ValueError(f"latent_flow: {name} belongs to the stem 'patch'; set it to 0")
        if c.patch_size != 2 ** len(c.io_channels) or (c.share_mod and c.io_channels):
            raise ValueError(
                f"latent_flow: the conv stem halves once per io_channels {c.io_channels}, so "
                f"patch_size must be {2 ** len(c.io_channels)}, not {c.patch_size}, and share_mod "
                "cannot be combined with it"
            )
        levels, made = (*c.io_channels, d), (rngs, dtype, self.plain)
        self.input_layer = linear(latent, levels[0], rngs)
        self.out_layer = linear(levels[0], latent, rngs, init=zeros)
        joined = 2 if c.use_skip_connection else 1
        down: list[nnx.Module] = []
        up: list[nnx.Module] = []
        for level, (here, below) in enumerate(itertools.pairwise(levels)):
            blocks = range(c.num_io_res_blocks - 1)
            down += [SparseResBlock(here, here, d, level, 0, *made) for _ in blocks]
            down.append(SparseResBlock(here, below, d, level, 1, *made))
            after = [SparseResBlock(here * joined, here, d, level, 0, *made) for _ in blocks]
            up = [SparseResBlock(below * joined, here, d, level + 1, -1, *made), *after, *up]
        self.input_blocks, self.out_blocks = nnx.List(down), nnx.List(up)

    def __call__(
        self,
        x: jax.Array,
        t: jax.Array,
        tokens: jax.Array,
        volume: jax.Array | None = None,
        *,
        views: Views = (None, None),
        layout: PartTable | None = None,
        coords: jax.Array,
        counts: jax.Array,
        plan: FlowPlan,
    ) -> jax.Array:
        """Velocity at x [B, V, C] and time t [B] in [0, 1], or one t of all; padding zero.

        Args:
          tokens: [B / n, M, D']. volume: [B / n, Rv, Rv, Rv, C'].
          views: with ``pixel_channels``, maps [B / n, N, S, S, C''] and cameras [B / n, N, 7] of N
            pictures (``nn.lifting.read_pixels``).
          layout: with ``layout_channels``, the part table [B / n, ...] of each picture's object.
          coords [B / m, V, 3], counts [B / m] and their plan (``nn.grids.flow_plan``): m draws in a
          row share them.
        """
        t, shared = jnp.broadcast_to(t, x.shape[:1]), x.shape[0] // coords.shape[0]
        if shared > 1:
            coords, counts = (jnp.repeat(a, shared, axis=0) for a in (coords, counts))
            plan = repeat_plan(plan, shared)
        valid = (jnp.arange(x.shape[1]) < counts[:, None])[..., None]
        x = jnp.where(valid, x, 0)
        time = self.embed_time(t)
        draws = x.shape[0] // tokens.shape[0]
        seen = self.see(x, t)
        if self.config.stem == "patch":
            extra = {
                "pixel": self._read(views, draws, shared, coords, counts),
                "layout": self._read_layout(layout, draws, shared, coords),
            }
            extra = {name: values for name, values in extra.items() if values is not None}
            out = self._patch(seen, time, tokens, volume, draws, coords, counts, plan, extra)
        else:
            out = self._convolve(seen, time, tokens, volume, draws, coords, counts, plan)
        return jnp.where(valid, self.to_velocity(out, x, t), 0)

    def _middle(self, h, time, tokens, volume, draws, coords, counts):
        h = h + position_embedding(coords, h.shape[-1]).astype(h.dtype)
        if self.config.volume_channels:
            h = h + at_cells(
                self.embed_volume(required(volume, "volume_channels", "volume"), draws), coords
            )
        return self.run_blocks(h, time, tokens, counts)

    def _read(self, views, draws, shared, coords, counts):
        """[B, V, pixel_channels] of what voxels read in the pictures, on average over views; None
        without ``pixel_channels``."""
        if not self.config.pixel_channels:
            return None
        pixels, cameras = views = _required_views(views)
        if shared % draws:  # one picture's draws are on voxels of their own
            pixels, cameras = (jnp.repeat(v, draws, axis=0) for v in views)
            draws = 1
        read = read_pixels(pixels, cameras, coords[::draws], counts[::draws], self.resolution)
        h = self.pixel_hidden(jax.nn.gelu(self.pixel_in(read))).mean(1)
        return jnp.repeat(jax.nn.gelu(h), draws, axis=0)

    def _read_layout(self, layout, draws, shared, coords):
        """[B, V, layout_channels] of what voxels see of the layout; None without
        ``layout_channels``."""
        if layout is not None and shared % draws:
            layout, draws = jax.tree.map(lambda a: jnp.repeat(a, draws, axis=0), layout), 1
        seen = self.see_layout(layout, coords[::draws], getattr(self, "resolution", 0))
        return None if seen is None else jnp.repeat(seen, draws, axis=0)

    def _patch(self, x, time, tokens, volume, draws, coords, counts, plan, extra):
        """``extra``: "pixel", "layout" -> what voxels know of them [B, V, C]."""
        (pool,) = plan.pools
        cubes = to_cells(x, pool, plain=self.plain)
        full = occupied(pool).astype(x.dtype)
        h = self.input_layer(
            jnp.concatenate([cubes.reshape(*cubes.shape[:2], -1), full * 2 - 1], -1)
        )
        for name, values in extra.items():
            of_cubes = to_cells(values, pool, plain=self.plain)
            h = h + getattr(self, f"{name}_cube")(of_cubes.reshape(*of_cubes.shape[:2], -1))
        h = self._middle(h, time, tokens, volume, draws, pool.coords, pool.counts)
        out = self.out_layer(layer_norm(h.astype(jnp.float32), 1e-5))
        out = from_cells(out.reshape(*cubes.shape[:3], -1), pool, plain=self.plain)
        if not self.config.voxel_channels:
            return out
        # a token is narrower than its cube's latents: what is fine is read off the voxel itself
        out = out + self.voxel_in(x)
        for name, values in extra.items():
            out = out + getattr(self, f"{name}_voxel")(values)
        return self.voxel_out(jax.nn.gelu(self.voxel_hidden(jax.nn.gelu(out))))

    def _convolve(self, x, time, tokens, volume, draws, coords, counts, plan):
        h = self.input_layer(x)
        skips = []
        for block in self.input_blocks:
            h = block(h, time, plan)
            skips.append(h)
        if plan.pools:
            coords, counts = plan.pools[-1].coords, plan.pools[-1].counts
        h = self._middle(h, time, tokens, volume, draws, coords, counts)
        for block, skip in zip(self.out_blocks, reversed(skips), strict=True):
            h = block(
                jnp.concatenate([h, skip], -1) if self.config.use_skip_connection else h, time, plan
            )
        return self.out_layer(layer_norm(h.astype(jnp.float32), 1e-5))


def _required_views(views: Views) -> tuple[jax.Array, jax.Array]:
    pixels, cameras = views
    if pixels is None or cameras is None:
        raise ValueError(
            "flow: this model reads pictures (pixel_channels > 0); pass views=(pixels, cameras), "
            "of the Condition that encode_images gives"
        )
    return pixels, cameras


def _patchify(x: jax.Array, patch: int) -> jax.Array:
    """[B, r, r, r, C] -> [B, tokens, C p^3], channels before positions (TRELLIS)."""
    items, side, channels = x.shape[0], x.shape[1] // patch, x.shape[-1]
    x = x.reshape(items, side, patch, side, patch, side, patch, channels)
    return x.transpose(0, 1, 3, 5, 7, 2, 4, 6).reshape(items, side**3, -1)


def _unpatchify(x: jax.Array, side: int, patch: int) -> jax.Array:
    items, channels = x.shape[0], x.shape[-1] // patch**3
    x = x.reshape(items, side, side, side, channels, patch, patch, patch)
    return x.transpose(0, 1, 5, 2, 6, 3, 7, 4).reshape(items, *[side * patch] * 3, channels)
