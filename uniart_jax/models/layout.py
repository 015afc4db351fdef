"""Parts as a set from one image: an image backbone and a part decoder (DETR3D's idea: Carion 2020,
Wang 2021).

    image -> backbone -> maps at strides 4, 8, 16 -> one map at stride 4, top down
                              |                          |
              sketch: an MLP of the whole coarsest map   |  tokens: every second cell of it
              -> camera, first guess of every part       |
                                    |                    |
       part queries -> layers: attention among parts, to the tokens, and 15 points of the part's
                       present box read off the map where the camera sees them
                    -> box, joint code, colour, existence; parent by a pointer

Every layer has heads of its own (a repeated run those of its layer), corrects the box of the layer
before (no gradient goes through that) and gives the rest anew. The joint code's moment is predicted
about the box's centre and moved to the origin, so that a pivot follows its box.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from uniart_jax.config import LayoutConfig, ModelConfig
from uniart_jax.models.box_sets import BoardDecoder, LegDecoder, PanelDecoder, Seen
from uniart_jax.models.layout_layers import BANDS, DecoderLayer, read_boxes, sine_embedding
from uniart_jax.nn.blocks import GroupNorm, LayerNorm, linear, zeros
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.nn.stem import StemStage
from uniart_jax.voxels.camera_code import CAMERA_CODE_SIZE, MEAN_CAMERA_CODE
from uniart_jax.voxels.joint_code import BOX_SIZE, CODE_SIZE
from uniart_jax.voxels.part_table import MOST_BOARDS, MOST_LEGS, MOST_PANELS
from uniart_jax.voxels.revolution_table import RADII

SKETCH_SIDE = 8  # cells of the coarsest map that the sketch reads, whatever the picture's size
TOKENS_SIDE = 16  # of the table of the tokens' places, resampled to the picture's tokens
POINTER = 64  # width of the parent pointer's queries and keys
GUESS = 64  # width of a query's offset from the sketch
ACROSS = np.array([[1, 2], [0, 2], [0, 1]])  # the other two axes, of each
HIDDEN_OF_REVOLUTIONS, PROPORTIONS = 96, 9
SHORTEST = 0.01  # object units, of a box whose proportions are told
SETS = {"legs": MOST_LEGS, "panels": MOST_PANELS, "boards": MOST_BOARDS}  # and rows of a label


class Convolutions(nnx.Module):
    """A small backbone from scratch: strided stages with a residual pair each; maps at strides 4,
    8, 16."""

    CHANNELS = (24, 48, 96)

    def __init__(self, rngs: nnx.Rngs, dtype=jnp.float32):
        channels = (3, *self.CHANNELS)
        self.stages = nnx.List(
            [
                StemStage(channels[i], channels[i + 1], stride, rngs, dtype)
                for i, stride in enumerate((4, 2, 2))
            ]
        )

    def __call__(self, image: jax.Array) -> tuple[jax.Array, ...]:
        """[B, H, W, 3] in [-1, 1] -> maps [B, H / s, W / s, C] for s of 4, 8, 16."""
        maps = [image]
        for stage in self.stages:
            maps.append(stage(maps[-1]))
        return tuple(maps[1:])


def make_backbone(config: LayoutConfig, rngs: nnx.Rngs, dtype, plain: bool = False) -> Any:
    """The image backbone that a config names: image in [-1, 1] -> maps at strides 4, 8, 16,
    with their ``CHANNELS``."""
    if config.backbone == "convolutions":
        return Convolutions(rngs, dtype)
    from uniart_jax.models.efficientnet_lite import EfficientNetLite0

    return EfficientNetLite0(rngs, dtype, plain)


class CellLinear(nnx.Module):
    """A dense layer of a whole map [B, P, C] -> [B, D], its kernel [P, C, D] a matrix a cell."""

    def __init__(self, cells: int, inputs: int, outputs: int, rngs: nnx.Rngs):
        bound = (6 / (cells * inputs + outputs)) ** 0.5
        shape = (cells, inputs, outputs)
        self.kernel = nnx.Param(
            jax.random.uniform(rngs.params(), shape, minval=-bound, maxval=bound)
        )
        self.bias = nnx.Param(jnp.zeros(outputs))

    def __call__(self, x: jax.Array) -> jax.Array:
        kernel = self.kernel[...].reshape(-1, self.bias.shape[0])
        return x.reshape(x.shape[0], -1) @ kernel.astype(x.dtype) + self.bias[...]


class PartHeads(nnx.Module):
    """A layer's reading of its queries [B, Q, D]."""

    def __init__(self, width: int, hidden: int, rngs: nnx.Rngs, dtype):
        self.hidden = linear(width, hidden, rngs, dtype=dtype)
        self.exists = linear(hidden, 1, rngs, dtype=dtype)
        self.box = linear(hidden, BOX_SIZE, rngs, init=zeros, dtype=dtype)
        self.code = linear(hidden, CODE_SIZE, rngs, dtype=dtype)
        self.color = linear(hidden, 3, rngs, dtype=dtype)

    def __call__(self, y: jax.Array, corners: jax.Array) -> dict[str, jax.Array]:
        """Parts from normalised queries y and the boxes [B, Q, 6] that they correct."""
        h = jax.nn.gelu(self.hidden(y))
        out = {
            name: getattr(self, name)(h).astype(jnp.float32)
            for name in ("exists", "box", "code", "color")
        }
        corners = corners + out["box"]
        code = out["code"]
        centre = jax.lax.stop_gradient(corners[..., :3] + corners[..., 3:]) / 2
        moment = code[..., 4:7] + jnp.cross(centre, code[..., 1:4])
        code = jnp.concatenate([code[..., :4], moment, code[..., 7:]], -1)
        return {
            "corners": corners,
            "codes": code,
            "exists": out["exists"][..., 0],
            "colors": out["color"],
        }


class RevolutionHead(nnx.Module):
    """Which parts are round about an axis of the frame, where that axis is, and how far they reach
    from it. A part is told in shares of its box: a cylinder that fills it is all zeros.

    It sees the box's proportions beside the query: what is round about an axis is as wide as it is
    deep, which a query alone tells poorly (docs/negative_results.md)."""

    def __init__(self, width: int, hidden: int, rngs: nnx.Rngs, dtype):
        self.hidden = linear(width + PROPORTIONS, hidden, rngs, dtype=dtype)
        self.axis = linear(hidden, 4, rngs, init=zeros, dtype=dtype)
        self.outline = linear(hidden, 3 * (2 + RADII), rngs, init=zeros, dtype=dtype)

    def __call__(self, y: jax.Array, corners: jax.Array) -> dict[str, jax.Array]:
        """Queries [B, Q, D] and their parts' corners [B, Q, 6] -> axis [B, Q, 4] logits of none, x,
        y and z; for each axis centers [B, Q, 3, 2] and radii [B, Q, 3, N], object units
        (``voxels.revolution_table``)."""
        seen = jnp.concatenate([y, _proportions(corners).astype(y.dtype)], -1)
        h = jax.nn.gelu(self.hidden(seen))
        told = self.outline(h).astype(jnp.float32).reshape(*y.shape[:2], 3, 2 + RADII)
        lower, upper = corners[..., :3][..., ACROSS], corners[..., 3:][..., ACROSS]
        half = (upper - lower).mean(-1, keepdims=True) / 2
        return {
            "axis": self.axis(h).astype(jnp.float32),
            "centers": (lower + upper) / 2 + half * told[..., :2],
            "radii": half * (1 + told[..., 2:]),
        }


def _proportions(corners: jax.Array) -> jax.Array:
    """Corners [..., 6] -> [..., 9]: the log of the sides, of their ratios (y to z, x to z, x to y),
    and how nearly each pair is equal, 1 where it is."""
    sides = jnp.log(jnp.maximum(corners[..., 3:] - corners[..., :3], SHORTEST))
    first, second = sides[..., ACROSS[:, 0]], sides[..., ACROSS[:, 1]]
    return jnp.concatenate([sides, first - second, jnp.exp(-4 * jnp.abs(first - second))], -1)


class LayoutNetwork(nnx.Module):
    """image [B, S, S, 3] -> camera, and a set of parts a layer."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.layout, compute_dtype(config)
        if c.queries < 1 or c.image_size < 32 or c.image_size % 32 or c.repeats < 0:
            raise ValueError(
                "layout: needs queries >= 1, an image_size that 32 divides and repeats >= 0, got "
                f"{c.queries}, {c.image_size}, {c.repeats}"
            )
        for name, most in SETS.items():
            if 0 != (count := getattr(c, name)) < most:
                raise ValueError(f"layout: {name} must be 0 or at least {most}, got {count}")
        self.config, width = c, c.width
        self.backbone = make_backbone(c, rngs, dtype, config.kernel == "plain")
        channels = self.backbone.CHANNELS
        self.map_norms = nnx.List([GroupNorm(n, groups=8) for n in channels])
        self.to_map = nnx.List([linear(n, c.map_channels, rngs, dtype=dtype) for n in channels])
        self.squeeze = linear(channels[-1], GUESS, rngs, dtype=dtype)
        self.sketch1 = CellLinear(SKETCH_SIDE**2, GUESS, c.sketch_width, rngs)
        self.sketch2 = linear(c.sketch_width, c.sketch_width, rngs, dtype=dtype)
        self.to_camera = linear(c.sketch_width, CAMERA_CODE_SIZE, rngs, init=zeros)
        self.map_sketch = linear(c.sketch_width, c.map_channels, rngs, dtype=dtype)
        self.to_tokens = linear(c.map_channels, width, rngs, dtype=dtype)
        self.tokens_norm = LayerNorm(width)
        draw = lambda shape, std: nnx.Param(std * jax.random.normal(rngs.params(), shape))  # noqa: E731
        self.tokens_place = draw((TOKENS_SIDE**2, width), 0.02)
        self.queries = draw((c.queries, width), 0.5)
        self.guess = linear(c.sketch_width, c.queries * GUESS, rngs, dtype=dtype)
        self.guess_out = linear(GUESS, width, rngs, dtype=dtype)
        self.place_in = linear(6 * 2 * BANDS, width, rngs, dtype=dtype)
        self.place_out = linear(width, width, rngs, dtype=dtype)
        self.anchors = nnx.Param(jnp.tile(jnp.array([-0.25] * 3 + [0.25] * 3), (c.queries, 1)))
        self.first_box = linear(width, 6, rngs, init=nnx.initializers.normal(0.01), dtype=dtype)
        self.layers = nnx.List([DecoderLayer(config, rngs, dtype) for _ in range(c.layers)])
        self.norm = LayerNorm(width)
        self.heads = nnx.List(
            [PartHeads(width, c.head_width, rngs, dtype) for _ in range(c.layers + 1)]
        )
        self.parent_q = linear(width, POINTER, rngs, dtype=dtype)
        self.parent_k = linear(width, POINTER, rngs, dtype=dtype)
        self.parent_root = linear(width, 1, rngs, dtype=dtype)
        if c.legs:
            self.legs = LegDecoder(config, rngs, dtype)
        if c.panels:
            self.panels = PanelDecoder(config, rngs, dtype)
        if c.boards:
            self.boards = BoardDecoder(config, rngs, dtype)
        if c.revolutions:
            self.revolutions = RevolutionHead(width, HIDDEN_OF_REVOLUTIONS, rngs, dtype)

    def __call__(
        self,
        image: jax.Array,
        camera: jax.Array | None = None,
        use_true_camera: jax.Array | None = None,
        phase: jax.Array | None = None,
        box_sets: bool = True,
    ) -> dict[str, Any]:
        """Find the parts.

        Args:
          image: [B, S, S, 3] sRGB in [0, 1], the background black.
          camera: [B, 7] true camera codes that boxes are read with instead of the estimate, where
            ``use_true_camera`` [B].
          phase: [2] 0 or 1, which cells of the map are the tokens; None: the last of each four.
          box_sets: whether legs, panels and boards are found too.

        Returns:
          camera [B, 7]; parts: a list over the first guess and each run of a layer of
          corners [B, Q, 6] (lower, upper), codes
          [B, Q, 9], exists [B, Q] logits, colors [B, Q, 3] linear RGB; parents [B, Q, Q] logits
          child -> parent, the diagonal the root's, of the last layer; tokens [B, Q, D], one a part;
          map [B, S/4, S/4, C]; with ``box_sets`` legs, panels and boards (``models.box_sets``)
          where the config has queries for them; with ``layout.revolutions`` the output of
          ``RevolutionHead`` too.
        """
        features, sketch = self.read_image(image)
        estimate = self.to_camera(sketch).astype(jnp.float32) + jnp.asarray(MEAN_CAMERA_CODE)
        used = jax.lax.stop_gradient(estimate)
        if camera is not None and use_true_camera is not None:
            used = jnp.where(use_true_camera[:, None], camera, used)
        tokens = self.tokens_norm(self.to_tokens(self._every_second(features, phase)))
        tokens_place = self._places(features.shape[1] // 2)
        items, count = image.shape[0], self.config.queries
        offset = self.guess_out(self.guess(sketch).reshape(items, count, GUESS))
        x = self.queries[...].astype(offset.dtype) + offset
        first = self.anchors[...] + self.first_box(x).astype(jnp.float32)
        parts = [self.heads[0](self.norm(x), first)]
        runs = list(zip(self.layers, list(self.heads)[1:], strict=True))
        for layer, heads in runs + runs[-1:] * self.config.repeats:
            corners = jax.lax.stop_gradient(parts[-1]["corners"])
            read = read_boxes(features, corners, used, gather=camera is None)
            x = layer(x, self._place(corners), tokens, tokens_place, read)
            parts.append(heads(self.norm(x), corners))
        y = self.norm(x)
        pointer = jnp.einsum("bqd,bkd->bqk", self.parent_q(y), self.parent_k(y)) / POINTER**0.5
        parents = pointer + jnp.eye(count) * self.parent_root(y)
        out = {
            "camera": estimate,
            "parts": parts,
            "parents": parents.astype(jnp.float32),
            "tokens": y,
            "map": features,
        }
        if self.sets and box_sets:
            last = parts[-1]
            body = likely_root(last["corners"], last["exists"], out["parents"])
            place = self._place(last["corners"])
            asked = y, last["corners"], last["codes"]
            seen = Seen(features, tokens, tokens_place, sketch, y, place, *asked, body, used)
            out |= {name: getattr(self, name)(seen) for name in self.sets}
        if self.config.revolutions:
            out["revolutions"] = self.revolutions(y, jax.lax.stop_gradient(parts[-1]["corners"]))
        return out

    @property
    def sets(self) -> list[str]:
        """The sets that it finds beside the parts: "legs", "panels", "boards"."""
        return [name for name in SETS if getattr(self.config, name)]

    def read_image(self, image: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The map [B, S/4, S/4, C] and the sketch [B, D] of images."""
        maps = self.backbone(image * 2 - 1)
        maps = [jax.nn.gelu(norm(m)) for norm, m in zip(self.map_norms, maps, strict=True)]
        h = jax.nn.gelu(self.sketch1(resize(self.squeeze(maps[-1]), SKETCH_SIDE)))
        h = h + jax.nn.gelu(self.sketch2(h))
        down = self.to_map[2](maps[2]) + self.map_sketch(h)[:, None, None]
        down = self.to_map[1](maps[1]) + twice(down)
        return self.to_map[0](maps[0]) + twice(down), h

    def _place(self, corners: jax.Array) -> jax.Array:
        """[B, Q, D] the embedding of boxes' corners [B, Q, 6]."""
        return self.place_out(jax.nn.gelu(self.place_in(sine_embedding(2 * corners))))

    def _places(self, side: int) -> jax.Array:
        """[side^2, D] the embedding of the tokens' places, resampled to so many tokens a side."""
        table = self.tokens_place[...].reshape(1, TOKENS_SIDE, TOKENS_SIDE, -1)
        return resize(table, side).reshape(side * side, -1)

    def _every_second(self, features: jax.Array, phase: jax.Array | None) -> jax.Array:
        """[B, S, S, C] -> [B, (S / 2)^2, C]: one cell of each four."""
        items, side, _, channels = features.shape
        cells = features.reshape(items, side // 2, 2, side // 2, 2, channels)
        if phase is None:
            chosen = cells[:, :, 1, :, 1]
        else:
            rows = jax.lax.dynamic_index_in_dim(cells, phase[0], 2, keepdims=False)
            chosen = jax.lax.dynamic_index_in_dim(rows, phase[1], 3, keepdims=False)
        return chosen.reshape(items, -1, channels)


def likely_root(corners: jax.Array, exists: jax.Array, parents: jax.Array) -> jax.Array:
    """[B, 6] corners of the part that is most likely there and the root; ``parents`` [B, Q, Q]
    logits, the diagonal the root's."""
    root = jnp.diagonal(jax.nn.log_softmax(parents, -1), axis1=1, axis2=2)
    best = (root + jax.nn.log_sigmoid(exists)).argmax(1)
    return jnp.take_along_axis(corners, best[:, None, None], 1)[:, 0]


def resize(x: jax.Array, side: int) -> jax.Array:
    """[B, S, S, C] -> [B, side, side, C], bilinear, smoothed where it shrinks."""
    if x.shape[1] == side:
        return x
    shape = (x.shape[0], side, side, x.shape[-1])
    return jax.image.resize(x.astype(jnp.float32), shape, "bilinear").astype(x.dtype)


def twice(x: jax.Array) -> jax.Array:
    """[B, H, W, C] -> [B, 2 H, 2 W, C], each cell repeated."""
    items, rows, columns, channels = x.shape
    x = jnp.broadcast_to(x[:, :, None, :, None], (items, rows, 2, columns, 2, channels))
    return x.reshape(items, 2 * rows, 2 * columns, channels)
