"""Loss of the layout network's panels and boards: predicted boxes of a set are matched to true
ones (``training.set_loss``).

    far(a, b)  = mean over corners' coordinates of  |a - b| w,   w = f / (size of b + r) + e
    cost[q, k] = sum over runs of  2 far - p / 2
    loss       = mean over runs (5 far + 2 BCE(exists)) + .3 L1(share)

``w`` asks more of where a board's faces are than of its edges; f, r and e are .3, .1 and 0 of
panels, .15, .05 and .5 of boards. Row terms are means per set, then over sets. Sets that are not
known pay nothing, boards that are less than ``TRUSTED`` of their part for the share alone: they are
never used, and often cannot be told, as the wires of a rack.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.training.set_loss import SetWeights, set_loss
from uniart_jax.voxels.panel_table import TRUSTED
from uniart_jax.voxels.typed_batches import LayoutBatch

WEIGHTS = SetWeights(match=2.0, sure=0.5, row=5.0, exists=2.0)
SHARE = 0.3
PANELS, BOARDS = (0.3, 0.1, 0.0), (0.15, 0.05, 0.5)  # f, r and e of w


def panel_losses(out: dict[str, Any], batch: LayoutBatch) -> dict[str, jax.Array]:
    """Terms "panels" (all of the loss) and "panels_row" (L1 of the last run's rows, object units)
    of ``models.box_sets.PanelDecoder``'s output.

    Raises:
      ValueError: the batch has no panels.
    """
    if batch.panels is None:
        raise ValueError("layout: layout.panels is above 0, but the batch has no panels")
    counts, share = batch.panel_counts, batch.panel_share
    loss, off = _box_set_loss(
        out, batch.panels, counts, counts >= 0, share, PANELS, len(batch.panels)
    )
    return {"panels": loss, "panels_row": off}


def board_losses(out: dict[str, Any], batch: LayoutBatch, query: jax.Array) -> dict[str, jax.Array]:
    """Terms "boards" and "boards_row" of ``models.box_sets.BoardDecoder``'s output for the parts
    that queries [B, K] were matched to: means of rows over those of which boards are ``TRUSTED``
    and more, of the share over all whose boards are known.

    Raises:
      ValueError: the batch has no boards.
    """
    if batch.boards is None:
        raise ValueError("layout: layout.boards is above 0, but the batch has no boards")
    flat = lambda x: x.reshape(-1, *x.shape[2:])  # noqa: E731

    def own(x):  # [B, Q, ...] -> [B K, ...]
        return flat(jax.vmap(lambda rows, q: rows[q])(x, query))

    said = jax.tree.map(own, out)
    counts, share = flat(batch.board_counts), flat(batch.board_share)
    known = counts >= 0
    counts = jnp.where(share >= TRUSTED, counts, -1)
    sets = jnp.maximum((counts >= 0).sum(), 1)
    loss, off = _box_set_loss(said, flat(batch.boards), counts, known, share, BOARDS, sets)
    return {"boards": loss, "boards_row": off}


def _box_set_loss(
    out: dict[str, Any],
    rows: jax.Array,
    counts: jax.Array,
    share_known: jax.Array,
    share: jax.Array,
    weight: tuple[float, float, float],
    sets: jax.Array | int,
) -> tuple[jax.Array, jax.Array]:
    """The loss, and the L1 of the last run's rows.

    out: rows, a list of [S, N, 6], exists, a list of [S, N], share [S]. rows: [S, M, 6] true
    corners. counts: [S] of them, -1 where they are not known. share_known, share: [S]. weight: f, r
    and e of w. sets: that means of rows are over.
    """
    faces, room, edges = weight
    size = rows[..., 3:] - rows[..., :3]
    near = jnp.concatenate([faces / (size + room) + edges] * 2, -1)  # [S, M, 6]
    loss, off, _ = set_loss(out["rows"], out["exists"], rows, counts, WEIGHTS, near, sets)
    off_share = (jnp.abs(out["share"] - share) * share_known).sum()
    off_share = off_share / jnp.maximum(share_known.sum(), 1)
    return loss + SHARE * off_share, off
