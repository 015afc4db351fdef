"""The networks: which there are, and their sizes. Defaults are the paper's."""

from __future__ import annotations

import dataclasses
from typing import Literal, NamedTuple, get_args

ComputeDtype = Literal["float32", "bfloat16"]
Kernel = Literal["auto", "xla", "cudnn", "triton", "splash", "plain"]
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
      spatial: it gives where things are too: the picture's camera, and maps and a volume to read
        through it; else tokens alone (``models.network.IMAGE_ENCODERS``).
    """

    trained: bool
    spatial: bool


# by ``ImageEncoderConfig.architecture``; their networks: ``models.network.IMAGE_ENCODERS``
IMAGE_ENCODERS = {
    "volume": ImageEncoderKind(trained=True, spatial=True),
    "dinov2": ImageEncoderKind(trained=False, spatial=False),
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

    architecture: str = "volume"  # a key of ``IMAGE_ENCODERS``
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

    def __post_init__(self) -> None:
        if self.architecture not in IMAGE_ENCODERS:
            raise ValueError(
                f"config: model.image_encoder.architecture is {self.architecture!r}; choose one of "
                f"{', '.join(IMAGE_ENCODERS)}, or add its kind to config.IMAGE_ENCODERS"
            )

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
    or more; 0: that is not found. ``revolutions``: which parts are round about an axis is found.
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
    revolutions: bool = False


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
    (``nn.lifting.read_pixels``; latent flow of stem 'patch') or each point of a grid twice as fine
    as the latent (``models.grid_pixels``; structure flow); 0 = none. ``layout_channels``: width
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
    compute_dtype: ComputeDtype = "float32"
    scan_blocks: bool = False
    remat: bool = False

    def __post_init__(self) -> None:
        for name, choices in (("compute_dtype", ComputeDtype), ("kernel", Kernel)):
            if (value := getattr(self, name)) not in get_args(choices):
                listed = ", ".join(get_args(choices))
                raise ValueError(f"config: model.{name} is {value!r}; choose one of {listed}")

    def networks(self) -> list[str]:
        """Those of ``STAGES`` that it has."""
        without = {"layout": not self.layout.queries, "mask": not self.mask.channels}
        return [name for name in STAGES if not without.get(name, False)]
