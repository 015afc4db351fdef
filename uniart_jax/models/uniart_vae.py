"""UniArt VAE: voxel features <-> one latent per voxel (paper section 4.1; trunks as TRELLIS's SLAT
encoder and decoder). How geometry and articulation meet in front of the encoder:
``models.aggregation``.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.aggregation import make_front
from uniart_jax.models.layout_decoder import LayoutDecoder, pointed, required
from uniart_jax.models.structure_vae import sample_posterior
from uniart_jax.models.voxel_batch import valid_tokens
from uniart_jax.nn.blocks import TransformerBlock, layer_norm, linear, zeros
from uniart_jax.nn.embeddings import position_embedding
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.nn.stack import run_stack
from uniart_jax.voxels.joint_code import BOX_SIZE, CODE_SIZE
from uniart_jax.voxels.typed_batches import Plans, VoxelBatch

LOGVAR_START = -6.0


class Trunk(nnx.Module):
    """TRELLIS's SparseTransformerBase: Linear, APE, blocks that alternate two window plans, and, if
    asked, LN and Linear.

    Ours, if the config asks for it: ``path``, a linear layer from input to output past all of them.
    What a voxel's latent must hold is on that voxel already, so a short training learns most of it
    there.
    """

    def __init__(self, inputs: int, outputs: int | None, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.uniart_vae, compute_dtype(config)
        self.full = c.attention == "full"
        self.scan_blocks, self.remat = config.scan_blocks, config.remat
        self.input_layer = linear(inputs, c.width, rngs, dtype=dtype)
        self.blocks = nnx.List(
            [
                TransformerBlock(
                    c.width,
                    c.num_heads,
                    c.mlp_ratio,
                    rngs,
                    qk_rms_norm=c.qk_rms_norm,
                    kernel=config.kernel,
                    dtype=dtype,
                )
                for _ in range(c.num_blocks)
            ]
        )
        self.out_layer = None if outputs is None else linear(c.width, outputs, rngs, init=zeros)
        self.path = linear(inputs, outputs or c.width, rngs, dtype=dtype) if c.linear_path else None

    def __call__(
        self,
        x: jax.Array,
        coords: jax.Array,
        plans: Plans,
        counts: jax.Array | None = None,
        added: jax.Array | None = None,
    ) -> jax.Array:
        """x [B, V, C] on coords [B, V, 3] with its window plans, or, where attention is 'full', its
        counts [B].

        ``added`` [B, V, width]: what else the first block is given."""
        if self.full and counts is None:
            raise ValueError("trunk: attention 'full' needs the batch's counts")
        h = self.input_layer(x)
        h = h if added is None else h + added.astype(h.dtype)
        h = h + position_embedding(coords, h.shape[-1]).astype(h.dtype)
        h = run_stack(
            self.blocks,
            lambda block, i, h: block(h, counts if self.full else plans[f"window_{i}"]),
            h,
            scan=self.scan_blocks,
            remat=self.remat,
            period=2,
        )
        h = layer_norm(h.astype(jnp.float32), 1e-5)
        h = h if self.out_layer is None else self.out_layer(h)
        return h if self.path is None else h + self.path(x)


class UniArtVAE(nnx.Module):
    """Methods: ``encode``, ``decode``; calling runs both.

    The batch's ``plans`` hold "parts" (encode with 'uniart' or 'pooling'), "window_0" and
    "window_1" (not with attention 'full'): ``nn.voxel_plans.voxel_plans``.
    """

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.uniart_vae, compute_dtype(config)
        self.cells = config.grid.subdivisions**3
        self.front = make_front(config, rngs)
        self.encoder = Trunk(self.front.channels, 2 * c.latent_channels, config, rngs)
        # a posterior that starts narrow: with TRELLIS's start (variance 1) the code drowns in noise
        # for hundreds of steps
        assert self.encoder.out_layer is not None
        bias = self.encoder.out_layer.bias
        bias.set_value(bias.get_value().at[c.latent_channels :].set(LOGVAR_START))
        self.decoder = Trunk(c.latent_channels, None, config, rngs)
        self.geometry_head = linear(c.width, self.cells * 4, rngs, dtype=dtype)
        self.segmentation_head = linear(c.width, 2 * BOX_SIZE + self.cells, rngs, dtype=dtype)
        self.articulation_head = linear(c.width, CODE_SIZE + BOX_SIZE, rngs, dtype=dtype)
        features = c.part_feature_channels  # a head of its own: weights without it still fit
        self.part_feature_head = linear(c.width, features, rngs, dtype=dtype) if features else None
        self.layout = LayoutDecoder(config, rngs) if c.layout_channels else None

    def encode(self, batch: VoxelBatch) -> dict[str, jax.Array]:
        """Batch -> {"mean", "logvar": [B, V, C]; "geometry", "articulation": the embeddings V_geo
        and V_art}; padding zero."""
        valid = valid_tokens(batch.counts, batch.coords.shape[1])
        features, geometry, articulation = self.front(batch)
        out = self.encoder(features, batch.coords, batch.plans, batch.counts)
        mean, logvar = jnp.split(jnp.where(valid, out.astype(jnp.float32), 0), 2, -1)
        geometry, articulation = (jnp.where(valid, x, 0) for x in (geometry, articulation))
        return {"mean": mean, "logvar": logvar, "geometry": geometry, "articulation": articulation}

    def decode(
        self, latent: jax.Array, batch: VoxelBatch, voxels: jax.Array | None = None
    ) -> dict[str, jax.Array]:
        """Latent [B, V, C] -> attributes of every voxel, or only of ``voxels`` [B, Q] (indices;
        losses draw few).

        Args:
          batch: coords, counts and plans ("window_0", "window_1"); with ``layout_channels`` the
            layout, a ``PartTable``.

        Returns:
          sdf [B, Q, r^3] in sub-cells; color [B, Q, r^3, 3] linear in [0, 1]; part_boxes [B, Q, 2,
          6], of the voxel's part and of another that shares it; other_part [B, Q, r^3], the logit
          of a sub-cell being the other's; own_box [B, Q, r^3, 6], the one or the other; joint_code
          [B, Q, 9]; parent_box [B, Q, 6]; part_feature [B, Q, P] where the model has it. Padding is
          zero. With ``layout_channels``, pointer [B, Q, r^3, N + 1] and rows [B, Q, N]: logits of a
          sub-cell being of each of the voxel's N candidate rows of the layout, or of none; where
          one wins, own_box, joint_code and parent_box are the row's.
        """
        valid = valid_tokens(batch.counts, latent.shape[1])
        latent = jnp.where(valid, latent, 0)
        coords, added = batch.coords, None
        if self.layout is not None:
            table = required(batch.layout)
            added = self.layout.before(table, coords)
        h = self.decoder(latent, coords, batch.plans, batch.counts, added)
        if voxels is not None:
            h = jnp.take_along_axis(h, voxels[..., None], axis=1, mode="clip")
            coords = jnp.take_along_axis(coords, voxels[..., None], axis=1, mode="clip")
            valid = voxels[..., None] < batch.counts[:, None, None]
        h = jnp.where(valid, h, 0)
        lead = h.shape[:2]
        more = None
        if self.layout is not None:
            more = self.layout.after(table, coords, h)
            h = h + more.hidden
        geometry = self.geometry_head(h).astype(jnp.float32)
        geometry = geometry if more is None else geometry + more.geometry
        color = jax.nn.sigmoid(geometry[..., self.cells :]).reshape(*lead, self.cells, 3)
        # a voxel is on one part or shared by two: each sub-cell takes one of two boxes, never a
        # mean of them
        segmentation = self.segmentation_head(h).astype(jnp.float32)
        pair = segmentation[..., : 2 * BOX_SIZE].reshape(*lead, 2, BOX_SIZE)
        other_part = segmentation[..., 2 * BOX_SIZE :]
        own_box = jnp.where(other_part[..., None] > 0, pair[..., 1:, :], pair[..., :1, :])
        articulation = self.articulation_head(h).astype(jnp.float32)
        out = {
            "sdf": geometry[..., : self.cells],
            "color": color,
            "part_boxes": pair,
            "other_part": other_part,
            "own_box": own_box,
            "joint_code": articulation[..., :CODE_SIZE],
            "parent_box": articulation[..., CODE_SIZE:],
        }
        if self.part_feature_head is not None:
            out["part_feature"] = self.part_feature_head(h).astype(jnp.float32)
        if more is not None:
            out |= pointed(table, more, out)
        return {
            k: jnp.where(valid.reshape(*lead, *[1] * (x.ndim - 2)), x, 0) for k, x in out.items()
        }

    def __call__(
        self, batch: VoxelBatch, key: jax.Array | None = None, voxels: jax.Array | None = None
    ) -> dict[str, jax.Array]:
        """Encode, sample the posterior if a key is given, decode: both methods' results and
        "latent"."""
        encoded = self.encode(batch)
        latent = sample_posterior(encoded["mean"], encoded["logvar"], key)
        return {**encoded, "latent": latent, **self.decode(latent, batch, voxels)}
