"""Image -> articulated object: the networks of a checkpoint and the voxel decoder behind one call.

    image -> mask network -> crop -> layout network -> boxes, joints and tree (voxels.layout)
    crop -> image encoder -> tokens, volume, pixels and camera (inference.samplers.Condition)
    structure flow -> structure VAE decoder -> active voxels
    latent flow on them -> UniArt VAE decoder -> voxels with everything on them
    voxels.follow, or voxels.assemble where there is no layout -> object

Each step is a method, so that evaluation can start from the truth at any of them.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Unpack

import jax
import numpy as np

from uniart_jax.config import (
    NETWORKS,
    Background,
    LatentSampleConfig,
    SampleConfig,
    StructureSampleConfig,
)
from uniart_jax.data.background import Way, cut_out
from uniart_jax.data.images import crop, read_image
from uniart_jax.data.layout_renders import render_layout
from uniart_jax.export.picture_colors import Picture
from uniart_jax.export.size import typical_scale
from uniart_jax.inference.ask_layout import Ask, ask_layout
from uniart_jax.inference.camera_fit import with_camera
from uniart_jax.inference.layouts import LayoutPredictor
from uniart_jax.inference.masks import MaskPredictor, load_mask_predictor
from uniart_jax.inference.mirror_average import encode_views, find_grid, find_voxels
from uniart_jax.inference.networks import Networks
from uniart_jax.inference.sample import Sample, SamplingOptions
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build
from uniart_jax.objects.object import ArticulatedObject, bounds_at
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.follow import assemble_layout
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE
from uniart_jax.voxels.kind import Kind, kind_of
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.part_table import THRESHOLD
from uniart_jax.voxels.read_layout import read_layout
from uniart_jax.voxels.typed_batches import Condition
from uniart_jax.voxels.usual_boards import with_usual_boards


class Pipeline(Networks):
    """A trained model: its networks (``inference.networks``), and what they make of a picture."""

    def __repr__(self) -> str:
        sizes, where = dict(self.parameters), "memory"
        if self.checkpoint is not None:
            where = self.checkpoint.folder
            for name in self.config.model.networks():
                if name not in sizes and self.checkpoint.has(name):  # read when first asked for
                    sizes[name] = build(name, self.config.model).abstract()
        count = sum(leaf.size for leaf in jax.tree.leaves(sizes))
        side, cells = self.config.model.grid.resolution, self.config.model.grid.subdivisions
        return (
            f"Pipeline({self.config.name}: {count / 1e6:.1f} million parameters "
            f"in {', '.join(sizes)}; {side}^3 voxels of {cells}^3 sub-cells; from {where})"
        )

    def __call__(
        self,
        image: str | Path | np.ndarray | Sequence[str | Path | np.ndarray] | None = None,
        *,
        seed: int = 0,
        name: str = "object",
        layout: Layout | bool = True,
        background: Background = "auto",
        progress: Callable[[str], None] = lambda step: None,
        **options: Unpack[SamplingOptions],
    ) -> ArticulatedObject:
        """The object alone of ``sample``, which see."""
        return self.sample(
            image,
            seed=seed,
            name=name,
            layout=layout,
            background=background,
            progress=progress,
            **options,
        ).obj

    def sample(
        self,
        image: str | Path | np.ndarray | Sequence[str | Path | np.ndarray] | None = None,
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
        mirrored: bool | None = None,
        structure: Mapping[str, Any] | None = None,
        latent: Mapping[str, Any] | None = None,
    ) -> Sample:
        """One image (or several views of one object) to an object.

        Args:
          image: path, or [H, W, 3 or 4] uint8 sRGB; a sequence of them = several views. None: a
            plain picture of ``layout`` (``data.layout_renders``), whose lengths may be metres.
          seed: same seed, same object, on the same number of cores of the same kind (elsewhere
            sums are rounded in another order: meshes differ a little, and textures are laid out
            otherwise). Flows that take one step give their mean, whatever the seed.
          layout: parts, joints and tree that the object follows (``voxels.follow``), at the state
            that the image shows, its camera found where it has none (``inference.camera_fit``);
            True = what the layout network finds in the (first) image, where there is one; False =
            they are read off the voxels.
          background: how the object is cut out of the image (``data.background.cut_out``).
          progress: called with the name of each step.
          steps, guidance, guidance_interval, rescale_t, solver, adaptive, tolerance, mirrored: of
            both flows (``config.SampleConfig``); None = as the checkpoint has them.
          structure, latent: the same of one flow alone, as ``{"steps": 3}``, which come before
            those of both; also what that flow alone has (``config.StructureSampleConfig``,
            ``LatentSampleConfig``).

        Raises:
          FileNotFoundError, ValueError: an image cannot be used, no object was found in it,
            ``background`` is no way to cut it out, an option is unknown or cannot be, or the
            checkpoint is not trained so far.
        """
        if untrained := self.config.untrained:
            more = "" if len(untrained) <= 3 else f" and {len(untrained) - 3} more"
            raise ValueError(
                f"this checkpoint is not trained yet ({', '.join(untrained[:3])}{more}): train it "
                "first (--init), or use sample_structure, sample_latents and gaussians"
            )
        side, most = None, self._most_parts
        if isinstance(layout, Layout) and len(layout) > most:
            raise ValueError(f"layout: {len(layout)} parts; this checkpoint takes {most} at most")
        if alone := image is None:
            if not isinstance(layout, Layout):
                raise ValueError("sample: give an image, a layout, or both")
            progress("drawing the layout")
            told, longest = layout.normalized()
            side = longest if layout.metres else layout.size
            image, camera = render_layout(told)
            layout = dataclasses.replace(with_usual_boards(told, side or 1.0), camera=camera)
            background = "keep"
        elif isinstance(layout, Layout):
            side = layout.size
            if layout.metres or layout.camera is None:
                plain, longest = layout.normalized()
                side = longest if layout.metres else side
                layout = dataclasses.replace(plain, camera=layout.camera)
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
            mirrored=mirrored,
            structure=structure,
            latent=latent,
        )
        if not alone:
            progress("looking at the image")
        cut = [self.cut_out(view, background) for view in views]
        shown = [picture for picture, _ in cut]
        pixels = np.stack([self._crop(view) for view in shown])
        found = self._followed(layout, shown[0])
        conditions = encode_views(self, pixels, found, structure_options, latent_options)
        keys = jax.random.split(jax.random.key(seed))
        progress("structure")
        coords, occupied = find_voxels(self, conditions, keys[0], structure_options)
        if len(coords) == 0:
            why = "made no object of the layout" if alone else "found no object in the image"
            raise ValueError(f"{name}: the model {why}{'' if alone else '; crop to the object'}")
        progress(f"{len(coords)} voxels")
        grid, solution = find_grid(self, coords, conditions, keys[1], latent_options, found)
        progress("parts and joints")
        flows = {"structure": occupied, "latent": solution}
        if found is None:
            obj = assemble(grid, name=name, tolerance=NETWORK_TOLERANCE)
        else:
            obj = assemble_layout(grid, found, name=name)
        return Sample(
            _sized(obj, kind_of(found or Layout.of_object(obj)), side),
            {"structure": structure_options, "latent": latent_options},
            {flow: int(solved.evaluations[0]) for flow, solved in flows.items()},
            {flow: int(solved.steps_over_tolerance[0]) for flow, solved in flows.items()},
            self._picture(shown[0], found, conditions.original),
            () if alone else tuple(way for _, way in cut),
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
        return self._predict_layout(self.cut_out(image)[0], threshold)

    def ask_layout(
        self,
        image: str | Path | np.ndarray,
        ask: Ask,
        background: Background = "auto",
        say: Callable[[str], None] = lambda problem: None,
        name: str | None = None,
    ) -> Layout:
        """The object's parts as a vision-language model tells them (``inference.ask_layout``), for
        ``pipeline(image, layout=…)``.

        Args:
          ask: prompt and a picture's path -> answer; ``uniart_jax.ask_command`` makes one of a
            program. say: called with what is wrong with an answer, before it is asked again.
          name: of the picture's file, without its suffix (default: the image's, or "picture").

        Raises:
          FileNotFoundError, ValueError: the image cannot be used, or no answer is a layout. What
            ``ask`` raises.
        """
        cut = self.cut_out(image, background)[0]
        margin = self.config.model.image_encoder.crop_margin
        stem = "picture" if isinstance(image, np.ndarray) else Path(image).stem
        return ask_layout(
            cut, ask, self._camera_or_none(cut), margin, say, name or stem, self._most_parts
        )

    def layout_or_none(
        self, image: str | Path | np.ndarray, background: Background = "auto"
    ) -> Layout | None:
        """``layout`` of an image; None where the checkpoint has no layout network."""
        return self._layout_or_none(self.cut_out(image, background)[0])

    def _followed(self, layout: Layout | bool, cut_out: np.ndarray) -> Layout | None:
        if not isinstance(layout, Layout):
            return self._layout_or_none(cut_out) if layout else None
        if layout.camera is not None:
            return layout
        margin = self.config.model.image_encoder.crop_margin
        return with_camera(layout, cut_out, self._camera_or_none(cut_out), margin)

    @property
    def _most_parts(self) -> int:
        return self.config.model.grid.max_parts

    def _camera_or_none(self, cut_out: np.ndarray) -> np.ndarray | None:
        found = self._layout_or_none(cut_out)
        return None if found is None else found.camera

    def _layout_or_none(self, cut_out: np.ndarray) -> Layout | None:
        there = self.checkpoint is not None and self.checkpoint.has("layout")
        return self._predict_layout(cut_out) if there and self.config.model.layout.queries else None

    def _predict_layout(self, cut_out: np.ndarray, threshold: float = THRESHOLD) -> Layout:
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
        """The checkpoint's sampling options, changed where asked: of both flows, and of one alone
        (``SamplingOptions``); None = as they are.

        Raises:
          ValueError: no option of both flows, or of the one that is named, or a value that cannot
            be.
        """
        alone = {"structure": changes.pop("structure", None), "latent": changes.pop("latent", None)}
        structure, latent = self.config.sample_structure, self.config.sample_latent
        both = _known("sampling", SampleConfig, changes)
        return (
            dataclasses.replace(
                structure, **both | _known("structure", structure, alone["structure"])
            ),
            dataclasses.replace(latent, **both | _known("latent", latent, alone["latent"])),
        )

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
          FileNotFoundError, ValueError: the image cannot be used, or ``background`` is unknown.
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


def _known(what: str, options: Any, changes: Any) -> dict[str, Any]:
    """Those of ``changes`` that are not None, which fields of ``options`` are; a ValueError names
    one that is none."""
    if not isinstance(changes or {}, Mapping):
        raise ValueError(f"{what}: give its options by name, as {{'steps': 3}}, got {changes!r}")
    known = [field.name for field in dataclasses.fields(options)]
    given = dict(changes or {})
    if unknown := [name for name in given if name not in known]:
        raise ValueError(f"{what} has no option '{unknown[0]}'; there are {', '.join(known)}")
    return {name: value for name, value in given.items() if value is not None}


def _sized(obj: ArticulatedObject, kind: Kind, side: float | None) -> ArticulatedObject:
    """The object as large as its layout says, ``side`` metres; else as its kind usually is, if it
    has a name. An image does not tell."""
    usual = typical_scale(obj, kind.family) if kind.named else 1.0
    scale = usual if side is None else side
    closed = bounds_at(obj, obj.rest()).reshape(-1, 3)
    longest = float(np.ptp(closed, axis=0).max()) * scale
    word = kind.family.replace("_", " ")
    why = f"usual of its kind ({word})" if kind.named else "an image does not tell"
    why = why if side is None else "by the layout's lengths in metres"
    note = f"size: longest side, closed, taken as {longest:.2f} m, {why}"
    return dataclasses.replace(obj, scale=scale, provenance=(*obj.provenance, note))
