"""The layout network in use: its first weights, and pictures -> parts as numpy arrays.

A picture is looked at twice, as it is and mirrored; the mirrored parts are mirrored back, matched
to the others by their boxes and averaged (``joined``). That costs a second pass and is more often
right than either.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from scipy.optimize import linear_sum_assignment

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data.cameras import mirror_camera_codes
from uniart_jax.data.layouts import load_block, settings_of
from uniart_jax.data.mirror import (
    mirror_boxes,
    mirror_centers,
    mirror_codes,
    mirror_corners,
    mirror_images,
    mirror_legs,
    mirror_radii,
)
from uniart_jax.inference.certainty import certainty, differences
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build, kept_of_model
from uniart_jax.voxels.joint_code import align, box_corners

APART = 0.15  # object units between the corners of rows that two looks have of one part
DIFFERENT = 0.5  # between codes of rows that two looks have of one part
SURE = 0.3  # object units that a match is worth if both rows are sure


def first_layout_weights(config: Config) -> dict[str, Any]:
    """What a layout network begins with: typical boxes as its queries' anchors, and published
    weights of its backbone."""
    first: dict[str, Any] = {"anchors": typical_boxes(config)}
    if config.model.layout.backbone == "efficientnet_lite0":
        first["backbone"] = published_backbone()
    return first


def published_backbone() -> dict[str, Any]:
    """Published weights of EfficientNet-Lite0."""
    from uniart_jax.weights.efficientnet_lite import find_published, read_efficientnet_lite0

    return read_efficientnet_lite0(find_published())


def check_backbone(model: ModelConfig) -> None:
    """FileNotFoundError, with what to install, where a backbone's published weights are missing."""
    if model.layout.backbone == "efficientnet_lite0":
        from uniart_jax.weights.efficientnet_lite import find_published

        find_published()


def typical_boxes(config: Config, rounds: int = 20) -> np.ndarray:
    """[queries, 6] corners that k-means finds among the parts of the first block of training
    objects."""
    table = load_block(config.data.layouts, 0, settings_of(config.data, config.model))
    known = np.arange(table["boxes"].shape[1]) < table["part_counts"][:, None]
    corners = box_corners(table["boxes"][known])
    rng, count = np.random.default_rng(config.seed), config.model.layout.queries
    centers = corners[rng.choice(len(corners), count, replace=len(corners) < count)]
    for _ in range(rounds):
        nearest = ((corners[:, None] - centers) ** 2).sum(-1).argmin(1)
        filled = np.unique(nearest)
        centers[filled] = np.stack([corners[nearest == k].mean(0) for k in filled])
    return centers.astype(np.float32)


class LayoutPredictor:
    """Pictures -> outputs of the layout network, of both looks together; ``mirrored`` False: of the
    picture as it is alone.

    Attributes:
      image_size: pixels a side. crop_margin: side of the crop over the object's longer side.
    """

    def __init__(self, model: ModelConfig, params: Any, mirrored: bool = True):
        self.mirrored = mirrored
        self.image_size = model.layout.image_size
        self.crop_margin = model.image_encoder.crop_margin
        self._params = jax.device_put(params)
        network = build("layout", model)

        def run(params, images):
            out = network.apply(params, images)
            legs = last_legs(out["legs"]) if "legs" in out else {}
            panels = last_panels(out["panels"]) if "panels" in out else {}
            boards = last_panels(out["boards"], "board") if "boards" in out else {}
            whole = {name: out[name] for name in ("camera", "parents")}
            rounds = out.get("revolutions", {})
            rounds = {f"round_{name}": values for name, values in rounds.items()}
            return {**out["parts"][-1], **whole, **legs, **panels, **boards, **rounds}

        self._run = kept_of_model(jax.jit(run), "layouts", model)

    def __call__(self, images: Sequence[np.ndarray]) -> list[dict[str, np.ndarray]]:
        """Crops [S, S, 3] uint8 over black -> for each corners [Q, 6] (lower, upper), codes [Q, 9],
        exists [Q] logits, colors [Q, 3] linear RGB, parents [Q, Q] logits child -> parent
        (diagonal: root), camera [7]; where the network finds legs, panels or boards,
        those of ``last_legs`` and ``last_panels``; where it finds revolutions, round_axis [Q, 4],
        round_centers [Q, 3, 2] and round_radii [Q, 3, N] (``models.layout.RevolutionHead``); of two
        looks differences [3] and certainty [] (``inference.certainty``)."""
        return [self._read(image) for image in images]

    def _read(self, image: np.ndarray) -> dict[str, np.ndarray]:
        """One picture and its mirror image at a time, so that it is read alike alone and among
        others; on a CPU more at once are no faster (on a GPU that was not measured)."""
        looks = [image, mirror_images(image)] if self.mirrored else [image]
        found = jax.device_get(self._run(self._params, np.stack(looks).astype(np.float32) / 255))
        rows = [{name: values[b] for name, values in found.items()} for b in range(len(looks))]
        return joined(rows[0], mirror_parts(rows[1])) if self.mirrored else rows[0]


def mirror_parts(outputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Outputs for a picture as outputs for its mirror image."""
    lower, upper = outputs["corners"][:, :3], outputs["corners"][:, 3:]
    boxes = mirror_boxes(np.concatenate([(lower + upper) / 2, upper - lower], -1))
    mirrors = {
        "leg_rows": mirror_legs,
        "panel_rows": mirror_corners,
        "board_rows": mirror_corners,
        "round_centers": mirror_centers,
        "round_radii": mirror_radii,
    }
    sets = {name: turn(outputs[name]) for name, turn in mirrors.items() if name in outputs}
    return {
        **outputs,
        **sets,
        "corners": box_corners(boxes),
        "codes": mirror_codes(outputs["codes"]),
        "camera": mirror_camera_codes(outputs["camera"]),
    }


def joined(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Two outputs for one picture as one: rows matched by their boxes and averaged, weighted by how
    sure each is.

    Rows whose corners lie more than ``APART`` apart are not of one part: the surer one's box, code
    and colour stand. Their existence is averaged all the same, so that a part which one look alone
    finds has to be the surer. Of codes that differ by more than ``DIFFERENT`` the surer row's
    stands: the mean of two joints, as of a hinge on the left and one on the right, may be of
    another kind than both.
    """
    rows, exists = (one["corners"], other["corners"]), (one["exists"], other["exists"])
    i, j, share = _matched(*rows, *exists)
    codes = align(other["codes"][j], one["codes"][i])
    differ = np.linalg.norm(codes - one["codes"][i], axis=1, keepdims=True) > DIFFERENT
    turned = np.where(differ, share > 0.5, share)
    mix = lambda a, b: (1 - share) * a + share * b  # noqa: E731
    unlike = differences(one, other, i, j)
    return {
        **(joined_legs(one, other) if "leg_rows" in one else {}),
        **(joined_panels(one, other) if "panel_rows" in one else {}),
        **(joined_boards(one, other, i, j, share[:, 0]) if "board_rows" in one else {}),
        **(joined_revolutions(one, other, i, j, share) if "round_axis" in one else {}),
        "corners": mix(one["corners"][i], other["corners"][j]),
        "codes": (1 - turned) * one["codes"][i] + turned * codes,
        "colors": mix(one["colors"][i], other["colors"][j]),
        "exists": (one["exists"][i] + other["exists"][j]) / 2,
        "parents": (one["parents"][np.ix_(i, i)] + other["parents"][np.ix_(j, j)]) / 2,
        "camera": (one["camera"] + other["camera"]) / 2,
        "differences": unlike,
        "certainty": certainty(unlike),
    }


def _matched(
    rows: np.ndarray, others: np.ndarray, exists: np.ndarray, others_exist: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows [Q, D] of two looks, matched: i, j [Q], and the second's share [Q, 1] in the mean."""
    sure = [1 / (1 + np.exp(-np.asarray(e, np.float64))) for e in (exists, others_exist)]
    apart = np.abs(rows[:, None] - others).max(-1)
    i, j = linear_sum_assignment(apart - SURE * np.minimum(sure[0][:, None], sure[1]))
    share = sure[1][j] / (sure[0][i] + sure[1][j] + 1e-6)
    return i, j, np.where(apart[i, j] < APART, share, share > 0.5)[:, None]


def last_legs(legs: dict[str, Any]) -> dict[str, Any]:
    """Of a ``models.box_sets.LegDecoder``'s output the last run: leg_rows [B, N, 10], leg_exists,
    leg_plinth and leg_fill [B, N], leg_alone [B]."""
    last = {f"leg_{name}": legs[name][-1] for name in ("rows", "exists", "plinth", "fill")}
    return last | {"leg_alone": legs["alone"]}


def last_panels(panels: dict[str, Any], name: str = "panel") -> dict[str, Any]:
    """Of a ``models.box_sets.PanelDecoder``'s output the last run: panel_rows [B, N, 6],
    panel_exists [B, N], panel_share [B]; of a ``BoardDecoder``'s those of each part, "board_"."""
    last = {f"{name}_{field}": panels[field][-1] for field in ("rows", "exists")}
    return last | {f"{name}_share": panels["share"]}


def joined_legs(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The legs of two outputs as those of one: ``joined``."""
    rows, exists = (one["leg_rows"], other["leg_rows"]), (one["leg_exists"], other["leg_exists"])
    i, j, share = _matched(*rows, *exists)
    means = {
        name: (one[name][i] + other[name][j]) / 2
        for name in ("leg_exists", "leg_plinth", "leg_fill")
    }
    return {
        **means,
        "leg_rows": (1 - share) * one["leg_rows"][i] + share * other["leg_rows"][j],
        "leg_alone": np.asarray((one["leg_alone"] + other["leg_alone"]) / 2),
    }


def joined_panels(
    one: dict[str, np.ndarray], other: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The panels of two outputs as those of one: ``joined``."""
    rows, exists = (
        (one["panel_rows"], other["panel_rows"]),
        (one["panel_exists"], other["panel_exists"]),
    )
    i, j, share = _matched(*rows, *exists)
    return {
        "panel_rows": (1 - share) * rows[0][i] + share * rows[1][j],
        "panel_exists": (exists[0][i] + exists[1][j]) / 2,
        "panel_share": np.asarray((one["panel_share"] + other["panel_share"]) / 2),
    }


def joined_boards(
    one: dict[str, np.ndarray],
    other: dict[str, np.ndarray],
    i: np.ndarray,
    j: np.ndarray,
    share: np.ndarray,
) -> dict[str, np.ndarray]:
    """The boards of two outputs as those of one, for parts ``i`` of the first that are ``j`` of the
    second. ``share`` [Q]: of the second's in the mean; where it is 0 or 1, as of rows that are not
    of one part, the boards of the one that stands are taken."""
    fields = ("rows", "exists", "share")
    rows = []
    for a, b, of_other in zip(i, j, share, strict=True):
        looks = [
            {f"panel_{field}": out[f"board_{field}"][k] for field in fields}
            for out, k in ((one, a), (other, b))
        ]
        alone = of_other in (0, 1)
        rows.append(looks[int(of_other)] if alone else joined_panels(*looks))
    return {f"board_{f}": np.stack([row[f"panel_{f}"] for row in rows]) for f in fields}


def joined_revolutions(
    one: dict[str, np.ndarray],
    other: dict[str, np.ndarray],
    i: np.ndarray,
    j: np.ndarray,
    share: np.ndarray,
) -> dict[str, np.ndarray]:
    """The revolutions of two outputs as those of one, as ``joined_boards``; ``share`` [Q, 1]."""

    def mean(name: str) -> np.ndarray:
        part = share.reshape(-1, *[1] * (one[name].ndim - 1))
        return (1 - part) * one[name][i] + part * other[name][j]

    return {name: mean(name) for name in ("round_axis", "round_centers", "round_radii")}


def load_layout_predictor(checkpoint: str) -> LayoutPredictor:
    """The layout network of a checkpoint: 'nano', a folder, or a training's WORKDIR.

    Raises:
      FileNotFoundError, ValueError: no such checkpoint, or one without a layout network.
    """
    found = Checkpoint.find(checkpoint)
    model = found.config.model
    if not model.layout.queries:
        raise ValueError(
            f"checkpoint '{checkpoint}': it has no layout network; train one with --stage layout"
        )
    return LayoutPredictor(model, found.load("layout"))
