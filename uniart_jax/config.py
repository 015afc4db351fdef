"""Every setting of the library as frozen dataclasses. No jax here, so that data workers and command
lines stay light.

``configs/*.py`` build a ``Config``; the command line overrides any field by its dotted name.
Defaults are the paper's sizes, which are TRELLIS's where TRELLIS has the same network
(docs/architecture.md).
"""

from __future__ import annotations

import dataclasses
import json
import reprlib
import sys
import types
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from uniart_jax.runtime.config_files import CONFIGS, find_file, run_file

Background = Literal["auto", "keep", "rembg"]  # how an object is cut out (data.background)
Kernel = Literal["auto", "xla", "cudnn", "triton", "splash", "plain"]
TOLERANCES = (1e-4, 1.0)  # of adaptive solvers
NETWORKS = ("image_encoder", "structure_vae", "uniart_vae", "structure_flow", "latent_flow")
STAGES = (*NETWORKS, "layout", "mask")  # the last two where a model has them
LATENT_OF = {"structure_flow": "structure", "latent_flow": "latent"}  # that a flow samples


@dataclasses.dataclass(frozen=True)
class GridConfig:
    """The voxel representation: R voxels a side, r sub-cells a voxel side."""

    resolution: int = 64
    subdivisions: int = 4
    max_parts: int = 64


class ImageEncoderKind(NamedTuple):
    """What the rest of the package has to know of an image encoder, beside its network.

    Attributes:
      trained: by a stage of its own; else it is taken as published and frozen.
      camera: it estimates the picture's camera and gives maps and a volume to read through it.
    """

    trained: bool
    camera: bool


# by ``ImageEncoderConfig.architecture``; their networks: ``models.network.IMAGE_ENCODERS``
IMAGE_ENCODERS = {
    "volume": ImageEncoderKind(trained=True, camera=True),
    "dinov2": ImageEncoderKind(trained=False, camera=False),
}


@dataclasses.dataclass(frozen=True)
class ImageEncoderConfig:
    """``architecture`` 'volume': a small convolutional network with tokens and a volume decoder,
    pre-trained by regressing the camera, coarse occupancy, boxes and joints from the image. It
    gives ``tokens`` for cross-attention and a ``volume`` of features aligned with the object's
    grid.

    'dinov2': the vision transformer of DINOv2 with registers, frozen, as TRELLIS conditions on it;
    ``tokens`` only. Of the fields it reads image_size, crop_margin, patch_size, registers, width,
    num_blocks, num_heads and mlp_ratio.
    """

    architecture: Literal["volume", "dinov2"] = "volume"
    patch_size: int = 14  # 'dinov2'
    registers: int = 4  # 'dinov2'
    # side of the crop over the object's longer side (TRELLIS: 1.2); records hold crops of 1.1
    crop_margin: float = 1.1
    image_size: int = 128  # pixels a side of the images in the records
    stem_stride: int = 4  # of the first stage
    stem_channels: tuple[int, ...] = (
        32,
        64,
        128,
    )  # each further stage halves; the last gives the tokens, the one before it what volume cells read  # noqa: E501
    width: int = 256
    num_blocks: int = 4
    num_heads: int = 4
    volume_tokens: int = 4  # a side: 4 -> 64 tokens
    volume_blocks: int = 6
    volume_resolution: int = 8  # a side, of the features handed to the flows
    volume_channels: int = 32
    target_resolution: int = 16  # a side, of the regressed boxes and joints
    sketch_width: int = 384  # of the MLP from the whole coarse map to the camera and a first volume
    mlp_ratio: float = 4.0

    @property
    def kind(self) -> ImageEncoderKind:
        """Of its architecture."""
        return IMAGE_ENCODERS[self.architecture]


@dataclasses.dataclass(frozen=True)
class LayoutConfig:
    """Parts as a set from one image (``models.layout``). ``queries`` 0: no such network (the
    paper).

    ``backbone``: 'efficientnet_lite0' begins with ImageNet weights (extra ``lite0``),
    'convolutions' from scratch. ``queries``: at most so many parts; objects that are trained on
    have no more. ``heads``: of attention. ``image_size``: pixels a side of the crops it sees, a
    multiple of 32; its weights fit every size. ``repeats``: how often the last layer is run once
    more, with the same weights. ``legs``: queries for what the object stands on, 8 or more;
    ``panels``: for the boards of its body, 24 or more; ``boards``: for those of each other part, 12
    or more; 0: that is not found.
    """

    queries: int = 0
    image_size: int = 128
    backbone: Literal["efficientnet_lite0", "convolutions"] = "efficientnet_lite0"
    map_channels: int = 96
    width: int = 128
    layers: int = 2
    repeats: int = 0
    heads: int = 4
    sketch_width: int = 512
    head_width: int = 128
    legs: int = 0
    panels: int = 0
    boards: int = 0


@dataclasses.dataclass(frozen=True)
class MaskConfig:
    """What of a picture is the object (``models.mask``). ``channels`` 0: no such network (the
    paper). ``image_size``: pixels a side at which a picture is looked at, a multiple of 32."""

    channels: int = 0
    width: int = 96  # of the transformer at its coarsest map
    image_size: int = 256


@dataclasses.dataclass(frozen=True)
class StructureVAEConfig:
    """Dense convolutional VAE, occupancy [R^3] <-> latent [(R / patch_size / 2^(levels-1))^3, C].
    Upstream: TRELLIS sparse_structure_vae.

    ``patch_size`` folds cubes of voxels into channels before the first convolution; 1 = none
    (TRELLIS). ``norm``: of the last layer only ('group': 32 groups), as in TRELLIS, whose residual
    blocks ignore the option.
    """

    patch_size: int = 1
    channels: tuple[int, ...] = (32, 128, 512)
    latent_channels: int = 8
    num_res_blocks: int = 2
    num_res_blocks_middle: int = 2
    norm: Literal["layer", "group"] = "layer"


@dataclasses.dataclass(frozen=True)
class UniArtVAEConfig:
    """Voxel features <-> latent per voxel. Trunks as TRELLIS's SLAT encoder and decoder.

    ``attention``: 'swin' cuts shifted windows of ``window`` voxels a side; 'full' does not cut;
    'serial' cuts the Morton order of the voxels into runs of exactly ``window`` tokens, shifted by
    half a run in every other block (no padding waste: the laptop's choice). ``part_segment``: parts
    longer than this are attended in pieces of this many voxels; 0 = never cut. ``linear_path``: a
    linear layer past each trunk (TRELLIS has none). ``layout_channels``: width of what the
    decoder's voxels see of a layout, whose rows its sub-cells then point at
    (``models.layout_decoder``); 0 = none (the paper).
    """

    width: int = 768
    num_blocks: int = 12
    num_heads: int = 12
    mlp_ratio: float = 4.0
    latent_channels: int = 8
    attention: Literal["swin", "serial", "full"] = "swin"
    window: int = 8
    qk_rms_norm: bool = False
    aggregation: str = "uniart"  # a key of ``models.aggregation.AGGREGATIONS``
    visual_channels: int = 1024
    part_feature_channels: int = 0
    geometry_channels: int = 128
    articulation_channels: int = 128
    part_segment: int = 0
    linear_path: bool = False
    layout_channels: int = 0

    @property
    def feature_channels(self) -> dict[str, int]:
        """Features that are read with each voxel, by the name of their column (``data.columns``),
        and their channels."""
        both = {"visual": self.visual_channels, "part_feature": self.part_feature_channels}
        return {name: channels for name, channels in both.items() if channels}


@dataclasses.dataclass(frozen=True)
class FlowConfig:
    """Rectified-flow transformer; TRELLIS's DiT with cross-attention to image tokens.

    ``patch_size``: side of the cube of latents that makes one token. Structure flow: patchify.
    Latent flow: ``stem`` 'conv' goes down to it by TRELLIS's sparse residual blocks
    (``io_channels`` a level), 'patch' by one linear layer on the cube, and back by another,
    followed, with ``voxel_channels`` > 0, by an MLP of this width on each voxel that also sees the
    voxel's own noisy latent. ``volume_channels``: the first so many of the image encoder's volume
    (its features, then 3 of colour) added to the tokens they are aligned with; 0 = none (TRELLIS).
    ``pixel_channels``: width of what each voxel reads off the pictures where the camera sees it
    (``nn.lifting.read_pixels``); latent flow of stem 'patch'; 0 = none. ``layout_channels``: width
    of what each voxel (structure flow: each cell of its latent) sees of a layout
    (``models.layout_features``); latent flow of stem 'patch'; 0 = none (TRELLIS).
    ``refine_channels``: structure flow: width of a refiner of what the structure VAE decodes, at
    full resolution (``models.occupancy_refiner``); 0 = none (TRELLIS). ``position_table``: the
    structure flow holds its position embedding as a frozen table instead of computing it (weights
    whose table differs). ``prediction``: the network's output is the velocity (TRELLIS) or the
    clean sample, from which the velocity follows. ``direction``: which way the network's own time
    runs. 'data_to_noise': x_0 data, velocity eps - x_0 (the paper's text, TRELLIS).
    'noise_to_data': z_0 prior, z_1 data, velocity z_1 - z_0 (the paper's supplement), the mirror
    image: inside, t is 1 - t and v is -v; times of losses, solvers and guidance stay as in the
    text.
    """

    model_channels: int = 1024
    num_blocks: int = 24
    num_heads: int = 16
    mlp_ratio: float = 4.0
    cond_channels: int = 1024
    patch_size: int = 1
    qk_rms_norm: bool = True
    qk_rms_norm_cross: bool = False
    share_mod: bool = False
    volume_channels: int = 0
    volume_resolution: int = 8
    pixel_channels: int = 0
    layout_channels: int = 0
    refine_channels: int = 0
    prediction: Literal["velocity", "data"] = "velocity"
    direction: Literal["data_to_noise", "noise_to_data"] = "data_to_noise"
    stem: Literal["conv", "patch"] = "conv"
    voxel_channels: int = 0
    io_channels: tuple[int, ...] = ()
    num_io_res_blocks: int = 2
    use_skip_connection: bool = True
    position_table: bool = False


@dataclasses.dataclass(frozen=True)
class GaussianConfig:
    """TRELLIS's own head on a UniArt-shaped latent: 3D Gaussians a voxel. Optional; names as in its
    ``representation_config``."""

    num_gaussians: int = 32
    voxel_size: float = 1.5  # how far a Gaussian may lie from its voxel's centre, in half voxels
    perturb_offset: bool = True
    lr_xyz: float = 1.0  # factors on the raw outputs
    lr_features_dc: float = 1.0
    lr_scaling: float = 1.0
    lr_rotation: float = 0.1
    lr_opacity: float = 1.0
    kernel_size_3d: float = 0.0009  # object units
    scaling_bias: float = 0.004
    opacity_bias: float = 0.1
    scaling_activation: Literal["exp", "softplus"] = "softplus"


@dataclasses.dataclass(frozen=True)
class ModelConfig:
    """The networks of one checkpoint, and how they are run.

    ``kernel``: of attention (``nn.attention``); 'plain' also leaves the derivatives of gathers and
    convolutions to JAX, so that ``jax.jvp`` and Hessian-vector products go through every network.
    ``scan_blocks`` compiles a stack of equal blocks once and loops over it; ``remat`` computes a
    block's activations again in the backward pass: compile time and memory then do not grow with
    depth.
    """

    grid: GridConfig = GridConfig()
    image_encoder: ImageEncoderConfig = ImageEncoderConfig()
    layout: LayoutConfig = LayoutConfig()
    mask: MaskConfig = MaskConfig()
    structure_vae: StructureVAEConfig = StructureVAEConfig()
    uniart_vae: UniArtVAEConfig = UniArtVAEConfig()
    structure_flow: FlowConfig = FlowConfig()
    latent_flow: FlowConfig = FlowConfig(patch_size=2, io_channels=(128,))
    gaussians: GaussianConfig = GaussianConfig()
    kernel: Kernel = "auto"
    compute_dtype: Literal["float32", "bfloat16"] = "float32"
    scan_blocks: bool = False
    remat: bool = False

    def networks(self) -> list[str]:
        """Those of ``STAGES`` that it has."""
        without = {"layout": not self.layout.queries, "mask": not self.mask.channels}
        return [name for name in STAGES if not without.get(name, False)]


@dataclasses.dataclass(frozen=True)
class StageConfig:
    """How one network is trained.

    ``accumulate``: micro-batches that a batch is cut into; their gradients are averaged before one
    update. ``gradient_clip``: largest global norm, 0 = any. ``clip_percentile``: of the last
    ``clip_window`` gradients' norms, if that is less (TRELLIS: 95 of 1000); 0 = not. ``freeze``:
    parameters that stay as they are, by dotted name or prefix. ``skip_not_finite``: so many steps
    in a row may have a loss or gradients that are not finite, and are passed over, which the
    learning rate's schedule does not count; one more ends the run.
    """

    steps: int = 800_000
    batch_size: int = 64
    accumulate: int = 1
    learning_rate: float = 1e-4
    schedule: Literal["constant", "cosine", "linear"] = "constant"
    hold: float = 0.6  # 'linear': share of the steps at the full rate, before it falls to 0
    muon: float = 0.0  # > 0: hidden matrices by Muon, at so many times the learning rate
    slow: tuple[str, ...] = ()  # parameters, by dotted name or prefix, at ``slow_rate`` times it
    slow_rate: float = 0.25
    warmup_steps: int = 1000
    weight_decay: float = 0.01
    betas: tuple[float, float] = (0.9, 0.999)
    ema_decay: float = 0.9995
    gradient_clip: float = 1.0
    clip_percentile: float = 0.0
    clip_window: int = 1000
    freeze: tuple[str, ...] = ()
    skip_not_finite: int = 0
    log_every: int = 100
    evaluate_every: int = 5000
    save_every: int = 5000
    keep_checkpoints: int = 2


@dataclasses.dataclass(frozen=True)
class LossConfig:
    """Weights and details of the losses (docs/paper.md)."""

    kl: float = 1e-6
    structure_kl: float = 1e-3
    articulation: float = 1.0  # the paper's lambda_1
    # within it, of restored part features (V_art-hat), where the UniArt VAE reads them
    part_feature: float = 1.0
    alignment: float = 0.0  # the supplement's reading of L_kl; its lambda_2 = 0.5
    color: float = 1.0
    huber_delta: float = 0.3
    # UniArt VAE: loss voxels drawn equally from all parts; 0 = all voxels, unbalanced. Image
    # encoder: coarse cells drawn half so.
    voxels_per_object: int = 0
    part_share: float = (
        0.0  # of the latent flow's loss spread evenly over parts, the rest over voxels
    )
    # of the latent flow's loss, measured on attributes of the latent (``training.latent_metric``)
    readout_share: float = 0.0
    # latent flow: weight of what the frozen UniArt VAE makes of its x_0 (distances, colours)
    # against what it makes of the true latent
    decoded: float = 0.0
    # structure flow: weight of what the frozen structure VAE makes of its x_0 against the true
    # occupancy (cross-entropy and Dice)
    decoded_structure: float = 0.0
    # UniArt VAE: share of the items whose latents a trained latent flow samples in one step, the
    # encoder
    # left as it is (``freeze``): the decoder learns what to make of a flow's mistakes
    sampled: float = 0.0
    time_mean: float = 1.0  # flows: of the logit of t, which is normally distributed
    time_std: float = 1.0  # and its standard deviation
    noise_share: float = 0.0  # share of draws taken uniformly from t in (.9, 1)
    condition_drop: float = 0.1
    # structure flow: share of the loss that is the refiner's, on what the flow samples in one step;
    # 1:
    # the flow's own is left out (``freeze`` its layers)
    refined: float = 0.0
    # flows, and a UniArt VAE with ``sampled``: share of the items that are shown the layout which
    # the frozen layout network finds in their picture, mistakes and all, in place of their own
    found: float = 0.0
    draws_per_image: int = 1  # structure flow: noise draws that share one image's condition


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
    world: Literal["seven", "wide", "detailed"] = "seven"  # families of those and of ``layouts``
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
    # layout network: share of the pictures that are as if cut out of a photograph
    photographs: float = 0.0
    # folder of pictures that stand behind most objects of these photographs, and of the mask
    # network's pictures ("" = none)
    backgrounds: str = ""
    # flows that see a layout: share of the side by which pictures are bent at most, so that the
    # layout says where things are
    image_warp: float = 0.0
    layout_errors: float = 0.0  # and the strength of the errors in it (``data.layout_errors``)
    # UniArt VAE: share of the parts whose joint and parent are drawn anew
    # (``objects.perturb.draw_joint``)
    new_joints: float = 0.0
    seed: int = 0  # of the order and of what is drawn for each item
    workers: int = 0  # processes that make batches; 0 = a thread


@dataclasses.dataclass(frozen=True)
class MeshConfig:
    """Device mesh: -1 means "all the rest"."""

    data: int = -1
    fsdp: int = 1


@dataclasses.dataclass(frozen=True)
class SampleConfig:
    """Sampling defaults that belong to a checkpoint.

    ``adaptive``: each item in steps of its own, of an error of about ``tolerance``
    (``flow.solvers``); ``steps`` and ``rescale_t`` then give the first step's length alone.
    ``mirrored``: where a flow takes one step, the mean with what it makes of the mirrored picture
    (``inference.mirror_average``).
    """

    solver: Literal["euler", "heun"] = "euler"
    adaptive: bool = False
    tolerance: float = 0.1
    steps: int = 25
    guidance: float = 1.0
    guidance_interval: tuple[float, float] = (0.0, 1.0)
    rescale_t: float = 3.0
    mirrored: bool = False

    def __post_init__(self) -> None:
        least, most = TOLERANCES
        if self.solver not in ("euler", "heun"):
            raise ValueError(f"sampling: solver must be euler or heun, got '{self.solver}'")
        if self.steps < 1:
            raise ValueError(f"sampling needs at least 1 step, not {self.steps}")
        if not least <= self.tolerance <= most:
            raise ValueError(f"tolerance must be in {least:g}..{most:g}, got {self.tolerance:g}")
        if not 0 <= self.guidance < float("inf"):
            raise ValueError(f"sampling: guidance must be 0 or more, got {self.guidance:g}")


@dataclasses.dataclass(frozen=True)
class StructureSampleConfig(SampleConfig):
    """A voxel is active above ``threshold``, a logit. What is sampled in few steps is close to a
    mean, from which thin things fade."""

    threshold: float = 0.0


@dataclasses.dataclass(frozen=True)
class LatentSampleConfig(SampleConfig):
    """Sampled distances are thickened by ``sdf_offset`` and smoothed by ``sdf_blur``, along panels
    by ``sdf_blur_along`` and, where that is not 0, along legs by ``voxels.grid.ROD``, in sub-cells
    (``voxels.grid.smoothed``), for the same reason."""

    sdf_offset: float = 0.0
    sdf_blur: float = 0.0
    sdf_blur_along: float = 0.0


@dataclasses.dataclass(frozen=True)
class Config:
    """One experiment.

    ``init``: a checkpoint that training goes on from (``--init`` overrides it). ``untrained``:
    parameters of a checkpoint that are still as they were drawn, by dotted name or prefix (what a
    conversion could not fill). ``quick_compile``: ``train.py`` compiles programs in less time,
    which then run slower, for tests of the whole training.
    """

    name: str = "paper"
    init: str = ""
    untrained: tuple[str, ...] = ()
    quick_compile: bool = False
    model: ModelConfig = ModelConfig()
    data: DataConfig = DataConfig()
    loss: LossConfig = LossConfig()
    mesh: MeshConfig = MeshConfig()
    image_encoder: StageConfig = StageConfig()
    layout: StageConfig = StageConfig()
    mask: StageConfig = StageConfig()
    structure_vae: StageConfig = StageConfig()
    uniart_vae: StageConfig = StageConfig()
    structure_flow: StageConfig = StageConfig()
    latent_flow: StageConfig = StageConfig()
    sample_structure: StructureSampleConfig = StructureSampleConfig()
    sample_latent: LatentSampleConfig = LatentSampleConfig()
    seed: int = 0


def load_config(name: str | Path) -> Config:
    """The ``config()`` of a Python file, or of a file of ``configs/`` by its name ("nano").

    Raises:
      FileNotFoundError, ValueError: no such file, or it has no function ``config`` that returns a
        ``Config``.
    """
    path = find_file(name, "config", CONFIGS)
    config = run_file(path)
    if not isinstance(config, Config):
        raise ValueError(
            f"config '{path}': it must define config() returning a uniart_jax.config.Config"
        )
    return config


class _Module(types.ModuleType):
    """This module, which can be called: ``uniart_jax.config("nano")`` is ``load_config``."""

    def __call__(self, name: str | Path) -> Config:
        return load_config(name)


sys.modules[__name__].__class__ = _Module


def to_json(config: Any) -> str:
    """A config as indented JSON; ``from_json`` reads it back."""
    return json.dumps(dataclasses.asdict(config), indent=2, sort_keys=True)


def from_json(cls: type, text: str) -> Any:
    """Rebuild a config dataclass from ``to_json``'s text.

    Raises:
      ValueError: the text is not JSON, or its fields are not those of ``cls`` (all strange names
        are listed).
    """
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:  # the latter: nested without end
        raise ValueError(f"config: not valid JSON ({error})") from None
    strange: list[str] = []
    config = _build(cls, data, "", strange)
    if strange:
        raise ValueError("config: unknown or malformed fields: " + ", ".join(strange))
    return config


def _build(cls: type, data: Any, path: str, strange: list[str]) -> Any:
    if not isinstance(data, dict):
        strange.append(path.rstrip(".") or "<root>")
        return cls()
    hints = get_type_hints(cls)
    values = {}
    for name, value in data.items():
        hint = hints.get(name)
        if hint is None:
            strange.append(path + name)
        elif isinstance(hint, type) and dataclasses.is_dataclass(hint):
            values[name] = _build(hint, value, f"{path}{name}.", strange)
        elif get_origin(hint) is tuple and isinstance(value, list):
            values[name] = tuple(value)
        elif get_origin(hint) is Literal:
            values[name] = value
            if value not in get_args(hint):
                strange.append(f"{path}{name}={reprlib.repr(value)}")
        elif isinstance(value, bool) != (hint is bool) or not isinstance(
            value, (hint, int) if hint is float else hint
        ):
            strange.append(f"{path}{name}={reprlib.repr(value)}")
        else:
            values[name] = value
    return cls(**values)
