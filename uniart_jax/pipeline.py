"""Image -> articulated object: the networks of a checkpoint and the voxel decoder behind one call.

    image -> crop -> image encoder -> tokens, volume, pixels and camera
        (inference.samplers.Condition)
    structure flow -> structure VAE decoder -> active voxels
    latent flow on them -> UniArt VAE decoder -> voxels with everything on them -> assemble ->
    object

Each step is a method, so that evaluation can start from the truth at any of them.
"""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import jax
import numpy as np

from uniart_jax.config import (
    LATENT_OF,
    NETWORKS,
    Background,
    Config,
    GridConfig,
    LatentSampleConfig,
    SampleConfig,
    StructureSampleConfig,
)
from uniart_jax.data.background import Way, cut_out
from uniart_jax.data.images import crop, read_image
from uniart_jax.export.picture_colors import Picture
from uniart_jax.flow.solvers import Solution
from uniart_jax.inference.layouts import LayoutPredictor
from uniart_jax.inference.masks import MaskPredictor, load_mask_predictor
from uniart_jax.inference.samplers import (
    flow_inputs,
    join_views,
    make_conditioner,
    make_latent_sampler,
    make_structure_decoder,
    make_structure_sampler,
    pad_coords,
)
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.gaussian_decoder import gaussian_parameters
from uniart_jax.models.network import build
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.grid import PartGrid, VoxelGrid, smoothed
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE
from uniart_jax.voxels.kind import Kind, kind_of
from uniart_jax.voxels.layout import THRESHOLD, Layout, read_layout
from uniart_jax.voxels.part_table import EMPTY, PartTable, part_table
from uniart_jax.voxels.typed_batches import Condition, VoxelBatch


class SamplingOptions(TypedDict, total=False):
    """Fields of ``config.SampleConfig`` to sample with; None, or absent: as the checkpoint has
    them."""

    steps: int | None
    guidance: float | None
    guidance_interval: tuple[float, float] | None
    rescale_t: float | None
    solver: Literal["euler", "heun"] | None
    adaptive: bool | None
    tolerance: float | None


@dataclasses.dataclass(frozen=True)
class Sample:
    """A sampled object and how. ``picture``: the (first) image with the camera that was estimated
    for it. Of both flows ("structure", "latent") the options, the velocities that were asked for
    (with guidance each is one call of the network on twice the batch) and the adaptive steps whose
    error was above the tolerance (``flow.solvers.Solution``). ``background``: how the object was
    cut out of each image (``data.background``); ``cut``: each image so cut out, [H, W, 4] uint8.
    ``layout``: what it follows, if anything."""

    obj: ArticulatedObject
    options: dict[str, SampleConfig]
    evaluations: dict[str, int]
    forced: dict[str, int]
    picture: Picture | None = None
    background: tuple[str, ...] = ()
    cut: tuple[np.ndarray, ...] = ()
    layout: Layout | None = None

    @property
    def kind(self) -> Kind:
        """The kind of thing that its parts are likest to."""
        return kind_of(self.layout or Layout.of_object(self.obj))


class Pipeline:
    """A trained model.

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
    def of(cls, checkpoint: Checkpoint, networks: Sequence[str] = NETWORKS) -> Pipeline:
        """Some networks of a checkpoint, with the statistics of the latents that they sample.

        Raises:
          FileNotFoundError, ValueError: as ``Checkpoint.load`` and ``Checkpoint.statistics``.
        """
        parameters = {name: checkpoint.load(name) for name in networks}
        latents = [LATENT_OF[name] for name in networks if name in LATENT_OF]
        statistics = {latent: checkpoint.statistics(latent) for latent in latents}
        return cls(checkpoint.config, parameters, statistics, checkpoint)

    def __repr__(self) -> str:
        names, where = ", ".join(self.parameters), "memory"
        if self.checkpoint is not None:
            where = self.checkpoint.folder
            names += ", and a layout network" if self.checkpoint.has("layout") else ""
        count = sum(leaf.size for leaf in jax.tree.leaves(self.parameters))
        side, cells = self.config.model.grid.resolution, self.config.model.grid.subdivisions
        return (
            f"Pipeline({self.config.name}: {count / 1e6:.1f} million parameters in {names}; "
            f"{side}^3 voxels of {cells}^3 sub-cells; from {where})"
        )

    def __call__(
        self,
        image: str | Path | np.ndarray | Sequence[str | Path | np.ndarray],
        *,
        seed: int = 0,
        name: str = "object",
        layout: Layout | bool = True,
        background: Background = "auto",
        progress: Callable[[str], None] = lambda step: None,
        steps: int | None = None,
        guidance: float | None = None,
        guidance_interval: tuple[float, float] | None = None,
        rescale_t: float | None = None,
        solver: Literal["euler", "heun"] | None = None,
        adaptive: bool | None = None,
        tolerance: float | None = None,
    ) -> ArticulatedObject:
        """The object alone of ``sample``, which see."""
        return self.sample(
            image,
            seed=seed,
            name=name,
            layout=layout,
            background=background,
            progress=progress,
            steps=steps,
            guidance=guidance,
            guidance_interval=guidance_interval,
            rescale_t=rescale_t,
            solver=solver,
            adaptive=adaptive,
            tolerance=tolerance,
        ).obj

    def sample(
        self,
        image: str | Path | np.ndarray | Sequence[str | Path | np.ndarray],
        *,
        seed: int = 0,
        name: str = "object",
        layout: Layout | bool = True,
        background: Background = "auto",
        progress: Callable[[str], None] = lambda step: None,
        steps: int | None = None,
        guidance: float | None = None,
        guidance_interval: tuple[float, float] | None = None,
        rescale_t: float | None = None,
        solver: Literal["euler", "heun"] | None = None,
        adaptive: bool | None = None,
        tolerance: float | None = None,
    ) -> Sample:
        """One image (or several views of one object) to an object.

        Args:
          image: path, or [H, W, 3 or 4] uint8 sRGB; a sequence of them = several views.
          seed: same seed, same object. Flows that take one step give their mean, whatever the seed.
          layout: parts, joints and tree that the object follows (``voxels.follow``): a layout in
            the image's frame and state; True = what the checkpoint's layout network finds in the
            (first) image, where it has one; False = they are read off the voxels.
          background: how the object is cut out of the image (``data.background.cut_out``).
          progress: called with the name of each step.
          steps, guidance, guidance_interval, rescale_t, solver, adaptive, tolerance: of both flows
            (``config.SampleConfig``); None = as the checkpoint has them.

        Raises:
          FileNotFoundError, ValueError: an image cannot be used, no object was found in it, or the
            checkpoint is not trained so far.
        """
        if untrained := self.config.untrained:
            more = "" if len(untrained) <= 3 else f" and {len(untrained) - 3} more"
            raise ValueError(
                f"this checkpoint is not trained yet ({', '.join(untrained[:3])}{more}): train it "
                "first (--init), or use sample_structure, sample_latents and gaussians"
            )
        single = isinstance(image, (str, Path, np.ndarray))
        views: list[Any] = [image] if single else list(image)
        if not views:
            raise ValueError("sample: no image; give one, or several views of one object")
        structure_options, latent_options = self.options(
            steps=steps,
            guidance=guidance,
            guidance_interval=guidance_interval,
            rescale_t=rescale_t,
            solver=solver,
            adaptive=adaptive,
            tolerance=tolerance,
        )
        progress("looking at the image")
        cut = [self.cut_out(view, background) for view in views]
        shown = [picture for picture, _ in cut]
        pixels = np.stack([self._crop(view) for view in shown])
        found = self._find_layout(shown[0]) if layout is True else layout or None
        condition = self.following(join_views(self.encode_images(pixels)), [found])
        keys = jax.random.split(jax.random.key(seed))
        progress("structure")
        structure = self.solve_structure(condition, keys[0], structure_options)
        coords = self.active_voxels(structure.x, condition, structure_options)[0]
        if len(coords) == 0:
            raise ValueError(f"{name}: the model found no object in the image; crop to the object")
        progress(f"{len(coords)} voxels")
        solution = self.solve_latents([coords], condition, keys[1], latent_options)
        progress("parts and joints")
        latent = np.asarray(solution.x)[0, : len(coords)]
        grid = self.decode_sampled(coords, latent, latent_options, found)
        flows = {"structure": structure, "latent": solution}
        return Sample(
            assemble(grid, name=name, tolerance=NETWORK_TOLERANCE)
            if found is None
            else assemble_layout(grid, found, name=name),
            {"structure": structure_options, "latent": latent_options},
            {flow: int(solved.evaluations[0]) for flow, solved in flows.items()},
            {flow: int(solved.forced[0]) for flow, solved in flows.items()},
            self._picture(shown[0], found, condition),
            tuple(way for _, way in cut),
            tuple(shown),
            found,
        )

    def _picture(
        self, cut_out: np.ndarray, layout: Layout | None, condition: Condition
    ) -> Picture | None:
        """An image [H, W, 4] with its camera: the layout's, else the image encoder's; None where
        neither has one."""
        if layout is not None and layout.camera is not None:
            camera = layout.camera
        elif condition.cameras is not None:
            camera = np.asarray(condition.cameras)[0, 0]
        else:
            return None
        margin = self.config.model.image_encoder.crop_margin
        return Picture.of(cut_out, camera, margin)

    def layout(self, image: str | Path | np.ndarray, threshold: float = THRESHOLD) -> Layout:
        """The object's parts as a table, found by the checkpoint's layout network
        (``voxels.layout``).

        Args:
          image: path, or [H, W, 3 or 4] uint8 sRGB. threshold: least confidence of a part that is
            kept.

        Raises:
          FileNotFoundError, ValueError: the image cannot be used, or the checkpoint has no layout
            network.
        """
        if not self.config.model.layout.queries:
            raise ValueError(
                "layout: this checkpoint has no layout network; train one with --stage layout"
            )
        return self._read_layout(self.cut_out(image)[0], threshold)

    def find_layout(
        self, image: str | Path | np.ndarray, background: Background = "auto"
    ) -> Layout | None:
        """``layout`` of an image; None where the checkpoint has no layout network."""
        return self._find_layout(self.cut_out(image, background)[0])

    def _find_layout(self, cut_out: np.ndarray) -> Layout | None:
        there = self.checkpoint is not None and self.checkpoint.has("layout")
        return self._read_layout(cut_out) if there and self.config.model.layout.queries else None

    def following(self, condition: Condition, layouts: Sequence[Layout | None]) -> Condition:
        """The condition of B images with their layouts for flows that see them
        (``FlowConfig.layout_channels``); None: flows are to do without."""
        model = self.config.model
        if not (model.structure_flow.layout_channels or model.latent_flow.layout_channels):
            return condition
        return condition._replace(layout=self._part_table(layouts, len(condition.tokens)))

    def _part_table(self, layouts: Sequence[Layout | None], items: int) -> PartTable:
        most = self.config.model.grid.max_parts
        if len(layouts) != items:
            raise ValueError(
                f"layout: {len(layouts)} layouts of {items} images; give one each, or None"
            )
        rows = [EMPTY if item is None else item.rows(most) for item in layouts]
        return part_table(rows, most)

    def _read_layout(self, cut_out: np.ndarray, threshold: float = THRESHOLD) -> Layout:
        predictor = self._layout_predictor
        picture = crop(cut_out, predictor.image_size, predictor.crop_margin)
        return read_layout(predictor([picture])[0], threshold)

    @functools.cached_property
    def mask_predictor(self) -> MaskPredictor | None:
        """The checkpoint's mask network in use, where it has one."""
        return load_mask_predictor(self.checkpoint)

    @functools.cached_property
    def _layout_predictor(self) -> LayoutPredictor:
        if self.checkpoint is None:
            raise ValueError("layout: this pipeline was not loaded from a checkpoint")
        return LayoutPredictor(self.config.model, self.checkpoint.load("layout"))

    def options(
        self, **changes: Unpack[SamplingOptions]
    ) -> tuple[StructureSampleConfig, LatentSampleConfig]:
        """The checkpoint's sampling options, changed where asked (``SampleConfig``'s fields); None
        = as they are.

        Raises:
          ValueError: no option of both flows, or a value that cannot be.
        """
        known = [field.name for field in dataclasses.fields(SampleConfig)]
        if unknown := [name for name in changes if name not in known]:
            raise ValueError(f"sampling has no option '{unknown[0]}'; there are {', '.join(known)}")
        asked = {name: value for name, value in changes.items() if value is not None}
        replace = dataclasses.replace
        structure, latent = self.config.sample_structure, self.config.sample_latent
        return replace(structure, **asked), replace(latent, **asked)

    def prepare(self, image: str | Path | np.ndarray) -> np.ndarray:
        """[S, S, 3] float32 in [0, 1]: read, foreground, square crop, on black."""
        return self._crop(self.cut_out(image)[0])

    def _crop(self, cut_out: np.ndarray) -> np.ndarray:
        encoder = self.config.model.image_encoder
        cut = crop(cut_out, encoder.image_size, encoder.crop_margin)
        return cut.astype(np.float32) / 255

    def cut_out(
        self, image: str | Path | np.ndarray, background: Background = "auto"
    ) -> tuple[np.ndarray, Way]:
        """[H, W, 4] uint8: read, background cut away; and how (``data.background.cut_out``).

        Raises:
          FileNotFoundError, ValueError: the image cannot be used.
        """
        name = "image" if isinstance(image, np.ndarray) else f"image '{image}'"
        pixels = image if isinstance(image, np.ndarray) else read_image(image)
        if pixels.ndim != 3 or pixels.shape[-1] not in (3, 4) or pixels.dtype != np.uint8:
            raise ValueError(
                f"{name}: expected [H, W, 3 or 4] uint8, got {pixels.shape} {pixels.dtype}"
            )
        if pixels.shape[-1] == 3:
            pixels = np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
        return cut_out(pixels, background, name, lambda: self.mask_predictor)

    def encode_images(self, images: np.ndarray) -> Condition:
        """[B, S, S, 3] in [0, 1] -> what the flows see of them."""
        return self._encode_images(self.parameters["image_encoder"], images)

    def sample_structure(
        self, condition: Condition, key: jax.Array, options: StructureSampleConfig | None = None
    ) -> list[np.ndarray]:
        """Active voxels [V_i, 3] of each item (``active_voxels``)."""
        latent = self.solve_structure(condition, key, options).x
        return self.active_voxels(latent, condition, options)

    def solve_structure(
        self, condition: Condition, key: jax.Array, options: StructureSampleConfig | None = None
    ) -> Solution:
        """Structure latents [B, s, s, s, C] and what they cost."""
        sampler = self._structure_sampler(options or self.config.sample_structure)
        parameters = self.parameters["structure_flow"]
        return sampler(parameters, self.statistics["structure"], condition, key)

    def active_voxels(
        self,
        latent: jax.Array,
        condition: Condition,
        options: StructureSampleConfig | None = None,
    ) -> list[np.ndarray]:
        """Structure latents, and the condition that they were sampled with -> active voxels [V_i,
        3] of each item; at most as many as the largest bucket holds, the most certain first."""
        options = options or self.config.sample_structure
        parameters = (self.parameters[name] for name in ("structure_vae", "structure_flow"))
        logits = np.asarray(self._decode_structure(*parameters, latent, condition))
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
        layouts: Sequence[Layout | None] = (),
    ) -> list[VoxelGrid]:
        """Latents [V_i, C] on voxels [V_i, 3] -> voxel grids.

        Args:
          layouts: of the items, for a decoder that sees them (``UniArtVAEConfig.layout_channels``);
            none are known without.
        """
        latent, batch = self._padded(coords, latents)
        if self.config.model.uniart_vae.layout_channels:
            table = self._part_table(list(layouts) or [None] * len(coords), len(coords))
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

    def decode_sampled(
        self,
        coords: np.ndarray,
        latent: np.ndarray,
        options: LatentSampleConfig | None = None,
        layout: Layout | None = None,
    ) -> VoxelGrid:
        """One item of ``decode``, thickened and smoothed as ``sample_latent`` says
        (``voxels.grid.smoothed``)."""
        options = options or self.config.sample_latent
        grid = self.decode([coords], [latent], [layout])[0]
        return smoothed(grid, options.sdf_offset, options.sdf_blur, options.sdf_blur_along)

    @functools.cached_property
    def _encode_images(self):
        return make_conditioner(self.config.model)

    @functools.cached_property
    def _decode_structure(self):
        return make_structure_decoder(self.config.model)

    @functools.cached_property
    def _decode_voxels(self):
        return jax.jit(
            functools.partial(build("uniart_vae", self.config.model).apply, method="decode")
        )

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
        return make_structure_sampler(self.config.model, options)

    @functools.lru_cache(maxsize=4)  # noqa: B019
    def _latent_sampler(self, options: SampleConfig):
        return make_latent_sampler(self.config.model, options)


def voxel_grid(
    decoded: dict[str, np.ndarray], item: int, coords: np.ndarray, grid: GridConfig
) -> VoxelGrid:
    """One item of what the UniArt VAE decodes (padded arrays, on the host), on its voxels [V,
    3]."""
    names = ("sdf", "color", "own_box", "joint_code", "parent_box")
    values = (decoded[name][item, : len(coords)] for name in names)
    return VoxelGrid(grid.resolution, grid.subdivisions, coords, *values)


def load(checkpoint: str | Path = "nano") -> Pipeline:
    """A model by name (shipped: "nano"), export folder, training WORKDIR, or ``hf:ORG/NAME``.

    Raises:
      FileNotFoundError: no such checkpoint, or networks are missing in it; all of them are named.
      ValueError: it is truncated, of another config, or not finite; all differences are listed.
    """
    found = Checkpoint.find(checkpoint)
    if missing := [f"{name}.safetensors" for name in NETWORKS if not found.has(name)]:
        raise FileNotFoundError(
            f"checkpoint '{checkpoint}': no {', '.join(missing)} in it; finish the training stages "
            "that write them, or convert them too"
        )
    return Pipeline.of(found)


def enable_compilation_cache() -> None:
    """Keep compiled programs between runs, in the user's cache folder; programs call this, the
    library does not."""
    if jax.config.jax_compilation_cache_dir is None:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
        jax.config.update("jax_compilation_cache_dir", str(base / "uniart_jax" / "xla"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
