"""What an object stands on, as a set from one image: legs, side boards and feet, or a plinth.

    leg queries and a guess from the sketch -> first rows
    runs of one layer: attention among legs, to the image's tokens and to the parts, and 15 points
    of the leg's present box read off the map where the camera sees them
                    -> existence, plinth, corrected row, how much of its rectangles it fills

It reads what ``models.layout`` makes of the image. No gradient goes back, so it can be trained with
the rest frozen (``layout.freeze``); trained together, all are clipped by one norm.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.layout_layers import BANDS, DecoderLayer, read_boxes, sine_embedding
from uniart_jax.nn.blocks import LayerNorm, linear, zeros

ROW = 10  # lower rectangle (x, y, x, y), upper rectangle, height of either
RUNS = 3  # of the layer
# a table's four legs: what training begins with
CORNER, THICK = 0.4, 0.1
TYPICAL_FILL = 0.8


class Seen(NamedTuple):
    """What the layout network makes of images.

    Attributes:
      map: [B, S/4, S/4, C]. tokens, tokens_place: [B, L, D], the latter without B. sketch: [B, E].
      parts: [B, Q, D] tokens of the parts. parts_place: [B, Q, D] embeddings of their boxes.
      camera: [B, 7].
    """

    map: jax.Array
    tokens: jax.Array
    tokens_place: jax.Array
    sketch: jax.Array
    parts: jax.Array
    parts_place: jax.Array
    camera: jax.Array


class LegDecoder(nnx.Module):
    """``LayoutConfig.legs`` queries -> a set of legs a run."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs, dtype):
        c = config.layout
        self.count, width = c.legs, c.width
        self.queries = nnx.Param(0.5 * jax.random.normal(rngs.params(), (c.legs, width)))
        self.guess = linear(c.sketch_width, width, rngs, dtype=dtype)
        self.anchors = nnx.Param(typical_rows(c.legs))
        self.first_row = linear(width, ROW, rngs, init=zeros, dtype=dtype)
        self.place_in = linear(6 * 2 * BANDS, width, rngs, dtype=dtype)
        self.place_out = linear(width, width, rngs, dtype=dtype)
        self.layer = DecoderLayer(config, rngs, dtype)
        self.norm = LayerNorm(width)
        self.hidden = linear(width, c.head_width, rngs, dtype=dtype)
        self.row = linear(c.head_width, ROW, rngs, init=zeros, dtype=dtype)
        self.kind = linear(c.head_width, 3, rngs, init=zeros, dtype=dtype)  # exists, plinth, fill
        self.alone = linear(width, 1, rngs, init=zeros, dtype=dtype)

    def __call__(self, seen: Seen) -> dict[str, Any]:
        """Returns rows, exists, plinth (logits) and fill, each a list over the first guess and the
        runs of [B, N, 10] or [B, N]; alone [B] logits: nothing but these carries the object."""
        seen = jax.tree.map(jax.lax.stop_gradient, seen)
        guess = self.guess(seen.sketch.astype(self.queries[...].dtype))
        x = self.queries[...] + guess[:, None]
        row = self.anchors[...] + self.first_row(x).astype(jnp.float32)
        out: dict[str, Any] = {"rows": [], "exists": [], "plinth": [], "fill": []}
        tokens = jnp.concatenate([seen.tokens, seen.parts.astype(seen.tokens.dtype)], 1)
        place = jnp.broadcast_to(seen.tokens_place, seen.tokens.shape)
        place = jnp.concatenate([place, seen.parts_place.astype(place.dtype)], 1)
        self._read(x, row, out)
        for _ in range(RUNS):
            row = jax.lax.stop_gradient(out["rows"][-1])
            corners = corners_of(row)
            read = read_boxes(seen.map, corners, seen.camera, gather=True)
            own = self.place_out(jax.nn.gelu(self.place_in(sine_embedding(2 * corners))))
            x = self.layer(x, own, tokens, place, read)
            self._read(x, row, out)
        alone = self.alone(self.norm(x).mean(1)).astype(jnp.float32)[:, 0]
        return out | {"alone": alone}

    def _read(self, x: jax.Array, row: jax.Array, out: dict[str, Any]) -> None:
        """Append what queries x [B, N, D] say of the rows that they correct."""
        h = jax.nn.gelu(self.hidden(self.norm(x)))
        kind = self.kind(h).astype(jnp.float32)
        out["rows"].append(row + self.row(h).astype(jnp.float32))
        out["exists"].append(kind[..., 0])
        out["plinth"].append(kind[..., 1])
        out["fill"].append(kind[..., 2] + TYPICAL_FILL)


def typical_rows(count: int) -> jax.Array:
    """[count, 10] legs at the corners of a square, again and again."""
    rows = []
    for k in range(count):
        x, y = (CORNER if k % 2 else -CORNER), (CORNER if k // 2 % 2 else -CORNER)
        rectangle = [x - THICK / 2, y - THICK / 2, x + THICK / 2, y + THICK / 2]
        rows.append([*rectangle, *rectangle, -0.4, -0.2])
    return jnp.asarray(rows, jnp.float32)


def corners_of(rows: jax.Array) -> jax.Array:
    """[..., 6] lower and upper corners of the boxes around legs [..., 10]."""
    low = jnp.minimum(rows[..., 0:2], rows[..., 4:6])
    high = jnp.maximum(rows[..., 2:4], rows[..., 6:8])
    return jnp.concatenate([low, rows[..., 8:9], high, rows[..., 9:10]], -1)
