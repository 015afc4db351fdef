"""Losses of sets of rows: predicted rows are matched to true ones, one to one, and each pays for
the row that it was matched to (DETR, Carion 2020).

    far(q, k)  = mean over the row's numbers of  |predicted - true| scale
    cost[q, k] = sum over runs of  w_match far(q, k) - w_sure p(q)
    loss       = mean over runs (w_row far of matched rows + w_exists BCE(exists))

One matching serves all runs. Row terms are means per set, then over sets. S sets · K true rows,
padded · Q >= K predicted rows · R numbers a row, object units.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from uniart_jax.training.losses import binary_cross_entropy
from uniart_jax.training.matching import match


class SetWeights(NamedTuple):
    """Weights of the formula above: of a row's distance and of its probability in the cost of a
    match, of a row's distance and of its existence in the loss."""

    match: float
    sure: float
    row: float
    exists: float


class Matching(NamedTuple):
    """Which predicted row each true row was matched to.

    Attributes:
      query: [S, K] the predicted row of each true one; of padding some other.
      chosen: [S, K, Q] the same, one-hot; zero of padding.
      present: [S, Q] 1 where a predicted row was matched.
      weights: [S, K] of true rows in a mean per set, then over sets; zero of padding.
      set_weights: [S] of sets in a mean over sets; zero of those that are not known.
    """

    query: jax.Array
    chosen: jax.Array
    present: jax.Array
    weights: jax.Array
    set_weights: jax.Array

    def take(self, values: jax.Array) -> jax.Array:
        """Of predicted rows [S, Q, ...] those of the true rows [S, K, ...]; zero of padding."""
        return jnp.einsum("skq,sq...->sk...", self.chosen, values)

    def mean(self, values: jax.Array) -> jax.Array:
        """Mean of true rows' values [S, K] per set, then over sets."""
        return (values * self.weights).sum()

    def existence(self, logits: jax.Array) -> jax.Array:
        """Mean cross-entropy of the logits [S, Q] that a predicted row exists."""
        return (binary_cross_entropy(logits, self.present).mean(-1) * self.set_weights).sum()


def match_rows(cost: jax.Array, counts: jax.Array, sets: jax.Array | int | None = None) -> Matching:
    """The one-to-one matching of least summed cost [S, Q, K].

    Args:
      counts: [S] true rows of each set; -1 where they are not known, which then pays nothing.
      sets: how many sets means are over; None: all S.
    """
    sets = len(cost) if sets is None else sets
    known = (counts >= 0).astype(jnp.float32)
    counts = jnp.maximum(counts, 0)
    valid = (jnp.arange(cost.shape[2]) < counts[:, None]).astype(jnp.float32)
    query = match(cost, counts)
    chosen = jax.nn.one_hot(query, cost.shape[1]) * valid[..., None]
    weights = valid / jnp.maximum(counts, 1)[:, None] / sets
    return Matching(query, chosen, chosen.sum(1), weights, known / sets)


def set_loss(
    rows: Sequence[jax.Array],
    exists: Sequence[jax.Array],
    true: jax.Array,
    counts: jax.Array,
    weights: SetWeights,
    scale: jax.Array | float = 1.0,
    sets: jax.Array | int | None = None,
) -> tuple[jax.Array, jax.Array, Matching]:
    """The loss, the mean L1 of the last run's matched rows, and the matching.

    Args:
      rows, exists: of each run [S, Q, R] and logits [S, Q].
      true: [S, K, R]. counts, sets: as of ``match_rows``.
      scale: [S, K, R], or one number, of the distance to each true row.
    """
    scales = jnp.broadcast_to(scale, true.shape)
    cost = jnp.zeros(())
    for row, sure in zip(rows, exists, strict=True):
        far = (jnp.abs(row[:, :, None] - true[:, None]) * scales[:, None]).mean(-1)
        cost = cost + weights.match * far - weights.sure * jax.nn.sigmoid(sure)[..., None]
    matched = match_rows(cost, counts, sets)
    total = last = jnp.zeros(())
    for row, sure in zip(rows, exists, strict=True):
        off = jnp.abs(matched.take(row) - true)
        last = matched.mean(off.mean(-1))
        total = total + weights.row * matched.mean((off * scales).mean(-1))
        total = total + weights.exists * matched.existence(sure)
    return total / len(rows), last, matched
