"""A model's trained networks in use, one after the other, as arrays on the host.

    images -> what the flows see of them -> structure latent -> active voxels -> UniArt latents ->
    voxel grids

``pipeline.Pipeline`` adds the steps from a picture to them, and from voxels to an object.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, Self

import jax
import numpy as np

from uniart_jax.config import (
    LATENT_OF,
    NETWORKS,
    Config,
    GridConfig,
    SampleConfig,
    StructureSampleConfig,
)
from uniart_jax.flow.solvers import Solution
from uniart_jax.inference.samplers import (
    flow_inputs,
    make_conditioner,
    make_latent_sampler,
    make_structure_decoder,
    make_structure_sampler,
    pad_coords,
    reads_layout_cameras,
    with_first_view_cameras,
)
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.gaussian_decoder import gaussian_parameters
from uniart_jax.models.network import build, kept_of_model
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.voxels.grid import PartGrid, VoxelGrid
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.part_table import EMPTY, PartTable, part_table
from uniart_jax.voxels.typed_batches import Condition, VoxelBatch


class Networks:
    """The networks of a checkpoint.

    Attributes:
      config: of the checkpoint.
      parameters: network name -> nested dict of float32 arrays.
      statistics: "structure", "latent" -> (mean, std).
      checkpoint: where the networks come from; optional ones are read from it when they are first
        asked for.
    """

    def __init__(
        self,
        config: Config,
        parameters: dict[str, Any],
        statistics: dict[str, Any],
        checkpoint: Checkpoint | None = None,
    ):
        self.config, self.parameters, self.statistics = config, parameters, statistics
        self.checkpoint = checkpoint

    @classmethod
    def of(cls, checkpoint: Checkpoint, networks: Sequence[str] = NETWORKS) -> Self:
        """Some networks of a checkpoint, with the statistics of the latents that they sample.

        Raises:
          FileNotFoundError, ValueError: as ``Checkpoint.load`` and ``Checkpoint.statistics``.
        """
        parameters = {name: checkpoint.load(name) for name in networks}
        latents = [LATENT_OF[name] for name in networks if name in LATENT_OF]
        statistics = {latent: checkpoint.statistics(latent) for latent in latents}
        return cls(checkpoint.config, parameters, statistics, checkpoint)

    def encode_images(self, images: np.ndarray) -> Condition:
        """[B, S, S, 3] in [0, 1] -> what the flows see of them."""
        return self._encode_images(self.parameters["image_encoder"], images)

    def following(self, condition: Condition, layouts: Sequence[Layout | None]) -> Condition:
        """The condition of B images with their layouts for flows that see them
        (``FlowConfig.layout_channels``), and their cameras (``cameras_of``); None: flows are to do
        without."""
        model = self.config.model
        condition = with_first_view_cameras(condition, self.cameras_of(layouts))
        if not (model.structure_flow.layout_channels or model.latent_flow.layout_channels):
            return condition
        return condition._replace(layout=self.part_table(layouts, len(condition.tokens)))

    def cameras_of(self, layouts: Sequence[Layout | None]) -> list[np.ndarray | None]:
        """Camera codes [7] of the layouts through which flows see the first view of each image
        (``samplers.reads_layout_cameras``); None: through the image encoder's."""
        reads = reads_layout_cameras(self.config.model)
        return [one.camera if reads and one is not None else None for one in layouts]

    def sample_structure(
        self, condition: Condition, key: jax.Array, options: StructureSampleConfig | None = None
    ) -> list[np.ndarray]:
        """Active voxels [V_i, 3] of each item (``active_voxels``)."""
        latent = self.solve_structure(condition, key, options).x
        return self.active_voxels(self.structure_logits(latent, condition), options)

    def solve_structure(
        self, condition: Condition, key: jax.Array, options: StructureSampleConfig | None = None
    ) -> Solution:
        """Structure latents [B, s, s, s, C] and what they cost."""
        sampler = self._structure_sampler(options or self.config.sample_structure)
        parameters = self.parameters["structure_flow"]
        return sampler(parameters, self.statistics["structure"], condition, key)

    def structure_logits(self, latent: jax.Array, condition: Condition) -> np.ndarray:
        """Structure latents, and the condition that they were sampled with -> occupancy logits [B,
        R, R, R]."""
        parameters = (self.parameters[name] for name in ("structure_vae", "structure_flow"))
        return np.asarray(self._decode_structure(*parameters, latent, condition))

    def active_voxels(
        self, logits: np.ndarray, options: StructureSampleConfig | None = None
    ) -> list[np.ndarray]:
        """Occupancy logits [B, R, R, R] -> active voxels [V_i, 3] of each item; at most as many as
        the largest bucket holds, the most certain first."""
        options = options or self.config.sample_structure
        most = max(self.config.data.voxel_buckets)
        found = []
        for item in logits - options.threshold:
            if (item > 0).sum() > most:
                item = np.where(item >= np.partition(item, -most, axis=None)[-most], item, -1.0)
            found.append(np.argwhere(item > 0).astype(np.int32)[:most])
        return found

    def sample_latents(
        self,
        coords: Sequence[np.ndarray],
        condition: Condition,
        key: jax.Array,
        options: SampleConfig | None = None,
    ) -> list[np.ndarray]:
        """UniArt latents [V_i, C] on the active voxels of each item."""
        latent = np.asarray(self.solve_latents(coords, condition, key, options).x)
        return [row[: len(voxels)] for row, voxels in zip(latent, coords, strict=True)]

    def solve_latents(
        self,
        coords: Sequence[np.ndarray],
        condition: Condition,
        key: jax.Array,
        options: SampleConfig | None = None,
    ) -> Solution:
        """UniArt latents [B, V, C] on the active voxels of each item, padded, and what they
        cost."""
        padded, counts = pad_coords(coords, self.config.data.voxel_buckets)
        voxels = flow_inputs(padded, counts, self.config.model)
        sampler = self._latent_sampler(options or self.config.sample_latent)
        parameters = self.parameters["latent_flow"]
        return sampler(parameters, self.statistics["latent"], condition, key, voxels)

    def encode_voxels(
        self,
        grid: PartGrid,
        visual: np.ndarray | None = None,
        part_feature: np.ndarray | None = None,
    ) -> np.ndarray:
        """UniArt latent mean [V, C] of a true grid.

        Args:
          visual, part_feature: [V, F], [V, P] features of its voxels, where the model reads them
            (``data.columns``).

        Raises:
          ValueError: the grid has more parts than the model holds, or features are missing or of
            another shape.
        """
        model = self.config.model
        given = {"visual": visual, "part_feature": part_feature}
        features: dict[str, np.ndarray] = {}
        for name, channels in model.uniart_vae.feature_channels.items():
            values = given[name]
            if values is None or values.shape != (len(grid.coords), channels):
                got = "none" if values is None else list(values.shape)
                raise ValueError(
                    f"voxels: this model reads {name} [{len(grid.coords)}, {channels}] with them, "
                    f"got {got}"
                )
            features[name] = values
        coords, counts = pad_coords([grid.coords], self.config.data.voxel_buckets)
        width, count, parts_held = coords.shape[1], counts[0], model.grid.max_parts
        if (parts := len(grid.boxes)) > parts_held:
            raise ValueError(f"voxels: {parts} parts, the model holds {parts_held}")

        def pad(values, rows, dtype):
            return np.concatenate([values, np.zeros((rows - len(values), *values.shape[1:]))])[
                None
            ].astype(dtype)

        voxel_part = pad(grid.voxel_part, width, "i4")
        padded: dict[str, Any] = {n: pad(values, width, "f4") for n, values in features.items()}
        plans = voxel_plans(
            coords, counts, model.uniart_vae, model.grid, voxel_part=voxel_part, fitted=True
        )
        batch = VoxelBatch(
            coords,
            counts,
            voxel_part,
            sdf=pad(grid.sdf, width, "f4"),
            color=pad(grid.color, width, "f4"),
            owner=pad(grid.owner, width, "i4"),
            boxes=pad(grid.boxes, parts_held, "f4"),
            codes=pad(grid.codes, parts_held, "f4"),
            parents=pad(grid.parents, parts_held, "i4"),
            plans=plans,
            **padded,
        )
        return np.asarray(self._encode_voxels(self.parameters["uniart_vae"], batch))[0, :count]

    def decode(
        self,
        coords: Sequence[np.ndarray],
        latents: Sequence[np.ndarray],
        layouts: Sequence[Layout | None] | PartTable = (),
    ) -> list[VoxelGrid]:
        """Latents [V_i, C] on voxels [V_i, 3] -> voxel grids.

        Args:
          layouts: of the items, or their table, for a decoder that sees them
            (``UniArtVAEConfig.layout_channels``); none are known without.
        """
        latent, batch = self._padded(coords, latents)
        if self.config.model.uniart_vae.layout_channels:
            table = layouts
            if not isinstance(table, PartTable):
                table = self.part_table(list(table) or [None] * len(coords), len(coords))
            batch = batch._replace(layout=table)
        out = jax.device_get(self._decode_voxels(self.parameters["uniart_vae"], latent, batch))
        grid, kept = self.config.model.grid, zip(batch.coords, batch.counts, strict=True)
        return [voxel_grid(out, b, voxels[:count], grid) for b, (voxels, count) in enumerate(kept)]

    def gaussians(
        self, coords: Sequence[np.ndarray], latents: Sequence[np.ndarray]
    ) -> list[dict[str, np.ndarray]]:
        """Latents [V_i, C] on voxels [V_i, 3] -> raw 3D Gaussians of each item
        (``models.gaussian_decoder.gaussian_parameters``).

        Raises:
          FileNotFoundError: the checkpoint has no Gaussian decoder.
          ValueError: its file is truncated, of another config or not finite.
        """
        if "gaussian_decoder" not in self.parameters:
            if self.checkpoint is None or not self.checkpoint.has("gaussian_decoder"):
                where = self.checkpoint.folder if self.checkpoint else "in memory"
                raise FileNotFoundError(
                    f"checkpoint {where}: no gaussian_decoder.safetensors; only checkpoints "
                    "converted from TRELLIS have one"
                )
            self.parameters["gaussian_decoder"] = self.checkpoint.load("gaussian_decoder")
        latent, batch = self._padded(coords, latents)
        out = jax.device_get(
            self._decode_gaussians(self.parameters["gaussian_decoder"], latent, batch)
        )
        each = self.config.model.gaussians.num_gaussians
        return [
            {name: values[b, : count * each] for name, values in out.items()}
            for b, count in enumerate(batch.counts)
        ]

    def _padded(
        self, coords: Sequence[np.ndarray], latents: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, VoxelBatch]:
        """Latents [B, V, C] and the batch that the voxel decoders read."""
        model = self.config.model
        padded, counts = pad_coords(coords, self.config.data.voxel_buckets)
        latent = np.zeros((*padded.shape[:2], model.uniart_vae.latent_channels), np.float32)
        for b, values in enumerate(latents):
            latent[b, : len(values)] = values
        plans = voxel_plans(padded, counts, model.uniart_vae, model.grid, fitted=True)
        return latent, VoxelBatch(padded, counts, plans=plans)

    def part_table(self, layouts: Sequence[Layout | None], items: int) -> PartTable:
        """The layouts of some items as the networks see them; None: not known.

        Raises:
          ValueError: another number of layouts, or one of more parts than the model holds.
        """
        most = self.config.model.grid.max_parts
        if len(layouts) != items:
            raise ValueError(
                f"layout: {len(layouts)} layouts of {items} images; give one each, or None"
            )
        rows = [EMPTY if item is None else item.rows(most) for item in layouts]
        return part_table(rows, most)

    @functools.cached_property
    def _encode_images(self):
        model = self.config.model
        return kept_of_model(make_conditioner(model), "conditioner", model)

    @functools.cached_property
    def _decode_structure(self):
        model = self.config.model
        return kept_of_model(make_structure_decoder(model), "structure decoder", model)

    @functools.cached_property
    def _decode_voxels(self):
        model = self.config.model
        decode = jax.jit(functools.partial(build("uniart_vae", model).apply, method="decode"))
        return kept_of_model(decode, "voxel decoder", model)

    @functools.cached_property
    def _decode_gaussians(self):
        model = self.config.model
        network = build("gaussian_decoder", model)

        @jax.jit
        def run(params, latent, batch):
            raw = network.apply(params, latent, batch)
            return gaussian_parameters(raw, batch.coords, model.gaussians, model.grid.resolution)

        return run

    @functools.cached_property
    def _encode_voxels(self):
        network = build("uniart_vae", self.config.model)
        return jax.jit(lambda params, batch: network.apply(params, batch, method="encode")["mean"])

    @functools.lru_cache(maxsize=4)  # noqa: B019  one pipeline lives as long as the program
    def _structure_sampler(self, options: SampleConfig):
        model = self.config.model
        sampler = make_structure_sampler(model, options)
        return kept_of_model(sampler, "structure sampler", model, options)

    @functools.lru_cache(maxsize=4)  # noqa: B019
    def _latent_sampler(self, options: SampleConfig):
        model = self.config.model
        sampler = make_latent_sampler(model, options)
        return kept_of_model(sampler, "latent sampler", model, options)


def voxel_grid(
    decoded: dict[str, np.ndarray], item: int, coords: np.ndarray, grid: GridConfig
) -> VoxelGrid:
    """One item of what the UniArt VAE decodes (padded arrays, on the host), on its voxels [V,
    3]."""
    names = ("sdf", "color", "own_box", "joint_code", "parent_box")
    values = (decoded[name][item, : len(coords)] for name in names)
    return VoxelGrid(grid.resolution, grid.subdivisions, coords, *values)
