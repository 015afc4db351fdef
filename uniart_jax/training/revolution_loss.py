"""Loss of the layout network's revolutions: whether a part is round and about which axis, and the
outline of those that are, in shares of their boxes.

    loss = CE(axis) + 2 mean over round parts of  L1(centre, radii) / half the mean side across
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from uniart_jax.voxels.typed_batches import LayoutBatch

OUTLINE = 2.0
LEAST_SIDE = 0.05  # object units, of a box that outlines are compared in


def revolution_losses(
    out: dict[str, jax.Array], batch: LayoutBatch, weights: jax.Array
) -> dict[str, jax.Array]:
    """Terms "revolutions" (all of the loss) and "revolutions_outline" (its second mean).

    Args:
      out: of ``models.layout.RevolutionHead``, of the queries that the true parts were matched to,
        [B, K, ...]. weights: [B, K] of the parts, their sum 1 at most.

    Raises:
      ValueError: the batch has no revolutions.
    """
    if batch.revolutions is None:
        raise ValueError("layout: layout.revolutions is set, but the batch has no revolutions")
    axis, true = batch.revolutions[..., 0].astype(jnp.int32), batch.revolutions[..., 1:]
    scores = jax.nn.log_softmax(out["axis"], -1)
    wrong = -jnp.take_along_axis(scores, axis[..., None], -1)[..., 0]
    about = jax.nn.one_hot(axis - 1, 3)  # all zeros of what is not round
    said = jnp.concatenate([out["centers"], out["radii"]], -1)
    said = (said * about[..., None]).sum(-2)
    size = batch.boxes[..., 3:]
    half = (size.sum(-1) - (size * about).sum(-1)) / 4
    off = jnp.abs(said - true).mean(-1) / jnp.maximum(half, LEAST_SIDE / 2)
    round_ones = weights * (axis > 0)
    outline = (off * round_ones).sum() / jnp.maximum(round_ones.sum(), 1e-6)
    loss = (wrong * weights).sum() + OUTLINE * outline
    return {"revolutions": loss, "revolutions_outline": outline}
