"""What an object is built of, as sets of boxes from one image: what its body stands on
(``LegDecoder``: legs, side boards and feet, or a plinth), the panels of its case
(``PanelDecoder``), and the boards of each part (``BoardDecoder``).

    queries and a guess from the sketch -> first rows
    runs of one layer: attention among rows and parts, to the image's tokens, and 15 points of the
    row's present box read off the map where the camera sees them
                    -> what the row is, corrected row

They read what ``models.layout`` makes of the image. No gradient goes back, so they can be trained
with the rest frozen (``layout.freeze``); trained together, all are clipped by one norm.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.layout_layers import BANDS, DecoderLayer, read_boxes, sine_embedding
from uniart_jax.nn.blocks import LayerNorm, linear, zeros
from uniart_jax.voxels.closed_pose import closed_boxes, closing, undone

LEG_ROW = 10  # lower rectangle (x, y, x, y), upper rectangle, height of either
# a table's four legs: what training begins with
CORNER, THICK = 0.4, 0.1
TYPICAL_FILL = 0.8
# object units, of a side of the box that panels, and boards, are told in
SMALLEST_BODY, SMALLEST_PART = 0.05, 0.02


class Seen(NamedTuple):
    """What the layout network makes of images.

    Attributes:
      map: [B, S/4, S/4, C]. tokens, tokens_place: [B, L, D], the latter without B. sketch: [B, E].
      parts: [B, Q, D] tokens of the parts. parts_place: [B, Q, D] embeddings of their boxes.
      asked: [B, P, D] tokens of the parts whose boards are asked for. asked_corners: [B, P, 6] of
        their boxes. asked_codes: [B, P, 9] of their joints. body: [B, 6] corners of the part that
        is most likely the root. camera: [B, 7].
    """

    map: jax.Array
    tokens: jax.Array
    tokens_place: jax.Array
    sketch: jax.Array
    parts: jax.Array
    parts_place: jax.Array
    asked: jax.Array
    asked_corners: jax.Array
    asked_codes: jax.Array
    body: jax.Array
    camera: jax.Array


class BoxSetDecoder(nnx.Module):
    """Queries -> a set of rows a run, or several sets S, and a number for each set.

    ``anchors`` [N, R]: rows of a set that training begins with. ``kinds``: numbers said of a row
    beside where it is. ``RUNS``: of the layer.
    """

    RUNS = 3

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs, dtype, anchors: jax.Array, kinds: int):
        c, (count, size) = config.layout, anchors.shape
        width = c.width
        self.queries = nnx.Param(0.5 * jax.random.normal(rngs.params(), (count, width)))
        self.guess = linear(c.sketch_width, width, rngs, dtype=dtype)
        self.anchors = nnx.Param(anchors)
        self.first_row = linear(width, size, rngs, init=zeros, dtype=dtype)
        self.place_in = linear(6 * 2 * BANDS, width, rngs, dtype=dtype)
        self.place_out = linear(width, width, rngs, dtype=dtype)
        self.layer = DecoderLayer(config, rngs, dtype)
        self.norm = LayerNorm(width)
        self.hidden = linear(width, c.head_width, rngs, dtype=dtype)
        self.row = linear(c.head_width, size, rngs, init=zeros, dtype=dtype)
        self.kind = linear(c.head_width, kinds, rngs, init=zeros, dtype=dtype)
        # for panels and boards, the share of the body or the part that they explain
        self.alone = linear(width, 1, rngs, init=zeros, dtype=dtype)

    def decode(self, seen: Seen) -> tuple[list[jax.Array], list[jax.Array], jax.Array]:
        """Rows [B, S N, R] and their kinds [B, S N, K], each a list over the first guess and the
        runs; the number for each set [B, S]."""
        seen = jax.tree.map(jax.lax.stop_gradient, seen)
        x = self.first(seen)
        scale, offset, motions = self.frame(seen)
        sets = x.shape[1] // len(self.anchors[...])
        row = jnp.tile(self.anchors[...], (sets, 1)) + self.first_row(x).astype(jnp.float32)
        said = [self._read(x, row)]
        for _ in range(self.RUNS):
            row = jax.lax.stop_gradient(said[-1][0])
            corners = self.corners(row * scale + offset)
            own = self.place_out(jax.nn.gelu(self.place_in(sine_embedding(2 * corners))))
            x = self.run(x, own, corners, seen, motions)
            said.append(self._read(x, row))
        rows, kinds = (list(values) for values in zip(*said, strict=True))
        rows = [row * scale + offset for row in rows]
        whole = self.norm(x).reshape(len(x), sets, -1, x.shape[-1]).mean(2)
        return rows, kinds, self.alone(whole).astype(jnp.float32)[..., 0]

    def first(self, seen: Seen) -> jax.Array:
        """[B, S N, D] queries that the runs begin with."""
        guess = self.guess(seen.sketch.astype(self.queries[...].dtype))
        return self.queries[...] + guess[:, None]

    def run(
        self,
        x: jax.Array,
        own: jax.Array,
        corners: jax.Array,
        seen: Seen,
        motions: jax.Array | None,
    ) -> jax.Array:
        """The layer on queries x [B, S N, D] with their boxes' embeddings, corners, and the motions
        [B, S N, 3, 4] that take these to where they are shown: those of a set attend to one another
        and to the parts."""
        read = read_boxes(seen.map, corners, seen.camera, motions, gather=True)
        parts, place = seen.parts.astype(x.dtype), seen.parts_place.astype(own.dtype)
        sets = x.shape[1] // len(self.anchors[...])
        return self.layer(x, own, seen.tokens, seen.tokens_place, read, parts, place, sets)

    def frame(self, seen: Seen) -> tuple[Any, Any, jax.Array | None]:
        """Scale and offset that take rows to object units, and the rigid transforms from the
        predicted (closed) pose to the pose in the image; None where both are the same."""
        return 1.0, 0.0, None

    @staticmethod
    def corners(rows: jax.Array) -> jax.Array:
        """[..., 6] lower and upper corners of the boxes around rows [..., R]."""
        return rows

    def _read(self, x: jax.Array, row: jax.Array) -> tuple[jax.Array, jax.Array]:
        """What queries x [B, N, D] say of the rows that they correct."""
        h = jax.nn.gelu(self.hidden(self.norm(x)))
        return row + self.row(h).astype(jnp.float32), self.kind(h).astype(jnp.float32)


class LegDecoder(BoxSetDecoder):
    """``LayoutConfig.legs`` queries -> a set of legs a run. Parts are seen as further tokens."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs, dtype):
        anchors = typical_legs(config.layout.legs)
        super().__init__(config, rngs, dtype, anchors, kinds=3)

    def __call__(self, seen: Seen) -> dict[str, Any]:
        """Returns rows, exists, plinth (logits) and fill, each a list over the first guess and the
        runs of [B, N, 10] or [B, N]; alone [B] logits: nothing but these carries the object."""
        rows, kinds, alone = self.decode(seen)
        return {
            "rows": rows,
            "exists": [kind[..., 0] for kind in kinds],
            "plinth": [kind[..., 1] for kind in kinds],
            "fill": [kind[..., 2] + TYPICAL_FILL for kind in kinds],
            "alone": alone[:, 0],
        }

    def run(self, x, own, corners, seen, motions):
        tokens = jnp.concatenate([seen.tokens, seen.parts.astype(seen.tokens.dtype)], 1)
        place = jnp.broadcast_to(seen.tokens_place, seen.tokens.shape)
        place = jnp.concatenate([place, seen.parts_place.astype(place.dtype)], 1)
        read = read_boxes(seen.map, corners, seen.camera, gather=True)
        return self.layer(x, own, tokens, place, read)

    @staticmethod
    def corners(rows: jax.Array) -> jax.Array:
        """[..., 6] lower and upper corners of the boxes around legs [..., 10]."""
        low = jnp.minimum(rows[..., 0:2], rows[..., 4:6])
        high = jnp.maximum(rows[..., 2:4], rows[..., 6:8])
        return jnp.concatenate([low, rows[..., 8:9], high, rows[..., 9:10]], -1)


class PanelDecoder(BoxSetDecoder):
    """``LayoutConfig.panels`` queries -> a set of panels a run, told in shares of the body's box.
    They attend to one another and to the parts as to one set."""

    RUNS = 4

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs, dtype):
        anchors = typical_panels(config.layout.panels)
        super().__init__(config, rngs, dtype, anchors, kinds=1)

    def __call__(self, seen: Seen) -> dict[str, Any]:
        """Returns rows and exists (logits), each a list over the first guess and the runs of
        [B, N, 6] or [B, N]; share [B]: of the body that panels and legs explain."""
        rows, kinds, share = self.decode(seen)
        return {"rows": rows, "exists": [kind[..., 0] for kind in kinds], "share": share[:, 0]}

    def frame(self, seen):
        return *_shares(seen.body[:, None], SMALLEST_BODY), None


class BoardDecoder(BoxSetDecoder):
    """``LayoutConfig.boards`` queries for each part P -> a set of boards a part and run, told in
    shares of the part's box, of a door that stands ajar as it lies closed (``voxels.closed_pose``).
    Those of one part attend to one another and to all parts."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs, dtype):
        anchors = typical_panels(config.layout.boards)
        super().__init__(config, rngs, dtype, anchors, kinds=1)
        self.guess = linear(config.layout.width, config.layout.width, rngs, dtype=dtype)

    def __call__(self, seen: Seen) -> dict[str, Any]:
        """Returns rows and exists (logits), each a list over the first guess and the runs of
        [B, P, N, 6] or [B, P, N]; share [B, P]: of each part that its boards explain."""
        rows, kinds, share = self.decode(seen)
        apart = lambda x: x.reshape(*share.shape, -1, x.shape[-1])  # noqa: E731
        return {
            "rows": [apart(row) for row in rows],
            "exists": [apart(kind)[..., 0] for kind in kinds],
            "share": share,
        }

    def first(self, seen):
        queries = self.queries[...]
        x = queries + self.guess(seen.asked.astype(queries.dtype))[:, :, None]
        return x.reshape(len(x), -1, x.shape[-1])

    def frame(self, seen):
        count, codes, corners = len(self.anchors[...]), seen.asked_codes, seen.asked_corners
        motions, angles = closing(codes, corners, seen.body[:, None], jnp)
        closed = closed_boxes(motions, angles, codes, corners, jnp)
        shown = jnp.repeat(undone(motions, jnp), count, 1)
        return *_shares(jnp.repeat(closed, count, 1), SMALLEST_PART), shown


def _shares(corners: jax.Array, smallest: float) -> tuple[jax.Array, jax.Array]:
    """Scale and offset [..., 6] that take rows in shares of boxes [..., 6] to object units."""
    lower, upper = corners[..., :3], corners[..., 3:]
    size = jnp.maximum(upper - lower, smallest)
    return jnp.tile(size, 2), jnp.tile((lower + upper - size) / 2, 2)


def typical_legs(count: int) -> jax.Array:
    """[count, 10] legs at the corners of a square, again and again."""
    rows = []
    for k in range(count):
        x, y = (CORNER if k % 2 else -CORNER), (CORNER if k // 2 % 2 else -CORNER)
        rectangle = [x - THICK / 2, y - THICK / 2, x + THICK / 2, y + THICK / 2]
        rows.append([*rectangle, *rectangle, -0.4, -0.2])
    return jnp.asarray(rows, jnp.float32)


def typical_panels(count: int) -> jax.Array:
    """[count, 6] boards across a unit box, a third along each axis, from one end to the other."""
    rows = np.tile(np.array([0.0] * 3 + [1.0] * 3), (count, 1))
    for k in range(count):
        axis, at = k % 3, (k // 3) / max(-(-count // 3) - 1, 1)
        rows[k, [axis, axis + 3]] = at - THICK / 4, at + THICK / 4
    return jnp.asarray(rows, jnp.float32)
