"""How networks are trained: steps and rates, losses, devices."""

from __future__ import annotations

import dataclasses
from typing import Literal


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
    """Weights and details of the losses (docs/paper.md).

    Weights here are those of the VAEs' and the flows' losses. Those of the layout network are
    constants of ``training.layout_loss`` and its heads' modules (``leg_loss``, ``panel_loss``,
    ``revolution_loss``), those of the image encoder and of the mask network constants of
    ``training.encoder_loss`` and ``training.mask_loss``.
    """

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
class MeshConfig:
    """Device mesh: -1 means "all the rest". ``min_split``: arrays of so many numbers and more are
    split over ``fsdp``; smaller ones cost more in latency than they save in memory."""

    data: int = -1
    fsdp: int = 1
    min_split: int = 2**16
